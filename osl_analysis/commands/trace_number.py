# SPDX-License-Identifier: Apache-2.0
"""From which files, trials and settings a headline number comes, by the trace of `summary.json`."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.base.errors import InputError, nearest
from osl_analysis.campaign.origin import EXPERIMENTS_BY_SETTING
from osl_analysis.report.methods import template
from osl_analysis.report.numbers import macro_name, numbers_in_summary
from osl_analysis.report.verdicts import changed_lines


def trace_text(summary: Mapping[str, Any], asked: str) -> str:
    """Tell where numbers come from.

    Parameters
    ----------
    summary : Mapping
        `summary.json`.
    asked : str
        The name of a number, its macro of LaTeX, or its value as it is printed.

    Raises
    ------
    InputError
        There is no such number.
    """
    numbers = numbers_in_summary(summary)
    name = asked.lstrip("\\").removeprefix("osl")
    meant = [
        number
        for number in numbers
        if name in (number.name, macro_name(number.name), *number.texts)
    ]
    if not meant:
        names = [number.name for number in numbers]
        raise InputError(
            f"{asked}: no number of these results",
            f"name one as summary.json does, or its macro or value{nearest(asked, names)}",
        )
    trace = summary["trace"]
    texts = []
    for number in meant:
        experiments = {trace["trials"][trial]["experiment"] for trial in number.trials}
        decide = [name for name, of in EXPERIMENTS_BY_SETTING.items() if experiments & {*of}]
        settings = {
            name: value
            for name, value in summary["settings"].items()
            if name.startswith((*decide,))
        }
        facts = {"number": number, "settings": settings, "changed": changed_lines(summary)}
        texts.append(template("trace.j2").render(facts, summary=summary, trace=trace))
    return "\n\n".join(texts)
