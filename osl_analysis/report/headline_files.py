"""Headline numbers as JSON, and as macros of LaTeX."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from osl_analysis.campaign.origin import ABOUT_MACROS, ABOUT_MEANING, sentence
from osl_analysis.report.decimal_places import fixed
from osl_analysis.report.headline import Headline
from osl_analysis.report.headline_text import trials_text
from osl_analysis.schema import SCHEMA, SCHEMA_FIELD


def to_json(
    about: Mapping[str, str],
    headlines: Sequence[Headline],
    missing: Mapping[str, Any] | None = None,
) -> str:
    """Write a summary as JSON.

    Parameters
    ----------
    about : Mapping of str to str
        What the numbers are made of.
    headlines : Sequence of Headline
        Each becomes an object in full precision; null if there is no interval, or no value of the
        draft.
    missing : Mapping or None
        What else the summary has, such as the missing trials and results.
    """
    numbers: dict[str, dict[str, Any]] = {}
    for headline in headlines:
        if not headline.is_macro_only:
            numbers[headline.label.name] = headline.to_json()
    content = {**about, SCHEMA_FIELD: SCHEMA, **(missing or {}), "numbers": numbers}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


SPECIAL = {sign: f"\\{sign}" for sign in "#$%&_{}"} | {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"
}  # fmt: skip
"""Special characters of LaTeX, and their commands."""


def in_latex(text: str) -> str:
    """Text with the special characters of LaTeX escaped."""
    return "".join(SPECIAL.get(sign, sign) for sign in text)


def to_tex(
    about: Mapping[str, str], headlines: Sequence[Headline], remarks: Sequence[str] = ()
) -> str:
    r"""Write headline numbers as LaTeX macros such as `\oslBeltStiffness`, rounded, without unit.

    Parameters
    ----------
    about : Mapping of str to str
        What the numbers are made of: `\oslData`, `\oslCampaign` ...
    headlines : Sequence of Headline
        `Low` and `High` are added where there is an interval.
    remarks : Sequence of str
        Comments at the begin.

    Returns
    -------
    str
        Each line ends in a comment, so that reading the file puts no space into the text.
    """
    lines = [
        f"% {sentence(about)}",
        "% Headline numbers by osl-analysis; \\input this file and use the macros.",
    ]
    lines += [f"% {remark}" for remark in remarks]
    for name, value in about.items():
        lines.append(tex_macro(ABOUT_MACROS[name], in_latex(value), ABOUT_MEANING[name]))
    for headline in headlines:
        lines += tex_macros(headline)
    return "\n".join(lines) + "\n"


def tex_macros(headline: Headline) -> list[str]:
    """The macros of one number: its value, the ends of its interval and of the fits to single
    amplitudes, its verdict."""
    label = headline.label
    estimate = headline.estimate
    places = estimate.places
    comment = f"{label.unit}, {label.meaning}"
    if estimate.n_doubtful or estimate.doubt:
        comment += f", n = {trials_text(estimate)}"
    kind = estimate.interval
    numbers = {
        "": (estimate.value, places.value, comment),
        "Low": (estimate.low, places.ends, f"low end: {kind}"),
        "High": (estimate.high, places.ends, f"high end: {kind}"),
        "AmplitudesLow": (
            estimate.amplitudes_low,
            places.value,
            "lowest of the fits to single amplitudes",
        ),
        "AmplitudesHigh": (
            estimate.amplitudes_high,
            places.value,
            "highest of the fits to single amplitudes",
        ),
    }
    lines = []
    for ending, (number, digits, remark) in numbers.items():
        if number is not None:
            lines.append(tex_macro(f"{label.macro}{ending}", tex_number(number, digits), remark))
    if estimate.verdict:
        lines.append(tex_macro(f"{label.macro}Verdict", estimate.verdict, "verdict"))
    return lines


def tex_macro(name: str, text: str, comment: str) -> str:
    return f"\\newcommand{{\\osl{name}}}{{{text}}}% {comment}"


def tex_number(number: float, digits: int) -> str:
    """A rounded number that reads the same in text and in mathematics: with a true minus, small
    ones with a power of ten."""
    text, _, power = fixed(number, digits).partition("e")
    if power:
        text += rf"\times 10^{{{int(power)}}}"
    if power or text.startswith("-"):
        text = rf"\ensuremath{{{text}}}"
    return text
