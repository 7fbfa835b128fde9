"""The sample sheet `trials.csv` of a campaign: one row per trial, validated when it is read."""

import csv
import math
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS, RENAMED
from osl_analysis.errors import InputError, nearest
from osl_analysis.formats.other_formats import refuse_others
from osl_analysis.model.compensator import CONTROLLERS

INVISIBLE = {"Cf", "Zl", "Zp", "Cc"}
"""Unicode categories of characters that nobody sees: zero width, text direction, line separators, control."""


@dataclass(frozen=True)
class SheetLine:
    """One row of a sheet. number: its line in the file, counted from 1; cells: by column, without outer blanks."""

    number: int
    cells: dict[str, str]


def sheet_lines(path: Path) -> tuple[list[str], list[SheetLine]]:
    """Columns and rows of a CSV sheet in UTF-8, with or without byte order mark.

    Empty lines and lines that begin with `#` are skipped; elsewhere `#` is text. `NA` is text, too. An empty cell says
    nothing.
    """
    rows = list(numbered_rows(path))
    if not rows:
        raise InputError(f"{path}: not a CSV table, it is empty; write a header and a row per trial")
    first, header = rows[0]
    columns = [outer_blanks_off(cell) for cell in header]
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{path}: line {first}: column '{column}' stands twice; remove one")
    lines = []
    for number, row in rows[1:]:
        cells = [outer_blanks_off(cell) for cell in row]
        if any(cells[len(columns) :]):
            said = f"{len(row)} cells, the header has {len(columns)}; quote a cell that contains a comma"
            raise InputError(f"{path}: line {number}: {said}")
        if any(cells):
            lines.append(SheetLine(number, dict(zip(columns, cells + [""] * len(columns), strict=False))))
    for line in lines:
        for column, cell in line.cells.items():
            for sign in cell if column != "exclude" else "":  # two equal names would differ; that is a sentence
                if (sign.isspace() and sign != " ") or unicodedata.category(sign) in INVISIBLE:
                    name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'a control character')})"
                    said = f"column '{column}': {cell!r} contains {name}; type the cell again"
                    raise InputError(f"{path}: line {line.number}: {said}")
    return columns, lines


def numbered_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a CSV file with the number of their line, without empty lines and comments."""
    try:
        content = path.read_bytes()
        refuse_others(path, content)
        if b"\0" in content.partition(b"\n")[0]:
            raise InputError(f"{path}: its header holds zero bytes, it is not UTF-8; save the sheet as 'CSV UTF-8'")
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}: line {line}: byte {error.object[error.start]:#04x} is not UTF-8; save the sheet as 'CSV UTF-8'"
        ) from error
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    number = 1
    try:
        for row in reader:
            if row and not row[0].lstrip().startswith("#"):
                yield number, row
            number = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: line {number}: not CSV ({error}); check the quotes") from error


def outer_blanks_off(cell: str) -> str:
    """A cell without blanks and invisible characters at its ends."""
    seen = [k for k, sign in enumerate(cell) if not (sign.isspace() or unicodedata.category(sign) in INVISIBLE)]
    return cell[seen[0] : seen[-1] + 1] if seen else ""


JOINT = "ankle"  # The joint of a trial whose row names none. The walkway measures this one.
LONGEST_WORD = 100  # Largest number of characters of a joint or controller.
SIDES, DIRECTIONS = ("left", "right"), ("up", "down")
CONDITIONS = ("group", "subject", "session", "side", "speed", "direction")
"""Columns that say under which conditions a crossing was walked. Walking results are split by them."""
SHEET_COLUMNS = (
    "trial", "experiment", "controller", "K_d", "B_d", "perturbed", "log", "log_source", "mocap", "mocap_source",
    "log_part", "desired", "windows", "exclude", "accept", "joint", *CONDITIONS, "body_mass_kg", "static",
)  # fmt: skip
SheetRows = dict[str, dict[str, Any]]  # The rows of a sheet by trial, with all columns; None where a cell is empty.


def read_sheet(path: Path) -> SheetRows:
    """Read and validate a sample sheet, CSV in UTF-8.

    trial: its name, of letters, digits, `_`, `.` and `-`.
    experiment: one of `EXPERIMENTS`.
    joint: what turned, as a word of the laboratory's own; empty: the ankle. On the walkway it is the ankle.
    side: left or right; of a crossing, the leg that steps on the platform.
    controller: its name; `compensated` and `uncompensated` are those of the draft. Empty: none, as in a passive device.
    K_d, B_d: desired impedance [N*m/rad, N*m*s/rad] of an impedance trial or a crossing, where it is known.
    perturbed: true or false, for a crossing.
    log, mocap: files, relative to the campaign's raw data.
    log_source, mocap_source: names of the files in `config/sources` that describe them.
    log_part: the part of the log that is this trial, where it holds several, such as `Test.run(2)` of a MATLAB file.
    desired: name of the curve under `torque_angle.desired` that a trial of torque against angle should follow.
    windows: stretches [s] of an impedance trial that are fitted, from the start of the recording, such as `2-30 40-62`;
        its motion is then taken for another one than the stepped sine. Empty: all of the motion.
    exclude: the reason why the trial is excluded; empty: it is used.
    accept: names of quality checks, separated by blanks. Their failure neither flags nor excludes the trial.
    group, subject, session, speed: conditions of a crossing, as words of the laboratory's own.
    body_mass_kg: of the person who walks, with clothes and leg. The load on the plate is compared with it.
    static: the static trial that calibrates a crossing or plate trial; empty: that of its subject, session and side.
    direction: turn of the platform, up (toes up, dorsiflexion) or down. It is checked against the markers.

    Raises InputError where the sheet is missing or empty, a column is unknown, or a value is not allowed.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such sample sheet; write one (docs/own_data.md) or set `sheet`")
    columns, lines = sheet_lines(path)
    unknown = sorted(set(columns) - set(SHEET_COLUMNS))
    absent = sorted({"trial", "experiment"} - set(columns))
    if unknown or absent:
        sign = next((sign for sign in ";\t|" if len(columns) == 1 and sign in columns[0]), "")
        if sign:
            raise InputError(f"{path}: its cells are separated by '{sign}'; save the sheet with commas, as 'CSV UTF-8'")
        what = f"unknown column '{unknown[0]}'" if unknown else f"no column '{absent[0]}'"
        like = nearest(unknown[0], set(SHEET_COLUMNS) - set(columns)) if unknown else ""
        raise InputError(f"{path}: {what}; the columns are {', '.join(SHEET_COLUMNS)}{like}")
    if not lines:
        raise InputError(f"{path}: no trials; add one row per trial")
    check_rows(lines, path)
    return {line.cells["trial"]: typed(line.cells) for line in lines}


def check_rows(lines: Sequence[SheetLine], path: Path) -> None:
    """Refuse a value that is not allowed, and a trial that stands twice; `path` is for messages."""
    seen: dict[str, int] = {}
    for line in lines:
        row = dict.fromkeys(SHEET_COLUMNS, "") | line.cells
        trial, problem = row["trial"], problem_in(row)
        if not problem and trial in seen:
            problem = f"trial '{trial}' stands twice, first in line {seen[trial]}; give each row its own name"
        if problem:
            raise InputError(f"{path}: line {line.number}: {problem}")
        seen[trial] = line.number
    check_spelling(lines, path)


def check_spelling(lines: Sequence[SheetLine], path: Path) -> None:
    """Refuse two names of a joint or controller that differ by capitals, or by how Unicode writes a letter, alone."""

    def folded(name: str) -> str:
        return unicodedata.normalize("NFKC", name).casefold()

    for column, known in (("joint", (JOINT,)), ("controller", CONTROLLERS)):
        first = {folded(name): name for name in known}
        for line in lines:
            name = line.cells.get(column) or known[0]
            before = first.setdefault(folded(name), name)
            if before != name:
                raise InputError(
                    f"{path}: line {line.number}: {column} '{name}' differs from '{before}' by capitals or accents "
                    f"alone, and would be another one; write '{before}' in both"
                )


def typed(cells: Mapping[str, str]) -> dict[str, Any]:
    """A valid row with numbers and truth values."""
    row: dict[str, Any] = {column: cells.get(column) or None for column in SHEET_COLUMNS}
    numbers = {name: float(row[name]) for name in ("K_d", "B_d", "body_mass_kg") if row[name]}
    perturbed = row["perturbed"] and row["perturbed"].lower() == "true"
    return row | numbers | {"perturbed": perturbed, "joint": row["joint"] or JOINT}


def problem_in(row: dict[str, str]) -> str:
    """What is wrong with one row of a sheet, with the remedy; empty if nothing is."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}", row["trial"]):
        return f"trial '{row['trial']}' must be up to 100 letters, digits, '_', '.' and '-': it becomes a file name"
    if new := RENAMED.get(row["experiment"]):
        return f"experiment '{row['experiment']}' is now called '{new}'; write '{new}'"
    if row["experiment"] not in EXPERIMENTS:
        like = nearest(row["experiment"], EXPERIMENTS)
        return f"experiment '{row['experiment']}' is none of {', '.join(EXPERIMENTS)}{like}"
    for column in ("joint", "controller"):
        if (length := len(row[column])) > LONGEST_WORD:
            return f"{column} '{row[column][:20]}...' has {length} characters; up to {LONGEST_WORD} are allowed"
    for column in ("K_d", "B_d", "body_mass_kg"):
        is_decimal = re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", row[column])
        if row[column] and not (is_decimal and math.isfinite(float(row[column]))):
            return f"{column} '{row[column]}' is not a number; give it in SI units, without the unit"
    if row["body_mass_kg"] and not float(row["body_mass_kg"]) > 0:
        return f"body_mass_kg '{row['body_mass_kg']}' must be above 0, or empty"
    if (row["K_d"] and not float(row["K_d"]) > 0) or (row["B_d"] and not float(row["B_d"]) >= 0):
        said = ", ".join(f"{column} = {row[column]}" for column in ("K_d", "B_d") if row[column])
        return f"{said} is not the impedance of a joint; give K_d > 0 and B_d >= 0"
    if row["perturbed"].lower() not in ("", "true", "false"):
        return f"perturbed '{row['perturbed']}' must be true or false"
    return problem_with_conditions(row) or problem_with_needs(row)


def problem_with_conditions(row: dict[str, str]) -> str:
    """What is wrong with the conditions of a row, with the remedy; empty if nothing is."""
    for column, allowed in (("side", SIDES), ("direction", DIRECTIONS)):
        if row[column] and row[column] not in allowed:
            return f"{column} '{row[column]}' must be {' or '.join(allowed)}"
    if EXPERIMENTS[row["experiment"]].place == "walkway" and row["joint"] not in ("", JOINT):
        return (
            f"joint '{row['joint']}' of experiment '{row['experiment']}': the walkway measures the {JOINT}; leave the "
            "cell empty if it is that, or write experiment 'ingest_only' for a recording that is not analysed"
        )
    if row["direction"] and row["perturbed"].lower() != "true":
        return f"direction '{row['direction']}' of a trial that is not perturbed; leave the cell empty"
    for column in CONDITIONS:
        cell = row[column]
        if not re.fullmatch(r"[\w .%+/-]{0,40}", cell):
            return f"{column} '{cell}' must be up to 40 letters, digits, blanks and . % + / - _: it names a group"
    return ""


def problem_with_needs(row: dict[str, str]) -> str:
    """What a row lacks that its experiment needs; empty if nothing."""
    for column in EXPERIMENTS[row["experiment"]].sheet:
        if not row[column]:
            return f"{column} is empty; a trial of experiment '{row['experiment']}' needs it"
    if not row["log"] and not row["mocap"]:
        return f"trial '{row['trial']}' names no file; fill in log or mocap"
    for column in ("log", "mocap"):
        if row[column] and not row[f"{column}_source"]:
            return f"{column}_source is empty; name the file in config/sources that describes {row[column]}"
        if row[f"{column}_source"].endswith((".yaml", ".yml")):
            return f"{column}_source '{row[f'{column}_source']}' names a file; write its name without the ending"
    windows, experiment = row["windows"], row["experiment"]
    if windows and experiment != "impedance":
        return f"windows '{windows}' of experiment '{experiment}'; only 'impedance' fits windows, leave it"
    if windows and not re.fullmatch(r"\d+\.?\d*-\d+\.?\d*(\s+\d+\.?\d*-\d+\.?\d*)*", windows):
        return f"windows '{windows}' are not from-to in s; write them as 2-30 40-62"
    if row["log_part"] and not row["log"]:
        return f"log_part '{row['log_part']}' without a log; fill in log, or clear log_part"
    return ""
