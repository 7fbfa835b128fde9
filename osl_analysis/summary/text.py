"""The headline numbers as JSON, as LaTeX macros and as tables, and the trials behind them."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import polars as pl

from osl_analysis.config.campaign import ABOUT_MACROS, ABOUT_MEANING, About
from osl_analysis.jobs.refusal import Refusal
from osl_analysis.judge.findings import exclusion_said
from osl_analysis.summary.headlines import COUNT, RANGE, Headline

BY_SHEET = "sample sheet"
"""Entry of the column `check` of `excluded.csv` for a trial that the sheet excludes."""


def trials_content(trials: Mapping[str, Sequence[str]], excluded: pl.DataFrame) -> dict[str, dict[str, Any]]:
    """By experiment how many `of` its trials are `used`, why others are `missing`, but for what the sheet excludes."""
    reasons: dict[str, str] = {}
    for row in excluded.filter(pl.col("check") != BY_SHEET).iter_rows(named=True):
        reasons.setdefault(row["trial"], exclusion_said(row))
    missing = {of: {name: reasons[name] for name in names if name in reasons} for of, names in trials.items()}
    return {
        experiment: {"used": len(names) - len(missing[experiment]), "of": len(names), "missing": missing[experiment]}
        for experiment, names in trials.items()
    }


def missing_results(refused: Iterable[Refusal]) -> dict[str, str]:
    """Results over several trials that could not be computed, with the reason."""
    return {one.file: one.reason.removeprefix(f"{one.file}: ") for one in refused if not one.trial}


def finding_lines(content: Mapping[str, Any]) -> list[str]:
    """What a reader must know of the campaign: its doubts and flags, and what could not be checked, a line each."""
    return [str(one["line"]) for one in content.get("findings", ())]


def missing_lines(content: Mapping[str, Any], reasons: bool) -> list[str]:
    """A line per experiment with missing trials, with their `reasons` or without, and per missing result."""
    lines = []
    for experiment, counts in content.get("trials", {}).items():
        if counts["missing"]:
            named = [f"{trial} ({why})" if reasons else trial for trial, why in counts["missing"].items()]
            lines.append(f"{counts['used']} of {counts['of']} {experiment} trials; without {', '.join(named)}")
    return lines + [f"no {file}: {why}" for file, why in content.get("missing_results", {}).items()]


AMPLITUDES = ("amplitudes_low", "amplitudes_high")
KEPT = ("value", "unit", "low", "high", "interval", "n", "n_doubtful", "n_left_out", "doubt", "draft", "meaning")
COLUMN_HEADS = ("quantity", "value", "interval", "n", "draft")
MACRO_PREFIX = "osl"
SPECIAL = {sign: f"\\{sign}" for sign in "#$%&_{}"} | {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"
}  # fmt: skip
"""Letters with a meaning of their own in LaTeX, and what sets them."""
NO_WIDTH = 1e-9  # relative width of an interval that counts as rounding
SMALLEST_PLAIN = 1e-4  # numbers smaller than this are written with a power of ten


def to_json(about: About, headlines: Sequence[Headline], missing: Mapping[str, Any] | None = None) -> str:
    """What the numbers are made of, which trials and results are `missing`, and an object per number in full precision.
    Null where there is no interval or the draft has no value; only numbers with a range over single amplitudes have
    it."""
    numbers = {
        h.name: {key: getattr(h, key) for key in (*KEPT, *(AMPLITUDES if h.amplitudes_low is not None else ()))}
        for h in headlines
    }
    content = {**asdict(about), **(missing or {}), "numbers": numbers}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_tex(about: About, headlines: Sequence[Headline], remarks: Sequence[str] = ()) -> str:
    r"""Macros such as `\oslBeltStiffness`, with `Low` and `High` where there is an interval, rounded, without unit;
    `\oslData`, `\oslCampaign` ... say what the numbers are made of. Each line ends in a comment, so that reading the
    file puts no space into the text. `remarks` are comments too."""
    lines = [f"% {about.sentence()}", "% Headline numbers by osl-analysis; \\input this file and use the macros."]
    lines += [f"% {remark}" for remark in remarks]
    for name, value in asdict(about).items():
        text = "".join(SPECIAL.get(sign, sign) for sign in value)
        lines.append(f"\\newcommand{{\\{MACRO_PREFIX}{ABOUT_MACROS[name]}}}{{{text}}}% {ABOUT_MEANING[name]}")
    for h in headlines:
        digits = decimals(h.value, *rounded_by(asdict(h)))
        finer = told_apart(h.low, h.high, digits)
        remark = f", n = {trials_text(asdict(h))}" if h.n_doubtful or h.doubt else ""
        ends = {
            "": (h.value, digits, f"{h.unit}, {h.meaning}{remark}"),
            "Low": (h.low, finer, f"low end: {h.interval}"),
            "High": (h.high, finer, f"high end: {h.interval}"),
            "AmplitudesLow": (h.amplitudes_low, digits, "lowest of the fits to single amplitudes"),
            "AmplitudesHigh": (h.amplitudes_high, digits, "highest of the fits to single amplitudes"),
        }
        for suffix, (number, places, comment) in ends.items():
            if number is not None:
                macro = f"{MACRO_PREFIX}{h.macro}{suffix}"
                lines.append(f"\\newcommand{{\\{macro}}}{{{tex_number(number, places)}}}% {comment}")
    return "\n".join(lines) + "\n"


def to_markdown(numbers: Mapping[str, Mapping[str, Any]]) -> str:
    """Table of the numbers of a summary, in the form that `to_json` writes, as Markdown."""
    lines = [f"| {' | '.join(COLUMN_HEADS)} |", f"| {' | '.join('---' for _ in COLUMN_HEADS)} |"]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |" for cells in rows(numbers)]
    return "\n".join(lines) + "\n"


def to_columns(numbers: Mapping[str, Mapping[str, Any]]) -> str:
    table = [COLUMN_HEADS, *rows(numbers)]
    widths = [max(len(cells[place]) for cells in table) for place in range(len(COLUMN_HEADS))]
    padded = ["  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) for cells in table]
    return "\n".join(line.rstrip() for line in padded) + "\n"


def rows(numbers: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    """The cells of each number: what it is, value, interval, trials, the draft's value. Counts of 0 are left out."""
    for number in numbers.values():
        if number["interval"] == COUNT and not number["value"]:
            continue
        digits = decimals(number["value"], *rounded_by(number))
        value = f"{fixed(number['value'], digits)} {number['unit']}"
        interval, draft = "", "" if number["draft"] is None else f"{number['draft']:g}"
        if number["low"] is not None:
            finer = told_apart(number["low"], number["high"], digits)
            interval = f"{fixed(number['low'], finer)} to {fixed(number['high'], finer)}, {number['interval']}"
        if number.get("amplitudes_low") is not None:
            lowest, highest = (fixed(number[key], digits) for key in AMPLITUDES)
            interval += f"; single amplitudes {lowest} to {highest}"
        yield number["meaning"], value, interval, trials_text(number), draft


def trials_text(number: Mapping[str, Any]) -> str:
    """Number of trials or fits behind a number, and how many doubtful ones are among them or were left out; or why the
    number itself is doubtful."""
    if number.get("doubt"):
        return f"{number['n']}, DOUBTFUL: {number['doubt']}"
    n, doubtful, left_out = (int(number.get(key) or 0) for key in ("n", "n_doubtful", "n_left_out"))
    if left_out:
        return f"{n} of {n + left_out}, {left_out} doubtful left out"
    return f"{n}, {doubtful} of them doubtful" if doubtful else str(n)


def rounded_by(number: Mapping[str, Any]) -> tuple[float | None, float | None, str | None]:
    """Bounds that decide to how many digits a number is rounded, and their kind. These are the range over single
    amplitudes if there is one and it is the wider one, otherwise the interval."""
    low, high = (number.get(key) for key in AMPLITUDES)
    own = number["low"], number["high"], number["interval"]
    if low is None or high is None or (number["low"] is not None and number["high"] - number["low"] > high - low):
        return own
    return low, high, None


def decimals(value: float, low: float | None, high: float | None, interval: str | None) -> int:
    """Decimal places with which a number is written: half its interval keeps two digits, without one it has three. With
    a range, which does not show the precision, it has three, or more until the ends differ; a count has none."""
    if interval == COUNT:
        return 0
    half = 0.0 if low is None or high is None or interval == RANGE else abs(high - low) / 2
    if half > NO_WIDTH * abs(value):
        return max(1 - exponent_of(half), 0)
    digits = max(2 - exponent_of(value), 0) if value else 0
    return told_apart(low, high, digits) if interval == RANGE else digits


def told_apart(low: float | None, high: float | None, digits: int) -> int:
    """Decimal places, `digits` or more, with which two different bounds read differently."""
    if low is None or high is None or abs(high - low) <= NO_WIDTH * max(abs(low), abs(high)):
        return digits
    while fixed(low, digits) == fixed(high, digits):
        digits += 1
    return digits


def exponent_of(number: float) -> int:
    """Power of ten of the leading digit."""
    return math.floor(math.log10(abs(number)))


def fixed(number: float, digits: int) -> str:
    """The number with that many decimal places; never a minus before zero."""
    text = f"{number:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def tex_number(number: float, digits: int) -> str:
    """A number that reads the same in text and in mathematics: with a true minus, small ones with a power of ten."""
    text = fixed(number, digits)
    if 0 < abs(float(text)) < SMALLEST_PLAIN:
        exponent = exponent_of(float(text))
        mantissa = fixed(number / 10.0**exponent, max(digits + exponent, 0))
        return rf"\ensuremath{{{mantissa}\times 10^{{{exponent}}}}}"
    return rf"\ensuremath{{{text}}}" if text.startswith("-") else text
