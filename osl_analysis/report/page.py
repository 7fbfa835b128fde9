"""The page itself: one HTML file with packed signals, figures and captions. It needs no other file
and no network."""

import hashlib
import json
import math
import re
import zlib
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import bokeh
import numpy as np
import polars as pl
from bokeh.resources import Resources
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from osl_analysis.errors import listing
from osl_analysis.judge.campaign import Entry
from osl_analysis.judge.finding import ESTIMATES, Grade
from osl_analysis.judge.words import WORDS, printed, without_names
from osl_analysis.report import TEMPLATES
from osl_analysis.report.headline_statistics import hold_bench_errors
from osl_analysis.report.headline_text import first_sentences, number_texts
from osl_analysis.report.trial_page import (
    STATES,
    ReportedTrial,
    full_numbers,
    response_text,
    value_and_interval,
)
from osl_analysis.stats.repeats import (
    DOUBTFUL,
    RULE_OF_MEANS,
    counted,
    doubtful_count,
    repeating_trials,
    summary_row,
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


def what_was_done(trials: Sequence[ReportedTrial], about: Mapping[str, str]) -> str:
    """The campaign in a sentence: numbers of trials by joint and experiment."""
    rows = [trial.row for trial in trials]
    numbers = Counter(row["experiment"] for row in rows)
    perturbed = sum(row["experiment"] == "walking" and bool(row.get("perturbed")) for row in rows)
    counts = [
        f"{n} {name.replace('_', ' ')}"
        + f" ({perturbed} perturbed)" * (name == "walking" and 0 < perturbed < n)
        for name, n in numbers.items()
    ]
    of = f" of the {joints}" if (joints := joints_of(trials)) else ""
    suffixes = dict.fromkeys(
        Path(row.get(role) or "").suffix for row in rows for role in ("log", "mocap")
    )
    files = in_words([suffix[1:].upper() for suffix in suffixes if suffix])
    only = f"{counts[0].partition(' ')[2]} " * (len(counts) == 1)
    said = f"{len(trials)} {about['data']} {only}{'trial' if len(trials) == 1 else 'trials'}{of}"
    made_of = f"{files} files, " * bool(files) + about["recorded"]
    return f"{said}{f': {in_words(counts)}' * (not only)} ({made_of})."


def joints_of(trials: Sequence[ReportedTrial]) -> str:
    found = dict.fromkeys(
        " ".join(filter(None, map(one.row.get, ("side", "joint")))) for one in trials
    )
    return in_words([joint for joint in found if joint])


def in_words(parts: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


def state_of(trials: Sequence[ReportedTrial], known: Sequence[Mapping[str, Any]]) -> str:
    """A few sentences: how many trials are doubtful or not used, and why, and what could not be
    checked. `known`: the findings of a summary on trials and walking groups."""
    used, said = [trial for trial in trials if not trial.left_out], []
    for verdict in ("doubtful", "doubtful in part", "flagged"):
        own = [*filter(None, (trial.causes_of(verdict) for trial in used))]
        why = Counter(cause for causes in own for cause in causes)
        causes = [cause if n == len(own) else f"{cause} ({n})" for cause, n in why.most_common(3)]
        are = "is" if len(own) == 1 else "are"
        said += [
            f"{len(own)} of {len(trials)} trials {are} {verdict}: {', '.join(causes)}."
        ] * bool(own)
    lost = Counter(trial.verdict for trial in trials if trial.left_out)
    gone = [f"{n} {'was' if n == 1 else 'were'} {verdict}" for verdict, n in lost.items()]
    said = said or ["No trial is doubtful."] * bool(used)
    said.append(f"{in_words(gone)}." if gone else "Nothing was refused or excluded.")
    of_groups = [
        one["cause"] for one in known if (one["of"], one["verdict"]) == (WALKING_GROUPS, "doubtful")
    ]
    said += [f"The walking K is doubtful: {', '.join(of_groups)}."] * bool(of_groups)
    unsure = list(dict.fromkeys(one["cause"] for one in known if one["verdict"] == "not checked"))
    more = [f"{len(unsure) - 3} more"] * (len(unsure) > 3)
    said += [f"Not checked, and in no interval: {in_words([*unsure[:3], *more])}."] * bool(unsure)
    return printed(" ".join(said))


def conditions(
    tables: Mapping[str, pl.DataFrame], findings: Mapping[str, Sequence[Entry]]
) -> list[dict[str, Any]]:
    """K, B and I of each condition (commanded impedance and joint) or walking group, with its
    trials and doubts. It is the mean of several trials (`summary_row`). Trials without a stated K_d
    are grouped by repetition (`repeating_trials`). `findings` are those on each trial."""
    found = of_groups(tables, findings)
    for name in ("impedance",):
        table = tables.get(name, pl.DataFrame(schema=["trial", "amplitude_deg"]))
        whole = (
            table.filter(pl.col("amplitude_deg").is_null())
            if "amplitude_deg" in table.columns
            else table
        )
        known = ("joint", "side", "controller", "K_d", "B_d")
        keys = [one for one in known if one in whole.columns and whole[one].n_unique() > 1]
        none = whole.get_column("K_d", default=pl.repeat(None, len(whole), eager=True)).is_null()
        unstated = none & (pl.len().over(*keys, pl.lit("all")) > 1)
        whole = whole.with_columns(
            own=pl.when(unstated).then(repeating_trials(whole) if none.any() else None)
        )
        for rows in whole.partition_by([*keys, "own"], maintain_order=True):
            found.append(condition(rows, name, keys, findings))
    return found


def condition(
    rows: pl.DataFrame, table: str, keys: Sequence[str], findings: Mapping[str, Sequence[Entry]]
) -> dict[str, Any]:
    """A row of `conditions`, from the fits of one condition, which agree in the columns `keys`."""
    used, trials = counted(rows), rows["trial"].to_list()
    row = used.row(0, named=True)
    friction = ("B_viscous", "f_C")  # which B holds: said where every trial has them
    shown = [
        *ESTIMATES,
        *(one for one in friction if one in rows.columns and not rows[one].null_count()),
    ]
    if len(used) > 1:
        for symbol in shown:
            mean = summary_row(used, symbol)
            row |= {f"{symbol}{end}": mean[of] for end, of in IN_SUMMARY.items()}
    of = [
        f"{key} {row[key]:g}" if key in ("K_d", "B_d") else row[key]
        for key in keys
        if row[key] is not None
    ]
    if row["own"] is not None:
        of += [f"trial{'s' * (len(rows) > 1)} {listing(trials, 3)}", motion_said(row)]
    about = [one for trial in trials for one in findings.get(trial, ())]
    cells = {symbol: value_and_interval(row, symbol) for symbol in shown}
    doubts, without = doubts_said(about, table, row, len(trials)), len(rows) - len(used)
    left_out = f"{without} left out of the mean" * (without > 0)
    doubts["doubt"] = "; ".join(filter(None, [doubts["doubt"], left_out]))
    full = {symbol: full_numbers(row, symbol) for symbol in shown}
    return {"of": ", ".join(of) or "all", "trials": trials, **doubts, **cells, "full": full}


def motion_said(row: Mapping[str, Any]) -> str:
    """What moved the joint in a trial, as measured."""
    kind = row.get("excitation") or "other"
    said = ["motion without a period" if kind == "other" else kind]
    if row.get("band_low_hz") is not None:
        said.append(f"{row['band_low_hz']:.2g} to {row['band_high_hz']:.2g} Hz")
    if row.get("theta_rms_deg") is not None:
        said.append(f"{row['theta_rms_deg']:.2g}° RMS")
    return ", ".join(said)


def of_groups(
    tables: Mapping[str, pl.DataFrame], findings: Mapping[str, Sequence[Entry]]
) -> list[dict[str, Any]]:
    found = []
    groups = tables.get("walking_summary", pl.DataFrame(schema=["estimator", "group"])).filter(
        estimator="ensemble"
    )
    judged = tables.get("walking", pl.DataFrame(schema=["trial", "group", DOUBTFUL])).drop_nulls(
        DOUBTFUL
    )
    for (group,), own in groups.group_by("group", maintain_order=True):
        row = {
            f"{one['quantity']}{end}": one[of]
            for one in own.to_dicts()
            for end, of in IN_SUMMARY.items()
        }
        of = "walking" if group == "all" else f"walking, {group}"
        about = doubts_said(findings.get(str(group), ()), "walking_groups", {})
        crossings = judged.filter(group=group)["trial"].to_list()
        of_each = doubts_said(
            [one for trial in crossings for one in findings.get(trial, ())], "walking", {}, 0
        )
        said = of_each["doubt"] and f"of {len(crossings)} perturbations {of_each['doubt']}"
        about["doubt"] = "; ".join(filter(None, [about["doubt"], said]))
        cells = {symbol: value_and_interval(row, symbol) for symbol in ESTIMATES}
        full = {symbol: full_numbers(row, symbol) for symbol in ESTIMATES}
        found.append({"of": of, "trials": [], **about, **cells, "full": full})
    return found


# ending of a fit's column, and column in a summary
IN_SUMMARY = {"": "mean", "_low": "low", "_high": "high"}


def doubts_said(
    entries: Sequence[Entry], table: str, row: Mapping[str, Any], n: int = 1
) -> dict[str, Any]:
    """The `doubt` about the fits of n trials in this table (of one trial by its `row`); the number
    of `unchecked`."""
    own = [one for one in entries if one["table"] == table and not one["in_part"]]
    doubts = [one for one in own if one["grade"] == Grade.DOUBTS]
    by_cause = Counter(cause for _, cause in {(one["trial"], one["cause"]) for one in doubts})
    said = [f"{cause} ({k}{f' of {n}' * bool(n)})" for cause, k in sorted(by_cause.items())]
    said = [doubted(one, row) for one in doubts] if n == 1 else [*map(printed, said)]
    unchecked = {one["cause"] for one in own if one["grade"] == Grade.UNCHECKED}
    return {"doubt": "; ".join(dict.fromkeys(said)), "unchecked": len(unchecked)}


def doubted(entry: Entry, row: Mapping[str, Any]) -> str:
    """A cause of doubt about a row, with the estimates of its fit and their units."""
    left = []
    for name, symbol in without_names(entry["cause"], row, entry["table"]).items():
        value, *ends = (entry.get(f"{name}_without{end}") for end in ("", "_low", "_high"))
        said = dict.fromkeys(
            f"{end:.3g}" for end in (ends if None not in ends else [value]) if end is not None
        )
        left += [f"{symbol} {' to '.join(said)}"] * bool(said)
    return printed(f"{entry['cause']}{f' (with it in the fit {in_words(left)})' if left else ''}")


def method_said(settings: Mapping[str, Any], tables: Mapping[str, pl.DataFrame]) -> str:
    """Two sentences and the equation, beside the first figure; empty where no impedance was
    estimated."""
    said, law = [], "τ = Kθ + Bθ̇ + Iθ̈"
    if "impedance" in tables:
        cutoff = settings["dynamometer"]["cutoff_hz"]
        said.append(
            f"{law} + τ₀ is fitted to angle and torque behind a zero-phase low-pass of"
            f" {cutoff:g} Hz."
        )
    if "walking_summary" in tables:
        response, window = (
            response_text(tables["walking_groups"]),
            1e3 * settings["walking"]["window_s"],
        )
        response += f", perturbed less unperturbed, in the {window:g} ms after the onset"
        said.append(f"While walking {law} is fitted to {response}.")
    shared = " Errors that all trials of the bench share are not in them." * (
        hold_bench_errors(tables) is False
    )
    has_doubtful = any(
        doubtful_count(table)[0] for table in tables.values() if DOUBTFUL in table.columns
    )
    rule = f" {RULE_OF_MEANS}" if has_doubtful else ""
    return (
        f"{' '.join(said)} τ resists the motion. Brackets are intervals of 95 %.{shared}{rule}"
        if said
        else ""
    )


def assumed_said(states: pl.DataFrame) -> str:
    """The settings of `settings.csv` that are used but not stated, and whether no device is; empty
    if all are."""
    # numbers and nulls become text
    states = states.cast(dict.fromkeys(("setting", "state", "value"), pl.String))
    rows = states.filter(state="assumed")
    has_none = any(states["state"].eq("none") & states["setting"].eq("parameters"))
    without = (
        "Without a parameter file nothing is held against a device's gains or belt." * has_none
    )
    said = [
        WORDS["settings"]
        .get(name, name if value.startswith("{") else f"{name} {value}")
        .format(value=value.removesuffix(".0"))
        for name, value in rows["setting", "value"].iter_rows()
    ]
    return " ".join(
        filter(
            None, [f"Assumed, since nobody stated it: {in_words(said)}." if said else "", without]
        )
    )


WALKING_GROUPS = "walking groups"  # subject of a finding in a summary that is not on a trial


def check_map(
    trials: Sequence[ReportedTrial], known: Sequence[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """By experiment: `trials` with their verdicts, sorted by condition; and `rows`, one per cause
    that a trial does not pass or that could not be checked on it, with the state of every trial. A
    finding on a walking group, `known` from a summary, counts for each of its trials."""
    of_groups = [one for one in known if one["of"] == WALKING_GROUPS]
    groups: dict[str, list[ReportedTrial]] = {}
    for trial in trials:
        groups.setdefault(trial.row["experiment"], []).append(trial)
    found = []
    for experiment, own in groups.items():
        own.sort(
            key=lambda one: [
                str(one.row.get("controller")),
                *(one.row.get(key) or 0.0 for key in ("K_d", "B_d")),
            ]
        )
        rows: dict[str, dict[str, str]] = {}
        for trial in own:
            for doubt in sorted(trial.doubts, key=lambda doubt: [*STATES].index(doubt.of)):
                rows.setdefault(doubt.cause, {}).setdefault(trial.name, doubt.verdict)
            for one in trial.unchecked:
                state = "remark" if one["grade"] == Grade.NOTES else "not checked"
                rows.setdefault(one["cause"], {}).setdefault(trial.name, state)
            its = {*trial.main["group"]} if "group" in trial.main.columns else set()
            for known_one in of_groups:
                if its & {*known_one["trials"]}:
                    rows.setdefault(known_one["cause"], {}).setdefault(
                        trial.name, known_one["verdict"]
                    )
        named = [(trial.name, trial.verdict) for trial in own]
        states = [
            (cause, [(name, its.get(name, "passed")) for name, _ in named])
            for cause, its in rows.items()
        ]
        found.append({"experiment": experiment, "trials": named, "rows": states})
    return found


def claims_said(claims: pl.DataFrame) -> list[dict[str, Any]]:
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
        "state": state_of(trials, told),
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
