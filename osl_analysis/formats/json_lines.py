"""JSON lines: one object of JSON per line, with numbers at any depth."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats._messages import stamp_fields
from osl_analysis.formats._objects import last_name, masked_numbers, numbers_in, whole_stamps
from osl_analysis.formats._text import in_utf8
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import FieldChannel, RowTime, TableSource
from osl_analysis.units import name_and_ending


class FieldTime(RowTime):
    """A field of time, or the rate of the lines."""

    ADDRESS = "field"
    # Path of the number that is time, or of a stamp of seconds and nanoseconds (no `unit`).
    field: str | None = None


class JsonSource(TableSource):
    """The source file of JSON lines."""

    channels: Mapping[str, FieldChannel] = Field(min_length=1)
    time: FieldTime


@dataclass
class Lines:
    """The numbers of a file of JSON lines."""

    numbers: list[int] = field(default_factory=list)  # of the lines that can be used, from 1
    # by field the rows that have a number, from 0, and these numbers
    values: dict[str, tuple[list[int], list[float | bool]]] = field(default_factory=dict)
    lost: int = 0  # lines that are no JSON
    reason: str = ""  # what is wrong with the first of them
    cut_line: int = 0  # the last line, if it breaks off, as a killed logger leaves it

    def take(self, text: bytes, line: int, is_last: bool) -> None:
        """Read the numbers of a line."""
        try:
            numbers = numbers_in(json.loads(text))
        except (ValueError, RecursionError) as error:
            if is_last:
                self.cut_line = line
                return
            self.lost += 1
            self.reason = self.reason or f"line {line} is not JSON: {error}"
            return
        row = len(self.numbers)
        self.numbers.append(line)
        for path, number in numbers.items():
            rows, values = self.values.setdefault(path, ([], []))
            rows.append(row)
            values.append(number)

    def column(self, path: str) -> NDArray[Any]:
        """The numbers of a field, (lines,), masked where a line has none."""
        rows, values = self.values[path]
        filled: list[float | bool | None] = [None] * len(self.numbers)
        for row, value in zip(rows, values, strict=True):
            filled[row] = value
        return masked_numbers(path, filled)


def read(path: Path, source: JsonSource | None) -> Recording:
    """Read the numbers of each line."""
    texts = in_utf8(path.read_bytes()).split(b"\n")
    lines = Lines()
    for line, text in enumerate(texts, start=1):
        if text.strip():
            lines.take(text, line, is_last=line == len(texts))
    if not lines.numbers:
        reason = lines.reason or "holds no whole line"
        raise InputError(f"{reason}; record it again, or exclude the trial")
    rows = Rows(len(lines.numbers), lines=np.array(lines.numbers), noun="line")
    channels: list[Channel] = []
    for name in lines.values:
        channels.append(
            Channel(
                address={"field": name},
                rows=rows,
                read=partial(lines.column, name),
                name=last_name(name),
                likely_unit=name_and_ending(last_name(name))[1],
            )
        )
    for parent in dict.fromkeys(name.rpartition(".")[0] for name in lines.values if "." in name):
        for parts in stamp_fields(parent):
            if set(parts) <= lines.values.keys():
                channels.append(
                    Channel(
                        address={"field": parent},
                        rows=rows,
                        read=partial(_stamps, lines, parts),
                        name=last_name(parent),
                        unit="ns",
                        kind=Kind.CLOCK,
                    )
                )

    def find_unlisted(address: Mapping[str, str]) -> Channel | None:
        name = address["field"]
        names = list(lines.values)
        advice = nearest(name, names) or "; correct `field` in the source file"
        raise InputError(f"no line has a number '{name}'; there are {listing(names)}{advice}")

    return Recording(
        format="json_lines",
        channels=channels,
        loss=_loss(lines),
        facts={"rows": str(rows.count)},
        find_unlisted=find_unlisted,
    )


def _stamps(lines: Lines, parts: tuple[str, str]) -> NDArray[Any]:
    seconds, nanoseconds = (lines.column(part) for part in parts)
    return whole_stamps(seconds, nanoseconds, parts, noun="line")


def _loss(lines: Lines) -> Loss:
    read_count = len(lines.numbers)
    total = read_count + lines.lost
    remarks: list[str] = []
    if lines.cut_line:
        remarks.append(f"the last line, {lines.cut_line}, breaks off and was left out")
    if lines.lost:
        remarks.append(
            f"{lines.lost} of {total} lines cannot be used and were skipped: {lines.reason}"
        )
    end = End.MISSING if lines.cut_line else End.UNKNOWN
    return Loss(read_count, total, end, remarks=remarks)


def _begins(begin: bytes) -> bool:
    """Tell whether an object stands in the first line, and one in the second."""
    first, _, rest = in_utf8(begin).strip().partition(b"\n")
    try:
        json.loads(first)
    except (ValueError, RecursionError):
        return False
    return first.startswith(b"{") and rest.lstrip().startswith(b"{")


FORMAT = Format(
    name="json_lines",
    suffixes=(".jsonl", ".ndjson"),
    begins=_begins,
    source=JsonSource,
    read=read,
    priority=2,
)
