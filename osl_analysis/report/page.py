"""The page itself: one HTML file with packed signals, figures and captions. It needs no other file
and no network."""

import hashlib
import json
import math
import re
import zlib
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from html import escape
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import bokeh
import numpy as np
import polars as pl
from bokeh.resources import Resources
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from osl_analysis.judge.finding import Grade
from osl_analysis.judge.words import printed
from osl_analysis.report import TEMPLATES
from osl_analysis.report.headline_text import first_sentences, number_texts
from osl_analysis.report.page_text import WALKING_GROUPS, joints_of, verdicts_text, what_was_done
from osl_analysis.report.trial_page import (
    STATES,
    ReportedTrial,
)

FIRST_FIGURES = ("fig5", "walking_page", "torque_angle", "response", "fig3")
"""The first of these figures that the campaign has is on the first screen; Fig. 5 only if an
impedance was desired."""

SCRIPTS = ("elements.js", "tables.js", "readings.js", "loops.js", "report.js")
"""The page's own scripts, in the order in which they are one."""


def written_page(
    content: Mapping[str, Any],
    trials: Mapping[str, tuple[Mapping[str, Any], Mapping[str, pl.DataFrame]]],
) -> str:
    """The HTML of the report, from the names in `report.html.j2` and each trial's content and
    tables."""
    around = template("report.html.j2")
    bokeh_js = "\n".join(
        Resources(mode="inline", log_level="warn", components=["bokeh", "bokeh-api"]).js_raw
    )
    report_js = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in SCRIPTS)
    style = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    hashes = (hashlib.sha256(script.encode()).digest() for script in (bokeh_js, report_js))
    scripts = " ".join(f"'sha256-{b64encode(digest).decode()}'" for digest in hashes)

    # all samples of the series of 250 trials take some 15 MB
    packed, every = {}, -(-len(trials) // 250) or 1
    for name, (told, tables) in trials.items():
        text = json.dumps(told, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        drawn = {table: packed_table(every_kth(rows, every)) for table, rows in tables.items()}
        both = json.dumps({"content": deflated(text.encode()), "tables": drawn}, allow_nan=False)
        # it cannot end the script element that holds it
        packed[name] = Markup(both.replace("<", "\\u003c"))
    return around.render(
        **content,
        bokeh_version=bokeh.__version__,
        # content security policy: nothing is loaded, and no script runs but these two, by their
        # hashes
        policy=(
            f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data:"
            " blob:; font-src data:; base-uri 'none'; form-action 'none'"
        ),
        bokeh_js=Markup(bokeh_js),
        report_js=Markup(report_js),
        style=Markup(style),
        packed=packed,
        every=every,
    )


def check_map(
    trials: Sequence[ReportedTrial], known: Sequence[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """By experiment: `trials` with their verdicts, sorted by condition; and `rows`, one per cause
    that a trial does not pass or that could not be checked on it, with the state of every trial. A
    finding on a walking group, `known` from a summary, counts for each of its trials."""
    by_experiment: dict[str, list[ReportedTrial]] = {}
    for trial in trials:
        by_experiment.setdefault(trial.row["experiment"], []).append(trial)
    maps = []
    for experiment, of_experiment in by_experiment.items():
        ordered = sorted(of_experiment, key=by_condition)
        states_of_cause: dict[str, dict[str, str]] = {}
        for trial in ordered:
            for cause, state in states_in(trial, known):
                states_of_cause.setdefault(cause, {}).setdefault(trial.name, state)
        rows = []
        for cause, states in states_of_cause.items():
            rows.append(
                (cause, [(trial.name, states.get(trial.name, "passed")) for trial in ordered])
            )
        verdicts = [(trial.name, trial.verdict) for trial in ordered]
        maps.append({"experiment": experiment, "trials": verdicts, "rows": rows})
    return maps


def by_condition(trial: ReportedTrial) -> list[Any]:
    """The order of trials: controller, K_d, B_d."""
    row = trial.row
    return [str(row.get("controller")), row.get("K_d") or 0.0, row.get("B_d") or 0.0]


def states_in(
    trial: ReportedTrial, known: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[str, str]]:
    """Each cause of a trial with its state; of several states of a cause the first counts."""
    for doubt in sorted(trial.doubts, key=lambda doubt: [*STATES].index(doubt.of)):
        yield doubt.cause, doubt.verdict
    for entry in trial.unchecked:
        yield entry["cause"], "remark" if entry["grade"] == Grade.NOTES else "not checked"
    if "group" not in trial.main.columns:
        return
    groups = {*trial.main["group"]}
    for finding in known:
        if finding["of"] == WALKING_GROUPS and groups & {*finding["trials"]}:
            yield finding["cause"], finding["verdict"]


def claim_rows(claims: pl.DataFrame) -> list[dict[str, Any]]:
    """The claims on the campaign, of the rows of `claims.csv`, each with its number and its limit
    for a reader."""
    found = []
    for row in claims.filter(pl.col("subject").is_null()).drop_nulls("verdict").to_dicts():
        margin = "" if row["margin"] is None else f" ± {row['margin']:g}"
        limit = " ".join(filter(None, [row["wanted"], f"{row['target']:g}{margin}", row["unit"]]))
        where = ", ".join(filter(None, [row["joint"], row["side"]]))
        found.append({**row, **number_texts(row), "where": where, "limit": limit})
    return found


RESULT_UNITS = {"K": "N*m/rad", "B": "N*m*s/rad", "I": "kg*m^2"}


def size_in_results(finding: Mapping[str, Any]) -> tuple[float, ...]:
    """By how much a finding changes K, B and I at worst, in their units; 0 where that is unknown.
    Findings are compared by K first, then by B, then by I."""
    return tuple(abs(finding.get(f"{symbol}_size") or 0.0) for symbol in RESULT_UNITS)


def size_text(finding: Mapping[str, Any]) -> str:
    """`size_in_results` for a reader; empty if nothing is known of it."""
    sizes = zip(RESULT_UNITS.items(), size_in_results(finding), strict=True)
    return ", ".join(
        f"{symbol} by up to {size:.2g} {unit}" for (symbol, unit), size in sizes if size
    )


def overview(
    trials: Sequence[ReportedTrial],
    summary: Mapping[str, Any],
    figures: Sequence[Mapping[str, Any]],
    about: Mapping[str, str],
) -> dict[str, Any]:
    """The content of the first screen: the main figure, the numbers of a `summary`, its findings by
    trial."""
    told = summary.get("findings", ())
    findings = sorted(
        (one for trial in trials for one in trial.findings), key=lambda one: not one["in_part"]
    )
    known = {trial.name for trial in trials}
    numbers = [*summary.get("numbers", {}).values()]
    desired = any(
        trial.row.get(name) is not None for trial in trials for name in ("controller", "K_d")
    )
    names = [figure["name"] for figure in figures]
    first = next((name for name in (*FIRST_FIGURES[not desired :], *names) if name in names), "")
    sizes = {(entry["cause"], entry["trial"]): entry["size"] or "" for entry in findings}

    def named(one: Mapping[str, Any]) -> list[tuple[str, str]]:
        return [
            (name, sizes.get((one["cause"], name), "")) for name in one["trials"] if name in known
        ]

    largest_first = sorted(told, key=size_in_results, reverse=True)
    return {
        "joints": joints_of(trials),
        "done": what_was_done(trials, about),
        "state": verdicts_text(trials, told),
        "map": check_map(trials, told),
        "answers": first_sentences(numbers),
        "numbers": [{**one, **number_texts(one)} for one in numbers],
        "findings": [
            {**one, "named": named(one), "changes": size_text(one)} for one in largest_first
        ],
        "first": [one for one in figures if one["name"] == first],
        "figures": [one for one in figures if one["name"] != first],
    }


@cache
def template(name: str) -> Template:
    known = FileSystemLoader(TEMPLATES)
    found = Environment(loader=known, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    found.filters["printed"] = printed
    return found.get_template(name)


def every_kth(table: pl.DataFrame, k: int) -> pl.DataFrame:
    """Every k-th row of a table, at least 200. Ends of a range, `_low` and `_high`, are the
    outermost in between."""
    if (k := min(k, len(table) // 200)) <= 1:
        return table
    low, high = (pl.col(f"^.*{end}$") for end in ("_low", "_high"))
    groups = (pl.int_range(pl.len()) // k).alias("k_th")
    others = pl.exclude("^.*_low$", "^.*_high$").first()
    return (
        table.group_by(groups, maintain_order=True)
        .agg(others, low.min(), high.max())
        .select(table.columns)
    )


def packed_table(table: pl.DataFrame) -> dict[str, Any]:
    """A table of numbers for the page. `units`: the step of each column, a power of two below 2^-14
    of its range. `data`: column by column, the differences modulo 2^32 of the counts of steps, byte
    by byte, which deflate well for smooth signals. A number that is not finite has the count
    -2^31."""
    units, data = dict[str, float](), list[bytes]()
    for name in table.columns:
        values = table[name].cast(pl.Float64).to_numpy()
        known = values[np.isfinite(values)]
        reach = max(np.ptp(known), 1e-4 * np.abs(known).max()) if len(known) else 0.0
        units[name] = 2.0 ** (math.ceil(math.log2(reach)) - 15) if reach else 1.0
        counts = np.where(np.isfinite(values), np.round(values / units[name]), -(2.0**31)).astype(
            np.int64
        )
        data.append(
            np.diff(counts, prepend=0).astype("<i4").view(np.uint8).reshape(-1, 4).T.tobytes()
        )
    return {"rows": len(table), "units": units, "data": deflated(b"".join(data))}


def deflated(content: bytes) -> str:
    """Bytes as the page's `DecompressionStream("deflate")` reads them, in base64."""
    return b64encode(zlib.compress(content, 7)).decode("ascii")


def inline_svg(text: str, name: str, label: str) -> Markup:
    """The SVG of a figure for the page, described by `label`. Identifiers begin with `name`, links
    lead to trials. The tab key skips the links: a figure has hundreds, and the table of trials has
    the same ones."""
    SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
    for prefix, space in (("", SVG), ("xlink", XLINK)):
        ElementTree.register_namespace(prefix, space.strip("{}"))
    root = ElementTree.fromstring(text)
    for metadata in root.findall(f"{SVG}metadata"):
        root.remove(metadata)
    for element in root.iter():
        for key, value in list(element.attrib.items()):
            if key == "id":
                element.set(key, f"{name}-{value}")
            elif key == f"{XLINK}href" and value.startswith("#"):
                element.set(key, f"#{name}-{value[1:]}")
            elif "url(#" in value:
                element.set(key, re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", value))
        # behind the name of the report in the figures' files; here the pointer says which
        if element.tag == f"{SVG}a":
            trial = element.get(f"{XLINK}href", "").rpartition("#trial=")[2]
            element.set(f"{XLINK}href", f"#trial={trial}")
            element.attrib.pop("target", None)
            element.set("tabindex", "-1")
            title = ElementTree.Element(f"{SVG}title")
            title.text = unquote(trial)
            element.insert(0, title)
    width, height = (
        float(root.attrib.pop(key, "0").removesuffix("pt")) for key in ("width", "height")
    )
    box, size = f"0 0 {width:g} {height:g}", f"width: {1.6 * width:.0f}px"
    root.attrib.update(
        {"viewBox": root.get("viewBox", box), "style": size, "role": "img", "aria-label": label}
    )
    root.set("class", "wide" if width > 300 else "narrow")  # [pt], on a phone
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def captions_by_title(text: str) -> dict[str, Markup]:
    sections = (section.partition("\n") for section in f"\n{text}".split("\n## ")[1:])
    return {title.strip(): caption_html(body.strip()) for title, _, body in sections}


def caption_html(text: str) -> Markup:
    """A caption as HTML: escapes of Markdown are undone, mathematics gets its indices, all else is
    text."""
    parts = re.finditer(
        r"\\(?P<sign>[^A-Za-z0-9\s])|\$(?P<symbol>[^$]+)\$|(?P<text>[^\\$]+|[\\$])", text
    )
    letters, found = {"theta": "θ", "tau": "τ", "pm": "±"}, []
    for part in parts:
        if not part["symbol"]:
            found.append(escape(part["sign"] or part["text"]))
            continue
        # a symbol of the paper, such as `\\hat{K}` or `K_d`
        accented = re.sub(r"\\hat\{?(\w)\}?", "\\1\u0302", part["symbol"])
        shown = escape(re.sub(r"\\(\w+)", lambda word: letters.get(word[1], word[1]), accented))
        for sign, element in (("_", "sub"), (r"\^", "sup")):
            shown = re.sub(
                rf"{sign}(?:\{{([^}}]*)\}}|(\w))", rf"<{element}>\1\2</{element}>", shown
            )
        found.append(f"<i>{shown.replace('{', '').replace('}', '')}</i>")
    return Markup("".join(found))
