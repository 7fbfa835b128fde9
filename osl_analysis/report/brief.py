"""What a run found, in a few lines for a terminal. The page and `findings.csv` have all of it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from osl_analysis.judge.summary_findings import CampaignFinding, findings_in_summary
from osl_analysis.report.numbers import numbers_in_summary

MOST_FINDINGS = 5


def brief_lines(summary: Mapping[str, Any]) -> list[str]:
    """Trials, K and B with their intervals, and each finding with its size and what to do."""
    lines = [trials_line(summary)]
    by_line: dict[str, list[str]] = {}
    for number in numbers_in_summary(summary):
        if number.line:
            by_line.setdefault(number.line, []).append(f"{number.name} {number.text}")
    lines += [f"{line}: {', '.join(texts)}" for line, texts in by_line.items()]
    return [*lines, *findings_lines(findings_in_summary(summary))]


def trials_line(summary: Mapping[str, Any]) -> str:
    """How many trials there are, are left out, and are doubtful."""
    counts = summary["trials"].values()
    left_out = {trial for of_experiment in counts for trial in of_experiment["missing"]}
    doubtful = {
        trial
        for finding in findings_in_summary(summary)
        if finding.verdict in ("doubtful", "flagged") and finding.table != "walking_groups"
        for trial in finding.trials
    }
    number = sum(of_experiment["of"] for of_experiment in counts)
    return (
        f"{number} trials: {len(doubtful - left_out)} doubtful, {len(left_out)} refused or excluded"
    )


def findings_lines(findings: Sequence[CampaignFinding]) -> Iterator[str]:
    """The first findings, each with its size in the worst trial and what to do."""
    told = [finding for finding in findings if finding.verdict != "not checked"]
    for finding in told[:MOST_FINDINGS]:
        counts = f"{len(finding.trials)} of {finding.n} {finding.kind}"
        line = ", ".join(filter(None, [counts, finding.words.size]))
        yield f"⚠ {finding.cause}: {line} → {finding.brief}"
    if len(told) > MOST_FINDINGS:
        yield f"⚠ and {len(told) - MOST_FINDINGS} more, which the page lists"
    unchecked = list(dict.fromkeys(f.cause for f in findings if f.verdict == "not checked"))
    if unchecked:
        yield f"not checked: {'; '.join(unchecked)}"
