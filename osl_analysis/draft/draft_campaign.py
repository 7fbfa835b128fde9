"""A draft of a campaign from a folder of recordings: a source file for each kind of them, a sample
sheet, the section `walking` of the configuration, and what the user has to decide."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import compress
from pathlib import Path

import numpy as np

from osl_analysis.draft.draft_session import (
    gate_lengths,
    is_gated,
    join_session_log,
)
from osl_analysis.draft.draft_sheet import (
    UNNAMED,
    DraftedTrial,
    draft_trials,
    is_fixture_alone,
    states_perturbation,
)
from osl_analysis.draft.draft_source import (
    DraftedLog,
    DraftedSource,
    drafted_log,
    drafted_source,
    pulse_channels,
)
from osl_analysis.draft.draft_walking import draft_walking, segment_of, stepping_leg
from osl_analysis.draft.guesses import joints_named, turns_slowly
from osl_analysis.draft.overview import FEWEST_READINGS, inspect_recording
from osl_analysis.draft.recorded_channel import Overview
from osl_analysis.errors import InputError, listing
from osl_analysis.files import shipped
from osl_analysis.formats import TEXT_PRIORITY, formats_of, known_formats
from osl_analysis.ingest.raw_files import check_file, is_capture, recordings_in, suffixes
from osl_analysis.measured import unusual
from osl_analysis.yaml_settings import read_mapping

CHANNEL_KEYS = {"topic", "field", "column", "variable"}  # that name a channel of a log
FEWEST_CHANNELS = 3  # of a shipped source file, by which its recorder is known


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide.

    Attributes
    ----------
    source_files
        Drafts of source files, by name.
    open
        File and question, as which of two clocks counts.
    has_open_captures
        Whether a capture asks something, as where its plate lies: its trials may be refused.
    refused
        Files that are no recordings, or cannot be read, with the reason.
    walking
        Section of the configuration.
    """

    source_files: dict[str, DraftedSource] = field(default_factory=dict)
    open: list[tuple[Path, str]] = field(default_factory=list)
    has_open_captures: bool = False
    refused: list[str] = field(default_factory=list)
    trials: list[DraftedTrial] = field(default_factory=list)
    walking: str = ""

    @property
    def sources(self) -> dict[str, str]:
        """Texts of the source files, by name."""
        return {name: source.text for name, source in self.source_files.items()}


@dataclass(frozen=True)
class Described:
    """A recording of a folder, and the source file that it shares with others like it."""

    file: Path  # relative to the folder
    overview: Overview
    source: str
    log: DraftedLog | None  # None for a capture
    recorder: str  # name of the shipped source file of its recorder; empty if unknown

    @property
    def tells(self) -> tuple[bool, int, int]:
        """How much it tells: whether a joint turns, whose spring has the torque's sign, and no
        fixture alone; channels; and those that may be signals, or whether its markers tell which
        axis points up."""
        is_joint = not is_fixture_alone(self.file)
        if self.log is None:
            return is_joint, len(self.overview.channels), int("axes" in self.overview.settings)
        moving = sum(not guess.why_not for guess in self.log.guesses)
        return is_joint, len(self.overview.channels), moving

    @property
    def key(self) -> str:
        """Its file as a sheet names it."""
        return self.file.as_posix()


def draft_campaign(folder: Path) -> Draft:
    """Say what the recordings below a folder are.

    Raises
    ------
    InputError
        There is no such folder, or no recording in it that can be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings; check the path")
    draft = Draft()
    described = describe_recordings(folder, draft)
    if not described:
        why = f" ({', '.join(sorted(suffixes()))})"
        if draft.refused:
            why = f", as {draft.refused[0]}"
        raise InputError(
            f"{folder}: no recording in it that can be read{why}; name the folder of the recordings"
        )
    captures = [one for one in described if one.log is None]
    logs = [one for one in described if one.log is not None]
    draft.source_files = draft_sources(described)
    draft.trials = trials_of(draft, logs, captures)
    join_log_of_session(draft, logs, captures)
    align_clocks(draft)
    ask(draft, described, captures)
    return draft


def describe_recordings(folder: Path, draft: Draft) -> list[Described]:
    """List what the recordings below a folder hold; those that cannot be read go into the draft.

    Files share a source file if one can describe them: format, clock, and the channels of a log.
    Captures of one laboratory have other markers in each trial, and may lack a pulse.
    """
    described: list[Described] = []
    names: dict[tuple[object, ...], str] = {}
    for path in recordings_in(folder):
        try:
            check_file(path)
            overview = inspect_recording(path)
        except InputError as error:
            # a note in a text file tells less than a recording that cannot be read
            is_text = all(known.priority >= TEXT_PRIORITY for known in formats_of(path))
            draft.refused.insert(len(draft.refused) if is_text else 0, str(error))
            continue
        most = max((channel.count for channel in overview.channels), default=0)
        if most < FEWEST_READINGS:
            why = f" ({'; '.join(overview.remarks)})" if overview.remarks else ""
            draft.refused.append(f"{path}: at most {most} rows of numbers, and no recording{why}")
            continue
        log = None
        recorder = ""
        layout: tuple[object, ...] = (overview.format, *pulse_channels(overview))
        if not is_capture(known_formats()[overview.format]):
            log = drafted_log(overview)
            recorder = known_recorder(overview)
            settings = {key: one for key, one in overview.settings.items() if key != "missing"}
            channels = [(*one.address.values(), one.unit) for one in overview.channels]
            layout = (overview.format, repr(settings), *channels)
        number = 1 + sum(one[0] == overview.format for one in names)
        own_name = overview.format if number == 1 else f"{overview.format}_{number}"
        source = names.setdefault(layout, recorder or own_name)
        described.append(Described(path.relative_to(folder), overview, source, log, recorder))
    return described


def known_recorder(overview: Overview) -> str:
    """The shipped source file of which a log has every channel, three or more; empty if there is
    none."""
    there = [set(channel.address.values()) for channel in overview.channels]
    best = ""
    most = FEWEST_CHANNELS - 1
    for path in sorted(shipped("config/sources").glob("*.yaml")):
        content = read_mapping(path)
        wanted = [
            {str(channel[key]) for key in CHANNEL_KEYS & channel.keys()}
            for channel in content.get("channels", {}).values()
        ]
        is_like = content["format"] == overview.format and all(one in there for one in wanted)
        if is_like and len(wanted) > most:
            best = path.stem
            most = len(wanted)
    return best


def draft_sources(described: Sequence[Described]) -> dict[str, DraftedSource]:
    """Draft a source file for each kind of recordings, by the one that tells most; that of a known
    recorder is the shipped one."""
    best: dict[str, Described] = {}
    for one in described:
        if one.source not in best or one.tells > best[one.source].tells:
            best[one.source] = one
    sources: dict[str, DraftedSource] = {}
    for name, one in best.items():
        sources[name] = drafted_source(one.overview, one.file.name, one.log)
        if one.recorder:
            own = shipped(f"config/sources/{one.recorder}.yaml")
            sources[name].known = own.read_text(encoding="utf-8")
    return sources


def trials_of(
    draft: Draft, logs: Sequence[Described], captures: Sequence[Described]
) -> list[DraftedTrial]:
    """Draft the trials, by the names of files, or else by what the source file of a log has: angle
    and torque of a joint, or current and torque of an actuator."""
    moved: dict[Path, str] = {}
    of_joints: dict[str, list[Described]] = {}
    for one in logs:
        assert one.log is not None
        source = draft.source_files[one.source]
        if source.has("theta", "torque"):
            angle = one.log.sure("theta")
            is_slow = angle is not None and one.log.clock and turns_slowly(angle, one.log.clock)
            moved[one.file] = "torque_angle" if is_slow else "impedance"
            of_joints.setdefault(one.source, []).append(one)
        elif source.has("torque_m", "current"):
            moved[one.file] = "actuator"
    files = [(one.file, one.source, False) for one in logs]
    files += [(one.file, one.source, True) for one in captures]
    trials = draft_trials(files, moved, has_fixed_plates(captures))
    for name, alike in of_joints.items():
        joints = joints_named([channel for one in alike for channel in one.overview.channels])
        for trial in trials:
            if len(joints) == 1 and trial.cells.get("log_source") == name:
                trial.cells["joint"] = joints[0]
    return trials


def has_fixed_plates(captures: Sequence[Described]) -> bool:
    """Whether captures have plates, but no platform's markers and no name of a perturbation."""
    if any(states_perturbation(one.file) for one in captures):
        return False
    channels = [channel for one in captures for channel in one.overview.channels]
    has_plates = any(channel.kind == "plate" for channel in channels)
    markers = [channel for channel in channels if channel.kind == "marker"]
    return has_plates and not any(segment_of(one.key)[1] == "platform" for one in markers)


def join_log_of_session(
    draft: Draft, logs: Sequence[Described], captures: Sequence[Described]
) -> None:
    """Give the log of a whole session to every capture of one who walks, where its sync line has a
    pulse as long as each of them."""
    alone = [trial for trial in draft.trials if "mocap" not in trial.cells]
    walks = {
        trial.cells["mocap"]: trial
        for trial in draft.trials
        if trial.cells["experiment"] == "walking" and "log" not in trial.cells
    }
    if len(alone) != 1 or len(walks) < 2:
        return
    session = next(one for one in logs if one.key == alone[0].cells["log"])
    assert session.log is not None
    lengths = gate_lengths(session.log)
    of_walks = [one for one in captures if one.key in walks]
    is_of_all = all(is_gated(capture.overview, lengths) for capture in of_walks)
    if len(lengths) < len(walks) or not is_of_all:
        return
    for trial in walks.values():
        trial.cells.update(log=session.key, log_source=session.source)
    draft.trials.remove(alone[0])
    side, _ = stepping_leg([capture.overview for capture in of_walks])
    for name, capture in {one.source: one for one in reversed(of_walks)}.items():
        join_session_log(draft.source_files[name], capture.overview, side)


def align_clocks(draft: Draft) -> None:
    """State `clock: sync` for logs with pulses beside captures with pulses, and `clock: common` for
    OpenSim's tables beside its markers."""
    for trial in draft.trials:
        if not trial.cells.keys() >= {"log_source", "mocap_source"}:
            continue
        log = draft.source_files[trial.cells["log_source"]]
        capture = draft.source_files[trial.cells["mocap_source"]]
        if log.has("sync") and capture.has("sync"):
            log.settings["clock"] = "sync"
        if (log.settings["format"], capture.settings["format"]) == ("opensim", "trc"):
            log.settings["clock"] = "common"


def ask(draft: Draft, described: Sequence[Described], captures: Sequence[Described]) -> None:
    """Draft the walking analysis, and gather what the user has to decide."""
    for one in described:
        draft.open += [(one.file, text) for text in one.overview.open]
        for guess in one.log.guesses if one.log is not None else ():
            if guess.formula and not guess.why_not:
                draft.open.append((one.file, f"{guess.column}: {guess.formula}"))
    draft.open += cut_files(described)
    may_walk = any(
        trial.cells["experiment"] == "walking"
        or (trial.cells["experiment"] == UNNAMED and "mocap" in trial.cells)
        for trial in draft.trials
    )
    section = draft_walking([one.overview for one in captures]) if may_walk else []
    draft.walking = "".join(f"{line}\n" for line in section)
    if may_walk and not section:
        draft.open += unknown_segments(captures)
    lacking_axes = [
        one.file
        for one in captures
        if one.overview.format == "trc" and "axes" not in draft.source_files[one.source].settings
    ]
    question = (
        "nothing tells which axis points up: state `axes` in the source file, [x, -z, y] where it"
        " is y, as in OpenSim"
    )
    draft.open += [(file, question) for file in lacking_axes]
    is_asked = any(capture.overview.open for capture in captures)
    draft.has_open_captures = is_asked or bool(lacking_axes)


def cut_files(described: Sequence[Described]) -> Iterator[tuple[Path, str]]:
    """Ask of files that do not tell their end and are shorter than others like them, whether it was
    cut off."""
    rows: dict[str, dict[Path, int]] = {}
    for one in described:
        if "end" in one.overview.facts:  # as of a text, half of which looks whole
            count = max(channel.count for channel in one.overview.channels)
            rows.setdefault(one.source, {})[one.file] = count
    for counts in rows.values():
        is_unusual, usual = unusual(np.array([*counts.values()]))
        for file in compress(counts, is_unusual):
            if counts[file] < usual:
                yield (
                    file,
                    f"{counts[file]} rows, {usual:.0f} in most like it: was its end cut off?",
                )


def unknown_segments(captures: Sequence[Described]) -> Iterator[tuple[Path, str]]:
    """Ask which markers are those of a walking analysis, where there are plates."""
    channels = [channel for one in captures for channel in one.overview.channels]
    if not any(channel.kind == "plate" for channel in channels):
        return
    labels = sorted({channel.key for channel in channels if channel.kind == "marker"})
    for one in captures:
        yield (
            one.file,
            "force plates and markers whose names tell no segment: a walking analysis needs"
            " `walking.markers` in config.yaml (docs/walking.md#the-configuration), of"
            f" {listing(labels, 40)}",
        )
