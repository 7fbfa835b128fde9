"""What a draft of a source file leaves to the user, and how it marks that."""

import re
from collections.abc import Iterator
from typing import Any

UNKNOWN = "UNKNOWN"  # a value that the file does not tell
NAME_OF_TIME = "NAME_OF_TIME"  # the column of time, if no column is named like a clock


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that the user must still edit: placeholder names and unknown values."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        place = (*above, str(key))
        is_unnamed = re.fullmatch(r"NAME_\d+", str(key)) is not None
        is_unknown = value == UNKNOWN and key in ("unit", "rate", "corners", "axes")
        if is_unnamed or is_unknown or value == NAME_OF_TIME:
            yield place
        else:
            yield from open_places(value, place)
