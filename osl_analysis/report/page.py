# SPDX-License-Identifier: Apache-2.0
"""The page of a run: one HTML file with verdict, conditions, findings, figures and a view of each
trial, whose signals are packed into it, which opens without a network."""

import math
import re
import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
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
from osl_analysis.report.paper_tables import stated_text
from osl_analysis.report.typography import printed, template
from osl_analysis.report.verdicts import LeftOut, results_on, verdict_on
from osl_analysis.stats.budget import CLEAR, IN_INTERVAL, QUANTITIES, WIDE
from osl_analysis.stats.doubts import DOUBTS, doubts_about
from osl_analysis.stats.rounding import estimate_text

NO_CONDITIONS = ("trial", "experiment", "exclude", *RECORDINGS, *SOURCES)
# between dollar signs, or with a subscript and no part of a name
SYMBOL_PATTERN = re.compile(
    r"(?<!\\)\$(.+?)(?<!\\)\$|(?<![\w-])([KBJZknf]_(?:viscous|tau|d_rendered|[dsjm1CGT]))(?![\w-])"
)
SIGNALS = ("time", "torque", "model", "residual", "motion")
RESPONSE = ("frequency", "magnitude", "low", "high", "phase", "model_magnitude", "model_phase")
ZLIB_LEVEL = 3  # level of zlib: a quarter of the time of the usual 6, and 8 % more bytes
STEPS = 2000  # to which a signal's range is rounded: half of a pixel of the plots
TIME_STEPS = 10**7
CURVE_POINTS = 60  # of a model over frequency
MOST_DRAWN = 10_000  # samples of a trial


def inline_svg(name: str, title: str, svg: str) -> Markup:
    """The drawing of a figure as part of a page, whose names are no other figure's, and whose
    points lead to their trials."""
    drawing = svg[svg.index("<svg") :]
    drawing = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", drawing)
    drawing = drawing.replace('"../report.html#', '"#')
    return Markup(drawing.replace("<svg", f'<svg role="img" aria-label="{title}"', 1))


@dataclass(frozen=True)
class Signals:
    """What the page plots of one trial."""

    table: pl.DataFrame  # with some of `SIGNALS`, from the first sample on
    what: str  # they are, in a sentence
    motion: str  # what moves, and its unit
    response: pl.DataFrame = field(default_factory=pl.DataFrame)  # with columns of `RESPONSE`

    def packed(self) -> dict[str, Any]:
        """The signals as `page.html.j2` unpacks them.

        Each column is rounded to steps of its range; of these the differences from sample to
        sample are compressed, with -1 for a missing one.
        """
        columns = {}
        differences = []
        present = [name for name in SIGNALS if name in self.table.columns]
        for signal in self.table.select(pl.col(present).cast(pl.Float64).fill_nan(None)):
            low, high = cast(Any, signal.min()), cast(Any, signal.max())
            if low is None:
                continue
            step = (high - low) / (TIME_STEPS if signal.name == "time" else STEPS) or 1.0
            steps = ((signal - low) / step).round().fill_null(-1).to_numpy()
            differences.append(np.diff(steps, prepend=0).astype("<i4").tobytes())
            columns[signal.name] = [low, step]
        return {
            "columns": columns,
            "motion": self.motion,
            "packed": b64encode(zlib.compress(b"".join(differences), ZLIB_LEVEL)).decode(),
            "response": self.response.to_dict(as_series=False),
        }


def written_page(page: Mapping[str, Any]) -> str:
    """The HTML of a page.

    Parameters
    ----------
    page : Mapping
        What `page.html.j2` shows: `about` and `made_of`, where the results come from; `answer`, the
        sentence that it begins with, and further `sentences`; `notes` on intervals, settings that
        nobody stated, recordings without a row; `conditions`, `groups`, `numbers`, `findings`, and
        `trials` (`trial_view`); `figures`, each with `name`, `title`, `caption` (sentences) and
        `drawing` (`inline_svg`); and why others are not there, `absent_figures` and
        `missing_results`.
    """
    # it imports Bokeh, which takes longer than all else of a dry run's imports (0.3 s)
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
        signals=signals,
        plots=plots.plots(),
        library=Markup(plots.library()),
    )


def with_symbols(text: str) -> Markup:
    """A text whose symbols, as `K_d` and `$\\hat{K}$`, are set in HTML; a dollar sign behind a
    backslash is one."""

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
    """What the page shows of a trial.

    Parameters
    ----------
    row : Mapping
        Its row of the sample sheet.
    tables : Mapping of str to polars.DataFrame
        Its rows of each result table, with the findings on them, and of `quality.csv`.
    findings : Sequence of Finding
        Those on it.
    left_out : LeftOut or None
        Why it has no result.
    signals : Signals or None
        What is plotted of it.

    Returns
    -------
    dict
        `why` has the causes of its verdict in a few words, or what is to be known of its device.
        `doubts` are about its recording or the fit to all of it, `results` say why its device is
        not of second order, `remarks` are others, and what was not checked. Of the fit to all of it
        `impedance` has K, B and I, `budgets` what makes their intervals. The `fits` have
        estimates in these `units`.
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
    of_whole = [doubt for doubt in doubts if not doubt.is_of_part]
    of_parts = [doubt for doubt in doubts if doubt.is_of_part]
    results = results_on(findings)
    notes = [each for each in findings if each.grade in (Grade.UNCHECKED, Grade.NOTES)]
    reasons = left_out.reasons if left_out else ()
    causes = dict.fromkeys(finding.cause for finding in of_whole or of_parts or results)
    return {
        "name": row["trial"],
        "experiment": row["experiment"],
        "condition": stated_condition(row),
        "recordings": ", ".join(str(row[name]) for name in RECORDINGS if row.get(name)),
        "verdict": verdict_on(row["experiment"], findings, left_out),
        "why": ", ".join(causes) or "; ".join(reasons),
        "left_out": reasons,
        "doubts": of_whole,
        "doubts_of_parts": of_parts,
        "results": results,
        "remarks": [note for note in notes if not (note.is_of_part or note in results)],
        "impedance": {symbol: estimate_text(last, name) for symbol, name in names},
        "fits": fits.to_dicts(),
        "units": {name: described[main].columns[name].unit for name in estimated},
        "budgets": shown_budgets(last, tables.get("budget")),
        "checks": tables["quality"].to_dicts() if "quality" in tables else (),
        "signals": signals,
    }


def shown_budgets(row: Mapping[str, Any], budget: pl.DataFrame | None) -> list[dict[str, Any]]:
    """The estimates of the fit to all of a trial with their verdicts; the shares of `parts` in the
    squares of their half-widths [percent]; and what nobody has checked would change."""
    shown = []
    for name, of_name in budgets_of_rows([row], budget)[0].items():
        squares = {part: of_name.half_width(part) ** 2 for part in IN_INTERVAL}
        total = sum(squares.values()) or 1.0
        known = [each for each in of_name.unknown if each.per]
        titles = [known_finding(each.source).title.replace("_", " ") for each in known]
        per_unit = [f"{title}: {each.per}" for title, each in zip(titles, known, strict=True)]
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
    """The verdict on K, B or I of a row with the findings on it, in words and as the kind of its
    badge; None of other estimates."""
    if name not in QUANTITIES or row.get(DOUBTS) is None:
        return None
    doubts = doubts_about(row[DOUBTS], [name])
    if doubts:
        return {"badge": "doubtful", "text": known_finding(doubts[0]["source"]).title}
    if name in row[WIDE_ESTIMATES]:
        return {"badge": "remark", "text": WIDE}
    return {"badge": CLEAR, "text": CLEAR}


def stated_condition(row: Mapping[str, Any]) -> str:
    """What the sheet states of a trial."""
    texts = []
    for name, value in row.items():
        if name == "perturbed" and value is not None:
            texts.append("perturbed" if value else "unperturbed")
        elif value is not None and name not in NO_CONDITIONS:
            texts.append(f"{name} {stated_text(value)}")
    return ", ".join(texts)


# What is plotted of a trial

OF_FITTED = "Measured torque, the model where it is fitted, and their difference, the residual."
ISOLATED = (
    "The response to the perturbation, this crossing less the unperturbed gait, over the time from"
    " its onset; the model of its own fit, and the residual."
)


def of_fit(series: pl.DataFrame, motion: str, what: str = OF_FITTED) -> Signals:
    """Torque, model, residual and motion of a fit.

    Parameters
    ----------
    series : polars.DataFrame
        The table `series` of a bench trial, or rows of `walking_responses.csv`.
    motion : str
        What moves.
    what : str
        What the signals are.
    """
    motion_column = "omega" if "omega" in series.columns else "theta_deg"
    unit = "rad/s" if motion_column == "omega" else "deg"
    residual = pl.col("torque") - pl.col("torque_model")
    table = every_kth(series).select(
        "time", "torque", model="torque_model", residual=residual, motion=motion_column
    )
    return Signals(table, what, f"{motion} ({unit})")


def every_kth(samples: pl.DataFrame) -> pl.DataFrame:
    """Every k-th sample, so that they are `MOST_DRAWN` or fewer."""
    k = max(1, math.ceil(len(samples) / MOST_DRAWN))
    return samples.gather_every(k)


def of_recording(samples: pl.DataFrame, motion: str) -> Signals:
    """Torque and angle of a crossing or of a recording without a fit, as far as it has them."""
    columns = {"time": pl.col("time") - samples["time"][0]}
    if "torque" in samples.columns:
        columns["torque"] = "torque"
    if "theta" in samples.columns:
        columns["motion"] = pl.col("theta").degrees()
    return Signals(
        every_kth(samples).select(**columns), "Signals without a fit of their own.", motion
    )


def measured_response(response: pl.DataFrame, fit: Mapping[str, Any]) -> pl.DataFrame:
    """The measured admittance with its intervals, of a stepped sine at each amplitude, and that of
    Eq. 15 with K, B and I of the fit to all of the trial."""
    of_amplitudes = response.drop_nulls("amplitude_deg")
    rows = response if of_amplitudes.is_empty() else of_amplitudes
    measured = rows.select(
        frequency="frequency_hz",
        magnitude="magnitude",
        low="magnitude_low",
        high="magnitude_high",
        phase="phase_deg",
    )
    measured_hz = measured["frequency"].to_numpy()
    hz = np.geomspace(measured_hz.min(), measured_hz.max(), CURVE_POINTS)
    s = 2j * np.pi * hz
    model = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)  # of Eq. 15 [rad/(N*m)]
    curve = pl.DataFrame(
        {
            "frequency": hz,
            "model_magnitude": np.abs(model),
            "model_phase": np.rad2deg(np.unwrap(np.angle(model))),
        }
    )
    both = pl.concat([measured, curve], how="diagonal_relaxed")
    return both.select(pl.col(pl.Float64).round_sig_figs(5))
