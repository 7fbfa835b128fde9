# SPDX-License-Identifier: Apache-2.0
"""Read the trials of a campaign's sample sheet, and check what must hold before anything runs.

The rules ask it about each trial, as `CAMPAIGN.trials("impedance")`.
"""

import filecmp
import hashlib
import json
import os
import re
import subprocess
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import requires, version
from io import DEFAULT_BUFFER_SIZE
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import polars as pl

from osl_analysis.base.errors import InputError, OslAnalysisError, naming
from osl_analysis.base.files import DISTRIBUTION, PACKAGE, ROOT, digest, shipped
from osl_analysis.base.table import MEASURED, SIMULATED
from osl_analysis.base.trial import metadata_of, parsed_windows
from osl_analysis.base.yaml_settings import check_known, read_mapping
from osl_analysis.campaign.configuration import Config
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.config.sheet import FIXTURE, RECORDINGS, SOURCES, SheetRows, read_sheet
from osl_analysis.ingest.raw_files import read_source, recorded_files
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.claims import read_claims
from osl_analysis.judge.recording_checks import unknown_check
from osl_analysis.model.drivetrain import joint_of, known_parameters
from osl_analysis.walking.groups import STATED, side_of, split_keys, static_of

DIGEST_DIGITS = 12  # of the digest of values: one that is equal by chance is not met
CODE_FOLDERS = ("osl_analysis", "rules")  # of a clone
CODE = {".py", ".yaml", ".j2", ".smk"}  # suffixes of what computes, judges and words


def digest_of(content: Any) -> str:
    """The first digits of the digest of values, whatever the order of their names."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGEST_DIGITS]


def values_in(path: Path) -> Any:
    """The values in a file: of YAML its fields, of CSV its rows without comments."""
    if path.suffix == ".yaml":
        return read_mapping(path)
    return pl.read_csv(path, comment_prefix="#", infer_schema=False).rows()


def digest_of_source(path: Path) -> str | None:
    """The digest of what a source file states, without its description; of its bytes where it is
    wrong, None where it is missing."""
    with suppress(OslAnalysisError):
        return digest_of(read_source(path).model_dump(mode="json", exclude={"description"}))
    return digest(path)


@cache
def code() -> str:
    """The digest of this package, its rules and the versions of its libraries."""
    files = [file for folder in (PACKAGE, ROOT / "rules") for file in sorted(folder.rglob("*"))]
    return digest_of([[digest(file) for file in files if file.suffix in CODE], libraries()])


@cache
def code_version() -> str:
    """The version that says which code this is: in a clone of the project its nearest tag, or its
    release, with the last commit that changed the code, and `-changed` where it is not committed;
    elsewhere the release with the first digits of the code's digest."""
    release = version(DISTRIBUTION)
    in_clone = (PACKAGE.parent / ".git").exists()
    commit = git("log", "-1", "--format=%h", "--", *CODE_FOLDERS) if in_clone else ""
    if not commit:
        return f"{release}+{code()[:8]}"
    tag = git("describe", "--tags", "--match=v*", commit).removeprefix("v")
    changed = git("status", "--porcelain", "--", *CODE_FOLDERS)
    return (tag or f"{release}+g{commit}") + ("-changed" if changed else "")


def git(*command: str) -> str:
    """What git says in the clone of the project; nothing where it is missing or refuses."""
    try:
        completed = subprocess.run(
            ["git", *command], cwd=PACKAGE.parent, capture_output=True, text=True
        )
    except OSError:
        return ""
    return completed.stdout.strip()


def libraries() -> dict[str, str]:
    """The versions of the libraries that this package needs."""
    needed = [line for line in requires(DISTRIBUTION) or () if "extra ==" not in line]
    names = [re.split(r"[^\w.-]", line)[0] for line in needed]
    return {name: version(name) for name in names}


def trace(
    stated: Mapping[str, str | None], trials: Iterable[Path], experiments: Mapping[str, str]
) -> dict[str, Any]:
    """What decides results: the digests of what is `stated` and of recordings; by trial (Parquet),
    its experiment, and which of both are its own; code and libraries."""
    recordings: dict[str, str] = {}
    facts_by_trial: dict[str, dict[str, Any]] = {}
    for path in trials:
        trial, provenance = metadata_of(path)
        files = facts_by_trial[trial] = {"experiment": experiments[trial], "files": []}
        for file in provenance["files"].values():
            recordings[file["path"]] = file["sha256"]
            files["files"] += [file["path"], f"source {file['source']}"]
    return {
        "stated": stated,
        "recordings": recordings,
        "trials": facts_by_trial,
        "code": {"version": code_version(), "digest": code()},
        "libraries": libraries(),
    }


# Cells of a row that ingest uses. A change of other cells does not cause a new ingest.
INGESTED = (
    "trial",
    "experiment",
    "log_part",
    *RECORDINGS,
    *SOURCES,
    *FIXTURE,
    "windows",
)
# cells of a row that name a recording
RECORDING = ("experiment", "log", "log_source", "log_part", "mocap")
WHOLE_RECORDING = "0-1000000"  # [s] as windows
FEWEST_PERTURBED = 2


UsedPart = tuple[float, float, str]
"""Begin and end [s] of a part of a recording, and the trial that uses it."""


def means_several(path: Path) -> bool:
    """Whether Snakemake takes a path for a pattern of several files."""
    return not {*str(path)}.isdisjoint("{}<>")


@dataclass(frozen=True)
class Campaign:
    """The trials of a configuration."""

    config: Config
    sheet: SheetRows  # all rows of the sample sheet

    @cached_property
    def rows(self) -> SheetRows:
        """Rows of the sample sheet that are not excluded."""
        return {trial: row for trial, row in self.sheet.items() if not row["exclude"]}

    def trials(self, *experiments: str) -> list[str]:
        """Names of the trials of these experiments, or of all, in the order of the sheet."""
        return [
            trial
            for trial, row in self.rows.items()
            if not experiments or row["experiment"] in experiments
        ]

    # Crossings of the walkway

    def crossings(self, perturbed: bool) -> list[str]:
        """Names of the walking trials that are perturbed, or of those that are not."""
        return [
            trial
            for trial in self.trials("walking")
            if bool(self.rows[trial]["perturbed"]) == perturbed
        ]

    def conditions(self) -> dict[str, dict[str, Any]]:
        """Conditions of every walking trial in the sheet, also of those that it excludes, by trial
        and column; None where empty."""
        return {
            trial: {column: row[column] for column in (*STATED, "perturbed", "exclude")}
            for trial, row in self.sheet.items()
            if row["experiment"] == "walking"
        }

    @cached_property
    def static_of(self) -> dict[str, str]:
        """The static trial that calibrates each crossing and each plate trial in use."""
        static_rows = {name: self.rows[name] for name in self.trials("static")}
        with naming(self.config.sheet):
            return {
                trial: static_of(trial, self.rows[trial], static_rows)
                for trial in (*self.trials("walking"), *self.plate_trials())
            }

    def plate_trials(self) -> list[str]:
        """Names of the plate trials from which the plate's inertia is identified; none if it is
        not, or nobody walks."""
        is_identified = self.config.walking.plate_inertia == "identified"
        return self.trials("plate") if is_identified and self.trials("walking") else []

    def sides(self) -> dict[str, str]:
        """The side of the leg that each static trial in use calibrates, by static trial: that of
        the sheet, else of the configuration."""
        sides = {}
        for static in {*self.static_of.values()}:
            served = {
                trial: self.rows[trial]
                for trial in self.trials("walking")
                if self.static_of[trial] == static
            }
            with naming(self.config.sheet):
                sides[static] = side_of(static, self.rows[static], served, self.config.walking.side)
        return sides

    # What belongs to a trial

    @cached_property
    def places(self) -> dict[str, dict[str, Any]]:
        """Joint and side of every trial in the sheet, by trial. On the walkway, the side that is
        analysed."""
        sides = self.sides()
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
        if parameters is None or joint_of(parameters) != self.rows[trial]["joint"]:
            return None
        return parameters

    def commanded(self, trial: str) -> dict[str, Any]:
        """What quality control compares with: the stepped sine that was asked for, or the markers
        of each cluster."""
        facts = EXPERIMENTS[self.rows[trial]["experiment"]]
        if facts.place == "walkway":
            return {"clusters": self.config.walking.markers.clusters}
        if not facts.stepped_sine:
            return {}
        bench = self.config.dynamometer
        protocol = bench.model_dump(mode="json", include={*PROTOCOL})
        return {**protocol, "longest_gap_s": bench.time_base.longest_gap_s}

    def recording(self, trial: str) -> Mapping[str, Any]:
        """The cells of a trial's row that ingest uses."""
        return {name: self.rows[trial][name] for name in INGESTED}

    def accepted(self, trial: str) -> list[str]:
        """The quality checks whose failure the sheet accepts for a trial."""
        return str(self.rows[trial]["accept"] or "").split()

    def logs(self, trial: str) -> list[Path]:
        """The recorded files of a trial."""
        named = filter(None, map(self.rows[trial].get, RECORDINGS))
        return [file for name in named for file in recorded_files(self.config.raw_data / name)]

    def readable_logs(self, trial: str) -> list[Path]:
        """The recorded files of a trial, but those that cannot be read: its ingest refuses them.

        A simulated one may not be made yet."""
        is_simulated = self.config.simulation is not None
        return [log for log in self.logs(trial) if is_simulated or os.access(log, os.R_OK)]

    def followed_logs(self, trial: str) -> list[Path]:
        """Those of them whose dates Snakemake compares."""
        return [log for log in self.readable_logs(trial) if not means_several(log)]

    def file_states(self, trial: str) -> list[int]:
        """The sizes [bytes] of all of them: another one is seen even if its date is older. Of those
        that Snakemake does not follow the dates [ns]."""
        states = []
        for file in filter(Path.exists, self.readable_logs(trial)):
            facts = file.stat()
            states.append(facts.st_mtime_ns if means_several(file) else facts.st_size)
        return states

    def sources(self, trial: str) -> list[Path]:
        """The source files of a trial."""
        named = filter(None, map(self.rows[trial].get, SOURCES))
        return [self.config.sources / f"{name}.yaml" for name in named]

    @cached_property
    def source_digests(self) -> dict[Path, str | None]:
        """The digests of what the source files state, by file."""
        files = {path for trial in self.trials() for path in self.sources(trial)}
        return {path: digest_of_source(path) for path in sorted(files)}

    @property
    def data(self) -> str:
        """`simulated` or `measured`: as the configuration says, else simulated if the simulator's
        truth is beside."""
        has_truth = (self.config.raw_data / "truth").is_dir()
        is_simulated = self.config.simulation is not None or has_truth
        return self.config.data or (SIMULATED if is_simulated else MEASURED)

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
    campaign = Campaign(config, sheet)
    if not campaign.rows:
        raise InputError(
            f"{config.sheet}: every trial is excluded", "clear `exclude` of those to analyse"
        )
    return campaign


# What a campaign must fulfil before anything runs


def check_campaign(campaign: Campaign) -> None:
    """Refuse a campaign that cannot be analysed.

    Raises
    ------
    InputError
        The configuration names a missing file; quality rules, or names under `accept`, match no
        check; two trials use one recording; or the analysis of walking trials lacks other trials.
    """
    check_files(campaign.config)
    used_parts = dict[tuple[Any, ...], list[UsedPart]]()
    for trial, row in campaign.rows.items():
        recording = tuple(row[cell] for cell in RECORDING)
        with naming(f"{campaign.config.sheet}: trial '{trial}'"):
            for name in campaign.accepted(trial):
                if name not in CHECKS:
                    raise InputError(f"accept: {unknown_check(name)}")
            if row["desired"]:
                curves = campaign.config.torque_angle.desired
                check_known(curves, "curve of torque_angle.desired", row["desired"])
            if row["log"]:
                check_not_used_twice(trial, row, used_parts.setdefault(recording, []))
    if campaign.config.simulation is None:
        check_no_copies(campaign)
    if campaign.trials("walking"):
        check_walking(campaign)


def check_not_used_twice(trial: str, row: Mapping[str, Any], used: list[UsedPart]) -> None:
    """Refuse a log of which another trial uses the same part; adds the parts of this trial to the
    `used` ones."""
    for start, stop in parsed_windows(row["windows"] or WHOLE_RECORDING):
        for used_start, used_stop, earlier_trial in used:
            if min(stop, used_stop) > max(start, used_start):
                raise InputError(
                    f"trial '{earlier_trial}' uses the same part of log '{row['log']}'",
                    "correct one, or give each its own `windows`",
                )
        used.append((start, stop, trial))


def check_no_copies(campaign: Campaign) -> None:
    """Refuse a recording that another trial of the experiment has under another name: it would
    count twice."""
    files_alike: dict[tuple[object, ...], list[Path]] = {}
    for trial, row in campaign.rows.items():
        for file in campaign.readable_logs(trial):
            size = file.stat().st_size
            if not size or file.suffix == ".yaml":  # two bags may have equal descriptions
                continue
            alike = (row["experiment"], row["log_part"], row["windows"], size, ends_of(file, size))
            earlier = files_alike.setdefault(alike, [])
            for earlier_file in {*earlier} - {file}:
                if filecmp.cmp(earlier_file, file, shallow=False):
                    raise InputError(
                        f"{campaign.config.sheet}: trial '{trial}': {file} is a copy of"
                        f" {earlier_file},"
                        " the recording of another trial, and would count twice",
                        "exclude one, or name its own",
                    )
            earlier.append(file)


def ends_of(file: Path, size: int) -> int:
    """A checksum of the first and the last bytes of a file. Only files that agree in it are
    compared whole, so that the time of a plan grows with their number and not with its square."""
    with file.open("rb") as stream:
        ends = stream.read(DEFAULT_BUFFER_SIZE)
        stream.seek(max(size - DEFAULT_BUFFER_SIZE, 0))
        return zlib.crc32(ends + stream.read())


def check_files(config: Config) -> None:
    """Refuse a missing file, folders that are files, and a results' folder that holds what is
    analysed. Ingest checks raw files."""
    # the jobs that use the parameters give their warnings
    with naming("parameters"), catch_warnings(action="ignore"):
        known_parameters(config.parameters)
    if config.impedance_trajectory is not None:
        with naming("impedance_trajectory"):
            read_impedance_trajectory(config.impedance_trajectory)
    followed = {"results", "parameters", "impedance_trajectory", "claims", "simulation"}
    if config.simulation is not None:
        followed.update(("raw_data", "sheet"))
    for field, path in config.model_dump(include=followed).items():
        if means_several(path):
            raise InputError(
                f"configuration: {field} = {path} has one of the signs {{}}<>, which mean"
                " several files to Snakemake",
                "choose a name without them",
            )
    if config.claims is not None:
        read_claims(config.claims)
    results = config.results.resolve()
    if any(
        path.resolve().is_relative_to(results)
        for path in (config.raw_data, config.sources, config.sheet, Path())
    ):
        raise InputError(
            f"configuration: results = {config.results} holds the recordings, source files,"
            " sheet or campaign",
            "name another folder",
        )
    for path in (config.raw_data, config.sources, config.results):
        for folder in (path, *path.parents):
            if folder.is_file():
                raise InputError(
                    f"{folder}: is a file", "name folders as `raw_data`, `sources` and `results`"
                )


def check_walking(campaign: Campaign) -> None:
    """Refuse walking trials without static, plate or other trials."""
    sheet = campaign.config.sheet
    walking = campaign.config.walking
    needs = {
        "trial of experiment 'static'": (campaign.trials("static"), 1),
        "unperturbed crossings (walking.fewest_unperturbed)": (
            campaign.crossings(perturbed=False),
            walking.fewest_unperturbed,
        ),
        "perturbed crossings": (campaign.crossings(perturbed=True), FEWEST_PERTURBED),
        "trial of experiment 'plate', unless walking.plate_inertia is none": (
            campaign.trials("plate"),
            int(walking.plate_inertia == "identified"),
        ),
    }
    for what, (trials, fewest) in needs.items():
        if len(trials) < fewest:
            raise InputError(
                f"{sheet}: walking needs {fewest} or more {what}, and there are {len(trials)}",
                "add them, or exclude the walking trials",
            )
    campaign.sides()
    with naming(sheet):
        split_keys(campaign.conditions())
