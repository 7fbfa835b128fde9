"""Losses of a log, counted while it is read and reported in the trial's provenance under `damage`."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

MOST_REMARKS = 20


@dataclass
class Damage:
    """The counts of one file."""

    finished: bool = False
    """The recorder closed the file. If it did not, nobody knows what is missing."""
    gaps: bool = False
    """Some part of the file cannot be read or is missing; the summary counts as a part."""
    declared_messages: int | None = None
    """Messages in the file according to its statistics record; None without one that can be trusted."""
    declared: Counter[int] | None = None
    """The same for each channel; None where the statistics do not tell."""
    declared_chunks: int | None = None
    """Chunks in the file according to its summary; None without a summary that can be trusted."""
    read: Counter[int] = field(default_factory=Counter)
    """Messages of each channel that were read."""
    verified: int = 0
    """Messages that were read and are covered by a checksum that was right."""
    misfits: Counter[int] = field(default_factory=Counter)
    """Messages of each channel that were read and do not fit their own schema; they count as lost."""
    chunks: int = 0
    """Chunks that were read."""
    chunks_lost: int = 0
    """Chunks that were found and could not be read."""
    indexed_lost: Counter[int] = field(default_factory=Counter)
    """Lost messages of each channel, as far as an index lists them."""
    uncounted: bool = False
    """Something was lost, and no index tells how many messages it held."""
    bytes: int = 0
    """Bytes of the file's data section."""
    bytes_lost: int = 0
    """Bytes of the data section that could not be read, without those at the end of a file that was cut off."""
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

    def lose(self, remark: str, size: int, messages: Counter[int] | None, chunks: int) -> None:
        """Count a lost stretch: bytes, messages of each channel (None if their number is not known), chunks."""
        self.remark(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.uncounted |= messages is None
        self.indexed_lost.update(messages or {})

    @property
    def messages(self) -> int:
        """Messages that were read."""
        return self.read.total()

    def messages_lost(self, channels: Collection[int] | None = None) -> int | None:
        """Lost messages of some channels, of all if none are named; None where the file does not tell how many.

        A file that was not closed never tells. Else the statistics record tells, or the message indexes do.
        """
        if not self.finished:
            return None
        if self.declared_messages is not None and channels is None:
            return max(0, self.declared_messages - self.messages) + self.misfits.total()
        if self.declared is not None and channels is not None:
            return sum(max(0, self.declared[one] - self.read[one]) + self.misfits[one] for one in channels)
        if self.declared_messages is not None and self.declared_messages == self.messages:
            return self.known_lost(channels)
        return None if self.uncounted or self.declared_messages is not None else self.known_lost(channels)

    def knows_of_missing_chunks(self) -> bool:
        """Whether the summary knows of more chunks than were found, and nothing tells what they held."""
        return self.declared_messages is None and (self.declared_chunks or 0) > self.chunks + self.chunks_lost

    def known_lost(self, channels: Collection[int] | None) -> int:
        """Messages of some channels, of all if none are named, that are certainly lost."""
        chosen = self.indexed_lost.keys() | self.misfits.keys() if channels is None else channels
        return sum(self.indexed_lost[one] + self.misfits[one] for one in chosen)

    def share_lost(self, channels: Collection[int] | None = None) -> float:
        """Lost share of the messages of some channels, of all if none are named.

        Where the file does not tell how many are lost, the lost share of all messages, or else of the bytes, stands
        for them if it is larger. What may be missing at the end of a file that was not closed counts for nothing: no
        byte of it is there.
        """
        lost = self.messages_lost(channels)
        certain = self.known_lost(channels) if lost is None else lost
        channels = self.read.keys() if channels is None else channels
        sound = sum(self.read[one] - self.misfits[one] for one in channels)
        share = certain / max(1, sound + certain)
        if lost is not None or not (self.uncounted or self.finished):
            return share
        total = self.messages_lost()
        others = 0.0 if total is None else total / max(1, self.messages - self.misfits.total() + total)
        return min(1.0, max(share, others, self.bytes_lost / max(1, self.bytes)))

    def contradicted(self) -> bool:
        """Whether the file holds other messages than its statistics record declares, also more of them."""
        of_channels = self.declared is not None and +self.declared != +self.read
        return of_channels or self.declared_messages not in (None, self.messages)

    def all_chunks_lost(self) -> int | None:
        """Lost chunks, also those that only the summary knows of; None in a file that was not closed."""
        if not self.finished:
            return None
        return max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks)

    def crc(self) -> str:
        """Whether checksums cover what was read: checked, mixed or absent."""
        if self.verified == self.messages and self.messages:
            return "checked"
        return "mixed" if self.verified else "absent"

    def report(self, topics: dict[str, Collection[int]]) -> dict[str, Any]:
        """The provenance's `damage`, with the channels of each topic that is used.

        `complete`: the recorder finished the file and all of it can be read; `crc`: "checked", "absent" (what was
        read is not verifiable) or "mixed"; `chunks_lost` and `messages_lost`, null if the file does not tell;
        `share_lost`, the largest of the topics; `topics` with `messages` and `messages_lost` each; `remarks`, a
        sentence each.
        """
        lost = self.messages_lost()
        return {
            "complete": lost == 0 and self.all_chunks_lost() == 0 and not self.gaps and not self.contradicted(),
            "crc": self.crc(),
            "chunks_lost": self.all_chunks_lost(),
            "messages_lost": lost,
            "share_lost": max((self.share_lost(channels) for channels in topics.values()), default=self.share_lost()),
            "topics": {
                topic: {
                    "messages": sum(self.read[one] for one in channels),
                    "messages_lost": self.messages_lost(channels),
                }
                for topic, channels in topics.items()
            },
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
