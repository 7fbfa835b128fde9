"""What a run found, in about ten lines for a terminal. The page and `findings.csv` have all."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from osl_analysis.judge.summary_findings import CampaignFinding, findings_in_summary
from osl_analysis.report.numbers import headline_sentences, numbers_in_summary
from osl_analysis.report.verdicts import IN_PART, verdicts_sentence

MOST_FINDINGS = 3  # with verdicts, numbers and what was not checked a run tells itself in ten lines
NOT_CHECKED = "not checked"


def brief_lines(summary: Mapping[str, Any]) -> list[str]:
    """How many trials are clear, doubtful and left out, the headline numbers, and each finding with
    its size and what to do, from a `summary.json`."""
    return [
        verdicts_sentence(summary["verdicts"], summary["results_of_clear"]),
        *headline_sentences(numbers_in_summary(summary)),
        *findings_lines(findings_in_summary(summary)),
    ]


def findings_lines(findings: Sequence[CampaignFinding]) -> Iterator[str]:
    """The first findings, each with its size in the worst trial and what to do, and all that could
    not be checked."""
    doubts = [finding for finding in findings if finding.verdict != NOT_CHECKED]
    for finding in doubts[:MOST_FINDINGS]:
        mark = "·" if finding.verdict == "remark" else "⚠"
        line = f"{mark} {finding.counts}"
        if finding.verdict == IN_PART:
            yield f"{line}, in some rows → leave out rows marked doubtful"
            continue
        first_size = finding.words.size.partition(". ")[0]
        if first_size and len(finding.trials) > 1:
            first_size = f"at worst ({finding.worst}) {first_size}"
        remedy = f" → {finding.brief}" if finding.brief else ""
        yield f"{line}{f', {first_size}' if first_size else ''}{remedy}"
    if len(doubts) > MOST_FINDINGS:
        yield f"· and {len(doubts) - MOST_FINDINGS} more, which the page lists"
    unchecked = causes_not_checked(findings)
    if unchecked:
        yield f"not checked, and in no interval: {'; '.join(unchecked)}"


def causes_not_checked(findings: Sequence[CampaignFinding]) -> list[str]:
    """What could not be checked, each once."""
    return list(dict.fromkeys(f.cause for f in findings if f.verdict == NOT_CHECKED))
