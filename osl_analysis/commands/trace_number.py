"""From which files, trials and settings a headline number comes, by the trace of `summary.json`."""

from collections.abc import Iterator, Mapping
from typing import Any

from osl_analysis.campaign.origin import EXPERIMENTS_BY_SETTING
from osl_analysis.campaign.trace import DIGITS
from osl_analysis.config.experiments import experiments_of
from osl_analysis.errors import InputError, nearest
from osl_analysis.report.numbers import Number, macro_name, numbers_in_summary
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
        if name in (number.name, macro_name(number.name), number.texts[0], number.text)
    ]
    if not meant:
        names = [number.name for number in numbers]
        raise InputError(
            f"{asked}: no number of these results; name one, as summary.json does, or its macro or"
            f" value{nearest(asked, names)}"
        )
    return "\n".join(line for number in meant for line in trace_lines(summary, number))


def trace_lines(summary: Mapping[str, Any], number: Number) -> Iterator[str]:
    """Where one number comes from."""
    trace = summary["trace"]
    yield f"{number.name} = {number.text} {number.unit}: {number.meaning}"
    yield f"table: tables/{number.table}.csv; {number.doubts or 'no trial left out as doubtful'}"
    digests = trace["recordings"] | trace["stated"]
    for trial in number.trials or trace["trials"]:
        files = [f"{file} {digests[file][:DIGITS]}" for file in trace["trials"][trial]]
        yield f"trial {trial}: {', '.join(files)}"
    experiments = experiments_of(number.table)
    decide = tuple(name for name, of in EXPERIMENTS_BY_SETTING.items() if experiments & {*of})
    settings = [
        f"{name} {value}" for name, value in summary["settings"].items() if name.startswith(decide)
    ]
    yield f"settings: {', '.join(settings)}"
    yield from changed_lines(summary)
    stated = [f"{name} {trace['stated'][name][:DIGITS]}" for name in ("configuration", "sheet")]
    of_code = [f"{name} {text}" for name, text in (trace["code"] | trace["libraries"]).items()]
    yield f"digests: all {summary['digest']}, {', '.join(stated)}"
    yield f"code: {', '.join(of_code)}"
