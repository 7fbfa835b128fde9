"""Tables of `walking_validation.md`: what each imperfection of a campaign does to its headline, and who says so."""

import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from walking_campaigns import ACCEPTED, Campaign, Group, Verdict
from walking_cases import TABLES, Case

from osl_analysis.errors import OslAnalysisError

SILENT = "**silently wrong**"


def headline_table(name: str, words: Iterable[str] = ()) -> str:
    """One table, or its rows that have one of the words in their labels."""
    lines = [line(["", "K, % (SE)", "B, % (SE)", "I, 10⁻³ kg·m² (SE)", "used", "", "what is said"]), line(["---"] * 7)]
    for case in TABLES[name]:
        if not words or any(word in case.label for word in words):
            started = time.monotonic()
            for row in rows_of(case):
                lines.append(row)
                print(row, flush=True)
            print(f"  ({time.monotonic() - started:.0f} s)", flush=True)
    return "\n".join(lines)


def rows_of(case: Case) -> Iterable[str]:
    """The rows of one campaign: as recorded, and with what the user can state."""
    with tempfile.TemporaryDirectory(dir="/tmp") as place:
        campaign = Campaign(case, Path(place) / "campaign")
        try:
            campaign.record()
        except OslAnalysisError as refusal:
            yield line([case.label, "", "", "", "", "not simulated", str(refusal)])
            return
        yield from verdict_rows(case.label, campaign.analyse(case.asked))
        if case.remedy:
            yield from verdict_rows(f"… {case.remedy.label}", campaign.analyse(case.remedy))


def verdict_rows(label: str, verdict: Verdict) -> Iterable[str]:
    """A row for each group of the campaign."""
    if verdict.refused:
        yield line([label, "–", "–", "–", "–", "refused", "; ".join([verdict.refused, *verdict.says])])
        return
    split = len(verdict.groups) > 1
    for k, group in enumerate(verdict.groups):
        name = f"{label if k == 0 else '…'} [{group.name}]" if split else label
        said = "; ".join(verdict.says) if k == 0 else ""
        yield line([name, *cells(group), str(verdict.used), word(group, verdict), said or "–"])


def cells(group: Group) -> list[str]:
    """Error of each quantity and, in brackets, in stated standard errors."""
    scaled = {q: (1e3 * e if q == "I" else e, z) for q, (e, z) in group.errors.items()}
    return [f"{scaled[q][0]:.1f} ({scaled[q][1]:.1f})" if q in scaled else "–" for q in ACCEPTED]


def word(group: Group, verdict: Verdict) -> str:
    """Whether a reader of the headline is misled."""
    if not group.errors:
        return "no result"
    if not group.wrong:
        return "right, but doubtful" if group.doubts else "right"
    if group.doubts:
        return "doubtful"
    if verdict.failed:
        return "flagged"
    return SILENT


def line(columns: Iterable[str]) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(text.replace("|", "/") for text in columns) + " |"
