"""The sample sheet `trials.csv` of a campaign, one row per trial, validated when it is read."""

import csv
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError, nearest
from osl_analysis.formats import TEXT_PRIORITY, formats_of, refuse_others
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.refusal import check_not_refused
from osl_analysis.trial import stretches

# the joint that the walkway measures, and of a row that names none beside rows that do
JOINT = "ankle"
USUAL_JOINTS = (JOINT, "knee", "hip")
# How similar a name of one's own may be to a usual one, as a share of its letters
SIMILAR_JOINT = 0.8
SIMILAR_CONTROLLER = 0.9

# columns with the conditions of a walking trial, by which the results are split
CONDITIONS = ("group", "subject", "session", "speed", "side", "direction")
# columns on what turns with the joint: inertia [kg*m^2], weight m g r [N*m], angle [deg] with its
# centre below
FIXTURE = ("fixture_inertia", "fixture_weight", "fixture_rest_deg")
# columns on a calibration's spring [N*m/rad] or inertia [kg*m^2], and its standard uncertainty in
# percent
KNOWN_COLUMNS = ("known_K", "known_I", "known_percent")
SHEET_COLUMNS = (
    "trial", "experiment", "controller", "K_d", "B_d", "perturbed", "log", "log_source", "mocap",
    "mocap_source", "log_part", "desired", "windows", "exclude", "accept", "joint", *CONDITIONS,
    "body_mass_kg", "static", *FIXTURE, "fixture", *KNOWN_COLUMNS,
)  # fmt: skip
NUMBER_COLUMNS = ("K_d", "B_d", "body_mass_kg", *FIXTURE, *KNOWN_COLUMNS)
# largest values of columns whose values must be above 0
LARGEST = {"body_mass_kg": 500, "known_K": 1e6, "known_I": 1e3, "known_percent": 50}
LARGEST_K_D = 1e4  # [N*m/rad]
LARGEST_B_D = 1e3  # [N*m*s/rad]
# By column: the experiments whose trials have it
USERS = {
    "windows": tuple(name for name, facts in EXPERIMENTS.items() if facts.place == "bench"),
    "desired": ("torque_angle",),
    "static": tuple(name for name, facts in EXPERIMENTS.items() if facts.place != "bench"),
    **dict.fromkeys((*KNOWN_COLUMNS, "fixture"), ("calibration",)),
    **dict.fromkeys(
        FIXTURE, tuple(name for name, facts in EXPERIMENTS.items() if facts.motion == "theta")
    ),
}
# By column: the form of its cells, in any capitals, and what is wrong with one that has another
FORMS = {
    "trial": (r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}",
        "must be up to 100 letters, digits, '_', '.' and '-': it becomes a file name"),
    **dict.fromkeys(NUMBER_COLUMNS, (r"([+-]?(\d{1,99}\.?\d*|\.\d+)([eE][+-]?\d{1,2})?)?",
        "is not a number; give it in SI units, without the unit")),
    "exclude": (r"(?!(0|no|false|none)$)(.|\n)*",
        "is no reason; clear the cell to analyse the trial, or say why not"),
    "perturbed": ("(true|false)?", "must be true or false"),
    "side": ("((?-i:left|right))?", "must be left or right"),
    "direction": ("((?-i:up|down))?", "must be up or down"),
    "fixture": ("(alone)?", "must be alone, for a calibration with nothing but the fixture"),
    **dict.fromkeys(("group", "subject", "session", "speed"), (r"[\w .%+/-]{0,40}",
        "must be up to 40 letters, digits, blanks and . % + / - _: it names a group")),
    **dict.fromkeys(("log_source", "mocap_source"), (r"(?!.*\.ya?ml$).*",
        "names a file; write its name without the ending")),
}  # fmt: skip
# blanks at the ends of a cell, of which some cannot be seen
BLANKS = re.compile(r"^[\s\u200b-\u200f\u2060\ufeff]+|[\s\u200b-\u200f\u2060\ufeff]+$")

# the rows of a sheet by trial, with all columns; None where a cell is empty
SheetRows = dict[str, dict[str, Any]]


def read_sheet(path: Path) -> SheetRows:
    """Read and validate a sample sheet; docs/own_data.md explains its columns.

    Parameters
    ----------
    path : Path
        CSV in UTF-8. Empty lines and lines that begin with `#` are skipped; elsewhere `#` is text,
        and so is `NA`. An empty cell says nothing, nor do blanks around one.

    Returns
    -------
    SheetRows
        K_d and B_d are in N*m/rad and N*m*s/rad; a joint that is not named is the ankle where other
        rows name theirs or are of the walkway, and else not known (None).

    Raises
    ------
    InputError
        No sheet, or a wrong column or value.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such sample sheet; write one (README, 'Your own data') or set `sheet`"
        )
    check_not_refused(path)
    lines = [
        (number, [BLANKS.sub("", cell) for cell in row]) for number, row in numbered_rows(path)
    ]
    if not lines:
        raise InputError(
            f"{path}: not a CSV table, it is empty; write a header and a row per trial"
        )
    header_line, columns = lines[0]
    check_header(path, header_line, columns)
    names = NamesInSheet()
    rows: SheetRows = {}
    for number, cells in lines[1:]:
        where = f"{path}: line {number}"
        if any(cells[len(columns) :]):
            raise InputError(
                f"{where}: {len(cells)} cells, the header has {len(columns)}; quote a cell that"
                " contains a comma"
            )
        if not any(cells):
            continue
        row = {**dict.fromkeys(SHEET_COLUMNS, ""), **dict(zip(columns, cells, strict=False))}
        problem = next(problems_in(row), "")
        if problem:
            raise InputError(f"{where}: {problem}")
        names.check(where, number, row)
        rows[row["trial"]] = typed_row(row)
    if not rows:
        raise InputError(f"{path}: no trials; add one row per trial")
    return with_joints(rows)


def typed_row(row: Mapping[str, str]) -> dict[str, Any]:
    """A row with numbers and truth values; None where a cell is empty."""
    typed: dict[str, Any] = {column: cell or None for column, cell in row.items()}
    for column in NUMBER_COLUMNS:
        if row[column]:
            typed[column] = float(row[column])
    if row["perturbed"]:
        typed["perturbed"] = row["perturbed"].lower() == "true"
    return typed


def with_joints(rows: SheetRows) -> SheetRows:
    """Put the ankle for each joint that is not named, where others are, or the walkway measures
    it."""
    is_known = any(
        row["joint"] or EXPERIMENTS[row["experiment"]].place == "walkway" for row in rows.values()
    )
    if not is_known:
        return rows
    return {trial: {**row, "joint": row["joint"] or JOINT} for trial, row in rows.items()}


def check_header(path: Path, line: int, columns: Sequence[str]) -> None:
    """Refuse a header, in this line, with a column that is unknown, absent or stands twice."""
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{path}: line {line}: column '{column}' stands twice; remove one")
    unknown = sorted(set(columns) - set(SHEET_COLUMNS))
    absent = sorted({"trial", "experiment"} - set(columns))
    if not unknown and not absent:
        return
    if len(columns) == 1:
        for separator in ";\t|":
            if separator in columns[0]:
                raise InputError(
                    f"{path}: its cells are separated by '{separator}'; save the sheet with commas,"
                    " as 'CSV UTF-8'"
                )
    problem = f"no column '{absent[0]}'" if absent else ""
    similar = ""
    if unknown:
        problem = f"unknown column '{unknown[0]}'"
        similar = nearest(unknown[0], set(SHEET_COLUMNS) - set(columns))
    raise InputError(f"{path}: {problem}; the columns are {', '.join(SHEET_COLUMNS)}{similar}")


class NamesInSheet:
    """The names of trials, joints and controllers in the rows of a sheet that were read."""

    def __init__(self) -> None:
        self._line_of_trial: dict[str, int] = {}
        self._joints = {folded(JOINT): JOINT}
        self._controllers = {folded(name): name for name in CONTROLLERS}

    def check(self, where: str, line: int, row: Mapping[str, str]) -> None:
        """Refuse the names of a row that nearly equal others."""
        trial = row["trial"].casefold()
        first_line = self._line_of_trial.setdefault(trial, line)
        if first_line != line:
            raise InputError(
                f"{where}: trial '{row['trial']}' stands twice, first in line {first_line}; give"
                " each row a name that differs by more than capitals"
            )
        joint = row["joint"] or JOINT
        # kneeL is a name
        usual_joints = [usual for usual in USUAL_JOINTS if len(usual) >= len(joint)]
        if joint.lower() not in USUAL_JOINTS:
            check_not_misspelt(where, "joint", joint, usual_joints, SIMILAR_JOINT)
        check_same_spelling(where, "joint", joint, self._joints)
        controller = row["controller"] or CONTROLLERS[0]
        if controller.lower() not in CONTROLLERS:
            check_not_misspelt(where, "controller", controller, CONTROLLERS, SIMILAR_CONTROLLER)
        check_same_spelling(where, "controller", controller, self._controllers)


def folded(name: str) -> str:
    """A name without the differences of capitals and of Unicode's ways to write a letter."""
    return unicodedata.normalize("NFKC", name).casefold()


def check_not_misspelt(
    where: str, column: str, name: str, usual: Sequence[str], similar: float
) -> None:
    """Refuse a name of one's own that is nearly a usual one."""
    meant = nearest(name, usual, similar) if name.isalpha() else ""
    if meant:
        raise InputError(
            f"{where}: {column} '{name}' is not a usual one; give a {column} of your own a name"
            f" that differs more{meant}"
        )


def check_same_spelling(where: str, column: str, name: str, spellings: dict[str, str]) -> None:
    """Refuse a name that only capitals or accents tell apart from an earlier one; adds it to the
    spellings."""
    before = spellings.setdefault(folded(name), name)
    if before != name:
        raise InputError(
            f"{where}: {column} '{name}' differs from '{before}' by capitals or accents alone, and"
            f" would be another one; write '{before}' in both"
        )


def numbered_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Read the rows of a CSV file with the number of their line, without empty lines and comments.

    Raises
    ------
    InputError
        The file is no CSV in UTF-8, or cannot be read.
    """
    reader = csv.reader(csv_text(path).splitlines(keepends=True), strict=True)
    number = 1
    try:
        for row in reader:
            if row and not row[0].lstrip().startswith("#"):
                yield number, row
            number = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: line {number}: not CSV ({error}); check the quotes") from error


def csv_text(path: Path) -> str:
    """The text of a CSV file; refuses workbooks and other encodings."""
    try:
        content = path.read_bytes()
        formats = formats_of(path) if content else []
        if content:
            refuse_others(path, formats)
        if any(format_.priority < TEXT_PRIORITY for format_ in formats):
            raise InputError(
                f"{path}: a workbook, or another binary table, which no sheet is; save it as 'CSV"
                " UTF-8'"
            )
        if b"\0" in content.partition(b"\n")[0]:
            raise InputError(
                f"{path}: its header holds zero bytes, it is not UTF-8; save the sheet as 'CSV"
                " UTF-8'"
            )
        return content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); check the path and its permissions"
        ) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}: line {line}: byte {error.object[error.start]:#04x} is not UTF-8; save the"
            " sheet as 'CSV UTF-8'"
        ) from error


def problems_in(row: Mapping[str, str]) -> Iterator[str]:
    """Say what is wrong with one row of a sheet, with the remedy; what follows a problem may be
    wrong because of it."""
    for column, cell in row.items():
        # a sign that cannot be seen: two equal names would differ; `exclude` is a sentence
        if column != "exclude" and not cell.isprintable():
            sign = next(sign for sign in cell if not sign.isprintable())
            name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'a control character')})"
            yield f"column '{column}': {cell!r} contains {name}; type the cell again"
    for column, (form, problem) in FORMS.items():
        if not re.fullmatch(form, row[column], re.IGNORECASE):
            yield f"{column} '{row[column]}' {problem}"
    experiment = row["experiment"]
    if experiment not in EXPERIMENTS:
        yield (
            f"experiment '{experiment}' is none of"
            f" {', '.join(EXPERIMENTS)}{nearest(experiment, EXPERIMENTS)}"
        )
    yield from wrong_numbers(row)
    yield from unfit_for_the_experiment(row)
    yield from missing_files(row)


def missing_files(row: Mapping[str, str]) -> Iterator[str]:
    """Say which file, or which description of one, a row lacks."""
    if not row["log"] and not row["mocap"]:
        yield f"trial '{row['trial']}' names no file; fill in log or mocap"
    for column in ("log", "mocap"):
        if row[column] and not row[f"{column}_source"]:
            yield f"{column}_source is empty; name the source file that describes {row[column]}"
    if row["log_part"] and not row["log"]:
        yield f"log_part '{row['log_part']}' without a log; fill in log, or clear log_part"


def wrong_numbers(row: Mapping[str, str]) -> Iterator[str]:
    """Say which numbers of a row no device or person has."""
    for column, largest in LARGEST.items():
        if row[column] and not 0 < float(row[column]) < largest:
            yield f"{column} '{row[column]}' must be above 0 and below {largest:g}, or empty"
    for column in ("fixture_inertia", "fixture_weight"):
        if float(row[column] or 0) < 0:
            yield (
                f"{column} '{row[column]}' is below 0; a centre above the axis has a"
                " fixture_rest_deg of 180"
            )
    if row["fixture_rest_deg"] and not row["fixture_weight"]:
        yield (
            "fixture_rest_deg without fixture_weight; give the weight's largest torque [N*m], or"
            " clear the cell"
        )
    is_stiffness = 0 < float(row["K_d"] or 1) <= LARGEST_K_D
    is_damping = 0 <= float(row["B_d"] or 0) <= LARGEST_B_D
    if not is_stiffness or not is_damping:
        stated = [f"{column} = {row[column]}" for column in ("K_d", "B_d") if row[column]]
        yield (
            f"{', '.join(stated)} is not the impedance of a joint; give K_d > 0, up to 10000"
            " N*m/rad, and B_d >= 0, up to 1000"
        )
    try:
        stretches(row["windows"] or "0-1")
    except InputError as error:
        yield str(error)


def unfit_for_the_experiment(row: Mapping[str, str]) -> Iterator[str]:
    """Say which cells of a row its experiment does not have, or lacks."""
    experiment = row["experiment"]
    yield from cells_of_other_experiments(row)
    if EXPERIMENTS[experiment].place == "walkway" and row["joint"] not in ("", JOINT):
        yield (
            f"joint '{row['joint']}' of experiment '{experiment}': the walkway measures the"
            f" {JOINT}; leave the cell empty if it is that, or write experiment 'ingest_only' for a"
            " recording that is not analysed"
        )
    if row["direction"] and row["perturbed"].lower() != "true":
        yield (
            f"direction '{row['direction']}' of a trial that is not perturbed; leave the cell empty"
        )
    for column in EXPERIMENTS[experiment].sheet:
        if not row[column]:
            yield f"{column} is empty; a trial of experiment '{experiment}' needs it"
    has_standard = row["known_percent"] and (row["known_K"] or row["known_I"])
    if experiment == "calibration" and not has_standard and not row["fixture"]:
        yield (
            "a calibration needs known_K [N*m/rad] or known_I [kg*m^2], and known_percent, its"
            " standard uncertainty; or `alone` under fixture, of the fixture without a joint"
        )


def cells_of_other_experiments(row: Mapping[str, str]) -> Iterator[str]:
    """Say which cells are filled that only trials of other experiments have."""
    experiment = row["experiment"]
    for column, users in USERS.items():
        if not row[column] or experiment in users:
            continue
        if column in FIXTURE:
            yield (
                f"{column} of experiment '{experiment}', which turns no joint under a load cell;"
                " leave the cell empty"
            )
        names = " or ".join(f"'{user}'" for user in users)
        yield (
            f"{column} '{row[column]}' of experiment '{experiment}'; it is for {names} alone,"
            " clear the cell"
        )
