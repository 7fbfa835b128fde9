"""Losses of a log, counted while it is read and reported in the trial's provenance under `damage`."""

from dataclasses import dataclass, field
from typing import Any

MOST_REMARKS = 20


@dataclass
class Damage:
    """The counts of one file."""

    finished: bool = False
    """The recorder closed the file."""
    gaps: bool = False
    """Some part of the file cannot be read; the summary counts as a part."""
    declared_messages: int | None = None
    """Messages in the file according to its summary; None without a summary that can be trusted."""
    declared_chunks: int | None = None
    """Chunks in the file according to its summary; None without a summary that can be trusted."""
    messages: int = 0
    """Messages that were read."""
    verified: int = 0
    """Messages that were read and are covered by a checksum that was right."""
    misfits: int = 0
    """Messages that were read and do not fit their own schema; they count as lost."""
    chunks: int = 0
    """Chunks that were read."""
    chunks_lost: int = 0
    """Chunks that were found and could not be read."""
    messages_counted_lost: int = 0
    """Lost messages, as far as an index tells how many there were."""
    uncounted: bool = False
    """Something was lost, and no index tells how many messages it held."""
    bytes: int = 0
    """Bytes of the file's data section."""
    bytes_lost: int = 0
    """Bytes of the data section that could not be read."""
    remarks: list[str] = field(default_factory=list)
    """Faults of the file, a sentence each."""
    more_remarks: int = 0
    """Remarks beyond the first ones, which are counted only."""

    def remark(self, text: str) -> None:
        """Add a remark. The number of remarks is limited."""
        if len(self.remarks) < MOST_REMARKS:
            self.remarks.append(text)
        else:
            self.more_remarks += 1

    def lose(self, remark: str, size: int, messages: int | None, chunks: int) -> None:
        """Count a lost stretch: its bytes, its messages (None if their number is not known) and its chunks."""
        self.remark(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.uncounted |= messages is None
        self.messages_counted_lost += messages or 0

    def messages_lost(self) -> int | None:
        """Lost messages of all topics; None where neither the summary nor an index tells."""
        if self.declared_messages is not None:
            return max(0, self.declared_messages - self.messages) + self.misfits
        return None if self.uncounted else self.messages_counted_lost + self.misfits

    def share_lost(self) -> float:
        """Lost share of the messages, or of the bytes where the number of lost messages is not known."""
        lost = self.messages_lost()
        if lost is not None:
            return lost / max(1, self.messages - self.misfits + lost)
        return min(1.0, self.bytes_lost / max(1, self.bytes) + self.misfits / max(1, self.messages))

    def all_chunks_lost(self) -> int:
        """Lost chunks; where the summary declares more chunks than were found, the difference counts too."""
        return max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks)

    def crc(self) -> str:
        """Whether checksums cover what was read: checked, mixed or absent."""
        if self.verified == self.messages and self.messages:
            return "checked"
        return "mixed" if self.verified else "absent"

    def report(self) -> dict[str, Any]:
        """The provenance's `damage`.

        `complete`: the recorder finished the file and all of it can be read; `crc`: "checked", "absent" (what was
        read is not verifiable) or "mixed"; `chunks_lost`; `messages_lost`, null if the file does not tell;
        `share_lost` of the messages, of the bytes if their number is not known; `remarks`, a sentence each.
        """
        lost, share = self.messages_lost(), self.share_lost()
        return {
            "complete": self.finished and not self.gaps and lost == 0 and self.all_chunks_lost() == 0,
            "crc": self.crc(),
            "chunks_lost": self.all_chunks_lost(),
            "messages_lost": lost,
            "share_lost": share,
            "remarks": self.all_remarks(),
        }

    def all_remarks(self) -> list[str]:
        """The remarks, with those that follow from the counts of the whole file."""
        remarks = list(self.remarks)
        if self.more_remarks:
            remarks.append(f"and {self.more_remarks} more remarks")
        if self.declared_messages is not None and self.declared_messages != self.messages:
            remarks.append(f"it declares {self.declared_messages} messages and holds {self.messages}")
        if self.crc() != "checked" and self.messages:
            remarks.append(
                f"not verifiable: no checksum covers {self.messages - self.verified} of {self.messages} messages"
            )
        return remarks
