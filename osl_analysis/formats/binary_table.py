"""Tables in formats of programs.

Sheets of Excel and OpenDocument are read by fastexcel, Parquet and Arrow by polars, arrays by
numpy, HDF5 by h5py.

A sheet follows the rules of a table of text; others have names and types of their own.
"""

import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, optional_module
from osl_analysis.formats import FIRST_BYTES
from osl_analysis.formats._cells import name_and_unit
from osl_analysis.formats._table import (
    LISTING,
    MOST_COLUMNS,
    SheetSource,
    Table,
    lasting_names,
    recording_of_table,
    table_of_rows,
)
from osl_analysis.formats._text import Line, Row
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.units import name_and_ending

OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
ZIP = b"PK\x03\x04"
HDF = b"\x89HDF\r\n\x1a\n"
HDF_PLACES = (0, 512, 1024, 2048)  # bytes at which an HDF5 file may begin
SHEET = re.compile(
    rb"xl/|\[Content_Types\]\.xml|mimetypeapplication/vnd\.oasis\.opendocument\.spreadsheet"
)
BEGINNINGS = {
    b"PAR1": "parquet",
    b"ARROW1": "arrow",
    b"\x93NUMPY": "npy",
}
UNIT_ATTRIBUTES = ("units", "unit", "Units", "Unit")
TITLE_ATTRIBUTES = ("columns", "names", "labels")
NUMBERS = "biufmM"  # NumPy's kinds of arrays that are columns


def kind_of(begin: bytes) -> str:
    """Tell the kind of table by the first bytes of a file; empty if it is none."""
    if begin.startswith(OLE) or (begin.startswith(ZIP) and SHEET.search(begin)):
        return "sheet"
    if begin.startswith(ZIP) and b".npy" in begin[:400]:
        return "npz"
    is_hdf = any(begin[place : place + len(HDF)] == HDF for place in HDF_PLACES)
    if is_hdf and not begin.startswith(b"MATLAB"):
        return "hdf5"
    for start, kind in BEGINNINGS.items():
        if begin.startswith(start):
            return kind
    return ""


@dataclass
class Arrays:
    """Arrays of a file by name, with what is written beside them."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)  # by name of the array
    titles: list[list[str]] = field(default_factory=list)  # lists that may name columns


def read(path: Path, source: SheetSource | None) -> Recording:
    """Read a table in a program's own format."""
    with path.open("rb") as file:
        kind = kind_of(file.read(FIRST_BYTES))
    if kind == "sheet":
        return _read_workbook(path, source)
    if kind == "hdf5":
        return _recording_of_arrays(_hdf5_arrays(path))
    if kind in ("npy", "npz"):
        return _recording_of_arrays(_numpy_arrays(path, kind))
    if kind == "parquet":
        return _recording_of_frame(pl.read_parquet(path))
    if kind == "arrow":
        return _recording_of_frame(pl.read_ipc(path))
    raise InputError(
        "no sheet, Parquet, Arrow, numpy or HDF5 file; check the path and the source's format"
    )


def check_archive(path: Path) -> None:
    """Refuse a ZIP file of which a part does not match its checksum."""
    with zipfile.ZipFile(path) as archive:
        damaged = archive.testzip()
    if damaged:
        raise InputError(
            f"its part {damaged} does not match its checksum; copy it again, or export it anew"
        )


def _read_workbook(path: Path, source: SheetSource | None) -> Recording:
    """Read the largest sheet of a workbook, by the rules of a table of text."""
    if zipfile.is_zipfile(path):
        check_archive(path)
    # from bytes: else it goes by the file's ending
    book = optional_module("fastexcel", "a workbook").read_excel(path.read_bytes())
    sheets = {
        name: book.load_sheet(name, header_row=None, dtypes="string").to_polars()
        for name in book.sheet_names
    }
    largest = max(sheets, key=lambda name: sheets[name].height * sheets[name].width)
    cells = sheets[largest].select(pl.all().cast(pl.String).fill_null("").str.strip_chars())
    layout = source or LISTING
    rows: list[Row] = []
    comments: list[Line] = []
    for number, row in enumerate(cells.iter_rows(), start=1):
        if row[0].startswith(layout.comment_signs):
            comments.append(Line(number, " ".join(cell for cell in row if cell)))
        elif any(row):
            rows.append(Row(number, list(row)))
    table = table_of_rows(rows, comments, layout)
    table = replace(table, end=End.WHOLE)
    others = [name for name, sheet in sheets.items() if name != largest and sheet.height]
    if others:
        remark = f"sheet '{largest}' is read, the largest; not read: {listing(others, 5)}"
        table = replace(table, remarks=[*table.remarks, remark])
    facts = {"rows": str(len(table.lines)), "sheet": largest}
    return recording_of_table("table", table, layout, noun="row", facts=facts)


def _recording_of_frame(frame: pl.DataFrame) -> Recording:
    """Make a channel of each column of numbers, times and text."""
    if frame.width > MOST_COLUMNS:
        raise InputError(
            f"has {frame.width} columns, at most {MOST_COLUMNS} are read; write a row per sample"
        )
    frame = frame.with_columns(
        pl.col(pl.Categorical, pl.Enum).cast(pl.String), pl.col(pl.Decimal).cast(pl.Float64)
    )
    readable: list[str] = []
    for name, kind in frame.schema.items():
        if kind.is_numeric() or kind.is_temporal() or kind in (pl.String, pl.Boolean):
            readable.append(name)
    if not readable or not frame.height:
        raise InputError("holds no column of numbers; name a recording")
    others = [name for name in frame.columns if name not in readable]
    remarks: list[str] = []
    if others:
        remarks.append(f"columns that hold no numbers are not read: {listing(others, 8)}")
    names = [name or str(place) for place, name in enumerate(readable, start=1)]
    table = Table(
        names=names,
        units=[name_and_unit(name)[1] for name in names],
        lines=np.arange(1, frame.height + 1),
        body=frame.select(readable),
        remarks=remarks,
        end=End.WHOLE,
    )
    facts = {"rows": str(frame.height)}
    return recording_of_table("table", table, LISTING, noun="row", facts=facts)


def _numpy_arrays(path: Path, kind: str) -> Arrays:
    try:
        if kind == "npy":
            return Arrays({"": np.load(path, allow_pickle=False)})
        check_archive(path)
        with path.open("rb") as file:  # numpy leaves that of a damaged archive open
            arrays = dict(np.load(file, allow_pickle=False))
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        raise InputError(
            "holds objects of Python, which may run a program and are not read; save arrays of"
            " numbers, as `numpy.savez(PATH, theta=theta, ...)`"
        ) from error
    return Arrays(
        arrays, titles=[_texts(array) for array in arrays.values() if array.dtype.kind in "US"]
    )


def _texts(array: NDArray[Any]) -> list[str]:
    if array.dtype.kind == "S":
        array = np.char.decode(array, "latin-1")
    return [str(text) for text in np.ravel(array)]


def _hdf5_arrays(path: Path) -> Arrays:
    """Read the data sets of numbers by path, and what their attributes say."""
    h5py = optional_module("h5py", "an HDF5 file")
    arrays = Arrays()

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
            return
        arrays.titles += _titles_of_dataset(h5py, item)
        if item.dtype.kind not in "biufV":
            return
        if any(key.startswith("values_block_") for key in item.attrs):
            raise InputError(
                f"'{name}' is a table that pandas wrote with pickled names; save it as Parquet"
                " (`frame.to_parquet(PATH)`)"
            )
        check_written(name, item)
        arrays.arrays[name] = item[()]
        for key in UNIT_ATTRIBUTES:
            text = item.attrs.get(key)
            if isinstance(text, bytes):
                text = text.decode("latin-1")
            if isinstance(text, str):
                arrays.units[name] = text

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        for name, value in file.attrs.items():
            if np.size(value) == 1 and name not in arrays.arrays:
                arrays.arrays[name] = np.ravel(value)
    return arrays


def _titles_of_dataset(h5py: Any, item: Any) -> list[list[str]]:
    """Lists of text that may name the columns of a matrix."""
    lists = [item.attrs[key] for key in TITLE_ATTRIBUTES if key in item.attrs]
    if h5py.check_string_dtype(item.dtype) and item.size <= MOST_COLUMNS:
        lists.append(item.asstr()[()])
    return [[str(text) for text in titles] for titles in lists if np.ndim(titles) == 1]


def check_written(name: str, item: Any) -> None:
    """Refuse a data set of which a killed recorder never wrote some: HDF5 fills it up."""
    parts = item.chunks or item.shape
    needed = int(np.prod([-(-size // part) for size, part in zip(item.shape, parts, strict=True)]))
    stored = item.id.get_num_chunks() if item.chunks else bool(item.id.get_storage_size())
    if item.size and not item.is_virtual and stored < needed:
        raise InputError(
            f"'{name}' was not written to its end, as by a recorder that was killed; save what was"
            " written as CSV or Parquet, or record again"
        )


def _recording_of_arrays(file_arrays: Arrays) -> Recording:
    """Make a channel of each array, column of a matrix, and field of records.

    Those of one length in one group share rows. Single numbers, such as a rate, become notes.
    """
    columns: dict[str, NDArray[Any]] = {}
    titles = titles_by_width(file_arrays.titles, file_arrays.arrays.values())
    for name, array in file_arrays.arrays.items():
        columns |= columns_in(name, array, titles)
    columns = {name: values for name, values in columns.items() if values.dtype.kind in NUMBERS}
    notes = [f"{name}={values[0]}" for name, values in columns.items() if values.size == 1]
    signals = {name: values for name, values in columns.items() if values.size > 1}
    if not signals:
        raise InputError("holds no column of numbers; name a recording")
    rows_by_place: dict[tuple[str, int], Rows] = {}
    channels: list[Channel] = []
    for lasting, (title, values) in zip(lasting_names([*signals]), signals.items(), strict=True):
        group = title.rpartition("/")[0]
        key = (group, values.size)
        if key not in rows_by_place:
            rows_by_place[key] = Rows(values.size, name=group)
        full_name, unit = name_and_unit(title)
        name = full_name.rpartition("/")[2]
        are_times = values.dtype.kind in "mM"
        if are_times:
            values = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
        unit = "ns" if are_times else file_arrays.units.get(title, "") or unit
        channels.append(
            Channel(
                address={"column": lasting},
                rows=rows_by_place[key],
                read=partial(np.asanyarray, values),
                name=name,
                title=title,
                unit=unit,
                likely_unit="" if unit else name_and_ending(name)[1],
                kind=Kind.CLOCK if are_times else Kind.SIGNAL,
            )
        )
    most = max(rows.count for rows in rows_by_place.values())
    return Recording(
        format="table",
        channels=channels,
        loss=Loss(most, most),
        notes=notes,
        facts={"rows": str(most)},
    )


def titles_by_width(lists: Sequence[Sequence[str]], arrays: Any = ()) -> dict[int, Sequence[str]]:
    """Lists of different titles that stand beside matrices, by how many columns they name, where
    one list does, and one matrix has so many."""
    by_width: dict[int, set[tuple[str, ...]]] = {}
    for titles in lists:
        if all(titles) and len(set(titles)) == len(titles) > 1:
            by_width.setdefault(len(titles), set()).add(tuple(titles))
    widths: list[int] = []
    for array in arrays:
        parts = [array[name] for name in array.dtype.names] if array.dtype.names else [array]
        widths += [min(part.shape) for part in parts if part.ndim == 2]
    return {
        width: min(alike)
        for width, alike in by_width.items()
        if len(alike) == 1 and widths.count(width) in (0, 1)
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
