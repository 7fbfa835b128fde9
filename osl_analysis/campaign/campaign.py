"""A campaign: its sample sheet, the trials that are analysed, and the origin of its results."""

import filecmp
import hashlib
import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any
from warnings import catch_warnings

from osl_analysis.campaign.configuration import Config, FrequencyResponseFigure
from osl_analysis.config.experiments import EXPERIMENTS, ResultTable
from osl_analysis.config.sheet import FIXTURE, SheetRows, read_impedance_trajectory, read_sheet
from osl_analysis.errors import InputError, listing, naming, nearest
from osl_analysis.files import default_config, shipped
from osl_analysis.ingest.examine import UNITS
from osl_analysis.ingest.raw_files import recorded_files
from osl_analysis.judge.limits import CHECKS, unknown_check, validate_rules
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.model.drivetrain import joint_of, known_parameters
from osl_analysis.table import MEASURED, SIMULATED
from osl_analysis.trial import stretches
from osl_analysis.walking.groups import STATED, side_of, split_keys, static_of
from osl_analysis.yaml_settings import content_digest, read_mapping


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

    def crossings(self, perturbed: bool) -> list[str]:
        """Names of the walking trials that are perturbed, or of those that are not."""
        return [
            name
            for name in self.trials("walking")
            if bool(self.row(name)["perturbed"]) == perturbed
        ]

    def conditions(self) -> dict[str, dict[str, Any]]:
        """Conditions of every walking trial in the sheet, by trial and column; None where empty."""
        return {
            one: {name: self.row(one)[name] for name in (*STATED, "perturbed")}
            for one in self.trials("walking")
        }

    def static(self, trial: str) -> str:
        """The static trial that calibrates a crossing or plate trial."""
        with naming(self.config.sheet):
            return static_of(
                trial, self.row(trial), {name: self.row(name) for name in self.trials("static")}
            )

    def plate_trials(self) -> list[str]:
        """Names of the plate trials from which the plate's inertia is identified; none if it is
        not."""
        walking = self.config.walking
        return (
            self.trials("plate")
            if walking.plate_inertia == "identified" and not walking.by_log
            else []
        )

    @cached_property
    def statics(self) -> dict[str, list[str]]:
        """The crossings that each static trial in use calibrates, by static trial, in the order of
        the sheet."""
        if self.config.walking.by_log:
            return {}
        found = {trial: self.static(trial) for trial in self.trials("walking")}
        used = {*found.values(), *map(self.static, self.plate_trials())}
        return {
            one: [trial for trial in found if found[trial] == one]
            for one in self.trials("static")
            if one in used
        }

    def calibration_settings(self, static: str) -> dict[str, Any]:
        """Settings for the calibration by a static trial: those of the configuration, with the side
        of the sheet."""
        served = {trial: self.row(trial) for trial in self.statics.get(static, [])}
        with naming(self.config.sheet):
            side = side_of(static, self.row(static), served, self.config.walking.side)
        return self.config.walking.part("CalibrationSettings") | {"side": side}

    def pattern(self, experiment: str) -> str:
        """A regular expression that matches the trials of an experiment, and no trial of
        another."""
        return "|".join(map(re.escape, self.trials(experiment))) or "(?!)"

    def row(self, trial: str) -> Mapping[str, Any]:
        """One trial's row of the sheet, empty cells as None."""
        if trial not in self.rows:
            raise InputError(
                f"{self.config.sheet}: no trial '{trial}'; it has"
                f" {', '.join([*self.rows][:5])}, ..."
            )
        return self.rows[trial]

    @cached_property
    def places(self) -> dict[str, dict[str, Any]]:
        """Joint and side of every trial in the sheet, by trial. On the walkway, the side that is
        analysed."""
        walking, sides = self.trials("walking"), dict[str, str]()
        for static, crossings in (self.statics if walking else {}).items():
            sides |= dict.fromkeys((static, *crossings), self.calibration_settings(static)["side"])
        sides |= {
            trial: sides[self.static(trial)] for trial in (self.plate_trials() if walking else ())
        }
        rows = self.rows.items()
        return {
            name: {"joint": row["joint"], "side": sides.get(name) or row["side"]}
            for name, row in rows
        }

    @property
    def data(self) -> str:
        """`simulated` or `measured`: as the configuration says, else simulated if the simulator's
        truth is beside."""
        made = self.config.simulation is not None or (self.config.raw_data / "truth").is_dir()
        return self.config.data or (SIMULATED if made else MEASURED)

    @property
    def beside_draft(self) -> bool:
        """Whether results are compared with the paper's draft, as `report` of the configuration
        says. By default, only if the draft's device is simulated."""
        asked, of_draft = self.config.report.beside_draft, shipped("config/parameters/default.yaml")
        return (
            self.config.simulation is not None and self.config.parameters == of_draft
            if asked is None
            else asked
        )

    def device(self, trial: str) -> Path | None:
        """The parameter file of a trial's device; None if there is none for its joint."""
        known = self.config.parameters
        return known if known and joint_of(known) == self.row(trial)["joint"] else None

    def predicted(self) -> list[str]:
        """The impedance trials with known gains: with a parameter file, a controller of the draft,
        K_d and B_d."""
        rows = {trial: self.row(trial) for trial in self.trials("impedance") if self.device(trial)}
        known = {trial for trial, row in rows.items() if row["controller"] in CONTROLLERS}
        return [
            trial
            for trial, row in rows.items()
            if trial in known and None not in (row["K_d"], row["B_d"])
        ]

    def rows_of(self, experiment: str, table: ResultTable) -> list[str]:
        """Names of the trials of an experiment that have rows in one of its tables."""
        human = self.config.dynamometer.human
        if table.scheduled_only and (human is None or human.over is None):
            return []
        return self.crossings(perturbed=True) if table.perturbed_only else self.trials(experiment)

    def needed_columns(self, trial: str) -> tuple[str, ...]:
        facts, walks = (
            EXPERIMENTS[self.row(trial)["experiment"]],
            self.row(trial)["experiment"] == "walking",
        )
        return ("theta", "torque") if walks and self.config.walking.by_log else facts.needed_columns

    def further_tables(self) -> list[str]:
        """The result tables that rules compute from all trials of an experiment together."""
        by_log = self.config.walking.by_log
        every = (
            table
            for name in EXPERIMENTS
            if self.trials(name)
            for table in EXPERIMENTS[name].further_tables
        )
        return [table for table in every if not (by_log and table in ("plate", "platform"))]

    def recording(self, trial: str) -> Mapping[str, Any]:
        """The cells of a trial's row that ingest uses. A change of other cells does not cause a new
        ingest."""
        used = ("trial", "experiment", "log", "log_source", "log_part", "mocap", "mocap_source")
        fixture = [column for column in FIXTURE if self.row(trial)[column] is not None]
        return {column: self.row(trial)[column] for column in (*used, *fixture)}

    def accepted(self, trial: str) -> list[str]:
        """The quality checks whose failure the sheet accepts for a trial."""
        return str(self.row(trial)["accept"] or "").split()

    def logs(self, trial: str) -> list[Path]:
        named = [self.row(trial)[column] for column in ("log", "mocap")]
        return [file for one in named if one for file in recorded_files(self.config.raw_data / one)]

    def sources(self, trial: str) -> list[Path]:
        named = [self.row(trial)[column] for column in ("log_source", "mocap_source")]
        return [self.config.sources / f"{one}.yaml" for one in named if one]


def open_campaign(config: Config, planned: SheetRows | None) -> Campaign:
    """The campaign of a configuration. `planned` is the sheet of a simulation that is not written
    yet."""
    sheet = read_sheet(config.sheet) if planned is None else planned
    # a trial without a joint has the device's
    if config.parameters is not None and config.parameters.is_file():
        with naming("parameters"):
            joint = joint_of(config.parameters)
        sheet = {trial: row | {"joint": row["joint"] or joint} for trial, row in sheet.items()}
    if config.dynamometer.human is not None:
        of_person = {trial for trial, row in sheet.items() if row["experiment"] == "impedance"}
        sheet = {
            t: {**row, "experiment": "human_joint"} if t in of_person else row
            for t, row in sheet.items()
        }
    used = {trial: row for trial, row in sheet.items() if row["exclude"] is None}
    if not used:
        raise InputError(
            f"{config.sheet}: every trial is excluded; clear `exclude` of those to analyse"
        )
    return Campaign(config, used, {trial: row for trial, row in sheet.items() if trial not in used})


def check_campaign(campaign: Campaign) -> None:
    """Refuse a configuration that names a missing file; quality rules, or names under `accept`,
    that match no check; and walking trials whose analysis lacks other trials."""
    check_files(campaign.config)
    validate_rules(campaign.config.quality, UNITS)
    taken = dict[tuple[Any, ...], list[tuple[float, float, str]]]()
    for trial in campaign.rows:
        for name in campaign.accepted(trial):
            if name not in CHECKS:
                raise InputError(
                    f"{campaign.config.sheet}: trial '{trial}', accept: {unknown_check(name)}"
                )
        row, cells = campaign.row(trial), ("experiment", "log", "log_source", "log_part", "mocap")
        mine = taken.setdefault(tuple(row[cell] for cell in cells), [])
        for start, stop in stretches(row["windows"] or "0-1000000") if row["log"] else ():
            if other := next((one for begin, end, one in mine if start < end and begin < stop), ""):
                said = (
                    f"log '{row['log']}' is that of trial '{other}'; correct one, or give each its"
                    " own `windows`"
                )
                raise InputError(f"{campaign.config.sheet}: trial '{trial}': {said}")
            mine.append((start, stop, trial))
        curve, curves = campaign.row(trial)["desired"], campaign.config.torque_angle.desired
        if curve and curve not in curves:
            there = (
                "torque_angle.desired in the configuration has"
                f" {listing([*curves])}{nearest(curve, curves)}"
            )
            raise InputError(
                f"{campaign.config.sheet}: trial '{trial}', desired '{curve}' is no curve; {there}"
            )
    if campaign.config.simulation is None:
        check_no_copies(campaign)
    if campaign.trials("walking"):
        check_walking(campaign)


def check_no_copies(campaign: Campaign) -> None:
    """Refuse a recording that another trial of the experiment has under another name: it would
    count twice."""
    alike: dict[tuple[object, ...], list[tuple[str, Path]]] = {}
    for trial in campaign.rows:
        row = campaign.row(trial)
        # two bags may have equal descriptions
        files = (one for one in campaign.logs(trial) if one.is_file() and one.suffix != ".yaml")
        for file in (one for one in files if (size := one.stat().st_size)):
            # the middle differs for most files of equal size
            with suppress(OSError), file.open("rb") as content:
                content.seek(size // 2)
                key = row["experiment"], row["log_part"], row["windows"], size, content.read(4096)
                for other, known in alike.setdefault(key, []):
                    if known != file and filecmp.cmp(known, file, shallow=False):
                        said = (
                            f"{file} is a copy of {known}, the recording of trial '{other}', and"
                            " would count twice"
                        )
                        said += "; exclude one, or name its own"
                        raise InputError(f"{campaign.config.sheet}: trial '{trial}': {said}")
                alike[key].append((trial, file))


def check_files(config: Config) -> None:
    """Refuse a missing file, and a results' folder that is a file. Ingest checks raw files."""
    if config.results == Path():
        raise InputError(
            "configuration: results is empty, or this very folder; name a folder, as `results:"
            " results`"
        )
    for field in ("results", "raw_data", "sources", "sheet"):
        path = getattr(config, field)
        for folder in path.parents if field == "sheet" else (path, *path.parents):
            if folder.is_file():
                raise InputError(
                    f"{folder}: is a file; name a folder under `{field}` in the configuration"
                )
        if field != "results" and path.resolve().is_relative_to(config.results.resolve()):
            raise InputError(
                f"configuration: results = {config.results} is or holds {field} = {path}; name"
                " another"
            )
    named = {"parameters": config.parameters, "impedance_trajectory": config.impedance_trajectory}
    for field, path in named.items():
        if path is not None and not path.is_file():
            raise InputError(
                f"{path}: no such file; correct {field} in the configuration, or write null for"
                " none"
            )
    # the jobs that use the parameters give them
    with naming("parameters"), catch_warnings(action="ignore"):
        known_parameters(config.parameters)
    if config.impedance_trajectory is not None:
        with naming("impedance_trajectory"):
            read_impedance_trajectory(config.impedance_trajectory)


def check_walking(campaign: Campaign) -> None:
    """Refuse walking trials whose analysis lacks files, or static, plate or other trials."""
    walking, add = campaign.config.walking, "add them, or exclude the walking trials"
    if campaign.config.simulation is not None:
        add += ", or correct experiments.walking or perturbed_share of the simulation"
    by, file = walking.perturbed_by, "log" if walking.by_log else "mocap"
    for trial in campaign.trials("walking"):
        where, row = f"{campaign.config.sheet}: trial '{trial}'", campaign.row(trial)
        if row[file] is None:
            raise InputError(
                f"{where}: {file} is empty; a trial of experiment 'walking' needs it (perturbed_by:"
                f" {by})"
            )
        if row["windows"] and not walking.by_command:
            raise InputError(
                f"{where}: windows cut no capture with a moving platform; export each crossing"
                " alone"
            )
    few = f"{add}, or lower walking.fewest_unperturbed, to 3 at least"
    needed = [
        (
            campaign.crossings(perturbed=False),
            "unperturbed crossings",
            walking.fewest_unperturbed,
            few,
        ),
        (campaign.crossings(perturbed=True), "perturbed crossings", 2, add),
    ]
    if not walking.by_log:
        needed.insert(0, (campaign.trials("static"), "trial of experiment 'static'", 1, add))
    if walking.plate_inertia == "identified" and not walking.by_log:
        state = (
            "add them, to remove the plate's own inertia, or state `plate_inertia: none` under"
            " `walking` if the "
        )
        state += "plate is light or compensates its inertia itself"
        needed.append(
            (
                campaign.trials("plate"),
                "trial of experiment 'plate' (unloaded platform, moved)",
                1,
                state,
            )
        )
    for there, what, least, remedy in needed:
        if len(there) < least:
            raise InputError(
                f"{campaign.config.sheet}: {len(there)} {what}, walking needs {least} or more;"
                f" {remedy}"
            )
    for static in campaign.statics:
        campaign.calibration_settings(static)
    with naming(campaign.config.sheet):
        split_keys(campaign.conditions(), walking)


def time_series_example(campaign: Campaign) -> dict[str, Any] | None:
    """The trial that Fig. 4 shows: its name, joint and side; the amplitude [deg] that is drawn
    (None: the largest); the duration [s]; and `chosen`, why this trial, if the configuration does
    not name it. None without impedance trials."""
    stated, trials = campaign.config.figures.time_series, campaign.trials("impedance")
    if not trials:
        return None
    name, amplitude_deg, chosen = trials[0], None, "the first impedance trial of the sheet"
    if stated is not None:
        asked = {"controller": stated.controller, "K_d": stated.K_d, "B_d": stated.B_d}
        if found := matching(campaign, asked, "time_series"):
            name, amplitude_deg, chosen = found[0], stated.amplitude_deg, ""
            known, of = (
                campaign.config.dynamometer.amplitudes_deg or (),
                "figures.time_series.amplitude_deg",
            )
            is_known = not known or any(
                abs(one / (amplitude_deg or one) - 1) < 0.1 for one in known
            )
            if not is_known and campaign.config.dynamometer.excitation != "any":
                said = (
                    "is none of dynamometer.amplitudes_deg"
                    f" ({', '.join(f'{one:g}' for one in known)})"
                )
                raise InputError(
                    f"configuration: {of} = {amplitude_deg:g} {said}; choose one of them, or null"
                )
        else:
            chosen += "; the example of the configuration is not in this campaign"
    shown = {
        "amplitude_deg": amplitude_deg,
        "duration_s": stated.duration_s if stated else 10.0,
        "chosen": chosen,
    }
    return {"trial": name, **campaign.places[name], **shown}


def response_example(campaign: Campaign) -> FrequencyResponseFigure | None:
    """The desired impedance of Fig. 7; None: the one with the most trials. Raises as
    `time_series_example`."""
    stated = campaign.config.figures.frequency_response
    if stated is None or not campaign.trials("impedance"):
        return None
    return (
        stated
        if matching(campaign, {"K_d": stated.K_d, "B_d": stated.B_d}, "frequency_response")
        else None
    )


def matching(campaign: Campaign, asked: dict[str, Any], figure: str = "") -> list[str]:
    """The impedance trials with these cells; None matches an empty cell. Raises InputError: the
    `figure` asks for an example that the campaign does not have, unless the default configuration
    does."""
    trials = campaign.trials("impedance")
    found = [
        name
        for name in trials
        if all(campaign.row(name)[cell] == value for cell, value in asked.items())
    ]
    default = read_mapping(default_config())["figures"].get(figure) or {}
    if (
        figure
        and not found
        and not all(default.get(name) == value for name, value in asked.items())
    ):
        said = ", ".join(
            f"{k} = {v:{'g' * (not isinstance(v, str))}}" for k, v in asked.items() if v is not None
        )
        raise InputError(
            f"{campaign.config.sheet}: no impedance trial with {said or 'these empty cells'};"
            f" choose another one under figures.{figure}, or null to have one"
            f" chosen{nearest(asked.get('controller') or '', CONTROLLERS)}"
        )
    return found


ABOUT_MEANING = {
    "campaign": "name of the campaign",
    "data": "simulated or measured",
    "version": "version of osl-analysis",
    "configuration": (
        "first digits of the SHA-256 of the configuration and of the files that it names"
    ),
    "recorded": "date of the data, or what is known in its place",
}
"""Facts on the origin of results."""
# The LaTeX macros, without prefix.
ABOUT_MACROS = {name: name.capitalize() for name in ABOUT_MEANING}


def sentence(about: Mapping[str, str], below_figure: bool = False) -> str:
    """The origin of results in a sentence. Below a figure, without the hash of settings that it may
    not even use."""
    of = {name: about.get(name, "") for name in ABOUT_MEANING}
    configuration = "" if below_figure else f", configuration {of['configuration']}"
    made_by = f"osl-analysis {of['version']}{configuration}"
    return f"{of['data'].capitalize()} data: campaign {of['campaign']}, {made_by}, {of['recorded']}"


def about(campaign: Campaign, simulation: list[Path]) -> dict[str, str]:
    """The origin of a campaign's results, by `ABOUT_MEANING`. `simulation` are the files of its
    simulation's settings. The data are dated by the configuration, else by the seed of the
    simulation, else by the recordings (UTC)."""
    config = campaign.config
    files = {
        path
        for path in (config.parameters, config.impedance_trajectory, *simulation)
        if path is not None
    }
    # not in the hash: these settings do not change results, or stand beside the hash
    places = {"raw_data", "sheet", "results", "sources", "failed_trials", "data", "recorded"}
    settings = config.model_dump(mode="json", exclude=places)  # with the defaults
    text = json.dumps(
        [settings, sorted(str(content_digest(path)) for path in files)], sort_keys=True
    )
    if config.recorded is not None:
        when = f"recorded {config.recorded}"
    elif config.simulation is not None:
        when = f"made with seed {read_mapping(config.simulation).get('seed')}"
    else:
        logs = {
            path for trial in campaign.trials() for path in campaign.logs(trial) if path.is_file()
        }
        days = sorted(
            {datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat() for path in logs}
        )
        when = (
            f"files of {' to '.join(dict.fromkeys([days[0], days[-1]]))}"
            if days
            else "date not known"
        )
    configuration = hashlib.sha256(text.encode()).hexdigest()[:8]
    values = config.campaign, campaign.data, version("osl-analysis"), configuration, when
    return dict(zip(ABOUT_MEANING, values, strict=True))
