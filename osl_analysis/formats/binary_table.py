# SPDX-License-Identifier: Apache-2.0
"""Tables in formats of programs.

Sheets of Excel and OpenDocument are read by fastexcel, Parquet and JSON lines by polars, HDF5 by
h5py.

A sheet follows the rules of a table of text; others have names and types of their own.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
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
    recording_of_table,
)
from osl_analysis.formats.csv_table import table_of_text
from osl_analysis.formats.reading import beginning
from osl_analysis.formats.text_cells import Text, name_and_unit, numbered, read_text
from osl_analysis.formats.topic import frame_of, take_values

BEGINNINGS = {
    "sheet": rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # of OLE; others are ZIP files
    rb"|PK\x03\x04.*(xl/|\[Content_Types\]\.xml|vnd\.oasis\.opendocument\.spreadsheet)",
    "hdf5": rb"(?!MATLAB)(.{512}|.{1024}|.{2048})?\x89HDF\r\n\x1a\n",
    "parquet": rb"PAR1",
    "json": rb'(\xef\xbb\xbf)?\s*\{\s*"[^\n]*\}\s*\n\s*\{',
}
"""How files begin, the more special ones first."""
FEWEST_OF_SIGNAL = 10  # of a signal


@dataclass(frozen=True)
class Variable:
    """What is no struct, cell or table in a file.

    Attributes
    ----------
    group
        Address of what it is in; empty for the file itself.
    kind
        Its class in MATLAB, or its type.
    numbers
        Real numbers of its shape; None for anything else.
    label
        The name of its signal, where a text beside it states it.
    """

    group: str
    address: str
    kind: str
    numbers: NDArray[Any] | None = None
    unit: str = ""
    label: str = ""


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
            return recording_of_variables("table", "column", _hdf5_variables(path))
        case "json":
            return _recording_of_frame(_frame_of_objects(path), End.UNKNOWN)
    return _recording_of_frame(_frame_of_parquet(path))


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
    unread_sheets = [name for name, sheet in sheets.items() if name != largest and sheet.height]
    if unread_sheets:
        remarks.append(
            f"sheet '{largest}' is read, the largest; not read: {listing(unread_sheets)}"
        )
    table = replace(table, end=End.WHOLE, remarks=remarks)
    return recording_of_table(
        "table", table, layout, noun="row", facts={"rows": len(table.lines), "sheet": largest}
    )


def _recording_of_frame(frame: pl.DataFrame, end: End = End.WHOLE) -> Recording:
    """Make a channel of each column of numbers, times and text."""
    kinds = selectors.float() | selectors.integer() | selectors.boolean()
    readable = frame.select(kinds | selectors.string() | selectors.temporal())
    unread_columns = [name for name in frame.columns if name not in readable.columns]
    table = Table(
        names=readable.columns,
        units=[name_and_unit(name)[1] for name in readable.columns],
        lines=np.arange(1, frame.height + 1),
        body=readable,
        remarks=remarks_on(unread_columns, readable.is_empty()),
        end=end,
    )
    return recording_of_table("table", table, LISTING, noun="row", facts={"rows": frame.height})


def _frame_of_parquet(path: Path) -> pl.DataFrame:
    """Read a table that does not say its size [bytes], with numbers of 8 bytes."""
    rows = pl.scan_parquet(path.read_bytes())
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
    return frame_of(rows)


def remarks_on(unread_columns: Sequence[str], are_all: bool) -> list[str]:
    """Say what of a file is not read. Raises InputError: it is all of it."""
    if are_all:
        raise InputError("holds no column of numbers", "name a recording")
    if not unread_columns:
        return []
    return [f"not read, as they are no columns of numbers: {listing(unread_columns)}"]


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
        raise InputError(f"{listing(elsewhere)} is stored in other files", "save it in this one")
    check_unpacked(path, sum(sizes.values()))
    return [*sizes]


def _hdf5_variables(path: Path) -> list[Variable]:
    """Read the data sets, with the units that they state, and the attributes of the file."""
    names = check_hdf5(path)
    h5py = optional_module("h5py", "an HDF5 file")
    with h5py.File(path, "r") as file:
        variables = [variable_of(name, value) for name, value in file.attrs.items()]
        for name in names:
            about = {key.casefold(): value for key, value in file[name].attrs.items()}
            unit = about.get("unit", about.get("units", ""))
            variables.append(variable_of(name, file[name][()], "".join(np.ravel(unit).astype(str))))
    return variables


def variable_of(name: str, value: Any, unit: str = "", group: str = "") -> Variable:
    """An array in a file."""
    array = np.atleast_1d(np.asarray(value))
    if array.dtype.kind in "UT":
        return Variable(group, name, "text")
    numbers = np.atleast_2d(array) if array.dtype.kind in "biuf" else None
    return Variable(group, name, array.dtype.name, numbers, unit)


def recording_of_variables(
    format_name: str, key: str, variables: Sequence[Variable], noun: str = "row"
) -> Recording:
    """Make a channel of each vector and each column of a matrix, with its address under a key of
    the source file. Few numbers, such as a rate, become notes."""
    notes = []
    unread_variables = []
    channels = []
    rows_by_place: dict[tuple[str, int], Rows] = {}
    for variable in variables:
        lines = lines_of(variable)
        numbers = variable.numbers
        if numbers is not None and numbers.size < FEWEST_OF_SIGNAL:
            notes.append(f"{variable.address}={' '.join(map(str, numbers.flat))}")
        elif not lines:
            unread_variables.append(variable.address)
        name_in_group = variable.address.removeprefix(variable.group).removeprefix(".")
        for place, values in lines.items():
            title = variable.label or place or name_in_group
            name, unit = name_and_unit(title)
            if variable.label:
                name += place
                title += place
            rows = Rows(values.size, variable.group, noun=noun)
            channels.append(
                Channel(
                    address={key: variable.address + place},
                    rows=rows_by_place.setdefault((variable.group, values.size), rows),
                    read=partial(np.ascontiguousarray, values),
                    name=name.rpartition("/")[2],
                    title=title,
                    unit=variable.unit or unit,
                )
            )
    remarks = remarks_on(unread_variables, not channels)
    most = max((channel.rows.count for channel in channels), default=0)
    loss = Loss(most, most, remarks=remarks)
    return Recording(format_name, channels, loss, notes=notes, facts={"rows": most})


def lines_of(variable: Variable) -> dict[str, NDArray[Any]]:
    """A vector, or each column or row of a matrix, that is long enough, by its place in it."""
    numbers = variable.numbers
    if numbers is None or numbers.ndim != 2 or max(numbers.shape) < FEWEST_OF_SIGNAL:
        return {}
    is_upright = numbers.shape[0] >= numbers.shape[1]
    form = "(:,{})" if is_upright else "({},:)"
    lines = numbers.T if is_upright else numbers
    if len(lines) == 1:
        return {"": lines[0]}
    return {form.format(number): line for number, line in enumerate(lines, start=1)}


FORMAT = Format(
    name="table",
    suffixes=(
        ".xlsx",
        ".xls",
        ".ods",
        ".parquet",
        ".h5",
        ".hdf5",
        ".jsonl",
        ".ndjson",
    ),
    begins=kind_of,
    source=SheetSource,
    read=read,
)
