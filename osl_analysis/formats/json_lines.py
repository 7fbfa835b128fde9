# SPDX-License-Identifier: Apache-2.0
"""JSON lines: one object of JSON per line, with numbers at any depth."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import Field

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import End, Format, Loss, Recording, Rows
from osl_analysis.base.source_file import FieldChannel, RowTime, TableSource
from osl_analysis.formats.text_cells import in_utf8
from osl_analysis.formats.topic import PLACE, Topic

LINES_AT_ONCE = 16_384  # whose objects are held in memory


class FieldTime(RowTime):
    """A field of time, or the rate of the lines."""

    ADDRESS = "field"
    # Path of the number that is time, or of a stamp of seconds and nanoseconds (no `unit`).
    field: str | None = None


class JsonChannel(FieldChannel):
    """A number of a line."""

    time: FieldTime | None = None  # Its own time, where it is not that of the others.


class JsonSource(TableSource):
    """The source file of JSON lines."""

    channels: Mapping[str, JsonChannel] = Field(min_length=1)
    time: FieldTime


def read(path: Path, source: JsonSource | None) -> Recording:
    """Read the numbers of each line."""
    content = in_utf8(path.read_bytes())
    texts = content.split(b"\n")
    lengths = np.array([len(text) for text in texts])
    starts = np.cumsum(lengths + 1) - lengths - 1
    lines = np.flatnonzero([bool(text.strip()) for text in texts])
    topic = Topic("", "json")
    for first in range(0, lines.size, LINES_AT_ONCE):
        part = lines[first : first + LINES_AT_ONCE]
        topic.add((content, starts[part], lengths[part]), np.zeros_like(part), 0)
    places = topic.table[PLACE].to_numpy()
    if not places.size:
        raise InputError(
            f"{topic.reason or 'holds no whole line'}", "record it again, or exclude the trial"
        )
    remarks = []
    end = End.UNKNOWN
    if topic.lost:
        skipped = np.delete(lines, places)
        remarks.append(
            f"{topic.lost} of {lines.size} lines cannot be used and were skipped: line"
            f" {skipped[0] + 1} is not JSON: {topic.reason}"
        )
        if skipped[-1] == len(texts) - 1:  # as a killed logger leaves it
            end = End.MISSING
    rows = Rows(places.size, lines=lines[places] + 1, noun="line")
    parents = dict.fromkeys(field.rpartition(".")[0] for field in topic.types)
    return Recording(
        format="json_lines",
        channels=topic.channels(rows, {}, parents),
        loss=Loss(places.size, lines.size, end, remarks=remarks),
        facts={"rows": places.size},
        find_unlisted=topic.refuse_text,
    )


def _is_json(text: bytes) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def _begins(begin: bytes) -> bool:
    """Tell whether an object stands in the first line, and one in the second."""
    first, _, rest = in_utf8(begin).strip().partition(b"\n")
    return first.startswith(b"{") and rest.lstrip().startswith(b"{") and _is_json(first)


FORMAT = Format(
    name="json_lines",
    suffixes=(".jsonl", ".ndjson"),
    begins=_begins,
    source=JsonSource,
    read=read,
)
