# SPDX-License-Identifier: Apache-2.0
"""Draft a campaign from a folder of recordings.

The draft has a source file for each kind of recording, a sample sheet, the section `walking` of the
configuration, and the questions that the user has to answer.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import chain, product
from pathlib import Path

import numpy as np

from osl_analysis.base.errors import InputError, listing
from osl_analysis.config.sheet import SOURCES
from osl_analysis.draft.draft_sheet import (
    UNNAMED,
    DraftedTrial,
    draft_trials,
    is_fixture_alone,
    stem_of,
)
from osl_analysis.draft.draft_source import (
    DraftedSource,
    drafted_source,
    guesses_of,
    pulse_channels,
)
from osl_analysis.draft.draft_walking import draft_walking
from osl_analysis.draft.likelihood import Guess, correlation, joints_named, turns_slowly
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.formats.binary_table import FEWEST_OF_SIGNAL
from osl_analysis.ingest.raw_files import check_file, recordings_in

PARTS = {"theta", "torque"}  # of which each log of a pair has one
MOST_OTHER_WORDS = 2  # words of which one of two names has each
NAME_BOTH = "name both files of a trial as `log` and `log_2`"
ONE_FILE_MISSING = (
    f"the file with the other of angle and torque is missing: copy it, or {NAME_BOTH}"
)
SEVERAL = f"one of several files may be the other one of these: {NAME_BOTH}"
LEAST_COMMON = 0.3  # correlation of a torque with angle and velocity of its trial; of others 0.1


@dataclass
class Described:
    """A recording of a folder, and the source file that it shares with others like it."""

    file: Path  # relative to the folder
    overview: Overview
    guesses: Sequence[Guess]
    source: str

    @property
    def tells(self) -> tuple[bool, int, bool, int]:
        """How much it tells: whether a joint turns, and no fixture alone; channels; the sign of a
        torque; and channels that may be signals, or whether its markers tell which axis points
        up."""
        details = sum(not guess.why_not for guess in self.guesses)
        details += "axes" in self.overview.settings
        turns = not is_fixture_alone(self.file)
        has_sign = any(guess.sign for guess in self.guesses)
        return turns, len(self.overview.channels), has_sign, details

    @property
    def likely(self) -> dict[str, RecordedChannel]:
        """Its channels by the columns that they are taken for."""
        return {guess.column: guess.channel for guess in self.guesses}


def pair_logs(recordings: Sequence[Described]) -> tuple[dict[Path, Path], list[tuple[str, str]]]:
    """Pair logs by name and by what they hold; the channels of a pair are guessed from both.

    Returns
    -------
    first_of
        File with the angle, by that with the torque: words of their names and folders are the same
        but for one, which is no number.
    questions
        Why others are not paired, and which files.
    """
    logs = {
        recording.file: recording for recording in recordings if not recording.overview.is_capture
    }
    angles = {file for file, log in logs.items() if {*log.likely} & PARTS == {"theta"}}
    torques = {file for file, log in logs.items() if {*log.likely} & PARTS == {"torque"}}
    alike = names_alike(angles, torques)
    uses = Counter(chain.from_iterable(alike))
    first_of = {}
    questions = [
        (ONE_FILE_MISSING, str(file)) for file in sorted(angles | torques) if not uses[file]
    ]
    several = [str(file) for file in sorted(uses) if uses[file] > 1]
    if several:
        questions.append((SEVERAL, listing(several)))
    for angle, torque in alike:
        if uses[angle] > 1 or uses[torque] > 1:
            continue
        why = why_no_pair(logs[angle].likely, logs[torque].likely)
        if why:
            questions.append((f"{why}: {NAME_BOTH}", f"{angle} and {torque}"))
            continue
        first_of[torque] = angle
        guesses = guesses_of(logs[angle].overview, logs[torque].overview)
        count = len(logs[angle].guesses)
        logs[angle].guesses = guesses[:count]
        logs[torque].guesses = guesses[count:]
    return first_of, questions if angles and torques else []


def names_alike(angles: Set[Path], torques: Set[Path]) -> list[tuple[Path, Path]]:
    """Pairs of files whose words, of name and folders, are the same but for `MOST_OTHER_WORDS`,
    none of which has a digit."""
    words = {
        file: {*re.split(r"[\W_]+", f"{file.parent}/{stem_of(file)}")} for file in angles | torques
    }
    pairs = []
    for angle, torque in product(sorted(angles), sorted(torques)):
        differing = words[angle] ^ words[torque]
        if len(differing) <= MOST_OTHER_WORDS and not re.search(r"\d", " ".join(differing)):
            pairs.append((angle, torque))
    return pairs


def why_no_pair(
    angles: Mapping[str, RecordedChannel], torques: Mapping[str, RecordedChannel]
) -> str:
    """Why two logs, by likely columns, are of different trials; empty if they may be of one."""
    theta, torque = angles["theta"], torques["torque"]
    has_clocks = theta.times is not None and torque.times is not None
    if angles.keys() & torques.keys() - {""} or not has_clocks:
        return ""  # what both recorded aligns them
    follows = correlation(theta, torque), correlation(theta, torque, with_speed=True)
    if np.hypot(*follows) < LEAST_COMMON:
        return "the torque does not follow the angle, if both begin at one instant"
    return ""


ASK_CLOCK = (
    "`clock: start` in sources/{source}.yaml: both files of a trial are taken to begin at one"
    " instant; check it, or write sync or common (docs/own_data.md)"
)


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide.

    Attributes
    ----------
    sources
        Drafts of source files, by name.
    open
        Question and file, as which of two clocks counts.
    refused
        Files that are no recordings, or cannot be read, with the reason.
    walking
        Section of the configuration.
    """

    source_files: dict[str, DraftedSource] = field(default_factory=dict)
    open: list[tuple[str, str]] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    trials: list[DraftedTrial] = field(default_factory=list)
    walking: str = ""


def draft_campaign(folder: Path) -> Draft:
    """Say what the recordings below a folder are.

    Raises
    ------
    InputError
        There is no such folder, or no recording in it that can be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings", "check the path")
    draft = Draft()
    described = describe_recordings(folder, draft)
    first_of, unpaired = pair_logs(described)
    draft.open += unpaired
    if not described:
        reason = f"{folder}: no recording in it that can be read"
        if draft.refused:
            raise InputError(f"{reason}, as {draft.refused[-1]}", "then the same command again")
        raise InputError(reason, "name the folder of the recordings")
    for name in dict.fromkeys(recording.source for recording in described):
        alike = [recording for recording in described if recording.source == name]
        best = max(alike, key=lambda recording: recording.tells)
        source = drafted_source(best.overview, best.file.name, best.guesses)
        draft.source_files[name] = source
        draft.open += [(question, f"sources/{name}.yaml") for question in source.computed]
    draft.trials = trials_of(draft, described, first_of)
    align_clocks(draft)
    captures = [recording.overview for recording in described if recording.overview.is_capture]
    experiments = {trial.cells["experiment"] for trial in draft.trials if "mocap" in trial.cells}
    if experiments & {"walking", UNNAMED}:
        draft.walking, questions = draft_walking(captures, "walking" in experiments)
        draft.open += [(question, "config.yaml") for question in questions]
    for recording in described:
        draft.open += [(question, str(recording.file)) for question in recording.overview.open]
    return draft


def describe_recordings(folder: Path, draft: Draft) -> list[Described]:
    """List what the recordings below a folder hold; those that cannot be read go into the draft.

    Files share a source file if one can describe them: format, clock, and the channels of a log.
    Captures of one laboratory have other markers in each trial, and may lack a pulse.
    """
    described = []
    names: dict[tuple[object, ...], str] = {}
    for path in recordings_in(folder):
        try:
            check_file(path)
            overview = overview_of_recording(path)
        except InputError as error:
            draft.refused.append(str(error))
            continue
        channels = [(*channel.address.values(), channel.unit) for channel in overview.channels]
        layout = (overview.format, repr(overview.settings), *channels)
        if overview.is_capture:
            layout = (overview.format, *pulse_channels(overview))
        if layout not in names:
            number = 1 + sum(known[0] == overview.format for known in names)
            names[layout] = overview.format if number == 1 else f"{overview.format}_{number}"
        file = path.relative_to(folder)
        described.append(Described(file, overview, guesses_of(overview), names[layout]))
    return described


def overview_of_recording(path: Path) -> Overview:
    """What a file holds.

    Raises
    ------
    InputError
        It cannot be read, or is no recording.
    """
    overview = inspect_recording(path)
    signals = overview.channels if overview.is_capture else overview.drafted
    if max((channel.count for channel in signals), default=0) < FEWEST_OF_SIGNAL:
        raise InputError(
            f"{path}: no signal of {FEWEST_OF_SIGNAL} numbers or more in it",
            "`osl-analysis inspect` lists what it holds",
        )
    return overview


def trials_of(
    draft: Draft, described: Sequence[Described], first_of: Mapping[Path, Path]
) -> list[DraftedTrial]:
    """Draft the trials, by the names of files, or else by what the source files of its logs have:
    angle and torque of a joint, or current and torque of an actuator. `first_of` are the first logs
    of trials, by the second."""
    columns_of: dict[Path, set[str]] = {}
    for recording in described:
        log = first_of.get(recording.file, recording.file)
        columns_of.setdefault(log, set()).update(draft.source_files[recording.source].named)
    moved = {}
    joints: dict[str, list[str]] = {}  # by file
    for recording in described:
        columns = columns_of.get(recording.file, set())
        if {"theta", "torque"} <= columns:
            is_slow = turns_slowly(recording.guesses, recording.overview.clock)
            moved[recording.file] = "torque_angle" if is_slow else "impedance"
            joints[str(recording.file)] = joints_named(recording.overview.channels)
        elif {"torque_m", "current"} <= columns:
            moved[recording.file] = "actuator"
    files = [
        (recording.file, recording.source, recording.overview.is_capture) for recording in described
    ]
    trials = draft_trials(files, moved, first_of)
    for trial in trials:
        named = joints.get(trial.cells.get("log", ""), [])
        if len(named) == 1:
            trial.cells["joint"] = named[0]
    return trials


def align_clocks(draft: Draft) -> None:
    """State `clock: start` for the second logs of trials, and ask whether it is so; `clock: sync`
    for logs with pulses beside others or captures with pulses, and `clock: common` for
    OpenSim's tables beside its markers."""
    for trial in draft.trials:
        sources = [draft.source_files[trial.cells[name]] for name in SOURCES if name in trial.cells]
        if len(sources) == 1:
            continue
        log, second = sources
        is_second = "log_2" in trial.cells
        aligned = second if is_second else log
        if all("sync" in source.named for source in sources):
            aligned.settings["clock"] = "sync"
        elif is_second:
            aligned.settings["clock"] = "start"
            question = ASK_CLOCK.format(source=trial.cells["log_2_source"])
            draft.open.append((question, trial.cells["trial"]))
        if (log.settings["format"], second.settings["format"]) == ("opensim", "trc"):
            log.settings["clock"] = "common"
