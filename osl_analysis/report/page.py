# SPDX-License-Identifier: Apache-2.0
"""The page of a run, as one HTML file that opens without a network.

It has the answer, the conditions, findings, figures and a view of each trial with its signals.
`templates/page.html.j2` sets it; the functions here choose its content.

Example: `written_page(page)`, where `page["trials"]` has the results of `trial_view`.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import polars as pl
from markupsafe import Markup, escape

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import RECORDINGS, SOURCES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.joining import WIDE_ESTIMATES
from osl_analysis.judge.judging import budgets_of_rows
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.judge.rules import Grade
from osl_analysis.report.paper_tables import notes_on_conditions, sheet_text
from osl_analysis.report.trial_signals import Signals
from osl_analysis.report.typography import printed, template
from osl_analysis.report.verdicts import LeftOut, results_on, verdict_on
from osl_analysis.stats.budget import CLEAR, IN_INTERVAL, QUANTITIES, WIDE
from osl_analysis.stats.doubts import DOUBTS, doubts_about
from osl_analysis.stats.promises import promise_texts
from osl_analysis.stats.rounding import estimate_text

NO_CONDITIONS = ("trial", "experiment", "exclude", *RECORDINGS, *SOURCES)
# between dollar signs, or with a subscript and no part of a name
SYMBOL_PATTERN = re.compile(
    r"(?<!\\)\$(.+?)(?<!\\)\$|(?<![\w-])([KBJZknf]_(?:viscous|tau|d_rendered|[dsjm1CGT]))(?![\w-])"
)


def inline_svg(name: str, title: str, svg: str) -> Markup:
    """The drawing of a figure as part of a page.

    Its ids begin with the figure's name, so that no other figure has them. Its points lead to their
    trials.
    """
    drawing = svg[svg.index("<svg") :]
    drawing = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", drawing)
    drawing = drawing.replace('"../report.html#', '"#')
    return Markup(drawing.replace("<svg", f'<svg role="img" aria-label="{title}"', 1))


def written_page(page: Mapping[str, Any]) -> str:
    """The HTML of a page.

    Parameters
    ----------
    page : Mapping
        The content for `page.html.j2`. `about` and `made_of` say where the results come from;
        `answer` is the first sentence, `sentences` are further ones; `notes` are about intervals,
        settings that nobody stated, and recordings without a row. `conditions`, `groups`,
        `numbers`, `findings` and `trials` (`trial_view`) are shown in tables. `figures` have
        `name`, `title`, `caption` (sentences) and `drawing` (`inline_svg`). `absent_figures` and
        `missing_results` say why others are not there.
    """
    # imported here, since Bokeh takes longer (0.3 s) than all other imports of a dry run
    from osl_analysis.report import plots

    filters = {"printed": lambda text: with_symbols(printed(text))}
    whole_lines = {"trim_blocks": True, "lstrip_blocks": True}
    html = template("page.html.j2", filters, autoescape=True, **whole_lines)
    with_signals = [trial for trial in page["trials"] if trial["signals"]]
    signals = {trial["name"]: trial["signals"].packed() for trial in with_signals}
    return html.render(
        page=page,
        experiments=EXPERIMENTS,
        estimate_text=estimate_text,
        notes_on_conditions=notes_on_conditions,
        signals=signals,
        plots=plots.plots(),
        library=Markup(plots.library()),
    )


def with_symbols(text: str) -> Markup:
    """A text with its symbols, as `K_d` and `$\\hat{K}$`, in HTML. A backslash before a dollar sign
    keeps the sign."""

    def symbol(match: re.Match[str]) -> str:
        letters = re.sub(r"\\hat\{(\w)\}", "\\1\u0302", match[1] or match[2])
        letters = re.sub(r"\\\w+\{(\w+)\}", r"\1", letters)
        letters = re.sub(r"_\{?([A-Za-z0-9]+)\}?", r"<sub>\1</sub>", letters)
        return f"<i>{re.sub(r'[{}^]', '', letters).replace('tau', 'τ')}</i>"

    in_html = SYMBOL_PATTERN.sub(symbol, str(escape(text)))
    return Markup(in_html.replace("\\$", "$"))


def trial_view(
    row: Mapping[str, Any],
    tables: Mapping[str, pl.DataFrame],
    findings: Sequence[Finding],
    left_out: LeftOut | None,
    signals: Signals | None,
) -> dict[str, Any]:
    """The content of a trial's view.

    Parameters
    ----------
    row : Mapping
        The trial's row of the sample sheet.
    tables : Mapping of str to polars.DataFrame
        The trial's rows of each result table, with their findings, and of `quality.csv`.
    findings : Sequence of Finding
        The findings on the trial.
    left_out : LeftOut or None
        Why the trial has no result; None if it has one.
    signals : Signals or None
        The plotted signals.

    Returns
    -------
    dict
        `why` has the causes of the verdict, or the properties of the device, in a few words.
        `doubts` are about the recording or the fit to the whole trial, `doubts_of_parts` about
        single amplitudes. `results` say why the device is not of second order. `remarks` are other
        findings and checks that were not possible. `impedance` has K, B and I of the fit to the
        whole trial, `budgets` the parts of their intervals, and `promises` what these hold. `fits`
        are the rows of all fits, with their `units`.
    """
    facts = EXPERIMENTS[row["experiment"]]
    main = facts.tables[0].name if facts.tables else ""
    fits = tables.get(main, pl.DataFrame())
    last = fits.row(-1, named=True) if len(fits) else {}
    names = zip(("K", "B", "I"), facts.impedance, strict=True)
    described = described_tables_by_name()
    known = [name for name in fits.columns if fits[name].count()]
    estimated = [name for name in known if name == "VAF" or f"{name}_low" in fits.columns]

    doubts = [finding for finding in findings if finding.grade is Grade.DOUBTS]
    trial_doubts = [doubt for doubt in doubts if not doubt.is_of_part]
    amplitude_doubts = [doubt for doubt in doubts if doubt.is_of_part]
    results = results_on(findings)
    notes = [finding for finding in findings if finding.grade in (Grade.UNCHECKED, Grade.NOTES)]
    reasons = left_out.reasons if left_out else ()
    causes = dict.fromkeys(finding.cause for finding in trial_doubts or amplitude_doubts or results)
    return {
        "name": row["trial"],
        "experiment": row["experiment"],
        "condition": stated_condition(row),
        "recordings": ", ".join(str(row[name]) for name in RECORDINGS if row.get(name)),
        "verdict": verdict_on(row["experiment"], findings, left_out),
        "why": ", ".join(causes) or "; ".join(reasons),
        "left_out": reasons,
        "doubts": trial_doubts,
        "doubts_of_parts": amplitude_doubts,
        "results": results,
        "remarks": [note for note in notes if not (note.is_of_part or note in results)],
        "impedance": {symbol: estimate_text(last, name) for symbol, name in names},
        "fits": fits.to_dicts(),
        "units": {name: described[main].columns[name].unit for name in estimated},
        "budgets": shown_budgets(last, tables.get("budget")),
        "promises": promise_texts([last.get("interval_method")]),
        "checks": tables["quality"].to_dicts() if "quality" in tables else (),
        "signals": signals,
    }


def shown_budgets(row: Mapping[str, Any], budget: pl.DataFrame | None) -> list[dict[str, Any]]:
    """The estimates of the fit to a whole trial, with their verdicts and budgets.

    `parts` are shares of the squared half-width [percent]. `not_known` names the contributions that
    nobody has measured, with the change per unit.
    """
    shown = []
    for name, estimate_budget in budgets_of_rows([row], budget)[0].items():
        squares = {part: estimate_budget.half_width(part) ** 2 for part in IN_INTERVAL}
        total = sum(squares.values()) or 1.0
        per_unit = []
        for contribution in estimate_budget.unknown:
            if contribution.per:
                title = known_finding(contribution.source).title.replace("_", " ")
                per_unit.append(f"{title}: {contribution.per}")
        shown.append(
            {
                "name": name,
                "text": estimate_text(row, name),
                "verdict": verdict_shown(row, name),
                "parts": {part: 100 * square / total for part, square in squares.items()},
                "not_known": "; ".join(per_unit),
            }
        )
    return shown


def verdict_shown(row: Mapping[str, Any], name: str) -> dict[str, str] | None:
    """The verdict on K, B or I of a row with its findings, and its badge; None for other
    estimates."""
    if name not in QUANTITIES or row.get(DOUBTS) is None:
        return None
    doubts = doubts_about(row[DOUBTS], [name])
    if doubts:
        return {"badge": "doubtful", "text": known_finding(doubts[0]["source"]).title}
    if name in row[WIDE_ESTIMATES]:
        return {"badge": WIDE, "text": WIDE}
    return {"badge": CLEAR, "text": CLEAR}


def stated_condition(row: Mapping[str, Any]) -> str:
    """The conditions of a trial in the sheet, in words."""
    texts = []
    for name, value in row.items():
        if name == "perturbed" and value is not None:
            texts.append("perturbed" if value else "unperturbed")
        elif value is not None and name not in NO_CONDITIONS:
            texts.append(f"{name} {sheet_text(value)}")
    return ", ".join(texts)
