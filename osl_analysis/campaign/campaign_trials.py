"""A campaign: the trials of its sample sheet, and what the rules ask about each of them."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from osl_analysis.campaign.configuration import Config
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.config.sheet import FIXTURE, SheetRows, read_sheet
from osl_analysis.errors import InputError, naming, nearest
from osl_analysis.files import shipped
from osl_analysis.ingest.raw_files import recorded_files
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.table import MEASURED, SIMULATED
from osl_analysis.walking.groups import STATED, side_of, static_of

# Cells of a row that ingest uses. A change of other cells does not cause a new ingest.
INGESTED = ("trial", "experiment", "log", "log_source", "log_part", "mocap", "mocap_source")


@dataclass(frozen=True)
class Campaign:
    """The trials of a configuration."""

    config: Config
    rows: SheetRows  # rows of the sample sheet that are not excluded
    unused: SheetRows  # excluded rows, with the reasons in the column `exclude`

    @property
    def excluded(self) -> dict[str, str]:
        """Reasons of the trials that the sheet excludes, by trial."""
        return {trial: row["exclude"] for trial, row in self.unused.items()}

    def trials(self, *experiments: str) -> list[str]:
        """Names of the trials of these experiments, or of all, in the order of the sheet."""
        return [
            trial
            for trial, row in self.rows.items()
            if not experiments or row["experiment"] in experiments
        ]

    def row(self, trial: str) -> Mapping[str, Any]:
        """One trial's row of the sheet, empty cells as None."""
        if trial not in self.rows:
            raise InputError(f"{self.config.sheet}: no trial '{trial}'{nearest(trial, self.rows)}")
        return self.rows[trial]

    # ---- Crossings of the walkway

    def crossings(self, perturbed: bool) -> list[str]:
        """Names of the walking trials that are perturbed, or of those that are not."""
        return [
            trial
            for trial in self.trials("walking")
            if bool(self.row(trial)["perturbed"]) == perturbed
        ]

    def conditions(self) -> dict[str, dict[str, Any]]:
        """Conditions of every walking trial in the sheet, by trial and column; None where empty."""
        columns = (*STATED, "perturbed")
        return {
            trial: {column: self.row(trial)[column] for column in columns}
            for trial in self.trials("walking")
        }

    @cached_property
    def static_of(self) -> dict[str, str]:
        """The static trial that calibrates each crossing and each plate trial in use."""
        static_rows = {name: self.row(name) for name in self.trials("static")}
        with naming(self.config.sheet):
            return {
                trial: static_of(trial, self.row(trial), static_rows)
                for trial in (*self.trials("walking"), *self.plate_trials())
            }

    def plate_trials(self) -> list[str]:
        """Names of the plate trials from which the plate's inertia is identified; none if it is
        not, or nobody walks."""
        is_identified = self.config.walking.plate_inertia == "identified"
        return self.trials("plate") if is_identified and self.trials("walking") else []

    @cached_property
    def statics(self) -> dict[str, list[str]]:
        """The crossings that each static trial in use calibrates, by static trial, in the order of
        the sheet."""
        crossings = self.trials("walking")
        return {
            static: [trial for trial in crossings if self.static_of[trial] == static]
            for static in self.trials("static")
            if static in self.static_of.values()
        }

    def calibration_settings(self, static: str) -> dict[str, Any]:
        """Settings for the calibration by a static trial: those of the configuration, with the side
        of the sheet."""
        crossings = {trial: self.row(trial) for trial in self.statics.get(static, [])}
        with naming(self.config.sheet):
            side = side_of(static, self.row(static), crossings, self.config.walking.side)
        return {**self.config.walking.part("CalibrationSettings"), "side": side}

    # ---- What belongs to a trial

    @cached_property
    def places(self) -> dict[str, dict[str, Any]]:
        """Joint and side of every trial in the sheet, by trial. On the walkway, the side that is
        analysed."""
        sides = {static: self.calibration_settings(static)["side"] for static in self.statics}
        return {
            trial: {
                "joint": row["joint"],
                "side": sides.get(self.static_of.get(trial, trial), row["side"]),
            }
            for trial, row in self.rows.items()
        }

    def device(self, trial: str) -> Path | None:
        """The parameter file of a trial's device; None if there is none for its joint."""
        parameters = self.config.parameters
        if parameters is None or joint_of(parameters) != self.row(trial)["joint"]:
            return None
        return parameters

    def commanded(self, trial: str) -> dict[str, Any]:
        """The stepped sine that was asked for, with which quality control compares the motion."""
        if not EXPERIMENTS[self.row(trial)["experiment"]].stepped_sine:
            return {}
        return self.config.dynamometer.model_dump(mode="json", include={*PROTOCOL})

    def recording(self, trial: str) -> Mapping[str, Any]:
        """The cells of a trial's row that ingest uses."""
        row = self.row(trial)
        stated = [column for column in (*FIXTURE, "windows") if row[column] is not None]
        return {column: row[column] for column in (*INGESTED, *stated)}

    def accepted(self, trial: str) -> list[str]:
        """The quality checks whose failure the sheet accepts for a trial."""
        return str(self.row(trial)["accept"] or "").split()

    def logs(self, trial: str) -> list[Path]:
        """The recorded files of a trial."""
        row = self.row(trial)
        named = [row[column] for column in ("log", "mocap") if row[column]]
        return [file for name in named for file in recorded_files(self.config.raw_data / name)]

    def readable_logs(self, trial: str) -> list[Path]:
        """The recorded files of a trial, but those that cannot be read: its ingest refuses them.

        A simulated one may not be made yet."""
        is_simulated = self.config.simulation is not None
        return [log for log in self.logs(trial) if is_simulated or os.access(log, os.R_OK)]

    def log_sizes(self, trial: str) -> list[int]:
        """The sizes of the recorded files [bytes]: another one is seen even if its date is
        older."""
        return [log.stat().st_size for log in self.readable_logs(trial) if log.exists()]

    def sources(self, trial: str) -> list[Path]:
        """The source files of a trial."""
        row = self.row(trial)
        named = [row[column] for column in ("log_source", "mocap_source") if row[column]]
        return [self.config.sources / f"{name}.yaml" for name in named]

    @property
    def data(self) -> str:
        """`simulated` or `measured`: as the configuration says, else simulated if the simulator's
        truth is beside."""
        if self.config.data:
            return self.config.data
        has_truth = (self.config.raw_data / "truth").is_dir()
        is_simulated = self.config.simulation is not None or has_truth
        return SIMULATED if is_simulated else MEASURED

    @property
    def beside_draft(self) -> bool:
        """Whether results are compared with the paper's draft: only if its device is simulated."""
        is_drafts_device = self.config.parameters == shipped("config/parameters/default.yaml")
        return self.config.simulation is not None and is_drafts_device


def open_campaign(config: Config, planned: SheetRows | None) -> Campaign:
    """Open the campaign of a configuration.

    Parameters
    ----------
    config : Config
    planned : SheetRows or None
        The sheet of a simulation that is not written yet; None: the sheet is read.

    Returns
    -------
    Campaign

    Raises
    ------
    InputError
        As `read_sheet`, or every trial is excluded.
    """
    sheet = read_sheet(config.sheet) if planned is None else planned
    # a trial without a joint has the device's
    if config.parameters is not None and config.parameters.is_file():
        with naming("parameters"):
            joint = joint_of(config.parameters)
        sheet = {trial: {**row, "joint": row["joint"] or joint} for trial, row in sheet.items()}
    used = {trial: row for trial, row in sheet.items() if row["exclude"] is None}
    unused = {trial: row for trial, row in sheet.items() if row["exclude"] is not None}
    if not used:
        raise InputError(
            f"{config.sheet}: every trial is excluded; clear `exclude` of those to analyse"
        )
    return Campaign(config, used, unused)
