"""Limits on what a MATLAB file may unpack to, so that no file needs more memory or time than its size justifies."""

from dataclasses import dataclass

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import FREE_TOTAL, TOTAL_RATIO

FREE_ELEMENTS = 1 << 17
"""Arrays, cells and fields of structs that a file may hold whatever its size is ..."""
BYTES_OF_ELEMENT = 8
"""... and bytes of the file for each further one. One takes 56 bytes before compression."""
DEEPEST = 32
"""Structs and cells inside one another."""
REMEDY = "save only the variables that you need, with `save('file.mat', 'x', 'y')`"


@dataclass
class MatBudget:
    """What may still be unpacked from one file."""

    file_bytes: int
    """Size of the file."""
    taken_bytes: int = 0
    """Bytes that were unpacked so far."""
    elements: int = 0
    """Arrays, cells and fields that were found so far."""

    @property
    def left_bytes(self) -> int:
        """Bytes that may still be unpacked."""
        return FREE_TOTAL + TOTAL_RATIO * self.file_bytes - self.taken_bytes

    def take_bytes(self, what: str, size: int) -> None:
        """Count `size` bytes before they are unpacked; `what` is for the message.

        Raises
        ------
        InputError
            They are more than are left.
        """
        if size > self.left_bytes:
            most = FREE_TOTAL + TOTAL_RATIO * self.file_bytes
            raise InputError(
                f"{what} unpacks to more than the {most} bytes that are unpacked from a file of {self.file_bytes} "
                f"bytes; {REMEDY}"
            )
        self.taken_bytes += size

    def take_elements(self, count: int) -> None:
        """Count arrays, cells and fields.

        Raises
        ------
        InputError
            They are more than a file of its size can hold for a reason.
        """
        self.elements += count
        most = FREE_ELEMENTS + self.file_bytes // BYTES_OF_ELEMENT
        if self.elements > most:
            raise InputError(f"holds more than {most} arrays, too many for a file of {self.file_bytes} bytes; {REMEDY}")
