"""A campaign: its sample sheet and the trials that are analysed."""

import re
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from osl_analysis.config import Config
from osl_analysis.errors import InputError
from osl_analysis.experiments import Table
from osl_analysis.formats.bag_folder import recorded_files
from osl_analysis.job_log import plain
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.parameters import joint_of
from osl_analysis.sheet import JOINT, read_sheet
from osl_analysis.table import MEASURED, SIMULATED
from osl_analysis.walking.conditions import PERTURBED, SHARED, STATED, STATIC, side_of, static_of

TRUTH = "truth"  # folder that the simulator writes beside its recordings
RECORDING_COLUMNS = ("trial", "experiment", "log", "log_source", "log_part", "mocap", "mocap_source")


@dataclass(frozen=True)
class Campaign:
    """The trials of a configuration."""

    config: Config
    """The configuration."""
    sheet: pd.DataFrame
    """Rows of the sample sheet that are not excluded, indexed by trial."""
    unused: pd.DataFrame
    """Rows of the sample sheet that are excluded, with the reasons in the column `exclude`."""

    @property
    def excluded(self) -> dict[str, str]:
        """Reasons of the trials that the sheet excludes, by trial."""
        return {str(trial): str(why) for trial, why in self.unused["exclude"].items()}

    def trials(self, *experiments: str) -> list[str]:
        """Names of the trials of these experiments, or of all, in the order of the sheet."""
        if len(experiments) == 1:
            return list(self.by_experiment.get(experiments[0], []))
        return [trial for trial, row in self.rows.items() if not experiments or row["experiment"] in experiments]

    def crossings(self, perturbed: bool) -> list[str]:
        """Names of the walking trials that are perturbed, or of those that are not."""
        return [name for name in self.trials("walking") if bool(self.row(name)["perturbed"]) == perturbed]

    def conditions(self) -> dict[str, dict[str, Any]]:
        """Conditions of every walking trial in the sheet, by trial and column; None where empty."""
        columns = (*STATED, PERTURBED)
        return {trial: {column: self.row(trial)[column] for column in columns} for trial in self.trials("walking")}

    def static(self, trial: str) -> str:
        """The static trial that calibrates a crossing or plate trial.

        Raises
        ------
        InputError
            There is none, or the sheet does not tell several apart.
        """
        row = self.row(trial)
        stated = tuple(row.get(column) for column in (STATIC, *SHARED))
        if stated not in self.static_by_cells:
            try:
                found = static_of(trial, row, {name: self.row(name) for name in self.trials("static")})
            except InputError as error:
                raise InputError(f"{self.config.sheet}: {error}") from error
            self.static_by_cells[stated] = found
        return self.static_by_cells[stated]

    @cached_property
    def static_by_cells(self) -> dict[tuple[Any, ...], str]:
        """The static trials that were looked up, by the cells of a row that decide: many trials share theirs."""
        return {}

    def plate_trials(self) -> list[str]:
        """Names of the plate trials from which the plate's inertia is identified; none if it is not."""
        return self.trials("plate") if self.config.walking.plate_inertia == "identified" else []

    @cached_property
    def statics(self) -> dict[str, list[str]]:
        """The crossings that each static trial in use calibrates, by static trial, in the order of the sheet."""
        found: dict[str, list[str]] = {}
        for trial in self.trials("walking"):
            found.setdefault(self.static(trial), []).append(trial)
        for trial in self.plate_trials():
            found.setdefault(self.static(trial), [])
        return {static: found[static] for static in self.trials("static") if static in found}

    def calibration_settings(self, static: str) -> dict[str, Any]:
        """Settings for the calibration by a static trial: those of the configuration, with the side of the sheet.

        A static trial of plate trials alone has no ankle that moves: its axis stays the anatomical one.
        """
        settings = self.config.walking.part("CalibrationSettings")
        served = {trial: self.row(trial) for trial in self.statics.get(static, [])}
        try:
            side = side_of(static, self.row(static), served, self.config.walking.side)
        except InputError as error:
            raise InputError(f"{self.config.sheet}: {error}") from error
        return settings | {"side": side} | ({} if served else {"hinge": "anatomical"})

    def pattern(self, experiment: str) -> str:
        """A regular expression that matches the trials of an experiment, and no trial of another.

        It has the shortest beginnings that tell them apart: Snakemake reads it for every file that it looks at.
        """
        others = {
            name[:end]
            for name, row in self.rows.items()
            if row["experiment"] != experiment
            for end in range(1, len(name) + 1)
        }
        found: set[str] = set()
        for name in self.trials(experiment):
            own = next((name[:end] for end in range(1, len(name) + 1) if name[:end] not in others), None)
            found.add(re.escape(name) if own is None else f"{re.escape(own)}[A-Za-z0-9_.-]*")
        return "|".join(sorted(found)) or "(?!)"

    def row(self, trial: str, experiment: str | None = None) -> Mapping[str, Any]:
        """One trial's row of the sheet, empty cells as None.

        Raises
        ------
        InputError
            There is no such trial, or it is not of this experiment.
        """
        if trial not in self.rows:
            raise InputError(f"{self.config.sheet}: no trial '{trial}'; it has {', '.join(self.sheet.index[:5])}, ...")
        if experiment is not None and self.rows[trial]["experiment"] != experiment:
            raise InputError(
                f"{self.config.sheet}: trial '{trial}' is of experiment '{self.rows[trial]['experiment']}', not "
                f"'{experiment}'; ask for a result of that experiment"
            )
        return self.rows[trial]

    @cached_property
    def rows(self) -> dict[str, dict[str, Any]]:
        """The rows of the trials, by trial; empty cells as None. The rules ask for a row some twenty times per job."""
        return {str(trial): cells(row.items()) for trial, row in self.sheet.iterrows()}

    @cached_property
    def by_experiment(self) -> dict[str, list[str]]:
        """Names of the trials of each experiment, in the order of the sheet."""
        found: dict[str, list[str]] = {}
        for trial, row in self.rows.items():
            found.setdefault(row["experiment"], []).append(trial)
        return found

    def every_row(self) -> dict[str, dict[str, Any]]:
        """The rows of all trials, of those that the sheet excludes too, by trial; empty cells as None."""
        return self.rows | {str(trial): cells(row.items()) for trial, row in self.unused.iterrows()}

    @cached_property
    def places(self) -> dict[str, dict[str, Any]]:
        """Joint and side of every trial in the sheet, by trial. A side on the walkway is the one that is analysed."""
        calibrated = (*self.trials("walking"), *self.plate_trials()) if self.trials("walking") else ()
        static_by_trial = {trial: self.static(trial) for trial in calibrated}
        side_by_static = {name: self.calibration_settings(name)["side"] for name in set(static_by_trial.values())}
        sides = side_by_static | {trial: side_by_static[static] for trial, static in static_by_trial.items()}
        rows = {trial: self.row(trial) for trial in self.trials()}
        return {trial: {"joint": row["joint"], "side": sides.get(trial) or row["side"]} for trial, row in rows.items()}

    def by_place(self, experiment: str) -> list[list[str]]:
        """The trials of an experiment, those of each joint and side together."""
        places, groups = self.places, dict[tuple[str | None, str | None], list[str]]()
        for trial in self.trials(experiment):
            groups.setdefault((places[trial]["joint"], places[trial]["side"]), []).append(trial)
        return list(groups.values())

    @property
    def data(self) -> str:
        """What the data are: `simulated` or `measured`, as the configuration says, or where the simulator's truth lies
        beside the recordings."""
        made = self.config.simulation is not None or (self.config.raw_data / TRUTH).is_dir()
        return self.config.data or (SIMULATED if made else MEASURED)

    @cached_property
    def joint_of_device(self) -> str | None:
        """The joint of the device whose parameter file the configuration names; None without one."""
        return joint_of(self.config.parameters) if self.config.parameters else None

    def device(self, trial: str) -> Path | None:
        """The parameter file of a trial's device; None where there is none for its joint."""
        return self.config.parameters if self.row(trial)["joint"] == self.joint_of_device else None

    def predicted(self) -> list[str]:
        """The impedance trials whose gains are known: by a parameter file, a controller of the draft, K_d and B_d."""
        known = self.sheet["controller"].isin(CONTROLLERS) & self.sheet[["K_d", "B_d"]].notna().all(axis=1)
        return [trial for trial in self.trials("impedance") if known[trial] and self.device(trial)]

    def rows_of(self, experiment: str, table: Table) -> list[str]:
        """Names of the trials of an experiment that have rows in one of its tables."""
        return self.crossings(perturbed=True) if table.perturbed_only else self.trials(experiment)

    def recording(self, trial: str) -> Mapping[str, Any]:
        """The cells of a trial's row that ingest uses. A change of other cells does not cause a new ingest."""
        row = self.row(trial)
        return {column: row[column] for column in RECORDING_COLUMNS}

    def accepted(self, trial: str) -> list[str]:
        """The quality checks whose failure the sheet accepts for a trial."""
        return str(self.row(trial)["accept"] or "").split()

    def logs(self, trial: str) -> list[Path]:
        """The raw files of a trial."""
        row = self.row(trial)
        named = [self.config.raw_data / row[column] for column in ("log", "mocap") if row[column]]
        return [file for path in named for file in recorded_files(path)]

    def recorded_mb(self, trial: str) -> float:
        """Size of a trial's raw files [MB]; 0 for no trial, and for files that are not there yet."""
        files = self.logs(trial) if trial in self.sheet.index else []
        return sum(path.stat().st_size for path in files if path.is_file()) / 1e6

    def sources(self, trial: str) -> list[Path]:
        """The source files that describe a trial's raw files."""
        row = self.row(trial)
        return [self.config.sources / f"{row[c]}.yaml" for c in ("log_source", "mocap_source") if row[c]]


def open_campaign(config: Config, planned: pd.DataFrame | None) -> Campaign:
    """The campaign of a configuration; `planned` is the sheet of a simulation that has not been written yet.

    Raises
    ------
    InputError
        The sheet is not valid, or excludes every trial.
    """
    sheet = read_sheet(config.sheet) if planned is None else planned.set_index("trial", drop=False)
    sheet = sheet.fillna({"joint": JOINT})
    used, unused = sheet[sheet["exclude"].isna()], sheet[sheet["exclude"].notna()]
    if used.empty:
        raise InputError(f"{config.sheet}: every trial is excluded; clear `exclude` of those to analyse")
    return Campaign(config, used, unused)


def cells(row: Iterable[tuple[Hashable, Any]]) -> dict[str, Any]:
    """A row of the sheet, column and entry each, by column; empty cells as None."""
    return {str(name): None if pd.isna(value) else plain(value) for name, value in row}
