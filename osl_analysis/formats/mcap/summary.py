"""The summary at the end of an MCAP file: how many messages and chunks its recorder wrote, as evidence of losses."""

import struct
from collections import Counter
from dataclasses import dataclass, field

from mcap.opcode import Opcode

from osl_analysis.formats.mcap.walk import RECORD, Buffer, crc_of

STATISTICS = struct.Struct("<Q14xI16xI")  # messages, chunks, bytes of the map of messages by channel
OF_CHANNEL = struct.Struct("<HQ")


@dataclass
class Summary:
    """What the summary of a file says."""

    described: list[tuple[int, int, int]] = field(default_factory=list)
    """Opcode, start and end of its schemas and channels."""
    messages: int | None = None
    """How many messages the recorder wrote; None without a statistics record that can be trusted."""
    by_channel: Counter[int] | None = None
    """The same for each channel; None where the record does not tell."""
    chunks: int | None = None
    """How many chunks the recorder wrote; None without a statistics record that can be trusted."""
    indexed_chunks: int = 0
    """How many chunks the index of chunks has; a file may have none."""
    checked: bool = False
    """A checksum covers it and is right."""
    damaged: bool = False
    """It cannot be trusted."""
    begin: int = 0
    """Where it begins: after the record that ends the data; 0 if there is none."""
    missing: int = 0
    """Bytes by which it stands before the place at which the recorder put it; negative if it stands after."""

    def all_chunks(self) -> int | None:
        """How many chunks the file should have; None where nothing tells."""
        return max(self.chunks or 0, self.indexed_chunks) or self.chunks


def take_summary_record(summary: Summary, data: Buffer, opcode: int, start: int, end: int) -> None:
    """Take in a record that tells how much the recorder wrote."""
    if opcode == Opcode.CHUNK_INDEX:
        summary.indexed_chunks += 1
    elif opcode == Opcode.STATISTICS:
        summary.messages, summary.chunks, size = STATISTICS.unpack_from(data, start)
        summary.by_channel = counts_by_channel(data[start + STATISTICS.size : min(start + STATISTICS.size + size, end)])
        if summary.by_channel is not None and summary.by_channel.total() != summary.messages:
            summary.by_channel = None  # the map may be left empty


def counts_by_channel(entries: bytes) -> Counter[int] | None:
    """Messages of each channel, from the map of a statistics record; None if it is cut short."""
    if len(entries) % OF_CHANNEL.size:
        return None
    return Counter(dict(OF_CHANNEL.iter_unpack(entries)))


def check_footer(summary: Summary, data: Buffer, start: int) -> None:
    """Check the summary by the footer whose content begins at `start`; ignore what a damaged summary declares.

    The footer tells where the summary begins, and has its checksum unless that is 0. If the summary stands elsewhere,
    bytes are missing before it, or were inserted. It then still tells what the recorder wrote.
    """
    footer = start - RECORD.size
    declared, _, expected = struct.unpack_from("<QQI", data, start)
    begin = declared or footer
    if not (begin >= summary.begin and leads_to(data, begin, footer)):
        summary.damaged |= not (summary.begin and leads_to(data, summary.begin, footer))
        summary.missing = begin - summary.begin
        begin = summary.begin
    if expected and not summary.damaged:
        summary.checked = crc_of(data, begin, start + 16) == expected
        summary.damaged = not summary.checked
    if summary.damaged:
        summary.messages, summary.by_channel, summary.chunks = None, None, None
        summary.indexed_chunks, summary.missing = 0, 0


def leads_to(data: Buffer, position: int, footer: int) -> bool:
    """Whether the records from a position on lead to the footer."""
    while position + RECORD.size <= footer:
        position += RECORD.size + RECORD.unpack_from(data, position)[1]
    return position == footer
