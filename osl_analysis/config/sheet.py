"""The sample sheet `trials.csv` of a campaign, one row per trial, and the commanded impedance over
stance, validated when they are read; and what a simulated campaign takes from the configuration of
its analysis."""

import csv
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError, nearest
from osl_analysis.formats import TEXT_PRIORITY, formats_of, refuse_others
from osl_analysis.model.compensator import CONTROLLERS, Weight
from osl_analysis.refusal import check_not_refused
from osl_analysis.trial import Array, stretches
from osl_analysis.yaml_settings import Settings

# The joint that the walkway measures, and of a row that names none beside rows that do.
JOINT = "ankle"
CONDITIONS = ("group", "subject", "session", "speed", "side", "direction")
"""Columns with the conditions of a walking trial. The results are split by them."""
FIXTURE = ("fixture_inertia", "fixture_weight", "fixture_rest_deg")
"""Columns on what turns with the joint: inertia [kg*m^2], weight m g r [N*m], angle [deg] with its
centre below."""
KNOWN_COLUMNS = ("known_K", "known_I", "known_percent")
"""Columns on a calibration's spring [N*m/rad] or inertia [kg*m^2], and its standard uncertainty in
percent."""
SHEET_COLUMNS = (
    "trial", "experiment", "controller", "K_d", "B_d", "perturbed", "log", "log_source", "mocap",
    "mocap_source",
    "log_part", "desired", "windows", "exclude", "accept", "joint", *CONDITIONS, "body_mass_kg",
    "static",
    *FIXTURE, *KNOWN_COLUMNS,
)  # fmt: skip
NUMBER_COLUMNS = ("K_d", "B_d", "body_mass_kg", *FIXTURE, *KNOWN_COLUMNS)
# The rows of a sheet by trial, with all columns; None where a cell is empty.
SheetRows = dict[str, dict[str, Any]]


def read_sheet(path: Path) -> SheetRows:
    """Read and validate a sample sheet, CSV in UTF-8; docs/own_data.md explains its columns. Empty
    lines and lines that begin with `#` are skipped; elsewhere `#` is text, and so is `NA`. An empty
    cell says nothing, nor do blanks around one. K_d and B_d are in N*m/rad and N*m*s/rad; a joint
    that is not named is the ankle where other rows name theirs or are of the walkway, and else not
    known (None). Raises InputError: no sheet, or a wrong column or value."""
    if not path.is_file():
        raise InputError(
            f"{path}: no such sample sheet; write one (README, 'Your own data') or set `sheet`"
        )
    check_not_refused(path)
    # some of them unseen
    blanks = re.compile(r"^[\s\u200b-\u200f\u2060\ufeff]+|[\s\u200b-\u200f\u2060\ufeff]+$")
    lines = [
        (number, [blanks.sub("", cell) for cell in row]) for number, row in numbered_rows(path)
    ]
    if not lines:
        raise InputError(
            f"{path}: not a CSV table, it is empty; write a header and a row per trial"
        )
    first, columns = lines[0]
    check_header(path, first, columns)
    rows: SheetRows = {}
    seen: dict[tuple[str, str], Any] = {
        ("joint", JOINT): JOINT,
        **{("controller", name): name for name in CONTROLLERS},
    }
    for number, cells in lines[1:]:
        where = f"{path}: line {number}"
        if any(cells[len(columns) :]):
            said = (
                f"{len(cells)} cells, the header has {len(columns)}; quote a cell that contains a"
                " comma"
            )
            raise InputError(f"{where}: {said}")
        if not any(cells):
            continue
        row = dict.fromkeys(SHEET_COLUMNS, "") | dict(zip(columns, cells, strict=False))
        if problem := next(problems_in(row), ""):
            raise InputError(f"{where}: {problem}")
        if (before := seen.setdefault(("trial", row["trial"].casefold()), number)) != number:
            said = (
                f"stands twice, first in line {before}; give each row a name that differs by more"
                " than capitals"
            )
            raise InputError(f"{where}: trial '{row['trial']}' {said}")
        for column, usual, alike in (
            ("joint", (JOINT, "knee", "hip"), 0.8),
            ("controller", CONTROLLERS, 0.9),
        ):
            name = row[column] or usual[0]
            before = seen.setdefault((column, unicodedata.normalize("NFKC", name).casefold()), name)
            check_name(where, column, name, before, usual, alike)
        numbers = {name: float(row[name]) for name in NUMBER_COLUMNS if row[name]}
        perturbed = row["perturbed"].lower() == "true" if row["perturbed"] else None
        told = {column: cell or None for column, cell in row.items()}
        rows[row["trial"]] = told | numbers | {"perturbed": perturbed}
    if not rows:
        raise InputError(f"{path}: no trials; add one row per trial")
    return with_joints(rows)


def with_joints(rows: SheetRows) -> SheetRows:
    """The rows with the ankle for each joint that is not named, where others are, or the walkway
    measures it."""
    known = any(
        row["joint"] or EXPERIMENTS[row["experiment"]].place == "walkway" for row in rows.values()
    )
    return {
        trial: row | {"joint": row["joint"] or (JOINT if known else None)}
        for trial, row in rows.items()
    }


def check_header(path: Path, first: int, columns: Sequence[str]) -> None:
    """Refuse a header, in line `first`, with a column that is unknown, absent or stands twice."""
    if twice := next((column for column in columns if columns.count(column) > 1), ""):
        raise InputError(f"{path}: line {first}: column '{twice}' stands twice; remove one")
    unknown, absent = (
        sorted(set(columns) - set(SHEET_COLUMNS)),
        sorted({"trial", "experiment"} - set(columns)),
    )
    if unknown or absent:
        if len(columns) == 1 and (
            sign := next((sign for sign in ";\t|" if sign in columns[0]), "")
        ):
            said = (
                f"its cells are separated by '{sign}'; save the sheet with commas, as 'CSV UTF-8'"
            )
            raise InputError(f"{path}: {said}")
        what = f"unknown column '{unknown[0]}'" if unknown else f"no column '{absent[0]}'"
        like = nearest(unknown[0], set(SHEET_COLUMNS) - set(columns)) if unknown else ""
        raise InputError(f"{path}: {what}; the columns are {', '.join(SHEET_COLUMNS)}{like}")


def check_name(
    where: str, column: str, name: str, before: str, usual: Sequence[str], alike: float
) -> None:
    """Refuse a name that is nearly a usual one, or that one `before`, which capitals or accents
    tell apart."""
    # kneeL is a name
    known = [one for one in usual if column == "controller" or len(one) >= len(name)]
    is_own = name.isalpha() and name.lower() not in usual
    if like := nearest(name, known, alike) if is_own else "":
        said = f"is not a usual one; give a {column} of your own a name that differs more"
        raise InputError(f"{where}: {column} '{name}' {said}{like}")
    # two equal names that capitals, or Unicode's ways to write a letter, tell apart
    if before != name:
        raise InputError(
            f"{where}: {column} '{name}' differs from '{before}' by capitals or accents alone, and"
            f" would be another one; write '{before}' in both"
        )


def numbered_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a CSV file with the number of their line, without empty lines and comments."""
    try:
        content = path.read_bytes()
        known = formats_of(path) if content else []
        if content:
            refuse_others(path, known)
        if any(one.priority < TEXT_PRIORITY for one in known):
            raise InputError(
                f"{path}: a workbook, or another binary table, which no sheet is; save it as 'CSV"
                " UTF-8'"
            )
        if b"\0" in content.partition(b"\n")[0]:
            raise InputError(
                f"{path}: its header holds zero bytes, it is not UTF-8; save the sheet as 'CSV"
                " UTF-8'"
            )
        text = content.decode("utf-8-sig")
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
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    number = 1
    try:
        for row in reader:
            if row and not row[0].lstrip().startswith("#"):
                yield number, row
            number = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: line {number}: not CSV ({error}); check the quotes") from error


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
    **dict.fromkeys(("group", "subject", "session", "speed"), (r"[\w .%+/-]{0,40}",
        "must be up to 40 letters, digits, blanks and . % + / - _: it names a group")),
    **dict.fromkeys(("log_source", "mocap_source"), (r"(?!.*\.ya?ml$).*",
        "names a file; write its name without the ending")),
}  # fmt: skip
"""By column: the form of its cells, in any capitals, and what is wrong with one that has
another."""


def problems_in(row: Mapping[str, str]) -> Iterator[str]:
    """What is wrong with one row of a sheet, with the remedy; what follows a problem may be wrong
    because of it."""
    for column, cell in row.items():
        # two equal names would differ; `exclude` is a sentence
        if column != "exclude" and not cell.isprintable():
            sign = next(sign for sign in cell if not sign.isprintable())
            name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'a control character')})"
            yield f"column '{column}': {cell!r} contains {name}; type the cell again"
    for column, (form, said) in FORMS.items():
        if not re.fullmatch(form, row[column], re.IGNORECASE):
            yield f"{column} '{row[column]}' {said}"
    if (experiment := row["experiment"]) not in EXPERIMENTS:
        yield (
            f"experiment '{experiment}' is none of"
            f" {', '.join(EXPERIMENTS)}{nearest(experiment, EXPERIMENTS)}"
        )
    yield from wrong_numbers(row)
    yield from unfit_for_the_experiment(row)
    if not row["log"] and not row["mocap"]:
        yield f"trial '{row['trial']}' names no file; fill in log or mocap"
    for column in ("log", "mocap"):
        if row[column] and not row[f"{column}_source"]:
            yield f"{column}_source is empty; name the source file that describes {row[column]}"
    if row["log_part"] and not row["log"]:
        yield f"log_part '{row['log_part']}' without a log; fill in log, or clear log_part"


def wrong_numbers(row: Mapping[str, str]) -> Iterator[str]:
    for column, most in {
        "body_mass_kg": 500,
        "known_K": 1e6,
        "known_I": 1e3,
        "known_percent": 50,
    }.items():
        if row[column] and not 0 < float(row[column]) < most:
            yield f"{column} '{row[column]}' must be above 0 and below {most:g}, or empty"
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
    if not 0 < float(row["K_d"] or 1) <= 1e4 or not 0 <= float(row["B_d"] or 0) <= 1e3:
        said = ", ".join(f"{column} = {row[column]}" for column in ("K_d", "B_d") if row[column])
        yield (
            f"{said} is not the impedance of a joint; give K_d > 0, up to 10000 N*m/rad, and B_d >="
            " 0, up to 1000"
        )
    try:
        stretches(row["windows"] or "0-1")
    except InputError as error:
        yield str(error)


USERS = {
    "windows": ("impedance", "human_joint", "walking"), "desired": ("torque_angle",), 
    "static": tuple(name for name, facts in EXPERIMENTS.items() if facts.place != "bench"),
    **dict.fromkeys(KNOWN_COLUMNS, ("calibration",)),
    **dict.fromkeys(FIXTURE, tuple(name for name,
    facts in EXPERIMENTS.items() if facts.motion == "theta")),
}  # fmt: skip
"""By column: the experiments whose trials have it."""


def unfit_for_the_experiment(row: Mapping[str, str]) -> Iterator[str]:
    experiment, joint = row["experiment"], row["joint"]
    for column, users in USERS.items():
        if row[column] and experiment not in users:
            if column in FIXTURE:
                said = (
                    f"{column} of experiment '{experiment}', which turns no joint under a load cell"
                )
                yield f"{said}; leave the cell empty"
            said = " or ".join(f"'{one}'" for one in users)
            yield (
                f"{column} '{row[column]}' of experiment '{experiment}'; it is for {said} alone,"
                " clear the cell"
            )
    if EXPERIMENTS[experiment].place == "walkway" and joint not in ("", JOINT):
        yield (
            f"joint '{joint}' of experiment '{experiment}': the walkway measures the {JOINT}; leave"
            " the cell empty if it is that, or write experiment 'ingest_only' for a recording that"
            " is not analysed"
        )
    if row["direction"] and row["perturbed"].lower() != "true":
        yield (
            f"direction '{row['direction']}' of a trial that is not perturbed; leave the cell empty"
        )
    for column in EXPERIMENTS[experiment].sheet:
        if not row[column]:
            yield f"{column} is empty; a trial of experiment '{experiment}' needs it"
    if experiment == "calibration" and not (
        row["known_percent"] and (row["known_K"] or row["known_I"])
    ):
        yield (
            "a calibration needs known_K [N*m/rad] or known_I [kg*m^2], and known_percent, its"
            " standard uncertainty"
        )
    if experiment == "walking" and len(row["windows"].split()) > 1:
        yield (
            f"windows '{row['windows']}' of a crossing; write one, and a row of the sheet for each"
            " crossing of a log"
        )


class SharedChoices(Settings):
    """The choices of a configuration that replace those of its simulation. Null: the simulation's
    own."""

    parameters: Path | None = None  # Parameter file of the device.
    gain_weight: Weight | None = None  # W with which the simulated leg's gains are selected.
    protocol: dict[str, Any] | None = None  # The stepped sine, as fields of a simulated schedule.
    # The impedance that the leg is asked to render over the gait cycle.
    impedance_trajectory: Path | None = None


SYNTHETIC = "synthetic"  # Kind of a trajectory that was made for a simulated leg.


@dataclass(frozen=True)
class ImpedanceTrajectory:
    """Desired impedance at the joint over the gait cycle."""

    phase: Array  # phase of the gait cycle, from 0 to 1, shape (n,)
    K_d: Array  # desired stiffness [N*m/rad], shape (n,)
    B_d: Array  # desired damping [N*m*s/rad], shape (n,)
    # equilibrium angle [rad], shape (n,); None: it is computed from the nominal ankle moment
    theta_eq: Array | None
    # what the file says of itself in a comment `# kind: synthetic`; None: it says nothing
    kind: str | None = None

    def at(self, values: Array, c: Array) -> Array:
        """One of the columns at cycle phases c of any cycle, by linear interpolation."""
        return np.interp(np.mod(c, 1.0), self.phase, values)


def read_impedance_trajectory(path: Path) -> ImpedanceTrajectory:
    """Read a CSV table with columns phase, K_d [N*m/rad], B_d [N*m*s/rad] and, optionally,
    theta_eq_rad [rad]. Lines that begin with `#` are comments. One of them, `# kind: synthetic`,
    may say what the trajectory is."""
    if not path.is_file():
        remedy = "correct its path in the configuration or the walking settings"
        raise InputError(f"{path}: no such impedance trajectory; {remedy}")
    rows = [row for _, row in numbered_rows(path)]
    names = [name.strip() for name in rows[0]] if rows else []
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{path}: column '{twice}' stands twice; rename or remove one")
    required = ("phase", "K_d", "B_d")
    absent = [name for name in required if name not in names]
    if absent or len(rows) < 3:
        problem = f"no column '{absent[0]}'" if absent else "fewer than two rows"
        raise InputError(
            f"{path}: {problem}; it needs a header with {', '.join(required)} and a row per phase"
        )
    try:
        columns = dict(zip(names, np.array(rows[1:], dtype=float).T, strict=True))
    except ValueError as error:
        raise InputError(
            f"{path}: not a table of numbers ({error}); write one number per column"
        ) from error
    for name, column in columns.items():
        if (wrong := column[~np.isfinite(column)]).size:
            raise InputError(f"{path}: column {name} holds {wrong[0]}; write a number in every row")
    phase = columns["phase"]
    if phase[0] != 0 or phase[-1] != 1 or not (np.diff(phase) > 0).all():
        raise InputError(
            f"{path}: column phase runs from {phase[0]:g} to {phase[-1]:g}; it must rise from 0"
            " to 1"
        )
    kind = re.search(r"^#\s*kind:\s*(\S.*?)\s*$", path.read_text(encoding="utf-8"), re.MULTILINE)
    theta_eq = columns.get("theta_eq_rad")
    return ImpedanceTrajectory(
        phase, columns["K_d"], columns["B_d"], theta_eq, kind[1] if kind else None
    )
