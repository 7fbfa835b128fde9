"""Files in which two logs follow each other: `cat a.mcap b.mcap`, or a recorder that appends to its last file.

The number of a channel means one topic in the first log and may mean another in the second. Such files are refused.
"""

import struct

from mcap.opcode import Opcode

from osl_analysis.formats.mcap.limits import RefusedFileError
from osl_analysis.formats.mcap.walk import MAGIC, RECORD, Buffer

REMEDY = "split them into two files there (`head -c`, `tail -c`) and give each a trial of its own"


def refuse_second_log(data: Buffer, begin: int, end: int) -> None:
    """Refuse a file in which another log begins between two places.

    Raises
    ------
    RefusedFileError
        A log begins there: its magic, with a header after it.
    """
    place = data.find(MAGIC, begin, min(len(data), end + len(MAGIC)))
    while place >= 0:
        start = place + len(MAGIC) + RECORD.size
        if start <= len(data):
            opcode, length = RECORD.unpack_from(data, place + len(MAGIC))
            if opcode == Opcode.HEADER and is_header(data, start, start + length):
                raise RefusedFileError(f"holds two logs, the second from byte {place} on: {REMEDY}")
        place = data.find(MAGIC, place + 1, min(len(data), end + len(MAGIC)))


def refuse_more(data: Buffer, footer_end: int) -> None:
    """Refuse a file that goes on after its end: a footer, and the magic that closes the file.

    Raises
    ------
    RefusedFileError
        Bytes follow.
    """
    end = footer_end + len(MAGIC)
    if data[footer_end:end] == MAGIC and len(data) > end:
        if data[end : end + len(MAGIC)] == MAGIC:
            raise RefusedFileError(f"holds two logs, the second from byte {end} on: {REMEDY}")
        raise RefusedFileError(
            f"ends at byte {end} and has {len(data) - end} bytes after it; if they are nothing, keep what is before "
            f"them (`head -c {end}`), else record again"
        )


def refuse_second_header(data: Buffer, start: int, end: int) -> None:
    """Refuse a file with a header that is not its first record; the content of the record is given.

    Raises
    ------
    RefusedFileError
        The content is that of a header.
    """
    if is_header(data, start, end):
        raise RefusedFileError(f"holds two logs, the second from byte {start - RECORD.size} on: {REMEDY}")


def is_header(data: Buffer, start: int, end: int) -> bool:
    """Whether the content of a record is a header: the lengths of its two texts leave nothing over."""
    if end > len(data) or end - start < 8:
        return False
    (profile,) = struct.unpack_from("<I", data, start)
    library = start + 4 + profile
    return library + 4 <= end and bool(library + 4 + struct.unpack_from("<I", data, library)[0] == end)
