"""What a run found, in ten lines for a terminal. The page and `findings.csv` have all of it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from osl_analysis.judge.finding import UNITS_OF_ESTIMATES
from osl_analysis.judge.summary_findings import CampaignFinding, findings_in_summary
from osl_analysis.report.decimal_places import RANGE
from osl_analysis.report.headline import Headline, headlines_in_summary
from osl_analysis.report.headline_text import written_number

WIDTH = 100  # signs of a line
MOST_FINDINGS = 5  # lines on findings: with the others a run tells itself in ten
ERRORS_OF_BENCH = {"K/K_d - 1": "K_bias", "|B - B_d|": "B_error"}
"""Errors of the bench, and how the names of their headline numbers begin; `_` and the controller
follow where the sheet states one."""
ESTIMATES_OF_BENCH = {"K": "K_example", "B": "B_example"}
"""The same of one condition, where no K_d is stated."""
WALKING = {"K": "walking_K", "B": "walking_B"}
INGEST_ONLY = "ingest_only"
"""The experiment whose trials are ingested and checked, and not fitted."""
ACTUATOR = {"k_tau n_m": "k_tau_n_m"}  # of a campaign of actuators alone
UNCHECKED = "not checked"
IN_PART = "doubtful in part"
MARKS = {"doubtful": "⚠", IN_PART: "⚠", "flagged": "⚠", "remark": "·"}
"""Marks of findings by verdict. What could not be checked has one line in all."""
OF_GROUPS = "walking_groups"
"""The table whose findings are on groups of trials, not on trials."""


def brief_lines(summary: Mapping[str, Any]) -> list[str]:
    """Say what a run found.

    Parameters
    ----------
    summary
        The content of `summary.json`.

    Returns
    -------
    list of str
        At most ten lines of at most 100 signs: trials that are clear, doubtful and left out; K and
        B with intervals; each finding with its size in the worst trial and what to do.
    """
    lines = [trials_line(summary), *numbers_lines(headlines_in_summary(summary))]
    lines += findings_lines(findings_in_summary(summary))
    return [shortened(line) for line in lines]


def findings_lines(findings: Sequence[CampaignFinding]) -> Iterator[str]:
    """A line for each of the first findings, and one for all that could not be checked."""
    marked = [finding for finding in findings if finding.verdict in MARKS]
    unchecked = [finding for finding in findings if finding.verdict == UNCHECKED]
    for finding in marked[:MOST_FINDINGS]:
        yield finding_line(finding)
    if len(marked) > MOST_FINDINGS:
        yield f"⚠ and {len(marked) - MOST_FINDINGS} more, which the page lists"
    if unchecked:
        yield unchecked_line(unchecked)


def trials_line(summary: Mapping[str, Any]) -> str:
    """How many trials are clear, doubtful, doubtful in part, flagged, left out, and ingested
    without being judged."""
    by_verdict: dict[str, set[str]] = {"doubtful": set(), IN_PART: set(), "flagged": set()}
    for finding in findings_in_summary(summary):
        if finding.verdict in by_verdict and finding.table != OF_GROUPS:
            by_verdict[finding.verdict].update(finding.trials)
    not_clear: set[str] = set()
    parts = []
    experiments = summary.get("trials", {}).values()
    left_out = {trial for counts in experiments for trial in counts["missing"]}
    for verdict, trials in by_verdict.items():
        trials = trials - left_out
        further = trials - not_clear  # a trial counts with its worst verdict
        not_clear |= trials
        if further:
            parts.append(f"{len(further)} {verdict}")
    number = ingested = 0
    for experiment, counts in summary.get("trials", {}).items():
        number += counts["of"]
        if experiment == INGEST_ONLY:
            ingested += counts["used"]
    if left_out:
        parts.append(f"{len(left_out)} refused or excluded")
    if ingested:
        parts.append(f"{ingested} ingested and not judged")
    clear = number - len(left_out) - ingested - len(not_clear)
    if clear or ingested + len(left_out) < number:
        parts.insert(0, f"{clear} clear")
    return f"{number} trial{'s' if number != 1 else ''}: {', '.join(parts)}"


def numbers_lines(numbers: Mapping[str, Headline]) -> Iterator[str]:
    """Errors of K and B by controller, and K and B of walking, with their intervals."""
    has_errors = any(name.startswith("K_bias") for name in numbers)
    begins = ERRORS_OF_BENCH if has_errors else ESTIMATES_OF_BENCH
    begin_of_K = next(iter(begins.values()))
    for name in numbers:
        if name.startswith(begin_of_K):
            controller = name.removeprefix(begin_of_K)
            names = {symbol: begin + controller for symbol, begin in begins.items()}
            is_stated = controller not in ("", "_no_controller")
            what = controller.removeprefix("_") if is_stated else "bench"
            yield numbers_line(what, names, numbers)
    if "walking_K" in numbers:
        yield numbers_line("walking", WALKING, numbers)
    elif "k_tau_n_m" in numbers and not any(name.startswith(begin_of_K) for name in numbers):
        yield numbers_line("actuator", ACTUATOR, numbers)


def numbers_line(what: str, names: Mapping[str, str], numbers: Mapping[str, Headline]) -> str:
    """Some headline numbers with their intervals; `names` has their keys by symbol. The kind of the
    intervals is left out where the line would be too long."""
    parts = []
    kinds: set[str] = set()  # of the intervals
    for symbol, name in names.items():
        if name not in numbers:
            continue
        estimate = numbers[name].estimate
        written = written_number(estimate)
        part = f"{symbol} = {written.value} {numbers[name].label.unit}"
        if written.interval:
            part += f" ({written.interval})"
            kinds.add("by trial" if estimate.interval == RANGE else "95 %")
        parts.append(part)
    line = f"{what}: {', '.join(parts)}"
    with_kind = f"{line} {' and '.join(sorted(kinds))}".rstrip()
    return with_kind if len(with_kind) <= WIDTH else line


def finding_line(finding: CampaignFinding) -> str:
    """`⚠ friction: 16 of 32 impedance trials, B by up to 1.7 N*m*s/rad → report the viscous
    damping`.

    Without the size where the line would be too long.
    """
    is_in_part = finding.verdict == IN_PART
    cause = f"{finding.cause}, in some rows" if is_in_part else finding.cause
    counts = f"{len(finding.trials)} of {finding.n} {finding.kind}"
    problem = f"{MARKS[finding.verdict]} {cause}: {counts}"
    remedy = "leave out rows marked doubtful" if is_in_part else finding.brief
    end = f" → {remedy}" if remedy else ""
    size = largest_size_text(finding.numbers)
    if not size:
        return f"{problem}{end}"
    line = f"{problem}, {size}{end}"
    return line if len(line) <= WIDTH else f"{problem}{end}"


def largest_size_text(numbers: Mapping[str, float]) -> str:
    """By how much a finding with these numbers moves that estimate which it moves most, as a share
    of the estimate without it; K where no such estimate is known."""
    largest_share = -1.0
    text = ""
    for symbol, unit in UNITS_OF_ESTIMATES.items():
        size = numbers.get(f"{symbol}_size")
        if size is None:
            continue
        without = numbers.get(f"{symbol}_without")
        share = size / abs(without) if without else 0.0
        if share > largest_share:
            largest_share = share
            text = f"{symbol} by up to {size:.2g} {unit}"
    return text


def unchecked_line(findings: Sequence[CampaignFinding]) -> str:
    """The most frequent thing that could not be checked, and how many others there are."""
    causes = list(dict.fromkeys(finding.cause for finding in findings))
    if len(causes) == 1:
        return f"not checked: {causes[0]}"
    return f"not checked: {causes[0]}; and {len(causes) - 1} more on the page"


def shortened(line: str) -> str:
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…"
