"""Search for the next sound record of an MCAP file, past bytes that cannot be read."""

import re

from mcap.opcode import Opcode

from osl_analysis.formats.mcap.summary import STATISTICS
from osl_analysis.formats.mcap.walk import NUMBERED, RECORD, Buffer, is_chunk, is_message_index

LENGTHS = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
TO_RESUME_AT = {
    True: re.compile(rb"[\x06\x07\x0b].{6}\0\0|\x0f\x04\0{7}|\x02\x14\0{7}", re.DOTALL),
    False: re.compile(rb"[\x03-\x07\x0b].{6}\0\0|\x0f\x04\0{7}|\x02\x14\0{7}", re.DOTALL),
}
"""Beginnings of records at which reading can go on, in files with and without chunks."""
MOST_CANDIDATES = 500_000  # to look at when searching for where to resume: a second of work


def resume_at(data: Buffer, begin: int, candidates: int, *, chunked: bool) -> tuple[int, int]:
    """Where the next sound record begins at which the scan can go on, or the end of the file.

    `candidates` is the number of places that may be tried; the number that is left is returned.
    """
    pattern = TO_RESUME_AT[chunked]
    while candidates and (match := pattern.search(data, begin)):
        candidates -= 1
        opcode, length = RECORD.unpack_from(data, match.start())
        start = match.start() + RECORD.size
        if start + length <= len(data) and is_sound(data, opcode, start, start + length, exact=True):
            return match.start(), candidates
        begin = match.start() + 1
    return len(data), candidates


def is_sound(data: Buffer, opcode: int, start: int, end: int, *, exact: bool = False) -> bool:
    """Whether the content of a record fits its opcode. If this is uncertain, another record must follow.

    A record may be longer than this version of the format says, unless `exact` is asked for.
    """
    if opcode == Opcode.CHUNK:
        return is_chunk(data, start, end)
    if opcode == Opcode.MESSAGE_INDEX:
        return is_message_index(data, start, end, exact=exact)
    if opcode in LENGTHS:
        return end - start == LENGTHS[Opcode(opcode)] or (not exact and end - start > LENGTHS[Opcode(opcode)])
    if opcode == Opcode.STATISTICS and end - start < STATISTICS.size:
        return False
    return opcode != 0 and record_follows(data, end)


def record_follows(data: Buffer, end: int) -> bool:
    """Whether a record, or the end of the file, follows."""
    if end == len(data) or data[end] in NUMBERED:
        return True
    if data[end] == 0 or end + RECORD.size > len(data):
        return False
    return bool(end + RECORD.size + RECORD.unpack_from(data, end)[1] <= len(data))  # private, or of a later version
