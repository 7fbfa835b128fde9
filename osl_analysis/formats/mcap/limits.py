"""Limits on what a file may unpack to, so that no file needs more memory or time than its size justifies.

A chunk may declare any size, and zeros compress ten thousandfold. Sizes are checked before anything is unpacked, and
`chunk.py` never unpacks more than was declared. Recorders write chunks of 1 to 8 MB that compress two- to twentyfold.
"""

from dataclasses import dataclass

from osl_analysis.errors import InputError

MEGABYTE = 1 << 20
LARGEST_CHUNK = 64 * MEGABYTE
"""Bytes to which a compressed chunk may unpack. One holds a message of any size, such as an image, and little else."""
SMALL_CHUNK = 8 * MEGABYTE
"""Bytes to which a chunk may unpack whatever its ratio is: messages that are all alike compress very well."""
MOST_RATIO = 1000
"""Bytes to which one byte of a larger chunk may unpack."""
HIGHEST_RATIO = {b"zstd": 1 << 15, b"lz4": 255}
"""More is impossible: zstd writes a block of 128 kB in 4 bytes, lz4 255 bytes in one. The header is then wrong."""
FREE_TOTAL = 64 * MEGABYTE
"""Bytes to which a whole file may unpack whatever its size is ..."""
TOTAL_RATIO = 100
"""... and how many more for each of its bytes."""
FREE_RECORDS = 1 << 18
"""Messages, schemas and channels that a file may hold whatever its size is ..."""
BYTES_OF_RECORD = 2
"""... and bytes of the file for each further one. Times that count up take 10 bytes of a compressed message."""

REMEDY = "unpack it with `mcap decompress`, or keep the topics that you need with `mcap filter`, if you trust the file"


class WrongFieldError(InputError):
    """The source file asks for a field that cannot be a column, whatever the messages hold."""


class RefusedFileError(InputError):
    """The file as a whole is not read; what was counted until then says nothing about it."""


@dataclass
class Budget:
    """What may still be unpacked from one file."""

    file_bytes: int
    """Size of the file."""
    taken_bytes: int = 0
    """Bytes that were unpacked so far."""
    records: int = 0
    """Records that were found in them."""
    remedy: str = REMEDY
    """What to do with a file that would unpack to too much."""

    def take_chunk(self, where: int, packed: int, size: int) -> None:
        """Count a compressed chunk at byte `where` of the file before it is unpacked.

        Raises
        ------
        RefusedFileError
            The chunk, or all chunks together, would unpack to too much.
        """
        chunk = f"the chunk at byte {where} unpacks from {packed} to {size} bytes"
        if size > LARGEST_CHUNK:
            raise RefusedFileError(f"{chunk}, more than the {LARGEST_CHUNK} that are unpacked; {self.remedy}")
        if size > SMALL_CHUNK and size > MOST_RATIO * packed:
            raise RefusedFileError(f"{chunk}, more than {MOST_RATIO} times as many; {self.remedy}")
        self.taken_bytes += size
        most = FREE_TOTAL + TOTAL_RATIO * self.file_bytes
        if self.taken_bytes > most:
            raise RefusedFileError(
                f"{chunk}, and the file so far to {self.taken_bytes}; at most {most} are unpacked from a file of "
                f"{self.file_bytes} bytes; {self.remedy}"
            )

    def take_bytes(self, size: int) -> None:
        """Count bytes that were read; a damaged database can hold the same ones in many places.

        Raises
        ------
        RefusedFileError
            They are more than a file of its size can hold for a reason.
        """
        self.taken_bytes += size
        if self.taken_bytes > FREE_TOTAL + TOTAL_RATIO * self.file_bytes:
            raise RefusedFileError(
                f"more than {self.taken_bytes} bytes of messages in {self.file_bytes}; {self.remedy}"
            )

    def left_records(self) -> int:
        """Records that may still be found."""
        return FREE_RECORDS + self.file_bytes // BYTES_OF_RECORD - self.records

    def take_records(self, where: int, count: int) -> None:
        """Count the records of a chunk, or of a stretch without chunks, that begins at byte `where`.

        Raises
        ------
        RefusedFileError
            The file holds more records than a file of its size can hold for a reason.
        """
        if count > self.left_records():
            raise RefusedFileError(
                f"more than {self.records + self.left_records()} records up to the chunk at byte {where}, too many for "
                f"a file of {self.file_bytes} bytes; {self.remedy}"
            )
        self.records += count
