"""A draft of a campaign from a folder of recordings: a source file for each kind of them, a sample
sheet, the section `walking` of the configuration, and what the user has to decide."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

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
from osl_analysis.draft.draft_walking import draft_walking, segment_of
from osl_analysis.draft.guesses import joints_named, turns_slowly
from osl_analysis.draft.overview import FEWEST_READINGS, inspect_recording
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.errors import InputError, listing
from osl_analysis.files import shipped
from osl_analysis.formats import TEXT_PRIORITY, formats_of, known_formats
from osl_analysis.ingest.raw_files import check_file, is_capture, recordings_in, suffixes
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
        if self.log is None:
            details = int("axes" in self.overview.settings)
        else:
            details = sum(not guess.why_not for guess in self.log.guesses)
        return not is_fixture_alone(self.file), len(self.overview.channels), details


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
    draft.source_files = draft_sources(described)
    draft.trials = trials_of(draft, described)
    align_clocks(draft)
    ask(draft, described)
    return draft


def describe_recordings(folder: Path, draft: Draft) -> list[Described]:
    """List what the recordings below a folder hold; those that cannot be read go into the draft.

    Files share a source file if one can describe them: format, clock, and the channels of a log.
    Captures of one laboratory have other markers in each trial, and may lack a pulse.
    """
    described: list[Described] = []
    names: dict[tuple[object, ...], str] = {}
    sources_of = Counter[str]()  # by format
    for path in recordings_in(folder):
        try:
            check_file(path)
            overview, log = looked_at(path)
        except InputError as error:
            # a note in a text file tells less than a recording that cannot be read
            is_text = all(known.priority >= TEXT_PRIORITY for known in formats_of(path))
            draft.refused.insert(len(draft.refused) if is_text else 0, str(error))
            continue
        recorder = ""
        layout: tuple[object, ...] = (overview.format, *pulse_channels(overview))
        if log is not None:
            recorder = known_recorder(overview)
            settings = {**overview.settings, "missing": None}
            channels = [(*channel.address.values(), channel.unit) for channel in overview.channels]
            layout = (overview.format, repr(settings), *channels)
        if layout not in names:
            sources_of[overview.format] += 1
            number = sources_of[overview.format]
            usual_name = overview.format if number == 1 else f"{overview.format}_{number}"
            names[layout] = recorder or usual_name
        file = path.relative_to(folder)
        described.append(Described(file, overview, names[layout], log, recorder))
    return described


def looked_at(path: Path) -> tuple[Overview, DraftedLog | None]:
    """What a file holds, and what the channels of a log may be.

    Raises
    ------
    InputError
        It cannot be read, or is no recording.
    """
    overview = inspect_recording(path)
    most = max((channel.count for channel in overview.channels), default=0)
    if most < FEWEST_READINGS:
        why = f" ({'; '.join(overview.remarks)})" if overview.remarks else ""
        raise InputError(f"{path}: at most {most} rows of numbers, and no recording{why}")
    if is_capture(known_formats()[overview.format]):
        return overview, None
    log = drafted_log(overview)
    if not log.guesses:
        raise InputError(f"{path}: no signal in it can be read; `osl-analysis inspect` lists it")
    return overview, log


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
        is_like = content["format"] == overview.format and all(
            address in there for address in wanted
        )
        if is_like and len(wanted) > most:
            best = path.stem
            most = len(wanted)
    return best


def draft_sources(described: Sequence[Described]) -> dict[str, DraftedSource]:
    """Draft a source file for each kind of recordings, by the one that tells most; that of a known
    recorder is the shipped one."""
    sources: dict[str, DraftedSource] = {}
    for name in dict.fromkeys(recording.source for recording in described):
        alike = [recording for recording in described if recording.source == name]
        best = max(alike, key=lambda recording: recording.tells)
        source = drafted_source(best.overview, best.file.name, best.log)
        if best.recorder:
            path = shipped(f"config/sources/{best.recorder}.yaml")
            source.known = path.read_text(encoding="utf-8")
        sources[name] = source
    return sources


def trials_of(draft: Draft, described: Sequence[Described]) -> list[DraftedTrial]:
    """Draft the trials, by the names of files, or else by what the source file of a log has: angle
    and torque of a joint, or current and torque of an actuator."""
    moved: dict[Path, str] = {}
    of_joints: dict[str, list[RecordedChannel]] = {}
    for recording in described:
        log = recording.log
        source = draft.source_files[recording.source]
        if log is None:
            continue
        if source.has("theta", "torque"):
            angle = log.sure("theta")
            is_slow = angle is not None and log.clock and turns_slowly(angle, log.clock)
            moved[recording.file] = "torque_angle" if is_slow else "impedance"
            of_joints.setdefault(recording.source, []).extend(recording.overview.channels)
        elif source.has("torque_m", "current"):
            moved[recording.file] = "actuator"
    files = [(recording.file, recording.source, recording.log is None) for recording in described]
    trials = draft_trials(files, moved, has_fixed_plates(described))
    for trial in trials:
        joints = joints_named(of_joints.get(trial.cells.get("log_source", ""), []))
        if len(joints) == 1:
            trial.cells["joint"] = joints[0]
    return trials


def has_fixed_plates(described: Sequence[Described]) -> bool:
    """Whether captures have plates, but no platform's markers and no name of a perturbation."""
    captures = [recording for recording in described if recording.log is None]
    if any(states_perturbation(capture.file) for capture in captures):
        return False
    channels = [channel for capture in captures for channel in capture.overview.channels]
    has_plates = any(channel.kind == "plate" for channel in channels)
    markers = [channel.key for channel in channels if channel.kind == "marker"]
    return has_plates and all(segment_of(label)[1] != "platform" for label in markers)


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


def ask(draft: Draft, described: Sequence[Described]) -> None:
    """Draft the walking analysis, and gather what the user has to decide."""
    captures = [recording for recording in described if recording.log is None]
    for recording in described:
        questions = [*recording.overview.open]
        if recording.log is not None:
            questions += [
                f"{guess.column}: {guess.formula}"
                for guess in recording.log.guesses
                if guess.formula and not guess.why_not
            ]
        source = draft.source_files[recording.source]
        if recording.overview.format == "trc" and "axes" not in source.settings:
            questions.append(
                "nothing tells which axis points up: state `axes` in the source file, [x, -z, y]"
                " where it is y, as in OpenSim"
            )
        draft.open += [(recording.file, question) for question in questions]
        draft.has_open_captures |= recording.log is None and bool(questions)
    alone = [trial for trial in draft.trials if "mocap" not in trial.cells]
    walks = [trial for trial in draft.trials if trial.cells["experiment"] == "walking"]
    if len(alone) == 1 and len(walks) > 1 and not any("log" in trial.cells for trial in walks):
        question = (
            "is this the log of the whole session? Write it in the row of each capture, with"
            " `shared` in their source file (docs/own_data.md#source-files)"
        )
        draft.open.append((Path(alone[0].cells["log"]), question))
    unnamed = [trial for trial in draft.trials if trial.cells["experiment"] == UNNAMED]
    if walks or any("mocap" in trial.cells for trial in unnamed):
        draft.walking = draft_walking([capture.overview for capture in captures])
        if not draft.walking:
            draft.open += unknown_segments(captures)


def unknown_segments(captures: Sequence[Described]) -> Iterator[tuple[Path, str]]:
    """Ask which markers are those of a walking analysis, where there are plates."""
    channels = [channel for capture in captures for channel in capture.overview.channels]
    if not any(channel.kind == "plate" for channel in channels):
        return
    labels = sorted({channel.key for channel in channels if channel.kind == "marker"})
    for capture in captures:
        yield (
            capture.file,
            "force plates and markers whose names tell no segment: a walking analysis needs"
            " `walking.markers` in config.yaml (docs/walking.md#the-configuration), of"
            f" {listing(labels, 40)}",
        )
