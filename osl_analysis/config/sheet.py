# SPDX-License-Identifier: Apache-2.0
"""The sample sheet `trials.csv` of a campaign, one row per trial, validated when it is read."""

import csv
import re
import unicodedata
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from osl_analysis.base.errors import InputError, nearest, on_one_line
from osl_analysis.base.table import QUOTED
from osl_analysis.base.trial import parsed_windows
from osl_analysis.base.yaml_settings import (
    NotNegative,
    Positive,
    Settings,
    Stiffness,
    check_known,
    misplaced,
    refuse_if,
    validated,
)
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.model.compensator import CONTROLLERS

# the joint that the walkway measures, and of a row that names none beside rows that do
JOINT = "ankle"
USUAL_JOINTS = (JOINT, "knee", "hip")
# How similar a name of one's own may be to a usual one, as a share of its letters
SIMILAR_JOINT = 0.8
SIMILAR_CONTROLLER = 0.9
# what begins an answer to whether a trial is excluded, and is no reason
ANSWERS = ("0", "no", "false", "none")

# columns on what turns with the joint: inertia [kg*m^2], weight m g r [N*m], angle [deg] with its
# centre below
FIXTURE = ("fixture_inertia", "fixture_weight", "fixture_rest_deg")
OF_CALIBRATION = ("known_K", "known_I", "known_percent", "fixture")
ON_DYNAMOMETER = tuple(name for name, facts in EXPERIMENTS.items() if facts.motion == "theta")
# By column: the experiments whose trials have it
USERS = {
    "windows": tuple(name for name, facts in EXPERIMENTS.items() if facts.place == "bench"),
    "desired": ("torque_angle",),
    "static": tuple(name for name, facts in EXPERIMENTS.items() if facts.place != "bench"),
    **dict.fromkeys(OF_CALIBRATION, ("calibration",)),
    **dict.fromkeys(FIXTURE, ON_DYNAMOMETER),
}
# by column: the one that has to be filled, and not `false`, beside it
NEEDED_COLUMN = {
    "log": "log_source",
    "log_2": "log_2_source",
    "log_2_source": "log",
    "mocap": "mocap_source",
    "log_part": "log",
    "fixture_rest_deg": "fixture_weight",
    "direction": "perturbed",
}
RECORDINGS = ("log", "log_2", "mocap")  # cells that name a file
SOURCES = ("log_source", "log_2_source", "mocap_source")  # of these, the name of its source file
# blanks at the ends of a cell, of which some cannot be seen
BLANKS = re.compile(r"^[\s\u200b-\u200f\u2060\ufeff]+|[\s\u200b-\u200f\u2060\ufeff]+$")
# the first line that is neither empty nor a comment
HEADER = re.compile(r"^[^#\s].*", re.MULTILINE)
NUMBERS = re.compile(r"[-\d., ]+")  # of a cell of numbers, or of windows

# the rows of a sheet by trial, with all columns; None where a cell is empty
SheetRows = dict[str, dict[str, Any]]


def check_not_misspelt(usual: Sequence[str], similar: float, name: str) -> str:
    """The check that a name of one's own is not nearly a usual one. A longer one, as `kneeL`, is a
    name."""
    meant = nearest(name, [known for known in usual if len(known) >= len(name)], similar)
    if meant and name.isalpha():
        raise ValueError(f"give a name of your own that differs more from the usual ones{meant}")
    return name


def check_reason(text: str) -> str:
    """The check that a trial is excluded for a reason, and not by an answer to whether it is."""
    if text.lower() in ANSWERS:
        raise ValueError("it is no reason; clear the cell to analyse the trial, or say why not")
    return on_one_line(text)


Windows = Annotated[str, AfterValidator(lambda text: parsed_windows(text) and text)]
Controller = Annotated[
    str, AfterValidator(partial(check_not_misspelt, CONTROLLERS, SIMILAR_CONTROLLER))
]
Damping = Annotated[float, Field(ge=0, le=1000)]
# it becomes a file name
TrialName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
# cells that may be empty
TextOrNone = str | None
NumberOrNone = NotNegative | None
ShortName = Annotated[str, Field(pattern=r"^[\w .%+/-]{1,40}$")] | None


class Asked(Settings):
    """What the fit of a single trial is asked, in cells of the sheet."""

    controller: Controller | None = None
    K_d: Stiffness | None = None
    B_d: Damping | None = None
    windows: Windows | None = None


class SheetRow(Settings):
    """A row of the sheet. docs/own_data.md explains its columns."""

    trial: TrialName
    experiment: Annotated[str, AfterValidator(partial(check_known, EXPERIMENTS, "experiment"))]
    controller: Controller | None = None
    K_d: Stiffness | None = None  # [N*m/rad]
    B_d: Damping | None = None  # [N*m*s/rad]
    perturbed: bool | None = None
    log: TextOrNone = None
    log_source: TextOrNone = None
    log_2: TextOrNone = None  # of another recorder, which has a clock of its own
    log_2_source: TextOrNone = None
    mocap: TextOrNone = None
    mocap_source: TextOrNone = None
    log_part: TextOrNone = None
    desired: TextOrNone = None
    windows: Windows | None = None
    exclude: Annotated[str, AfterValidator(check_reason)] | None = None
    accept: TextOrNone = None
    joint: (
        Annotated[str, AfterValidator(partial(check_not_misspelt, USUAL_JOINTS, SIMILAR_JOINT))]
        | None
    ) = None
    group: ShortName = None
    subject: ShortName = None
    session: ShortName = None
    speed: ShortName = None
    side: Literal["left", "right"] | None = None
    direction: Literal["up", "down"] | None = None
    body_mass_kg: Annotated[float, Field(gt=0, lt=500)] | None = None
    static: TextOrNone = None
    fixture_inertia: NumberOrNone = None  # [kg*m^2]
    # [N*m]; of a centre above the axis it is positive, too, with a fixture_rest_deg of 180
    fixture_weight: NumberOrNone = None
    fixture_rest_deg: float | None = None
    fixture: Literal["alone"] | None = None  # a calibration with nothing but the fixture
    known_K: Positive | None = None  # spring of a calibration [N*m/rad]
    known_I: Positive | None = None  # inertia of a calibration [kg*m^2]
    known_percent: Annotated[float, Field(gt=0, lt=50)] | None = None  # standard uncertainty

    @field_validator("*")
    @classmethod
    def _is_visible(cls, cell: Any, info: ValidationInfo) -> Any:
        """Refuse a sign that cannot be seen: two equal names would differ. `exclude` is a
        sentence."""
        is_name = isinstance(cell, str) and info.field_name != "exclude"
        if is_name and not cell.isprintable():
            raise ValueError("it contains a sign that cannot be seen; type the cell again")
        return cell

    _has_file = refuse_if(lambda row: not row.log and not row.mocap, "fill in log or mocap", "log")
    _has_two_clocks = refuse_if(
        lambda row: row.log_2 and row.mocap, "a trial has log_2 or mocap; clear one", "log_2"
    )
    _walkway_has_ankle = refuse_if(
        lambda row: (
            EXPERIMENTS[row.experiment].place == "walkway" and row.joint not in (None, JOINT)
        ),
        f"the walkway measures the {JOINT}; clear the cell if it is that, or write experiment"
        " ingest_only for a recording that is not analysed",
        "joint",
    )
    _calibration_has_standard = refuse_if(
        lambda row: (
            row.experiment == "calibration"
            and not row.fixture
            and not (row.known_percent and (row.known_K or row.known_I))
        ),
        "a calibration needs known_K [N*m/rad] or known_I [kg*m^2], and known_percent, its standard"
        " uncertainty; or `alone` under fixture, of the fixture without a joint",
    )

    @model_validator(mode="after")
    def _fits_experiment(self) -> Self:
        filled = self.model_dump(exclude_none=True)
        for column in EXPERIMENTS[self.experiment].sheet:
            if column not in filled and not self.exclude:
                raise misplaced(f"it is empty; experiment {self.experiment} needs it", column)
        for column, needed_column in NEEDED_COLUMN.items():
            needed_value = filled.get(needed_column)
            has_needed = needed_value not in ("", None) and needed_value is not False
            if column in filled and not has_needed:
                raise misplaced(
                    f"it needs {needed_column}, neither empty nor false; correct that, or clear"
                    " this cell",
                    column,
                )
        for column, users in USERS.items():
            if column in filled and self.experiment not in users:
                raise misplaced(f"it is for {' or '.join(users)} alone; clear the cell", column)
        return self


SHEET_COLUMNS = tuple(SheetRow.model_fields)


def read_sheet(path: Path) -> SheetRows:
    """Read and validate a sample sheet; docs/own_data.md explains its columns.

    Parameters
    ----------
    path : Path
        CSV in UTF-8, with commas or semicolons. Empty lines and lines that begin with `#` are
        skipped; elsewhere `#` is text, and so is `NA`. An empty cell says nothing, nor do blanks
        around one.

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
            f"{path}: no such sample sheet", "write one (README, 'Your own data') or set `sheet`"
        )
    lines = [*numbered_rows(path)]
    if len(lines) < 2 or len(lines[0][1]) < 2:
        raise InputError(
            f"{path}: not a CSV table of trials",
            "write a header and a row per trial, and save it as 'CSV UTF-8'",
        )
    _, columns = lines[0]
    if len(set(columns)) < len(columns):
        raise InputError(f"{path}: a column stands twice in the header", "remove one")
    rows = {}
    spellings: dict[tuple[str, str], str] = {}
    for number, cells in lines[1:]:
        where = f"{path}: line {number}"
        if any(cells[len(columns) :]):
            raise InputError(f"{where}: more cells than columns", "quote a cell that has a comma")
        filled = {column: cell for column, cell in zip(columns, cells, strict=False) if cell}
        row = validated(filled, SheetRow, where, files=()).model_dump()
        if row["trial"] in rows:
            raise InputError(f"{where}: trial '{row['trial']}' stands twice", "name each once")
        check_spellings(where, row, spellings)
        rows[row["trial"]] = row
    names_joints = [
        row["joint"] or EXPERIMENTS[row["experiment"]].place == "walkway" for row in rows.values()
    ]
    for row in rows.values():
        row["joint"] = row["joint"] or (JOINT if any(names_joints) else None)
    return rows


def check_spellings(where: str, row: dict[str, Any], spellings: dict[tuple[str, str], str]) -> None:
    """Refuse names that only capitals or Unicode's ways to write a letter tell apart from those of
    earlier rows; adds them to the spellings."""
    for column in ("trial", "joint", "controller"):
        name = row[column] or ""
        folded = unicodedata.normalize("NFKC", name).casefold()
        before = spellings.setdefault((column, folded), name)
        if before != name:
            raise InputError(
                f"{where}: {column} '{name}' differs from '{before}' by capitals or accents alone",
                "write both alike, or another name",
            )


def numbered_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Read the rows of a CSV file with the number of their line, without those that are empty and
    comments, and cells without blanks around them. Of one with semicolons, as Excel saves it in
    German, numbers have a decimal comma.

    Raises
    ------
    InputError
        The file is no CSV in UTF-8, or may not be read.
    """
    number = 1
    try:
        text = path.read_text(encoding="utf-8-sig")
        header = HEADER.search(text)
        separator = ";" if header and ";" in header[0] else ","
        reader = csv.reader(text.splitlines(keepends=True), delimiter=separator, strict=True)
        for row in reader:
            cells = [QUOTED.sub("", BLANKS.sub("", cell)) for cell in row]
            if separator == ";":
                cells = [
                    cell.replace(",", ".") if NUMBERS.fullmatch(cell) else cell for cell in cells
                ]
            if any(cells) and not cells[0].startswith("#"):
                yield number, cells
            number = reader.line_num + 1
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path}: line {number}: cannot be read ({error})",
            "save it as 'CSV UTF-8', and check its quotes and permissions",
        ) from error
