"""JSON lines: one object of JSON per line, with numbers at any depth."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats._messages import joined_columns, stamp_fields, whole_stamps
from osl_analysis.formats._objects import fields_in, last_name, masked_numbers, number_at
from osl_analysis.formats._ros_shapes import NoNumberError
from osl_analysis.formats._text import in_utf8
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import FieldChannel, RowTime, TableSource
from osl_analysis.units import is_clock, name_and_ending

MOST_ELEMENTS = 64  # of an array that are listed: longer ones are images, and no signals
LINES_AT_ONCE = 1 << 16  # that are held as objects, which take more memory than their numbers
LEAST_RISES = 0.8  # share of the steps of a clock
LINES_TRIED = 1000  # by which it is told whether a field may be a clock
NAME_A_NUMBER = (
    "name a number as `field` in the source file; for time, or state the rate: `time: {rate: 1000}`"
)
FEW_FIELDS = 16  # all of which are read, since a line is decoded as a whole
LISTED_LINES = 2000  # of a long file, by which its fields are listed


class FieldTime(RowTime):
    """A field of time, or the rate of the lines."""

    ADDRESS = "field"
    # Path of the number that is time, or of a stamp of seconds and nanoseconds (no `unit`).
    field: str | None = None


class JsonSource(TableSource):
    """The source file of JSON lines."""

    OF = " of format json_lines"
    channels: Mapping[str, FieldChannel] = Field(min_length=1)
    time: FieldTime


class Lines:
    """The lines of a file, and what is wrong with some."""

    def __init__(self, path: Path) -> None:
        data = in_utf8(path.read_bytes())
        lines = data.split(b"\n")
        self.texts = [text for text in lines if text.strip()]
        self.numbers = [number for number, text in enumerate(lines, start=1) if text.strip()]
        self.cut_line = 0  # the last line, if it breaks off, as a killed logger leaves it
        if lines[-1].strip() and not _is_json(lines[-1]):
            self.cut_line = self.numbers.pop()
            self.texts.pop()
        if not self.texts:
            raise InputError("holds no whole line; record it again, or exclude the trial")
        self.unusable: list[int] = []  # places of lines that are no JSON, or lack a number
        self.reason = ""  # what is wrong with the first of these
        self.no_number: dict[str, str] = {}  # what stands in place of a field's first number

    def fields(self) -> dict[str, str]:
        """Path and type of every number, of long files by some of their lines."""
        some = np.unique(np.linspace(0, len(self.texts) - 1, LISTED_LINES).astype(np.int64))
        fields: dict[str, str] = {}
        for row in some.tolist():
            with suppress(ValueError, RecursionError):
                for description in fields_in(json.loads(self.texts[row]), MOST_ELEMENTS):
                    fields.setdefault(description.path, description.type)
        return fields

    def decode(
        self, fields: Sequence[str], asked: Collection[str] = (), most: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """Read fields of all lines, or of the first ones, in one pass.

        Parameters
        ----------
        asked
            Fields in which a line must have a number or nothing: else it cannot be used.

        Returns
        -------
        dict
            By field its numbers, (lines,), masked where a line has none. Lines that cannot be used
            are left out, and fields that no line has.
        """
        self.unusable = []
        parts: dict[str, list[NDArray[Any]]] = {field: [] for field in fields}
        texts = self.texts if most is None else self.texts[:most]
        for begin in range(0, len(texts), LINES_AT_ONCE):
            some = texts[begin : begin + LINES_AT_ONCE]
            for field, numbers in self._decode_some(some, begin, fields, asked).items():
                parts[field].append(masked_numbers(field, numbers))
        columns: dict[str, NDArray[Any]] = {}
        for field, pieces in parts.items():
            column = joined_columns(pieces)
            if not np.ma.getmaskarray(column).all():
                columns[field] = column
        return columns

    def _decode_some(
        self, texts: Sequence[bytes], begin: int, fields: Sequence[str], asked: Collection[str]
    ) -> dict[str, list[float | bool | None]]:
        columns: dict[str, list[float | bool | None]] = {field: [] for field in fields}
        for row, text in enumerate(texts, start=begin):
            line = self.numbers[row]
            try:
                numbers = self._numbers_of(json.loads(text), fields, asked, line)
            except NoNumberError as error:
                self.unusable.append(row)
                self.reason = self.reason or f"{error}, in line {line}"
            except (ValueError, RecursionError) as error:
                self.unusable.append(row)
                self.reason = self.reason or f"line {line} is not JSON: {error}"
            else:
                for field, number in zip(fields, numbers, strict=True):
                    columns[field].append(number)
        return columns

    def _numbers_of(
        self, value: Any, fields: Sequence[str], asked: Collection[str], line: int
    ) -> list[float | bool | None]:
        numbers: list[float | bool | None] = []
        for field in fields:
            try:
                numbers.append(number_at(value, field))
            except NoNumberError as error:
                self.no_number.setdefault(field, f"{error}, in line {line}")
                if field in asked:
                    raise
                numbers.append(None)
        return numbers


def read(path: Path, source: JsonSource | None) -> Recording:
    """Read a file of JSON lines: what a source file asks for and, of many fields, what may be a
    clock, or all."""
    lines = Lines(path)
    fields = lines.fields()
    wanted = list(fields)
    asked: list[str] = []
    if source is not None:
        asked = _asked(source, fields)
        beside = list(fields) if len(fields) <= FEW_FIELDS else _clocks_in(lines, fields)
        wanted = list(dict.fromkeys([*asked, *beside]))
    columns = lines.decode(wanted, asked)
    numbers = np.delete(np.array(lines.numbers), lines.unusable)
    if not numbers.size:
        raise InputError(f"{lines.reason}; {NAME_A_NUMBER}")
    rows = Rows(numbers.size, lines=numbers, noun="line")
    channels: list[Channel] = []
    for field, values in columns.items():
        name = last_name(field)
        channels.append(
            Channel(
                address={"field": field},
                rows=rows,
                read=partial(np.asanyarray, values),
                name=name,
                likely_unit=name_and_ending(name)[1],
                type=fields.get(field, ""),
            )
        )
    parents = dict.fromkeys(field.rpartition(".")[0] for field in columns if "." in field)
    for parent in parents:
        for parts in stamp_fields(parent):
            if set(parts) <= columns.keys():
                channels.append(
                    Channel(
                        address={"field": parent},
                        rows=rows,
                        read=partial(_stamps, columns, parts),
                        name=last_name(parent),
                        unit="ns",
                        kind=Kind.CLOCK,
                    )
                )

    def find_unlisted(address: Mapping[str, str]) -> Channel | None:
        field = address["field"]
        if field in lines.no_number:
            raise InputError(f"{lines.no_number[field]}; {NAME_A_NUMBER}")
        names = list(fields)
        advice = nearest(field, names) or "; correct `field` in the source file"
        raise InputError(f"no line has a field '{field}'; there are {listing(names)}{advice}")

    return Recording(
        format="json_lines",
        channels=channels,
        loss=_loss(lines, fields, rows.count),
        facts={"rows": str(rows.count)},
        find_unlisted=find_unlisted,
    )


def _stamps(columns: Mapping[str, NDArray[Any]], parts: tuple[str, str]) -> NDArray[Any]:
    seconds, nanoseconds = (columns[part] for part in parts)
    return whole_stamps(seconds, nanoseconds, parts, noun="line")


def _asked(source: JsonSource, fields: Mapping[str, str]) -> list[str]:
    """The fields that a source file asks for; time may be one, or a stamp of two parts."""
    asked = [channel.field for channel in source.channels.values()]
    asked += [channel.counter for channel in source.channels.values() if channel.counter]
    time = source.time.field
    if time:
        parts = next((pair for pair in stamp_fields(time) if set(pair) <= fields.keys()), ())
        asked += parts or [time]
    return asked


def _clocks_in(lines: Lines, fields: Mapping[str, str]) -> list[str]:
    """The fields that may be clocks, by their names or since they rise; a counter may overflow."""
    clocks = [field for field in fields if is_clock(last_name(field))]
    for field, values in lines.decode(list(fields), most=LINES_TRIED).items():
        steps = np.diff(np.ma.compressed(values).astype(np.float64))
        if steps.size and np.mean(steps > 0) > LEAST_RISES:
            clocks.append(field)
    return clocks


def _loss(lines: Lines, fields: Mapping[str, str], read: int) -> Loss:
    total = read + len(lines.unusable)
    remarks: list[str] = []
    for field, kind in fields.items():
        length = re.fullmatch(r"\w+\[(\d+)\]", kind)
        is_first = field.endswith("[0]")
        if is_first and length and int(length[1]) > MOST_ELEMENTS:
            remarks.append(
                f"{field.removesuffix('[0]')} has {length[1]} elements; only the first"
                f" {MOST_ELEMENTS} are listed"
            )
    if lines.cut_line:
        remarks.append(f"the last line, {lines.cut_line}, breaks off and was left out")
    if lines.unusable:
        remarks.append(
            f"{len(lines.unusable)} of {total} lines cannot be used and were skipped:"
            f" {lines.reason}"
        )
    end = End.MISSING if lines.cut_line else End.UNKNOWN
    return Loss(read, total, end, remarks=remarks)


def _is_json(text: bytes) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def _begins(begin: bytes) -> bool:
    """Tell whether an object stands in the first line, and one in the second."""
    first, _, rest = in_utf8(begin).lstrip().partition(b"\n")
    has_two_objects = first.startswith(b"{") and rest.lstrip().startswith(b"{")
    return has_two_objects and _is_json(first)


FORMAT = Format(
    name="json_lines",
    suffixes=(".jsonl", ".ndjson"),
    begins=_begins,
    source=JsonSource,
    read=read,
    priority=2,
)
