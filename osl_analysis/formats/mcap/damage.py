"""What a log has lost: counted while it is read, reported in the trial's provenance under `damage`."""

from dataclasses import dataclass, field
from typing import Any

MOST_REMARKS = 20


@dataclass
class Damage:
    """The tally of one file.

    `finished`: the recorder closed the file. `gaps`: some of it cannot be read, of the summary too.
    `declared_messages` and `declared_chunks` are what the summary says of the whole file, None without a summary
    that can be trusted. `verified` of the messages read are covered by a checksum that was right, `misfits` of them
    do not fit their own schema. `uncounted`: something was lost of which the file does not say how many messages it
    held.
    """

    finished: bool = False
    gaps: bool = False
    declared_messages: int | None = None
    declared_chunks: int | None = None
    messages: int = 0
    verified: int = 0
    misfits: int = 0
    chunks: int = 0
    chunks_lost: int = 0
    messages_counted_lost: int = 0
    uncounted: bool = False
    bytes: int = 0
    bytes_lost: int = 0
    remarks: list[str] = field(default_factory=list)
    more_remarks: int = 0

    def remark(self, text: str) -> None:
        """Note what is not as it should be; a file damaged everywhere does not fill the report."""
        if len(self.remarks) < MOST_REMARKS:
            self.remarks.append(text)
        else:
            self.more_remarks += 1

    def lose(self, remark: str, size: int, messages: int | None, chunks: int) -> None:
        """A stretch of `size` bytes is lost, with as many `messages`, None if that is not known."""
        self.remark(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.uncounted |= messages is None
        self.messages_counted_lost += messages or 0

    def messages_lost(self) -> int | None:
        """Lost messages of all topics; None where neither summary nor index tells."""
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
        """Lost chunks; more than were seen damaged where the summary declares more."""
        return max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks)

    def crc(self) -> str:
        """Whether checksums cover what was read."""
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
        """What was noted, with what follows from the whole file."""
        remarks = list(self.remarks)
        if self.more_remarks:
            remarks.append(f"and {self.more_remarks} more of the kind")
        if self.declared_messages is not None and self.declared_messages != self.messages:
            remarks.append(f"it declares {self.declared_messages} messages and holds {self.messages}")
        if self.crc() != "checked" and self.messages:
            remarks.append(
                f"not verifiable: no checksum covers {self.messages - self.verified} of {self.messages} messages"
            )
        return remarks
