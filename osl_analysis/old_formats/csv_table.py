"""Tables of numbers in text files of any program. Encoding, delimiter, decimal sign, header, units,
comments and footer are found from the content. Cells become numbers and times."""

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.old_formats.table import Ledger
from osl_analysis.trial import Array

DELIMITERS = {"tab": "\t", "space": " "}
# bytes that no text has; byte 26 is allowed, it ends files of DOS
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x19]")
# its mark, or ASCII in either order
UTF_16 = re.compile(rb"\xff\xfe|\xfe\xff|([\t\r\n -~]\0){8}|(\0[\t\r\n -~]){8}")
# two in a row: cp1252 `é` may look like one
JAPANESE = re.compile("[\u3041-\u30fa\u30fc]{2}|[\u4e00-\u9fff]{2}")
COMMENTS = ("#", "%", "//")
MISSING = (
    "", "nan", "NaN", "NAN", "NA", "N/A", "#N/A", "null", "NULL", "None", "<NA>", "NaT",
    "-nan", "nan(ind)", "-nan(ind)",
)  # fmt: skip
"""Cells that programs write for a failed reading."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d{1,3})?", re.ASCII)
THOUSANDS = {
    ".": re.compile(r"([+-]?\d{1,3}(?:,\d{3})+)\.(\d+)"),
    ",": re.compile(r"([+-]?\d{1,3}(?:\.\d{3})+),(\d+)"),
}
"""By decimal sign: numbers whose thousands are separated by the other sign."""
WHOLE_THOUSANDS = {
    sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}({re.escape(sign)}\d{{3}})+") for sign in ",."
}
BETWEEN_THOUSANDS = "'\u2019\u202f\u2009\u00a0"  # signs that only separate thousands
SMALL_WHOLE = re.compile(r"[+-]?\d{1,3}")
STATED_ROWS = re.compile(
    r"(?i)\W*(?:total |(?:number|no\.?) of )?(?:samples|rows|frames|length|data"
    r" points)[\s:=,;]+(\d+)\b(?![.,]\d)"
)
"""Text above a table that states its number of rows."""
CLOCK = (
    r"(?:(\d+) days?,? )?\+?(\d{1,3}):(\d{2})(?::(\d{1,2}))?(?:[.,:](\d{1,9}))?\d*(?:"
    r" ?([AaPp])\.?[Mm]\.?)?"
)
TIME = (
    r"^(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T"
    rf" ]\s*)?{CLOCK}\s*(?:Z|UTC|([+-]\d{{2}}):?(\d{{2}}))?$"
)
# MATLAB writes the times of a timetable so
SECONDS = r"^(\d{1,12}(?:\.\d{1,15})?(?:[eE][+-]?\d{1,3})?) sec$"
MOST_COLUMNS = 10_000  # a table with more columns is transposed, or no recording
FIRST_LINES, LAST_LINES = 300, 60  # lines of a long text from which its dialect is found
LONGEST_CELL = 131_072  # characters
TextLines = list[tuple[int, str]]  # number in the file, counted from 1, and text
Rows = list[tuple[int, list[str]]]
IsUnit = Callable[[str], bool]


def read_text(path: Path) -> tuple[bytes, bool]:
    """The text of a file, in UTF-8 with Unix line breaks, and whether its last line has one.
    Refuses zero bytes."""
    data = decoded_text(path.read_bytes()).encode()
    # a minus sign
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace("\u2212".encode(), b"-")
    if any(sign.encode() in data for sign in BETWEEN_THOUSANDS):  # as in Switzerland and France
        data = re.sub(rf"(?<=\d)[{BETWEEN_THOUSANDS}](?=\d{{3}}(?!\d))", "", data.decode()).encode()
    data = data[: len(data.rstrip(b"\x1a"))]
    if (zero := data.find(b"\0")) >= 0:
        line = data.count(b"\n", 0, zero) + 1
        said = f"line {line} holds zero bytes, as a loss of power leaves them"
        raise InputError(f"{said}; delete the file from there on, or name a text file")
    return data, data.rstrip(b" \t").endswith(b"\n")


def numbered(data: bytes, first: int = 1) -> TextLines:
    """The lines of a text without blank ones, each with its number. `first` is the number of the
    first line."""
    lines = data.decode(errors="replace").split("\n")
    return [
        (number, line)
        for number, line in enumerate(lines, start=first)
        if line and not line.isspace()
    ]


def read_lines(path: Path) -> tuple[TextLines, bool]:
    """The numbered lines of a file without blank ones, and whether the last line has a break.
    Raises as `read_text`."""
    data, ends = read_text(path)
    return numbered(data), ends


def decoded_text(data: bytes) -> str:
    """Text decoded from UTF-8, UTF-16, the Japanese code page, or else the western one of
    Windows."""
    with suppress(UnicodeDecodeError):
        return utf8_of(data).decode()
    with suppress(UnicodeDecodeError):
        if JAPANESE.search(text := data.decode("cp932")):
            return text
    return data.decode("cp1252", errors="replace")


def utf8_of(data: bytes) -> bytes:
    """The bytes of a text, without a byte order mark. UTF-16 becomes UTF-8."""
    if UTF_16.match(data):
        data = data.decode(
            "utf-16-be" if data[:1] == b"\0" else "utf-16", errors="replace"
        ).encode()
    return data.removeprefix(b"\xef\xbb\xbf")


def is_text(begin: bytes) -> bool:
    """Whether a file that begins so is text, by its first line: later zero bytes may come from a
    loss of power."""
    if UTF_16.match(begin):
        return True
    return CONTROL.search(begin.partition(b"\n")[0]) is None


def begins_with_rows(begin: bytes) -> bool:
    """Whether most of the last 20 lines in the begin of a text are rows of two or more numbers or
    times."""
    lines = numbered(decoded_text(begin).encode().rpartition(b"\n")[0])[-20:]
    sign = delimiter_of(lines, "auto")
    cells = [text.strip(' "').split(None if sign == " " else sign) for _, text in lines]
    return sum(len(one) > 1 and all(map(is_value, one)) for one in cells) > 0.8 * len(cells) > 8


def delimiter_of(lines: TextLines, given: str) -> str:
    """The given delimiter. For `auto`: the one of tab, `;`, `|`, `,` and blank with which most
    cells are numbers, times or missing. Without numbers: the first of tab, `;` and `|` that every
    line has; a blank if no line has a comma."""
    if given != "auto":
        return DELIMITERS.get(given, given)
    sample = [text for _, text in lines if text.strip()][:FIRST_LINES]
    scores = dict[str, float]()
    for sign in "\t;|, ":
        split = [text.strip().split(None if sign == " " else sign) for text in sample]
        (width, _), *_ = Counter(map(len, split)).most_common(1) or [(0, 0)]
        cells = [cell.strip(' "') for one in split if len(one) == width > 1 for cell in one]
        typical = sum(len(one) == width for one in split) / max(1, len(split))
        scores[sign] = (
            typical * sum(map(is_value, filter(None, cells))) / max(1, sum(map(bool, cells)))
        )
    # a blank also splits at tabs
    best = max(scores, key=lambda sign: scores[sign] * (1 if sign != " " else 0.98))
    if scores[best] > 0:
        return best
    everywhere = [sign for sign in "\t;|" if sample and all(sign in text for text in sample)]
    spaced = (
        sample
        and not any("," in text for text in sample)
        and all(" " in text.strip() for text in sample)
    )
    return everywhere[0] if everywhere else " " if spaced else ","


def split_rows(lines: TextLines, delimiter: str) -> Rows:
    """Stripped cells of every line, without lines of empty cells. Refuses a quote that is not
    closed on its line."""
    if delimiter == " ":
        lines = [(number, re.sub(r"\s+", " ", text.strip())) for number, text in lines]
    csv.field_size_limit(LONGEST_CELL)  # other packages change it
    reader = csv.reader((text for _, text in lines), delimiter=delimiter, skipinitialspace=True)
    rows: Rows = []
    try:
        # a quote that is not closed takes in several lines
        for (line, _), cells in zip(lines, reader, strict=False):
            if lines[reader.line_num - 1][0] != line:
                raise InputError(f"line {line}: a quote is not closed; remove it")
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                rows.append((line, stripped))
    except csv.Error as error:
        line = lines[reader.line_num - 1][0]
        raise InputError(
            f"line {line} has a cell of more than {LONGEST_CELL} characters; repair it"
        ) from error
    return rows


def name_and_unit(title: str) -> tuple[str, str]:
    """Name and unit of `torque [Nm]`, `torque (Nm)`, `torque {Nm}` or `torque / Nm`; the unit is
    empty if none."""
    match = re.fullmatch(
        r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\})|(.*\S)\s+/\s+(\S.*)",
        title,
        re.DOTALL,
    )
    return (
        (match[1] or match[5], match[2] or match[3] or match[4] or match[6] or "")
        if match
        else (title, "")
    )


def without_brackets(unit: str) -> str:
    """A unit from a row of units, without its brackets: `[deg]` and `(deg)` become `deg`."""
    return unit[1:-1].strip() if unit[:1] + unit[-1:] in ("[]", "()", "{}") else unit


@dataclass
class UnreadableCellError(Exception):
    """A cell that is not a number."""

    place: int  # in the column


def cell_numbers(
    cells: Sequence[str | None] | pl.Series, missing: Collection[str], decimal: str
) -> Array:
    """Values (n,): NaN where a cell is None or one of the words in `missing`. Raises
    UnreadableCellError."""
    if isinstance(cells, pl.Series) and cells.dtype != pl.String:
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy()
    text = pl.Series(cells, dtype=pl.String)
    absent = (text.is_null() | text.is_in(list(missing))).to_numpy()
    plain = text
    # a full stop then separates thousands, or `decimal` is wrong: the cell must not be a number
    if decimal == ",":
        plain = text.str.replace(".", "?", literal=True).str.replace(",", ".", literal=True)
    values = plain.cast(pl.Float64, strict=False).to_numpy().copy()
    values[absent] = np.nan
    unread, other = (
        np.flatnonzero(~np.isfinite(values) & ~absent).tolist(),
        "." if decimal == "," else ",",
    )
    is_grouped = bool(unread) and WHOLE_THOUSANDS[other].fullmatch(str(text[unread[0]])) is not None
    if is_grouped and are_whole_thousands(text.filter(~pl.Series(absent)).to_list(), other):
        return cell_numbers(text.str.replace_all(other, "", literal=True), missing, decimal)
    for place in unread:  # polars does not read `+1.5` and `1.0D-3`
        cell, thousands = str(plain[place]), THOUSANDS[decimal].fullmatch(str(text[place]))
        if thousands:  # in `12.681,27` it is clear which sign is which
            cell = re.sub("[.,]", "", thousands[1]) + "." + thousands[2]
        if not is_number_cell(cell):
            raise UnreadableCellError(place)
        values[place] = float(re.sub("[dD]", "e", cell))
    return values


def are_whole_thousands(cells: Collection[str], sign: str) -> bool:
    """Whether `sign` separates thousands of whole numbers in a column, as in `998` and `1.000`. As
    a decimal sign it would stand in every number if three decimals are written, and no number would
    end in 0 if zeros are left out."""
    grouped = [cell for cell in cells if not SMALL_WHOLE.fullmatch(cell)]
    ends = any(cell.endswith("0") for cell in grouped)
    return (
        len(grouped) < len(cells)
        and ends
        and all(WHOLE_THOUSANDS[sign].fullmatch(cell) for cell in grouped)
    )


def is_number_cell(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None and math.isfinite(float(re.sub("[dD]", "e", cell)))


def is_value(cell: str) -> bool:
    """Whether a cell may be one of a column of numbers or times."""
    is_word = cell in MISSING or cell.casefold() in ("true", "false")
    is_number = is_number_cell(cell.replace(",", ".", 1)) or any(
        one.fullmatch(cell) for one in THOUSANDS.values()
    )
    return is_word or is_number or any(re.match(one, cell) for one in (TIME, SECONDS))


def cell_stamps(cells: pl.Series) -> NDArray[np.int64] | None:
    """Times of day (n,) [ns] of cells such as `10:12:13.002`, `2024-05-01T10:12:13Z`, `0 days
    00:00:00.002` and `12:13.5` (minutes and seconds); None if a cell is no time. Dates are ignored:
    times just continue past midnight."""
    if cells.dtype.is_temporal():
        whole = cells.cast(
            (pl.Datetime if cells.dtype in (pl.Date, pl.Datetime) else pl.Duration)("ns")
        )
        return None if whole.null_count() else whole.cast(pl.Int64).to_numpy()
    if cells.dtype == pl.String and all(
        one.str.contains(SECONDS).fill_null(False).all() for one in (cells[:9], cells)
    ):
        return np.asarray(
            (cells.str.extract(SECONDS).cast(pl.Float64) * 1e9).round().cast(pl.Int64).to_numpy()
        )
    if cells.dtype != pl.String or not cells.str.contains(TIME).fill_null(value=False).all():
        return None
    part = [cells.str.extract(TIME, group) for group in range(1, 9)]
    days, hours, minutes = (one.cast(pl.Int64).fill_null(0).to_numpy() for one in part[:3])
    seconds = part[3].cast(pl.Int64).fill_null(0).to_numpy()
    # minutes and seconds
    if part[3].null_count() == len(cells) and part[4].null_count() < len(cells):
        hours, minutes, seconds = np.zeros_like(hours), hours, minutes
    fraction = part[4].fill_null("").str.pad_end(9, "0").cast(pl.Int64).to_numpy()
    if not part[5].null_count():
        hours = hours % 12 + 12 * part[5].str.to_lowercase().eq("p").to_numpy()
    zone = (
        60 * part[6].cast(pl.Int64).fill_null(0).to_numpy()
        + part[7].cast(pl.Int64).fill_null(0).to_numpy()
    )
    total = ((days * 24 + hours) * 60 + minutes - zone) * 60 + seconds
    stamps = total * 1_000_000_000 + fraction
    turn = 86_400_000_000_000 if hours.any() else 3_600_000_000_000
    back = np.diff(stamps, prepend=stamps[:1]) < -turn // 2
    return np.asarray(stamps + turn * np.cumsum(back))


@dataclass(frozen=True)
class CsvLayout:
    """How a logger writes its table: fields of `ingest.source.CsvSource`, which explains them."""

    delimiter: str = "auto"
    decimal: str = "auto"
    comment: str = "auto"
    header: Literal["auto", "row", "comment", "none"] = "auto"
    units_row: bool | Literal["auto"] = "auto"
    missing: tuple[str, ...] = MISSING
    most_missing: float = 0.01
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"


@dataclass(frozen=True)
class CsvTable:
    """The rows of a log, as text or, where its format has them, as numbers."""

    # names of the columns, as in the header; a column without a name has its number
    names: list[str]
    # units of the columns, from a row of units or from brackets behind the name; else empty
    units: list[str]
    lines: NDArray[np.int64]  # number of each row's line in the file, (rows,)
    # the cells, a column each; null in rows in which the logger omitted the column
    body: pl.DataFrame
    comments: list[str]  # comments, and what stands above the header and below the rows
    damage: Ledger  # what was repaired or left out
    delimiter: str = ""
    decimal: str = "."
    noun: str = "line"  # word for what `lines` count
    is_padded: bool = False  # whether columns differ in length and are padded with nulls
    # which columns are not, in words: nothing tells their time
    not_read: list[str] = field(default_factory=list)


def place_of(name: str, names: Sequence[str]) -> int:
    """Place of the one column that a name, pattern or number means (`places_of`). Refuses none, and
    several."""
    places, where = places_of(name, names), f"column '{name[:80]}'"
    if len(places) > 1:
        which = listing([f"{place + 1} ('{names[place]}')" for place in places])
        advice = "write a pattern or a name that only one has, or its number"
        raise InputError(f"{where} occurs {len(places)} times, as columns {which}; {advice}")
    if not places:
        advice = (
            nearest(name, names)
            or "; correct the name in the source file, or state `time: {rate: HZ}` if it is time"
        )
        advice = advice if len(names) > 1 else "; state `delimiter` if these are several columns"
        raise InputError(f"{where} is missing; the file has {listing(names)}{advice}")
    return places[0]


def places_of(name: str, names: Sequence[str]) -> list[int]:
    """Places of the columns with this name (with or without unit), pattern (`*`: any text) or
    number (from 1)."""
    plain = [name_and_unit(title)[0] for title in names]
    for titles in (names, plain):
        if name in titles:
            return [i for i, title in enumerate(titles) if title == name]
    if "*" in name:
        pattern = re.compile(re.escape(name).replace(r"\*", ".*"), re.DOTALL)
        return [
            i
            for i in range(len(names))
            if pattern.fullmatch(names[i]) or pattern.fullmatch(plain[i])
        ]
    number_given = re.fullmatch(r"[1-9]\d{0,4}", name, re.ASCII) and int(name) <= len(names)
    return [int(name) - 1] if number_given else []


def is_clock(title: str) -> bool:
    """Whether a column is named like a clock: `time`, `t_s`, `loop_time [ms]`."""
    # without groups of HDF5
    name = re.sub(r"\s+", "_", name_and_unit(title)[0].rpartition("/")[2].strip())
    words = "time|t|timestamp|stamp|(state|loop|pi|sys|ros|elapsed)_time|elapsed|clock|seconds|time_since_start|x_value"
    words += "|millis|micros|[mu]s|(date_?)?time|datetime|date_and_time|time_of_day|(uhr)?zeit|tijd|temps|tiempo|tempo"
    return re.fullmatch(f"_*({words})(_(s|sec|ms|us|ns))?", name, re.IGNORECASE) is not None


def read_csv_table(
    path: Path, layout: CsvLayout, is_unit: IsUnit, most_rows: int | None = None
) -> CsvTable:
    """The rows of a log as text; of a long log about the first `most_rows`. Raises InputError: a
    row does not fit."""
    data, ends = read_text(path)
    table = table_of_text(data, ends, layout, is_unit, most_rows)
    stated = [int(found[1]) for text in table.comments if (found := STATED_ROWS.match(text))]
    table.damage.end_unknown = len(table.lines) not in stated
    if most_rows is None and stated and len(table.lines) < min(stated):
        said = f"its text states {min(stated)} samples, and {len(table.lines)} rows are there"
        table.damage.miss_end(f"{said}: the end is missing, or the number counts something else")
    return table


def table_of_text(
    data: bytes, ends: bool, layout: CsvLayout, is_unit: IsUnit, most_rows: int | None
) -> CsvTable:
    """The rows of a text; of a long text about the first `most_rows`."""
    first, last, count = 0, len(data), data.count(b"\n")
    if count < 2 * (FIRST_LINES + LAST_LINES):
        return table_of(numbered(data), layout, is_unit, ends)
    for _ in range(FIRST_LINES):
        first = data.index(b"\n", first) + 1
    for _ in range(LAST_LINES):
        last = data.rindex(b"\n", 0, last)
    # polars splits the middle, if all lines are alike
    middle, behind = data[first : last + 1], count - LAST_LINES + 1
    if most_rows is not None and count > most_rows:
        middle = middle[: middle.rfind(b"\n", 0, most_rows * len(middle) // count) + 1]
    with suppress(InputError):  # reading the whole file then says what is wrong
        begin, end = numbered(data[:first]), numbered(data[last + 1 :], behind + 1)
        table = table_of([*begin, *end], layout, is_unit, ends)
        rest = alike_rows(middle, table.delimiter, table.body.columns)
        if rest is not None and not table.damage.gaps:
            above = int((table.lines <= FIRST_LINES).sum())
            between = FIRST_LINES + 1 + np.arange(len(rest))
            lines = np.concatenate([table.lines[:above], between, table.lines[above:]])
            body = pl.concat([table.body[:above], rest, table.body[above:]])
            return replace(table, lines=lines, body=body)
    return table_of(numbered(data), layout, is_unit, ends)


def alike_rows(text: bytes, delimiter: str, names: Sequence[str]) -> pl.DataFrame | None:
    """The cells of lines that all have a cell per name, in an eighth of time and memory; None if a
    line differs."""
    if b'"' in text or b"\n\n" in text or any(sign.encode() in text for sign in COMMENTS):
        return None
    if delimiter == " ":
        text, delimiter = (
            re.sub(rb"[ \t]+", b"\t", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)),
            "\t",
        )
    signs = np.frombuffer(text, np.uint8)
    counts = np.diff(
        np.searchsorted(np.flatnonzero(signs == ord(delimiter)), np.flatnonzero(signs == 10)),
        prepend=0,
    )
    if (counts != len(names) - 1).any():
        return None
    rows = pl.read_csv(
        text, has_header=False, separator=delimiter, quote_char=None, infer_schema=False
    )
    rows = rows.with_columns(pl.all().fill_null("").str.strip_chars())
    rows.columns = list(names)
    return None if rows.select(pl.all_horizontal(pl.all() == "").any()).item() else rows


def is_last_whole(cells: Sequence[str]) -> bool:
    """Whether the last cell of a file without a final line break is complete: it has as many
    decimals as all others in its column. Whole numbers do not tell: False."""
    decimals = {
        len(re.split("[.,]", cell, maxsplit=1)[-1]) * bool(re.search("[.,]", cell))
        for cell in cells
    }
    return len(cells) > 1 and len(decimals) == 1 and 0 not in decimals


def table_of(lines: TextLines, layout: CsvLayout, is_unit: IsUnit, ends: bool = True) -> CsvTable:
    """The table in lines of text. `ends`: the last line has a break."""
    signs = COMMENTS if layout.comment == "auto" else tuple(filter(None, [layout.comment]))
    comments, content = TextLines(), TextLines()
    for line, text in lines:
        sign = next((one for one in signs if text.lstrip().startswith(one)), None)
        if sign is None:
            content.append((line, text))
        else:
            comments.append((line, text.strip()[len(sign) :].strip()))
    if content and (stated := re.fullmatch(r"sep=(.)", content[0][1].strip())):  # as Excel reads it
        content = content[1:]
        layout = replace(
            layout, delimiter=stated[1] if layout.delimiter == "auto" else layout.delimiter
        )
    delimiter = delimiter_of(content, layout.delimiter)
    return table_of_rows(split_rows(content, delimiter), comments, layout, is_unit, delimiter, ends)


@dataclass
class Head:
    names: list[str]
    units: list[str]
    first: int  # place of the first row of data
    line: int = 0  # of the names
    notes: list[str] = field(default_factory=list)  # other text above them


def table_of_rows(
    rows: Rows,
    comments: TextLines,
    layout: CsvLayout,
    is_unit: IsUnit,
    delimiter: str = "",
    ends: bool = True,
) -> CsvTable:
    """The table in rows of cells, of text or of a sheet of numbers."""
    damage = Ledger()
    if layout.header != "comment" and not rows:
        raise InputError("holds no rows; record it again, or exclude the trial")
    first_value = first_column_of_values(rows)
    head = head_of(rows, comments, layout, is_unit, delimiter, first_value)
    if len(head.names) > MOST_COLUMNS:
        raise InputError(
            f"has {len(head.names)} columns, at most {MOST_COLUMNS} are read; write a row per"
            " sample"
        )
    rows, below = without_footer(rows[head.first :], first_value, layout)
    if below:
        said = " ".join(below[0][1])[:60]
        damage.remarks.append(
            f"{len(below)} lines below the table, from {below[0][0]} on, are no rows: '{said}'"
        )
    names = [name or str(place) for place, name in enumerate(head.names, start=1)]
    rows = [(line, unpadded(cells, len(names))) for line, cells in rows]
    if not rows:
        raise InputError("no rows of data; record it again, or exclude the trial")
    rows = without_cut_row(rows, len(names), damage, whole=ends or bool(below))
    fitting, repairs = fitting_rows(rows, len(names), layout)
    if skipped := len(rows) - len(fitting):
        damage.lose(repairs.pop(), 0, Counter({0: skipped}), 0)
    damage.remarks += repairs
    if not fitting:
        raise InputError(
            f"none of its rows fits the header's {len(names)} names; state `delimiter` or `header`"
        )
    body = [
        pl.Series(str(k), [row[k] for _, row in fitting], dtype=pl.String)
        for k in range(len(names))
    ]
    lines = np.array([line for line, _ in fitting])
    notes = [*head.notes, *(text for _, text in comments), *(" ".join(cells) for _, cells in below)]
    decimal = decimal_of(fitting) if layout.decimal == "auto" else layout.decimal
    return CsvTable(names, head.units, lines, pl.DataFrame(body), notes, damage, delimiter, decimal)


def first_column_of_values(rows: Rows) -> int | None:
    """Place of the first column in which at least half of the cells are numbers, times or missing;
    None if none."""
    sample = rows[: 2 * FIRST_LINES]
    (width, _), *_ = Counter(len(cells) for _, cells in sample).most_common(1) or [(0, 0)]
    typical = [cells for _, cells in sample if len(cells) == width]
    typical = typical[len(typical) // 2 :]  # the first rows may be a header
    for place in range(width):
        cells = [cells[place] for cells in typical if cells[place]]
        if cells and sum(map(is_value, cells)) >= 0.5 * len(cells):
            return place
    return None


def is_data(cells: Sequence[str], width: int, first_value: int, begins_blank: bool) -> bool:
    """Whether a row may be data: as wide as most, with a number or time in the first column that
    has them, and, if data `begins_blank`, nothing before it."""
    named = [cell for cell in cells if cell]
    is_head = not any(map(is_value, named)) or STATED_ROWS.match(" ".join(named)) is not None
    is_head |= begins_blank and any(cells[:first_value])
    if is_head or len(cells) != width or not is_value(cells[first_value]):
        return False
    counts = [str(k) for k in range(len(named))], [str(k + 1) for k in range(len(named))]
    return bool(cells[0]) or named not in counts  # pandas numbers columns without a name: `,0,1,2`


def is_odd_data(cells: Sequence[str], width: int) -> bool:
    """Whether a row above the data is data that lacks cells or has a word: more than half of its
    cells are numbers."""
    named = [cell for cell in cells if cell]
    is_count = (not cells[0] and named[:1] in (["0"], ["1"])) or STATED_ROWS.match(
        " ".join(cells)
    ) is not None
    return (
        len(cells) > max(1, width / 2)
        and sum(map(is_number_cell, named)) > len(named) / 2
        and not is_count
    )


def head_of(
    rows: Rows,
    comments: TextLines,
    layout: CsvLayout,
    is_unit: IsUnit,
    delimiter: str,
    first_value: int | None,
) -> Head:
    """Names and units of the columns, and the place of the first row of data."""
    if layout.header == "comment":
        named = split_rows(comments[-1:], delimiter)
        if not named:
            sign = "#" if layout.comment == "auto" else layout.comment
            raise InputError(f"no line begins with '{sign}'; write `header: row` or `header: none`")
        return Head(named[0][1], [name_and_unit(name)[1] for name in named[0][1]], 0)
    (width, _), *_ = Counter(len(cells) for _, cells in rows[: 2 * FIRST_LINES]).most_common(1)
    if layout.header == "none":
        return Head([str(place + 1) for place in range(width)], [""] * width, 0)
    if first_value is None:
        line, cells = rows[len(rows) // 2]
        said = f"no table of numbers: most of its {len(rows)} rows hold none, such as line {line}, "
        said += (
            f"'{' '.join(cells)[:40]}'; name a recording, or write a header and a row per sample"
        )
        raise InputError(
            said if len(rows) > 1 else "no rows of data; record it again, or exclude the trial"
        )
    begins_blank = not any(rows[len(rows) // 2][1][:first_value])
    data = partial(is_data, width=width, first_value=first_value, begins_blank=begins_blank)
    first = next((place for place, (_, cells) in enumerate(rows) if data(cells)), len(rows))
    if layout.ragged == "dropped_variable":  # such a logger writes its header first
        first = 1
    while first and is_odd_data(rows[first - 1][1], width):
        first -= 1
    every = rows[:first]
    above = joined_heads([row for row in every if not STATED_ROWS.match(" ".join(row[1]))])
    heads = above[len(above) - headers_above(above, width) :]
    units_row = layout.units_row is True or (
        layout.units_row == "auto" and are_units(heads, is_unit)
    )
    units = [*map(without_brackets, heads.pop()[1])] if units_row and len(heads) > 1 else []
    if delimiter == " " and len(units) < width:  # it is unknown which column has no unit
        units = []
    names, line = named_by(heads, above, comments, width, delimiter), heads[-1][0] if heads else 0
    upper = named_by([], [], comments[:-1], width, delimiter) if not (heads or above) else []
    if upper and are_units([(0, upper), (0, names)], is_unit):
        units, names = [*map(without_brackets, names)], upper
    if not names and layout.header == "row":
        said = f"line {rows[0][0]} holds numbers, not the columns' names"
        raise InputError(f"{said}; write `header: none` and the columns' numbers")
    # LabVIEW's, without time's
    labelled = next((cells[1:] for _, cells in every if cells[0] == "Y_Unit_Label"), [])
    signals = [name for name in names if not is_clock(name) and name != "Comment"]
    # if each signal has its time, in every second column
    stated_all = [cell for cell in labelled if cell]
    labels = iter(stated_all if len(stated_all) == len(signals) else labelled)
    units = units or ["" if is_clock(name) else next(labels, "") for name in names]
    stated = [name_and_unit(name)[1] for name in names] or [""] * width
    units = [unit or own for unit, own in zip([*units, *[""] * len(stated)], stated, strict=False)]
    notes = [" ".join(filter(None, cells)) for number, cells in every if number != line]
    return Head(names or [str(place + 1) for place in range(width)], units, first, line, notes)


def joined_heads(above: Rows) -> Rows:
    """Rows above the data. The last two are joined if they fill different columns: pandas writes an
    index so."""
    (line, upper), (_, last) = above[-2:] if len(above) > 1 else [(0, [""]), (0, ["", ""])]
    if len(upper) != len(last) or any(map(all, zip(upper, last, strict=True))) or not any(last):
        return above
    return [*above[:-2], (line, [one or other for one, other in zip(upper, last, strict=True)])]


def headers_above(above: Rows, width: int) -> int:
    """Number of header rows right above the data, at most three. Each has cells for at least half
    of the columns."""
    count = 0
    for _, cells in reversed(above[-3:]):
        filled = sum(map(bool, cells))
        if not (
            width / 2 <= filled
            and len(unpadded(cells, 0)) <= width + 1
            and (width == 1 or filled > 1)
        ):
            break
        count += 1
    return min(count, 1) if width == 1 else count


def are_units(heads: Rows, is_unit: IsUnit) -> bool:
    """Whether the last of several header rows holds units."""
    last = heads[-1][1] if len(heads) > 1 else []
    cells = [without_brackets(cell) for cell in last if cell not in ("", "-", "[]", "()")]
    return bool(cells) and sum(is_unit(cell) and cell != "1" for cell in cells) > len(cells) / 2


def named_by(
    heads: Rows, above: Rows, comments: TextLines, width: int, delimiter: str
) -> list[str]:
    """Names of the columns, from the header row nearest to the data; if names repeat there, joined
    with the row above. Without a header: from a line with another delimiter, or a comment. Empty if
    there are none."""
    if heads:
        names = unpadded(heads[-1][1], 0)
        if delimiter == " " and len(names) > width:  # `POS (ANAT)` is one name
            names = re.findall(r"\S+(?: [(\[]\S+)*", " ".join(names))
        # LabVIEW's last column is empty
        if len(names) == width + 1 and names[-1].casefold() == "comment":
            names = names[:width]
        if len(heads) > 1 and len({*filter(None, names)}) < len([*filter(None, names)]):
            upper = [""]
            # a name stands above the first of its columns
            for cell in [*heads[-2][1], *[""] * width][:width]:
                upper.append(cell or upper[-1])
            names = [" ".join(filter(None, pair)) for pair in zip(upper[1:], names, strict=False)]
        return names
    texts = [delimiter.join(cells) for _, cells in above[-1:]] + [
        text for _, text in comments[::-1]
    ]
    for text in texts:
        for pattern in (
            re.escape(delimiter or ","),
            r"\t",
            ";",
            ",",
            r"\|",
            r"\s{2,}",
            r"(?<=[\])}])\s+",
            r"\s+",
        ):
            cells = [cell.strip(' "') for cell in re.split(pattern, text.strip())]
            if len(cells) == width and not any(map(is_value, cells)):
                return cells
    return []


def without_footer(rows: Rows, first_value: int | None, layout: CsvLayout) -> tuple[Rows, Rows]:
    """Rows of data, and the footer: the last rows with a word in or before the first column of
    numbers."""
    end, place = len(rows), first_value or 0
    while end and layout.header in ("auto", "row") and len(rows) - end < LAST_LINES:
        cells = rows[end - 1][1]
        # blank elsewhere
        beside = [cell for cell, first in zip(cells[:place], rows[0][1], strict=False) if not first]
        if len(cells) <= place or all(
            is_value(cell) or is_value(cell.split(" ")[0]) for cell in [*beside, cells[place]]
        ):
            break
        end -= 1
    return (rows[:end], rows[end:]) if end else (rows, [])


def without_cut_row(rows: Rows, width: int, damage: Ledger, whole: bool) -> Rows:
    """Rows without a last row that is, or may be, cut off by an interrupted recorder. `whole`: it
    has a line break."""
    line, cells = rows[-1]
    if len(rows) > 1 and len(cells) < min(width, len(rows[-2][1])):
        damage.miss_end(f"the last line, {line}, is cut off and was skipped")
        return rows[:-1]
    if len(rows) > 1 and not whole and not is_last_whole([cells[-1] for _, cells in rows]):
        damage.remarks.append(
            f"the last line, {line}, has no line break, may be cut in a number and was skipped"
        )
        damage.uncounted = True
        return rows[:-1]
    return rows


def decimal_of(rows: Sequence[tuple[int, Sequence[str | None]]]) -> str:
    """The decimal sign of the cells. A comma if numbers have commas and no stops, unless all may
    separate thousands."""
    columns = zip_longest(*(row for _, row in (*rows[:FIRST_LINES], *rows[-LAST_LINES:])))
    numbers = [
        [*filter(is_value, {cell or "" for cell in column} - {*MISSING})] for column in columns
    ]
    others = [column for column in numbers if not are_whole_thousands(column, ".")]
    cells = [cell for column in others for cell in column]
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell)]
    if any(THOUSANDS[","].fullmatch(cell) for cell in cells):
        return ","
    stops = any(re.fullmatch(r"[+-]?\d*\.\d+([eEdD][+-]?\d+)?", cell) for cell in cells)
    if len(others) < len(numbers):
        return "." if stops else ","
    thousands = all(WHOLE_THOUSANDS[","].fullmatch(cell) for cell in commas)
    return "," if commas and not stops and not thousands else "."


def share_above(count: int, total: int) -> float:
    """count / total rounded up to three decimals, for the user to write."""
    return math.ceil(1000 * count / total) / 1000


def unpadded(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones beyond `width`: some programs pad lines with them."""
    last = max((place for place, cell in enumerate(cells, start=1) if cell), default=0)
    return cells[: max(last, width)]


def fitting_rows(
    rows: Rows, width: int, layout: CsvLayout
) -> tuple[list[tuple[int, list[str | None]]], list[str]]:
    """The rows that fit, with None for omitted columns, and a note on each repair."""
    if layout.ragged == "dropped_variable":
        return dropped_variables(rows, width, layout.missing)
    odd = [(line, len(cells)) for line, cells in rows if len(cells) != width]
    if odd and (layout.ragged == "refuse" or len(odd) > layout.most_missing * len(rows)):
        share = share_above(len(odd), len(rows))
        more = f" and `most_missing: {share:g}`" if share > layout.most_missing else ""
        remedy = (
            f"repair these lines, or write `ragged: skip`{more} in the source file to leave"
            " them out"
        )
        if len({count for _, count in odd}) == 1 and len(odd) == len(rows):
            remedy = "write a name for each, and the same sign between names as between cells"
        said = (
            f"line {odd[0][0]} has {odd[0][1]} cells under {width} names, and {len(odd)} of"
            f" {len(rows)} rows"
        )
        raise InputError(f"{said} do not fit; {remedy}")
    note = f"{len(odd)} of {len(rows)} rows do not fit the header and were skipped"
    return [(line, list(cells)) for line, cells in rows if len(cells) == width], [note] * bool(odd)


def dropped_variables(
    rows: Rows, width: int, missing: Collection[str]
) -> tuple[list[tuple[int, list[str | None]]], list[str]]:
    """The rows of a logger that omits failed variables; None from there on. The omitted columns are
    those missing in the row before. The logger of `opensourceleg` writes its header late, with the
    first thousand rows. Variables that failed before have no name in it: their cells, those missing
    in the last row that has them, are left out."""
    notes, columns, filled = list[str](), list(range(width)), list[tuple[int, list[str | None]]]()
    first = next((place for place, (_, cells) in enumerate(rows) if len(cells) == width), 0)
    lengths = {len(cells) for _, cells in rows[:first]}
    unnamed = (
        [place for place, cell in enumerate(rows[first - 1][1]) if cell in missing] if first else []
    )
    if unnamed and lengths == {width + len(unnamed)}:
        named = [
            (n, [cell for k, cell in enumerate(cells) if k not in unnamed])
            for n, cells in rows[:first]
        ]
        which = ", ".join(str(place + 1) for place in unnamed)
        notes.append(
            f"up to line {rows[first - 1][0]}, cells {which} of every row have no name and were"
            " left out"
        )
        rows = [*named, *rows[first:]]
    for place, (line, cells) in enumerate(rows):
        if len(cells) != len(columns):
            before = rows[place - 1][1] if place else []
            failed = [
                column for column, cell in zip(columns, before, strict=False) if cell in missing
            ]
            if len(cells) > len(columns) or len(columns) - len(cells) != len(failed):
                raise InputError(
                    f"line {line} has {len(cells)} cells where {len(columns)} were, and"
                    f" {len(failed)} were missing in the line before: it is unknown which column"
                    " was omitted; cut the file off there"
                )
            columns = [column for column in columns if column not in failed]
            which = ", ".join(str(column + 1) for column in failed)
            notes.append(f"from line {line} on, columns {which} are missing")
        by_column: dict[int, str] = dict(zip(columns, cells, strict=True))
        filled.append((line, [by_column.get(column) for column in range(width)]))
    return filled, notes
