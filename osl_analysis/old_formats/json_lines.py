"""JSON lines: one object of JSON per line, with numbers at any depth."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.old_formats.csv_table import utf8_of
from osl_analysis.old_formats.message_fields import Columns, Indices, Reader, fields_in, json_object
from osl_analysis.old_formats.table import Ledger

# of an array that are listed: longer ones are images or whole recordings, and no signals
MOST_ELEMENTS = 64


@dataclass(frozen=True)
class JsonLines:
    texts: list[bytes]  # in UTF-8, without line breaks
    numbers: Indices  # number of each in the file, counted from 1
    damage: Ledger  # what was left out


def is_json_lines(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is JSON lines: an object in its first line, and
    in the second."""
    first, _, rest = utf8_of(begin).lstrip().partition(b"\n")
    return first.startswith(b"{") and rest.lstrip().startswith(b"{") and is_whole(first)


def read_json_lines(path: Path) -> JsonLines:
    """The lines of a file. A last line that breaks off, as a killed logger leaves it, is left
    out."""
    every, damage = utf8_of(path.read_bytes()).split(b"\n"), Ledger(end_unknown=True)
    numbered = [(number, text) for number, text in enumerate(every, 1) if text.strip(b" \t\r\n")]
    if numbered and every[-1] and not is_whole(numbered[-1][1]):
        damage.miss_end(f"the last line, {numbered.pop()[0]}, breaks off and was left out")
    if not numbered:
        raise InputError("holds no whole line; record it again, or exclude the trial")
    return JsonLines(
        [text for _, text in numbered], np.array([number for number, _ in numbered]), damage
    )


def is_whole(text: bytes) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def decode_lines(lines: JsonLines, paths: Sequence[str]) -> Columns:
    """The fields at `paths` (`variables.ankle_angle`, `position[0]`) of all lines."""
    reader = Reader([*dict.fromkeys(paths)], json_object, lines.numbers)
    reader.take(lines.texts)
    found = reader.columns()
    remedy = (
        "name a number as `field` in the source file; for time, or state the rate: `time: {rate:"
        " 1000}`"
    )
    if not found.rows.size:
        raise InputError(f"{found.misfit}; {remedy}")
    if skipped := found.misfits:
        said = (
            f"{skipped} of {len(lines.texts)} lines cannot be used and were skipped: {found.misfit}"
        )
        lines.damage.lose(said, 0, Counter({0: skipped}), 0)
        # one that is no JSON may be the rest of several
        broken = np.setdiff1d(np.arange(len(lines.texts)), found.rows)
        lines.damage.uncounted = not all(is_whole(lines.texts[row]) for row in broken.tolist())
    for path in [path for path, values in found.values.items() if np.ma.getmaskarray(values).all()]:
        if found.misfit:
            raise InputError(
                f"no line that can be used has a field '{path}': {found.misfit}; {remedy}"
            )
        names, _ = addresses_of(lines)
        advice = nearest(path, names) or "; correct `field` in the source file"
        raise InputError(f"no line has a field '{path}'; there are {listing(names)}{advice}")
    return found


def addresses_of(lines: JsonLines) -> tuple[list[str], dict[str, int]]:
    """Every number in the lines, of long files in 2000 of them, in the order in which they appear;
    and the arrays of which only the first elements are among these, with their lengths."""
    found, long = dict[str, None](), dict[str, int]()
    for row in np.unique(np.linspace(0, len(lines.texts) - 1, 2000).astype(np.int64)).tolist():
        with suppress(ValueError, RecursionError):
            for one in fields_in(json.loads(lines.texts[row]), MOST_ELEMENTS, long):
                found.update(dict.fromkeys(one.addresses()))
    return list(found), long
