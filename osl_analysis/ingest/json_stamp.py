"""A stamp in lines of JSON that is an object of whole seconds and nanoseconds, as messages of ROS have it."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.json_lines import DecodedLines, JsonLines
from osl_analysis.ingest.stamps import LAST_SECOND, SECOND, stamp_fields
from osl_analysis.ingest.table_log import TableColumn

Parts = tuple[str, str]
"""Paths of the seconds and of the nanoseconds."""


def stamps_among(names: Collection[str]) -> Mapping[str, Parts]:
    """The stamps among several paths, by the path of the object, the shortest way first."""
    above = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
    found = {path: parts for path in above for parts in stamp_fields(path) if path and set(parts) <= set(names)}
    return dict(sorted(found.items(), key=lambda one: one[0].count(".")))


def stamp_column(lines: JsonLines, decoded: DecodedLines, parts: Parts) -> TableColumn:
    """The stamps [ns] as one column; a line that lacks one of the parts has none.

    Raises
    ------
    InputError
        A part is not a whole number, or too large for one.
    """
    for name, most in zip(parts, (LAST_SECOND, SECOND), strict=True):
        values, there = decoded.values[name], decoded.present[name]
        numbers = np.where(there, values, 0).astype(np.float64)
        wrong = there & ((np.abs(numbers) > most) | (numbers != np.rint(numbers)) | (values.dtype == bool))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                f"{lines.path}: field '{name}' is {values[row]} in line {lines.numbers[decoded.rows[row]]}, which is "
                f"no whole number from 0 to {most}; name another time, or state the rate: `time: {{rate: 1000}}`"
            )
    there = decoded.present[parts[0]] & decoded.present[parts[1]]
    seconds, nanoseconds = (np.where(there, decoded.values[name], 0).astype(np.int64) for name in parts)
    return TableColumn(seconds * SECOND + nanoseconds, there, "ns")


def without_other_lines(lines: JsonLines, decoded: DecodedLines, names: Sequence[str]) -> tuple[DecodedLines, str]:
    """The lines that have one of the fields at least, and a sentence on the others, such as a header; empty if none."""
    kept = np.any([decoded.present[name] for name in names], axis=0)
    if kept.all():
        return decoded, ""
    first = lines.numbers[decoded.rows[int(np.argmin(kept))]]
    count = int((~kept).sum())
    note = (
        f"{lines.path.name}: {count} of {kept.size} lines have none of the fields and were left out, first line {first}"
    )
    values = {name: one[kept] for name, one in decoded.values.items()}
    present = {name: one[kept] for name, one in decoded.present.items()}
    return DecodedLines(decoded.rows[kept], values, present, decoded.misfits, decoded.misfit), note
