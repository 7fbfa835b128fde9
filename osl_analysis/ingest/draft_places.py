"""What a drafted source file leaves to its user, and the refusal of a draft that was not edited."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from osl_analysis.columns import COLUMNS
from osl_analysis.errors import InputError, listing
from osl_analysis.yaml_places import dotted, line_of

UNKNOWN = "UNKNOWN"
"""Stands where the file does not tell a value."""
NAME_OF_TIME = "NAME_OF_TIME"
"""Stands for the column of time where no column is called like a clock."""
UNNAMED = re.compile(r"NAME_\d+")
"""Stands for the canonical name of a channel."""
STATED = ("unit", "extra_cells", "counts")
"""Fields in which `UNKNOWN` is what a draft leaves open. Elsewhere it may be a name in the recording."""
LISTED = 6
"""Largest number of places in a message."""


def refuse_draft(path: Path, content: dict[str, Any]) -> None:
    """Refuse a source file in which places of a draft are not edited.

    Raises
    ------
    InputError
        Such places are left; the message lists them with their lines.
    """
    places = list(open_places(content))
    if places:
        named = listing([f"`{dotted(place)}` in line {line_of(path, place)}" for place in places], LISTED)
        raise InputError(
            f"{path}: a draft of `osl-analysis inspect` in which {len(places)} places are to be edited: {named}; give "
            f"each signal that you need its canonical name ({', '.join(c for c in COLUMNS if c != 'time')}), state "
            f"each {UNKNOWN}, and delete the other lines of `channels`"
        )


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that are not edited yet: channels without a name, and what is UNKNOWN."""
    for key, value in content.items() if isinstance(content, dict) else ():
        place = (*above, str(key))
        if UNNAMED.fullmatch(str(key)) or (value == UNKNOWN and key in STATED) or value == NAME_OF_TIME:
            yield place
        else:
            yield from open_places(value, place)
