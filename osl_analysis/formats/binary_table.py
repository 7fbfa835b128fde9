"""Tables in formats of programs.

Sheets of Excel and OpenDocument are read by fastexcel, Parquet and Arrow by polars, arrays by
numpy, HDF5 by h5py.

A sheet follows the rules of a table of text; others have names and types of their own.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from polars import selectors

from osl_analysis.errors import InputError, listing, optional_module
from osl_analysis.formats import beginning
from osl_analysis.formats._cells import name_and_unit
from osl_analysis.formats._table import (
    LISTING,
    MOST_COLUMNS,
    SheetSource,
    Table,
    lasting_names,
    recording_of_table,
)
from osl_analysis.formats._text import Text
from osl_analysis.formats.csv_table import table_of_text
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.units import name_and_ending

BEGINNINGS = {
    "sheet": rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # of OLE; others are ZIP files
    rb"|PK\x03\x04.*(xl/|\[Content_Types\]\.xml|vnd\.oasis\.opendocument\.spreadsheet)",
    "npz": rb"PK\x03\x04.{,400}\.npy",
    "hdf5": rb"(?!MATLAB)(.{512}|.{1024}|.{2048})?\x89HDF\r\n\x1a\n",
    "parquet": rb"PAR1",
    "arrow": rb"ARROW1",
    "npy": rb"\x93NUMPY",
}
"""How files begin, the more special ones first."""
UNIT_ATTRIBUTES = ("units", "unit", "Units", "Unit")
TITLE_ATTRIBUTES = ("columns", "names", "labels")
NUMBERS = "biufmM"  # NumPy's kinds of arrays that are columns


@dataclass
class Arrays:
    """Arrays of a file by name, with what is written beside them."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)  # by name of the array
    titles: list[Any] = field(default_factory=list)  # arrays of texts that may name columns


def kind_of(begin: bytes) -> str:
    """Tell the kind of table by the first bytes of a file; empty if it is none."""
    kinds = (kind for kind, form in BEGINNINGS.items() if re.match(form, begin, re.DOTALL))
    return next(kinds, "")


def read(path: Path, source: SheetSource | None) -> Recording:
    """Read a table in a program's own format."""
    match kind_of(beginning(path)):
        case "sheet":
            return _read_workbook(path, source)
        case "hdf5":
            return _recording_of_arrays(_hdf5_arrays(path))
        case "npy" | "npz":
            return _recording_of_arrays(_numpy_arrays(path))
        case "parquet":
            return _recording_of_frame(pl.read_parquet(path))
        case "arrow":
            return _recording_of_frame(pl.read_ipc(path))
    raise InputError(
        "no sheet, Parquet, Arrow, numpy or HDF5 file; check the path and the source's format"
    )


def _read_workbook(path: Path, source: SheetSource | None) -> Recording:
    """Read the largest sheet of a workbook, by the rules of a table of text."""
    # from bytes: else it goes by the file's ending
    book = optional_module("fastexcel", "a workbook").read_excel(path.read_bytes())
    sheets: dict[str, pl.DataFrame] = {}
    for name in book.sheet_names:
        sheets[name] = book.load_sheet(name, header_row=None, dtypes="string").to_polars()
    largest = max(sheets, key=lambda name: sheets[name].height * sheets[name].width)
    cells = sheets[largest].select(pl.all().cast(pl.String).str.replace_all(r'[\s"]+', " "))
    text = cells.write_csv(include_header=False, separator="\t", quote_style="never")
    layout = source or LISTING
    table = table_of_text(Text(text.encode(), is_ended=True), layout, "\t")
    remarks = [*table.remarks]
    others = [name for name, sheet in sheets.items() if name != largest and sheet.height]
    if others:
        remarks.append(f"sheet '{largest}' is read, the largest; not read: {listing(others, 5)}")
    table = replace(table, delimiter="", end=End.WHOLE, remarks=remarks)
    facts = {"rows": str(len(table.lines)), "sheet": largest}
    return recording_of_table("table", table, layout, noun="row", facts=facts)


def _recording_of_frame(frame: pl.DataFrame) -> Recording:
    """Make a channel of each column of numbers, times and text."""
    kinds = selectors.float() | selectors.integer() | selectors.boolean()
    readable = frame.select(kinds | selectors.string() | selectors.temporal())
    if readable.is_empty():
        raise InputError("holds no column of numbers; name a recording")
    remarks: list[str] = []
    others = [name for name in frame.columns if name not in readable.columns]
    if others:
        remarks.append(f"columns of no numbers, times or text are not read: {listing(others, 8)}")
    names = [name or str(place) for place, name in enumerate(readable.columns, start=1)]
    table = Table(
        names=names,
        units=[name_and_unit(name)[1] for name in names],
        lines=np.arange(1, frame.height + 1),
        body=readable,
        remarks=remarks,
        end=End.WHOLE,
    )
    facts = {"rows": str(frame.height)}
    return recording_of_table("table", table, LISTING, noun="row", facts=facts)


def _numpy_arrays(path: Path) -> Arrays:
    """Read one array, or an archive of several."""
    try:
        with path.open("rb") as file:  # numpy leaves that of a damaged archive open
            stored = np.load(file)
            arrays = {"": stored} if isinstance(stored, np.ndarray) else dict(stored)
    except ValueError as error:
        if "pickle" not in str(error):
            raise
        raise InputError(
            "holds objects of Python, which may run a program and are not read; save arrays of"
            " numbers, as `numpy.savez(PATH, theta=theta, ...)`"
        ) from error
    return Arrays(arrays, titles=[array for array in arrays.values() if array.dtype.kind in "US"])


def _hdf5_arrays(path: Path) -> Arrays:
    """Read the data sets of numbers by path, and what their attributes say."""
    h5py = optional_module("h5py", "an HDF5 file")
    found = Arrays()
    with h5py.File(path, "r") as file:
        for name, value in file.attrs.items():
            if np.size(value) == 1:
                found.arrays[name] = np.ravel(value)
        names: list[str] = []
        file.visit(names.append)
        for name in names:
            item = file[name]
            if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
                continue
            found.titles += [item.attrs[key] for key in TITLE_ATTRIBUTES if key in item.attrs]
            if h5py.check_string_dtype(item.dtype) and item.size <= MOST_COLUMNS:
                found.titles.append(item[()])
            elif item.dtype.kind in "biufV":
                _check_written(name, item)
                found.arrays[name] = item[()]
                for key in UNIT_ATTRIBUTES:
                    if key in item.attrs:
                        found.units[name] = _text(item.attrs[key])
    return found


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def _check_written(name: str, item: Any) -> None:
    """Refuse a data set of which a killed recorder never wrote some: HDF5 fills it up."""
    if item.chunks:
        needed = np.prod(-(-np.array(item.shape) // item.chunks))
        if item.id.get_num_chunks() < needed:
            raise InputError(
                f"'{name}' was not written to its end, as by a recorder that was killed; save what"
                " was written as CSV or Parquet, or record again"
            )


def _recording_of_arrays(found: Arrays) -> Recording:
    """Make a channel of each array, column of a matrix, and field of records.

    Those of one length in one group share rows. Single numbers, such as a rate, become notes.
    """
    titles = titles_by_width(found.titles, found.arrays.values())
    notes: list[str] = []
    signals: dict[str, NDArray[Any]] = {}
    for name, array in found.arrays.items():
        for title, values in columns_in(name, array, titles).items():
            if values.dtype.kind in NUMBERS and values.size == 1:
                notes.append(f"{title}={values[0]}")
            elif values.dtype.kind in NUMBERS and values.size:
                signals[title] = values
    if not signals:
        raise InputError("holds no column of numbers; name a recording")
    rows_by_place: dict[tuple[str, int], Rows] = {}
    channels: list[Channel] = []
    for lasting, (title, values) in zip(lasting_names([*signals]), signals.items(), strict=True):
        group = title.rpartition("/")[0]
        rows = rows_by_place.setdefault((group, values.size), Rows(values.size, group))
        full_name, unit = name_and_unit(title)
        name = full_name.rpartition("/")[2]
        unit = found.units.get(title) or unit
        are_times = values.dtype.kind in "mM"
        if are_times:
            values = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
            unit = "ns"
        channels.append(
            Channel(
                address={"column": lasting},
                rows=rows,
                read=partial(np.asanyarray, values),
                name=name,
                title=title,
                unit=unit,
                likely_unit="" if unit else name_and_ending(name)[1],
                kind=Kind.CLOCK if are_times else Kind.SIGNAL,
            )
        )
    most = max(rows.count for rows in rows_by_place.values())
    facts = {"rows": str(most)}
    return Recording("table", channels, Loss(most, most), notes=notes, facts=facts)


def titles_by_width(
    lists: Iterable[Any], arrays: Iterable[NDArray[Any]] = ()
) -> dict[int, Sequence[str]]:
    """Lists of different titles that stand beside matrices, by how many columns they name, where
    one list does, and one matrix has so many."""
    by_width: dict[int, set[tuple[str, ...]]] = {}
    for texts in lists:
        titles = tuple(_text(text) for text in np.ravel(texts))
        if all(titles) and len(set(titles)) == len(titles) > 1:
            by_width.setdefault(len(titles), set()).add(titles)
    widths = [min(array.shape) for array in arrays if array.ndim == 2]
    return {
        width: min(alike)
        for width, alike in by_width.items()
        if len(alike) == 1 and widths.count(width) < 2
    }


def columns_in(
    name: str, array: NDArray[Any], titles: Mapping[int, Sequence[str]]
) -> dict[str, NDArray[Any]]:
    """The columns of an array (n,), a matrix (n, m) or records. The longer axis is the rows."""
    if array.dtype.names:
        columns: dict[str, NDArray[Any]] = {}
        for part in array.dtype.names:
            columns |= columns_in(f"{name}.{part}".strip("."), array[part], titles)
        return columns
    if array.ndim < 2 or 1 in array.shape:
        return {name or "1": np.ravel(array)}
    lines = array if array.shape[0] < array.shape[1] else array.T
    if lines.ndim > 2 or len(lines) > MOST_COLUMNS:
        return {}
    names = titles.get(len(lines))
    if names is None:
        names = [f"{name} {number}".strip() for number in range(1, len(lines) + 1)]
    return {title: np.ascontiguousarray(line) for title, line in zip(names, lines, strict=True)}


def _begins(begin: bytes) -> bool:
    return bool(kind_of(begin))


FORMAT = Format(
    name="table",
    suffixes=(
        ".xlsx", ".xls", ".ods", ".parquet", ".feather", ".arrow", ".ipc", ".npy",
        ".npz", ".h5", ".hdf5",
    ),
    begins=_begins,
    source=SheetSource,
    read=read,
    priority=3,
)  # fmt: skip
