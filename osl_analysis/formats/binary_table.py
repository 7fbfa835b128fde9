# SPDX-License-Identifier: Apache-2.0
"""Tables in formats of programs.

Sheets of Excel and OpenDocument are read by fastexcel, Parquet, Arrow and JSON lines by polars,
arrays by numpy, HDF5 by h5py.

A sheet follows the rules of a table of text; others have names and types of their own.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile, is_zipfile

import numpy as np
import polars as pl
from numpy.typing import NDArray
from polars import selectors

from osl_analysis.base.errors import InputError, listing, on_one_line, optional_module, shortened
from osl_analysis.base.memory import check_unpacked
from osl_analysis.base.recording import Channel, End, Format, Loss, Recording, Rows
from osl_analysis.formats.cell_table import (
    LISTING,
    SheetSource,
    Table,
    lasting_names,
    recording_of_table,
)
from osl_analysis.formats.csv_table import table_of_text
from osl_analysis.formats.reading import beginning
from osl_analysis.formats.text_cells import Text, name_and_unit, numbered, read_text
from osl_analysis.formats.topic import check_fields, take_values

BEGINNINGS = {
    "sheet": rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # of OLE; others are ZIP files
    rb"|PK\x03\x04.*(xl/|\[Content_Types\]\.xml|vnd\.oasis\.opendocument\.spreadsheet)",
    "npz": rb"PK\x03\x04.{,400}\.npy",
    "hdf5": rb"(?!MATLAB)(.{512}|.{1024}|.{2048})?\x89HDF\r\n\x1a\n",
    "parquet": rb"PAR1",
    "arrow": rb"ARROW1",
    "npy": rb"\x93NUMPY",
    "json": rb'(\xef\xbb\xbf)?\s*\{\s*"[^\n]*\}\s*\n\s*\{',
}
"""How files begin, the more special ones first."""


class Column(NamedTuple):
    """Numbers (n,) of a file of arrays."""

    group: str  # of the file, within which columns of one length share rows
    address: str
    title: str
    values: NDArray[Any]
    unit: str = ""  # that the file states


def kind_of(begin: bytes) -> str:
    """Tell the kind of table by the first bytes of a file; empty if it is none."""
    kinds = (kind for kind, form in BEGINNINGS.items() if re.match(form, begin, re.DOTALL))
    return next(kinds, "")


def read(path: Path, source: SheetSource | None) -> Recording:
    """Read a table in a program's own format."""
    if is_zipfile(path):
        with ZipFile(path) as archive:
            check_unpacked(path, sum(part.file_size for part in archive.infolist()))
    match kind_of(beginning(path)):
        case "sheet":
            return _read_workbook(path, source)
        case "hdf5":
            return _recording_of_arrays(*_hdf5_arrays(path))
        case "npy" | "npz":
            return _recording_of_arrays(_numpy_arrays(path), {})
        case "parquet":
            return _recording_of_frame(_frame(pl.scan_parquet(path.read_bytes()), path))
        case "json":
            return _recording_of_frame(_frame_of_objects(path), End.UNKNOWN)
    return _recording_of_frame(_frame(pl.scan_ipc(path.read_bytes()), path))


def _read_workbook(path: Path, source: SheetSource | None) -> Recording:
    """Read the largest sheet of a workbook, by the rules of a table of text."""
    # from bytes: else it goes by the file's ending
    book = optional_module("fastexcel", "a workbook").read_excel(path.read_bytes())
    sheets = {}
    for name in book.sheet_names:
        sheets[name] = book.load_sheet(name, header_row=None, dtypes="string").to_polars()
    largest = max(sheets, key=lambda name: sheets[name].height * sheets[name].width)
    cells = sheets[largest].select(pl.all().cast(pl.String).str.replace_all(r'[\s"]+', " "))
    text = cells.write_csv(include_header=False, separator="\t", quote_style="never")
    layout = source or LISTING
    table = table_of_text(Text(text.encode(), is_ended=True), layout)
    remarks = [*table.remarks]
    others = [name for name, sheet in sheets.items() if name != largest and sheet.height]
    if others:
        remarks.append(f"sheet '{largest}' is read, the largest; not read: {listing(others)}")
    table = replace(table, end=End.WHOLE, remarks=remarks)
    return recording_of_table(
        "table", table, layout, noun="row", facts={"rows": len(table.lines), "sheet": largest}
    )


def _recording_of_frame(frame: pl.DataFrame, end: End = End.WHOLE) -> Recording:
    """Make a channel of each column of numbers, times and text."""
    kinds = selectors.float() | selectors.integer() | selectors.boolean()
    readable = frame.select(kinds | selectors.string() | selectors.temporal())
    others = [name for name in frame.columns if name not in readable.columns]
    table = Table(
        names=readable.columns,
        units=[name_and_unit(name)[1] for name in readable.columns],
        lines=np.arange(1, frame.height + 1),
        body=readable,
        remarks=remarks_on(others, readable.is_empty()),
        end=end,
    )
    return recording_of_table("table", table, LISTING, noun="row", facts={"rows": frame.height})


def _frame(rows: pl.LazyFrame, path: Path) -> pl.DataFrame:
    """Read a table that does not say its size [bytes], with numbers of 8 bytes."""
    count = rows.select(pl.len()).collect().item()
    check_unpacked(path, 8 * count * len(rows.collect_schema()))
    return rows.collect()


def _frame_of_objects(path: Path) -> pl.DataFrame:
    """Read an object of JSON per line; a number in it has a column, as `variables.time`."""
    rows = []
    for line in numbered(read_text(path).data):
        row: dict[str, Any] = {}
        try:
            take_values(json.loads(line.text), "", row)
        except ValueError as error:
            reason = shortened(on_one_line(error))
            raise InputError(
                f"line {line.number} is no JSON: {reason}", "delete it, as the end of a cut log"
            ) from error
        rows.append(row)
    check_fields({name for row in rows for name in row})
    return pl.DataFrame(rows, strict=False, infer_schema_length=None)


def remarks_on(others: Sequence[str], are_all: bool) -> list[str]:
    """Say what of a file is not read. Raises InputError: it is all of it."""
    if are_all:
        raise InputError("holds no column of numbers", "name a recording")
    return [f"not read, as they are no columns of numbers: {listing(others)}"] if others else []


def check_hdf5(path: Path) -> list[str]:
    """List the data sets of HDF5, before any of it is read. Raises InputError: it leads to other
    files of this machine, or unpacks to too much."""
    h5py = optional_module("h5py", "an HDF5 file")
    elsewhere: list[str] = []
    sizes: dict[str, int] = {}

    def look(name: str, link: Any) -> None:
        item = file[name] if isinstance(link, h5py.HardLink) else None
        is_elsewhere = isinstance(link, h5py.ExternalLink)
        if isinstance(item, h5py.Dataset):
            sizes[name] = item.nbytes
            is_elsewhere = bool(item.external or item.is_virtual)
        if is_elsewhere:
            elsewhere.append(name)

    with h5py.File(path, "r") as file:
        file.visititems_links(look)
    if elsewhere:
        raise InputError(
            f"{path}: {listing(elsewhere)} is stored in other files", "save it in this one"
        )
    check_unpacked(path, sum(sizes.values()))
    return [*sizes]


def _numpy_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read one array, the fields of one of records, or an archive of several arrays."""
    with path.open("rb") as file:  # numpy leaves that of a damaged archive open
        stored = np.load(file)
        if not isinstance(stored, np.ndarray):
            return dict(stored)
    return {name: stored[name] for name in stored.dtype.names or ()} or {"": stored}


def _hdf5_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Read the data sets and the attributes of the file, and the units that they state."""
    names = check_hdf5(path)
    h5py = optional_module("h5py", "an HDF5 file")
    units = {}
    with h5py.File(path, "r") as file:
        arrays = {name: np.asarray(value) for name, value in file.attrs.items()}
        for name in names:
            arrays[name] = np.asarray(file[name][()])
            for key, value in file[name].attrs.items():
                if key.casefold() in ("unit", "units"):
                    units[name] = "".join(np.ravel(value).astype(str))
    return arrays, units


def _recording_of_arrays(arrays: Mapping[str, NDArray[Any]], units: Mapping[str, str]) -> Recording:
    """Make a channel of each array (n,) and column of a matrix (n, m), whose longer axis is the
    rows. Single numbers, such as a rate, become notes."""
    notes = []
    others = []
    columns = {}
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf" or array.ndim > 2 or not array.size:
            others.append(name)
        elif array.size == 1:
            notes.append(f"{name}={array.item()}")
        else:
            lines = np.atleast_2d(array)
            if lines.shape[0] >= lines.shape[1]:
                lines = lines.T
            for number, line in enumerate(lines, start=1):
                title = name if len(lines) == 1 else f"{name} {number}"
                columns[title.strip() or "1"] = line
    remarks = remarks_on(others, not columns)
    parts = [
        Column(title.rpartition("/")[0], lasting, title, columns[title], units.get(title, ""))
        for title, lasting in zip(columns, lasting_names([*columns]), strict=True)
    ]
    channels = channels_of("column", parts)
    most = max(values.size for values in columns.values())
    loss = Loss(most, most, remarks=remarks)
    return Recording("table", channels, loss, notes=notes, facts={"rows": most})


def channels_of(key: str, columns: Sequence[Column], noun: str = "row") -> list[Channel]:
    """Make a channel of each column, with its address under a key of the source file."""
    rows_by_place: dict[tuple[str, int], Rows] = {}
    channels = []
    for column in columns:
        count = column.values.size
        rows = Rows(count, column.group, noun=noun)
        name, unit = name_and_unit(column.title)
        channels.append(
            Channel(
                address={key: column.address},
                rows=rows_by_place.setdefault((column.group, count), rows),
                read=partial(np.ascontiguousarray, column.values),
                name=name.rpartition("/")[2],
                title=column.title,
                unit=column.unit or unit,
            )
        )
    return channels


FORMAT = Format(
    name="table",
    suffixes=(
        ".xlsx", ".xls", ".ods", ".parquet", ".feather", ".arrow", ".ipc", ".npy",
        ".npz", ".h5", ".hdf5", ".jsonl", ".ndjson",
    ),
    begins=kind_of,
    source=SheetSource,
    read=read,
)  # fmt: skip
