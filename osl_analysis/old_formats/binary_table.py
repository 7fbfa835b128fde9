"""Tables in formats of programs: sheets of Excel and OpenDocument by fastexcel, Parquet and Arrow
by polars, arrays of numpy, and HDF5 by h5py. A sheet follows the rules of a table of text; others
have names and types of their own.

Formats that are not read are recognised by their content, if laboratories often have them or if
they look like a log. The ending of a name proves nothing. Else a marker file in TSV would pass for
a CSV log with nonsense columns."""

import mmap
import os
import re
import struct
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from pickletools import genops
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, optional_module
from osl_analysis.old_formats import csv_table
from osl_analysis.old_formats.json_lines import is_json_lines
from osl_analysis.old_formats.table import Ledger, check_memory, in_one_sentence, isolated

OLE, ZIP, HDF = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"PK\x03\x04", b"\x89HDF\r\n\x1a\n"
SHEET = re.compile(
    rb"xl/|\[Content_Types\]\.xml|mimetypeapplication/vnd\.oasis\.opendocument\.spreadsheet"
)


def kind_of(begin: bytes) -> str:
    """The kind of table in a file, by its first bytes; empty if it is none."""
    if begin.startswith(OLE) or (begin.startswith(ZIP) and SHEET.search(begin)):
        return "sheet"
    if begin.startswith(ZIP) and b".npy" in begin[:400]:
        return "npz"
    if (
        any(begin[place : place + len(HDF)] == HDF for place in (0, 512, 1024, 2048))
        and begin[:6] != b"MATLAB"
    ):
        return "hdf5"
    starts = {
        b"PAR1": "parquet",
        b"ARROW1": "arrow",
        b"\xff\xff\xff\xff": "stream",
        b"\x93NUMPY": "npy",
    }
    return next((kind for start, kind in starts.items() if begin.startswith(start)), "")


def is_table_file(begin: bytes) -> bool:
    return bool(kind_of(begin))


def read_binary_table(
    path: Path, layout: csv_table.CsvLayout, is_unit: csv_table.IsUnit, most_rows: int | None = None
) -> csv_table.CsvTable:
    """The rows of a table in a program's own format, of a long one the first `most_rows`."""
    with path.open("rb") as file:
        kind = kind_of(file.read(1 << 16))
    if not kind:
        raise InputError(
            "no sheet, Parquet, Arrow, numpy or HDF5 file; check the path and the source's format"
        )
    with in_one_sentence():
        if kind in ("sheet", "npz") and zipfile.is_zipfile(path):
            check_archive(path)
        if kind == "sheet":
            return read_workbook(path, layout, is_unit)
        damage, units, notes, not_read = Ledger(), dict[str, str](), list[str](), list[str]()
        if kind == "stream":
            check_memory(path.stat().st_size)
            frame = pl.read_ipc_stream(path)
        elif kind in ("parquet", "arrow"):
            if kind == "arrow":
                check_arrow(path)
            with without_trace():
                lazy = pl.scan_parquet(path) if kind == "parquet" else pl.scan_ipc(path)
                names, rows = lazy.collect_schema().names(), lazy.select(pl.len()).collect().item()
                check_memory(8 * rows * len(names))
                frame = pl.read_parquet(path) if kind == "parquet" else pl.read_ipc(path)
        elif kind == "hdf5":
            optional_module("h5py", "an HDF5 file")  # before the fork: it takes a fifth of a second
            arrays, units = isolated(partial(hdf5_arrays, path))
            frame = frame_of(arrays, not_read, notes)
            tell_bytes_behind(path, 0, damage)
        else:
            try:
                if kind == "npy":
                    values = np.load(path, mmap_mode="r", allow_pickle=False)
                    check_memory(values.nbytes)
                    frame = frame_of({"": np.asarray(values)}, not_read, notes)
                else:
                    with path.open("rb") as file:  # numpy leaves that of a damaged archive open
                        frame = frame_of(dict(np.load(file, allow_pickle=False)), not_read, notes)
            except ValueError as error:
                if not holds_objects(path):
                    raise
                said = "holds objects of Python, which may run a program and are not read"
                raise InputError(
                    f"{said}; save arrays of numbers, as `numpy.savez(PATH, theta=theta, ...)`"
                ) from error
    table = table_of_frame(frame[:most_rows] if most_rows else frame, units, damage, notes)
    is_padded = kind in ("hdf5", "npz") and any(one.has_nulls() for one in table.body)
    return replace(table, is_padded=is_padded, not_read=not_read)


@contextmanager
def without_trace() -> Iterator[None]:
    """Within the block, hide what Rust prints when it panics on a damaged file."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def read_workbook(
    path: Path, layout: csv_table.CsvLayout, is_unit: csv_table.IsUnit
) -> csv_table.CsvTable:
    """The largest sheet of a workbook, by the rules of a table of text."""
    optional_module("fastexcel", "a workbook")
    with path.open("rb") as file:
        if file.read(len(OLE)) == OLE:
            check_xls(path)
    # a damaged one may ask for all memory
    name, others, content = isolated(partial(largest_sheet, path))
    cells = content.select(pl.all().cast(pl.String).fill_null("").str.strip_chars())
    rows = [
        (number, list(row)) for number, row in enumerate(cells.iter_rows(), start=1) if any(row)
    ]
    signs = (
        csv_table.COMMENTS if layout.comment == "auto" else tuple(filter(None, [layout.comment]))
    )
    notes: csv_table.TextLines = [
        (n, " ".join(filter(None, row))) for n, row in rows if row[0].startswith(signs)
    ]
    noted = {number for number, _ in notes}
    table = csv_table.table_of_rows(
        [row for row in rows if row[0] not in noted], notes, layout, is_unit
    )
    table.damage.remarks.extend(
        [f"sheet '{name}' is read, the largest; not read: {listing(others, 5)}"] * bool(others)
    )
    return replace(table, noun="row")


def check_xls(path: Path) -> None:
    """Refuse an old workbook with a sheet whose records (type, length, content) break off before
    its end: the decoder would take the rows up to there for all ([MS-XLS] 2.1.4; the stream's
    sectors: [MS-CFB] 2)."""
    data = path.read_bytes()
    size = 1 << min(16, struct.unpack_from("<H", data, 30)[0])

    def sector(number: int) -> bytes:
        return data[(number + 1) * size : (number + 2) * size].ljust(size, b"\0")

    listed, more = (
        list(struct.unpack_from("<109I", data, 76)),
        struct.unpack_from("<I", data, 68)[0],
    )
    while more < len(data) // size > len(listed):
        *own, more = struct.unpack(f"<{size // 4}I", sector(more))
        listed += own
    following = [
        n
        for one in listed
        if one < len(data) // size
        for n in struct.unpack(f"<{size // 4}I", sector(one))
    ]

    def stream(number: int) -> bytes:
        numbers = list[int]()
        while number < len(following) >= len(numbers):
            numbers.append(number)
            number = following[number]
        return b"".join(map(sector, numbers))

    folder = stream(struct.unpack_from("<I", data, 48)[0])
    entries = [folder[at : at + 128] for at in range(0, len(folder) - 127, 128)]
    for entry in (
        one
        for one in entries
        if one[:64].decode("utf-16-le", "replace").split("\0")[0] == "Workbook"
    ):
        begin, length = struct.unpack_from("<II", entry, 116)
        content, at, depth = stream(begin)[:length], 0, 0
        while at + 4 <= len(content):
            kind, held = struct.unpack_from("<HH", content, at)
            # begin and end of a sheet, or of a chart in one
            depth += (kind == 0x0809) - (kind == 0x000A)
            if depth and not 0 < kind < 0x1100:
                break
            at += 4 + held
        if depth:
            raise InputError(
                "a sheet breaks off, and rows behind are lost; copy the file again, or export it"
                " anew"
            )


def largest_sheet(path: Path) -> tuple[str, list[str], pl.DataFrame]:
    """Name and cells of the largest sheet, and the names of the others that hold something."""
    # else by its suffix
    book = optional_module("fastexcel", "a workbook").read_excel(path.read_bytes())
    sheets = {
        name: book.load_sheet(name, header_row=None, dtypes="string") for name in book.sheet_names
    }
    name = max(sheets, key=lambda one: sheets[one].height * sheets[one].width)
    return (
        name,
        [one for one, sheet in sheets.items() if one != name and sheet.height],
        sheets[name].to_polars(),
    )


def check_arrow(path: Path) -> None:
    """Refuse an Arrow file whose parts do not follow one another up to its footer: behind inserted
    or lost bytes, values are in wrong rows. The footer, a flatbuffer, lists in its third and fourth
    fields the begin of each part, and the lengths of its head and body."""
    with (
        path.open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        suppress(struct.error),
    ):
        begin = len(data) - 10 - struct.unpack_from("<i", data, len(data) - 10)[0]
        root = begin + struct.unpack_from("<I", data, begin)[0]
        fields, parts = root - struct.unpack_from("<i", data, root)[0], list[tuple[int, int, int]]()
        for slot in range(8, min(12, struct.unpack_from("<H", data, fields)[0]), 2):
            (place,) = struct.unpack_from("<H", data, fields + slot)
            at = root + place + struct.unpack_from("<I", data, root + place)[0]
            count = struct.unpack_from("<I", data, at)[0] if place else 0
            parts += struct.iter_unpack("<qi4xq", data[at + 4 : at + 4 + 24 * count])
        ends = [sum(one) for one in sorted(parts)]
        is_whole = ends[:-1] == [one[0] for one in sorted(parts)[1:]]
        # a mark of the end, shorter in old files
        if ends and not (is_whole and ends[-1] in (begin - 8, begin - 4)):
            raise InputError(
                "its parts do not follow one another: bytes were lost or inserted; copy it again"
            )


def check_archive(path: Path) -> None:
    """Raises InputError: a ZIP takes too much memory unpacked, stands behind other bytes, or a
    checksum fails."""
    with zipfile.ZipFile(path) as archive:
        check_memory(sum(one.file_size for one in archive.infolist()), "what it unpacks to")
        if (before := min((one.header_offset for one in archive.infolist()), default=0)) > 0:
            raise InputError(
                f"{before} bytes stand before its first part, as of another file; split them there"
            )
        if damaged := archive.testzip():
            raise InputError(
                f"its part {damaged} does not match its checksum; copy it again, or export it anew"
            )


def holds_objects(path: Path) -> bool:
    """Whether an array in a file of numpy holds objects of Python, by the types in its header."""
    if not zipfile.is_zipfile(path):
        return b"'|O'" in np.fromfile(path, np.uint8, FIRST_BYTES).tobytes().partition(b"\n")[0]
    with zipfile.ZipFile(path) as archive:
        begins = [archive.open(name).read(FIRST_BYTES) for name in archive.namelist()]
    return any(b"'|O'" in begin.partition(b"\n")[0] for begin in begins)


def hdf5_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Data sets of numbers by path, and the units that their attributes state. Unwritten blocks are
    no values."""
    h5py = optional_module("h5py", "an HDF5 file")
    arrays, units, sizes = dict[str, NDArray[Any]](), dict[str, str](), list[int]()

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
            return
        texts = [item.attrs.get(key) for key in ("columns", "names", "labels")]
        pickled = [
            bytes(item.attrs[key])
            for key in item.attrs
            if re.fullmatch(r"values_block_\d+_kind", key)
        ]
        # how pandas writes titles: read without running what a pickle may hold
        with suppress(ValueError):
            texts += [
                [arg for op, arg, _ in genops(one) if "UNICODE" in op.name] for one in pickled
            ]
        is_text = h5py.check_string_dtype(item.dtype) and item.size <= csv_table.MOST_COLUMNS
        texts.append(item.asstr()[()] if is_text else None)
        for number, one in enumerate(texts):
            if one is not None and np.ndim(one) == 1:
                arrays[f"{name} {number} of titles"] = np.array([str(text) for text in one])
        if item.dtype.kind not in "biufV":
            return
        sizes.append(item.size * max(8, item.dtype.itemsize))
        check_memory(sum(sizes))
        arrays[name] = item[()]
        lacking = never_written(item)
        if lacking is not None and item.dtype.kind != "V":
            arrays[name] = np.where(lacking, np.nan, arrays[name].astype(np.float64))
        for key in ("units", "unit", "Units", "Unit"):
            if isinstance(text := item.attrs.get(key), str | bytes):
                units[name] = text.decode("latin-1") if isinstance(text, bytes) else text

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        arrays |= {
            name: np.ravel(one)
            for name, one in file.attrs.items()
            if np.size(one) == 1 and name not in arrays
        }
    return arrays, units


def tell_bytes_behind(path: Path, begin: int, damage: Ledger) -> None:
    """Note bytes behind the end that the superblock, at a byte, states: some were inserted."""
    with path.open("rb") as file:
        start = file.read(begin + 128)[begin:].ljust(128, b"\0")
    (stated,) = struct.unpack_from("<Q", start, 40 if start[8] < 2 else 28)
    if (behind := path.stat().st_size - int(stated)) > 0:
        damage.lose(f"{behind} bytes stand behind its end, and are not read", 0, None, 0)


def never_written(item: Any) -> NDArray[np.bool_] | None:
    """Mask of the values of an HDF5 data set that were never written, as by a killed recorder: HDF5
    gives a fill value there. None if all were written. Raises InputError: two parts of the data set
    are at one place."""
    if item.size and not item.is_virtual and not item.id.get_storage_size():
        return np.ones(item.shape, bool)
    size = item.chunks
    if not size:
        return None
    every = (item.id.get_chunk_info(number) for number in range(item.id.get_num_chunks()))
    chunks = [one for one in every if one.byte_offset is not None]
    if len({one.byte_offset for one in chunks}) < len(chunks):
        raise InputError(
            f"two parts of {item.name} stand at one place: the index is damaged; copy the file"
            " again"
        )
    if len(chunks) >= np.prod([-(-n // m) for n, m in zip(item.shape, size, strict=True)]):
        return None
    lacking = np.ones(item.shape, bool)
    for one in chunks:
        lacking[tuple(slice(n, n + m) for n, m in zip(one.chunk_offset, size, strict=True))] = False
    return lacking


def frame_of(
    arrays: Mapping[str, NDArray[Any]], not_read: list[str], notes: list[str]
) -> pl.DataFrame:
    """The columns of arrays with the most frequent length, or that of a clock: an array (n,), each
    column of a matrix (n, m), each field of records; null behind the last value of a shorter one.
    The longer axis is the rows. Lists of text are titles of the only matrix of this width. Single
    numbers, such as a rate, become `notes`; `not_read` says which columns are of another length."""
    titles = titles_in(arrays)
    columns = {
        own: values
        for name, array in arrays.items()
        for own, values in columns_in(name, array, titles).items()
    }
    numbers = {name: values for name, values in columns.items() if values.dtype.kind in "biufmM"}
    notes += [f"{name}={values[0]}" for name, values in numbers.items() if values.size == 1]
    lengths = Counter(values.size for values in numbers.values() if values.size > 1)
    if not lengths:
        raise InputError("holds no column of numbers; name a recording")
    length = max(lengths, key=lambda size: (lengths[size], size))
    kept = {
        length,
        *(one.size for name, one in numbers.items() if csv_table.is_clock(name.rpartition("/")[2])),
    } - {1}
    if others := [name for name, values in numbers.items() if values.size not in (1, *kept)]:
        lengths_read = listing([str(one) for one in sorted(kept)])
        not_read.append(
            f"not read are columns of another length than {lengths_read}: {listing(others, 8)}"
        )
    signals = {name: pl.Series(one) for name, one in numbers.items() if one.size in kept}
    check_memory(8 * max(kept) * len(signals))
    return pl.DataFrame(
        {name: one.extend_constant(None, max(kept) - len(one)) for name, one in signals.items()}
    )


def titles_of_columns(lists: Iterable[Sequence[str]]) -> dict[int, Sequence[str]]:
    """Lists of different titles that stand beside matrices, by how many columns they name, where
    one list does."""
    found: dict[int, set[tuple[str, ...]]] = {}
    for titles in lists:
        if all(titles) and len(set(titles)) == len(titles) > 1:
            found.setdefault(len(titles), set()).add(tuple(titles))
    return {size: min(alike) for size, alike in found.items() if len(alike) == 1}


def titles_in(arrays: Mapping[str, NDArray[Any]]) -> dict[int, Sequence[str]]:
    """Those of the matrices among arrays, by their width, where one alone is of it."""
    texts = [
        np.char.decode(one, "latin-1") if one.dtype.kind == "S" else one for one in arrays.values()
    ]
    parts = [one[own] for one in arrays.values() for own in one.dtype.names or [...]]
    widths = Counter(min(one.shape) for one in parts if one.ndim == 2)
    found = titles_of_columns(
        [*map(str, one)] for one in texts if one.dtype.kind == "U" and one.ndim == 1
    )
    return {size: own for size, own in found.items() if widths[size] == 1}


def columns_in(
    name: str, array: NDArray[Any], titles: Mapping[int, Sequence[str]]
) -> dict[str, NDArray[Any]]:
    if array.dtype.names:
        parts = [
            columns_in(f"{name}.{own}".strip("."), array[own], titles) for own in array.dtype.names
        ]
        return {own: values for part in parts for own, values in part.items()}
    if array.ndim < 2 or 1 in array.shape:
        return {name or "1": np.ravel(array)}
    lines = array if array.shape[0] < array.shape[1] else array.T
    if lines.ndim > 2 or len(lines) > csv_table.MOST_COLUMNS:
        return {}
    names = titles.get(
        len(lines), [f"{name} {place}".strip() for place in range(1, len(lines) + 1)]
    )
    return {own: np.ascontiguousarray(line) for own, line in zip(names, lines, strict=True)}


def table_of_frame(
    frame: pl.DataFrame, units: Mapping[str, str], damage: Ledger, notes: list[str]
) -> csv_table.CsvTable:
    """The columns of numbers, times and text of a frame."""
    if frame.width > csv_table.MOST_COLUMNS:
        said = f"has {frame.width} columns, at most {csv_table.MOST_COLUMNS} are read"
        raise InputError(f"{said}; write a row per sample")
    texts = frame.select(
        pl.col(pl.Categorical, pl.Enum).cast(pl.String), pl.col(pl.Decimal).cast(pl.Float64)
    )
    frame = frame.with_columns(texts)
    kinds = frame.schema.items()
    known = [
        name
        for name, kind in kinds
        if kind.is_numeric() or kind.is_temporal() or kind in (pl.String, pl.Boolean)
    ]
    if others := [name for name in frame.columns if name not in known]:
        damage.remarks.append(f"columns that hold no numbers are not read: {listing(others, 8)}")
    if not known or not frame.height:
        raise InputError("holds no column of numbers; name a recording")
    body = frame.select(known)
    names = [name or str(place) for place, name in enumerate(known, start=1)]
    stated = [units.get(name) or csv_table.name_and_unit(name)[1] for name in names]
    body.columns = [str(place) for place in range(body.width)]
    return csv_table.CsvTable(
        names, stated, np.arange(1, frame.height + 1), body, notes, damage, noun="row"
    )


FIRST_BYTES = 1 << 16  # bytes of a file that `refuse_others` needs
AS_C3D = "export the trial as C3D"
AS_CSV = "open it in a spreadsheet, also where it is called `.xls`, and save its table as CSV"
HTML = r"\A\s*<(!doctype html|html|head|table|meta|\?xml[^>]*>\s*<(\?mso|workbook))"
JSON = r"\A\s*(\{\s*[\"'}]|\[\s*\{|\[[^\[\]]*\d\s*\]\s*$)"  # or a dictionary as Python prints it
PACKED = r"\A(PK\x03\x04|\x1f\x8b|BZh|\xfd7zXZ\0|\x28\xb5\x2f\xfd|7z\xbc\xaf\x27\x1c|Rar!)"
OTHERS = (
    (
        "an export of Qualisys Track Manager in TSV",
        r"\A\s*NO_OF_(FRAMES|SAMPLES|CAMERAS)\b",
        AS_C3D,
    ),
    ("an export of OptiTrack Motive in CSV", r'\A"?Format Version"?,"?\d', AS_C3D),
    ("a page of HTML or XML", HTML, AS_CSV),
    ("a document of JSON", JSON, "write JSON lines, an object per line and sample"),
    ("nothing but zero bytes", r"\A\0+\Z", "copy or record it again"),
    ("a PNG image", r"\A\x89PNG", "name the recording itself"),
    ("compressed (such as ZIP or gzip)", PACKED, "unpack it and name the recording inside"),
)
"""What a file is, how it begins, and what to do; what is more special comes first."""


def refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file of a format that is not read."""
    begin = begin[:FIRST_BYTES]
    if is_table_file(begin):
        return
    is_text = csv_table.UTF_16.match(begin) is not None or not csv_table.CONTROL.search(begin)
    text = csv_table.decoded_text(begin) if is_text else begin.decode("latin-1")
    for name, pattern, remedy in OTHERS:
        if re.search(pattern, text, re.MULTILINE | re.IGNORECASE) and not is_json_lines(begin):
            raise InputError(f"{path}: {name}, which is not read; {remedy}")
