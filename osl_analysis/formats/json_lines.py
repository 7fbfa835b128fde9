"""JSON lines: one object of JSON per line, with numbers at any depth."""

import json
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from osl_analysis.errors import InputError
from osl_analysis.formats._messages import SECOND_NS, STAMP_PARTS, masked, numbers_in
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import FieldChannel, RowTime, TableSource
from osl_analysis.units import name_and_ending


class FieldTime(RowTime):
    """A field of time, or the rate of the lines."""

    ADDRESS = "field"
    field: str | None = None


class JsonSource(TableSource):
    """The source file of JSON lines."""

    OF = " of format json_lines"
    channels: Mapping[str, FieldChannel] = Field(min_length=1)
    time: FieldTime


def read(path: Path, source: JsonSource | None) -> Recording:
    """Read the numbers of each line."""
    texts = path.read_bytes().removeprefix(b"\xef\xbb\xbf").splitlines()
    lines: list[dict[str, Any]] = []
    numbers: list[int] = []
    for number, text in enumerate(texts, start=1):
        with suppress(ValueError, RecursionError):
            lines.append(dict(numbers_in(json.loads(text))))
            numbers.append(number)
    if not lines:
        raise InputError("holds no line of JSON; record it again, or exclude the trial")
    rows = Rows(len(lines), lines=np.array(numbers), noun="line")
    columns = {
        field: masked([line.get(field) for line in lines])
        for field in dict.fromkeys(field for line in lines for field in line)
    }
    channels = []
    for field, values in columns.items():
        name = field.partition("[")[0].rpartition(".")[2]
        unit = name_and_ending(name)[1]
        read_values = partial(np.asanyarray, values)
        channels.append(Channel({"field": field}, rows, read_values, name=name, likely_unit=unit))
    for field in columns:
        for seconds, rest in STAMP_PARTS:
            parent, dot, last = field.rpartition(".")
            other = f"{parent}.{rest}"
            if dot and last == seconds and other in columns:
                stamps = columns[field].astype(np.int64) * SECOND_NS + columns[other].astype(
                    np.int64
                )
                channels.append(
                    Channel(
                        {"field": parent},
                        rows,
                        partial(np.asanyarray, stamps),
                        name=parent,
                        unit="ns",
                        kind=Kind.CLOCK,
                    )
                )
    lost = sum(bool(text.strip()) for text in texts) - len(lines)
    remarks = [f"{lost} lines are no JSON and were skipped"] if lost else []
    loss = Loss(len(lines), len(lines) + lost, End.UNKNOWN, remarks=remarks)
    return Recording("json_lines", channels, loss, facts={"rows": str(rows.count)})


def _begins(begin: bytes) -> bool:
    """Tell whether an object stands in the first line, and one in the second."""
    first, _, rest = begin.lstrip(b"\xef\xbb\xbf \r\n").partition(b"\n")
    return first.startswith(b"{") and first.rstrip().endswith(b"}") and rest.lstrip()[:1] == b"{"


FORMAT = Format(
    name="json_lines",
    suffixes=(".jsonl", ".ndjson"),
    begins=_begins,
    source=JsonSource,
    read=read,
    priority=2,
)
