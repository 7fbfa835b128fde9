"""`osl-analysis init`: the folder of a new campaign, drafted from recordings if there are any, and
what the user has to decide before it runs."""

import csv
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
import yaml

from osl_analysis.commands.trials import inspect_file
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.files import CAMPAIGN, seen_from, shipped
from osl_analysis.formats import TEXT_PRIORITY, formats_of, known_formats
from osl_analysis.ingest import raw_files
from osl_analysis.ingest.draft import (
    DraftedLog,
    draft_source,
    drafted_log,
    guessed_lines,
    pulse_channels,
    to_be_edited,
)
from osl_analysis.ingest.draft_session import (
    gate_lengths,
    is_gated,
    with_angle_unit,
    with_session_log,
)
from osl_analysis.ingest.draft_sheet import (
    UNNAMED,
    DraftedTrial,
    draft_trials,
    is_fixture_alone,
    states_perturbation,
)
from osl_analysis.ingest.draft_walking import draft_walking, segment_of, stepping_leg
from osl_analysis.ingest.likely_column import named_joint
from osl_analysis.ingest.overview import FEWEST_READINGS, Overview
from osl_analysis.ingest.placeholders import UNKNOWN
from osl_analysis.measured import unusual
from osl_analysis.yaml_settings import read_mapping

COLUMNS = (
    *("trial", "experiment", "controller", "K_d", "B_d", "perturbed"),
    *("log", "log_source", "mocap", "mocap_source", "exclude"),
)
SELDOM = ("joint", "fixture")  # columns of a drafted sheet only where a trial has them
CHANNEL_KEYS = {"topic", "field", "column", "variable"}  # that name a channel of a log
FEWEST_CHANNELS = 3  # of a shipped source file, by which its recorder is known
MOST_SHOWN = 4  # files or trials of one kind in the text of `init`
MOST_REFUSED = 3  # files that were not read, in the text of `init`
MOST_QUESTIONS = 4  # in the text of `init`; the files have all of them
MOST_OF_SOURCES = 4  # lines on source files in the text of `init`


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide.

    Attributes
    ----------
    sources
        Texts of the source files, by name.
    open
        File and question, as which of two clocks counts.
    has_open_captures
        Whether a capture asks something, as where its plate lies: its trials may be refused.
    refused
        Files that are no recordings, or cannot be read, with the reason.
    walking
        Section of the configuration.
    """

    sources: dict[str, str] = field(default_factory=dict)
    open: list[tuple[Path, str]] = field(default_factory=list)
    has_open_captures: bool = False
    refused: list[str] = field(default_factory=list)
    trials: list[DraftedTrial] = field(default_factory=list)
    walking: str = ""


@dataclass
class Described:
    """A recording of a folder, and the source file that it shares with others like it."""

    file: Path  # relative to the folder
    overview: Overview
    source: str
    log: DraftedLog | None  # None for a capture

    @property
    def tells(self) -> tuple[bool, int, int]:
        """How much it tells: whether a joint turns, whose spring has the torque's sign, and no
        fixture alone; channels; and those that may be signals, or whether its markers tell which
        axis points up."""
        is_joint = not is_fixture_alone(self.file)
        if self.log is None:
            return is_joint, len(self.overview.channels), int("axes" in self.overview.settings)
        moving = sum(not guess.is_no_signal for guess in self.log.guesses)
        return is_joint, len(self.overview.channels), moving


Example = Literal["bench", "walking"]
RECORDERS: Mapping[Example, Sequence[str]] = {
    "bench": ("dynamometer", "dynamometer_nodes"),
    "walking": ("leg", "vicon"),
}
"""Source files of what the simulator records, by example."""


def new_campaign(
    folder: Path,
    recorders: Sequence[str] = (),
    recordings: Path | None = None,
    example: Example | None = None,
) -> Draft:
    """Make a folder with a campaign, and say what was drafted.

    Parameters
    ----------
    folder
        New or empty. It is whole or not there.
    recorders
        Names of shipped source files to begin from.
    recordings
        A folder of recordings, for which sheet and source files are drafted. They stay there.
    example
        A small simulated campaign instead, of the bench or of a walkway.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        what = "exists and is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: {what}; name a new folder, nothing is overwritten")
    draft = Draft() if recordings is None else draft_campaign(recordings)
    known = sorted(path.stem for path in shipped("config/sources").glob("*.yaml"))
    for name in recorders:
        if name not in known:
            raise InputError(
                f"no source file for a recorder '{name}'; there are"
                f" {', '.join(known)}{nearest(name, known)}"
            )
    names = RECORDERS[example] if example else recorders
    texts = {
        name: shipped(f"config/sources/{name}.yaml").read_text(encoding="utf-8") for name in names
    }
    raw_data = Path("recordings")
    if recordings is not None:
        raw_data = seen_from(folder, recordings)
    name = folder.resolve().name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder, prefix=".campaign.") as place:
            made = Path(place) / "campaign"
            sources = {**draft.sources, **texts}
            write_campaign(made, name, raw_data, sources, example or draft)
            # the configuration comes last: a folder without it is no campaign
            for part in sorted(made.iterdir(), key=lambda path: path.name == CAMPAIGN.name):
                part.rename(folder / part.name)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made ({error.strerror}); choose another place"
        ) from error
    return draft


def write_campaign(
    folder: Path, name: str, raw_data: Path, sources: Mapping[str, str], content: Draft | Example
) -> None:
    """Write the files of a campaign.

    Parameters
    ----------
    content
        What was drafted, or the name of an example.
    sources
        Texts of source files by name.
    """
    (folder / "sources").mkdir(parents=True)
    allowed = re.sub(r"[^A-Za-z0-9_-]", "_", name).strip("_") or "campaign"
    path = raw_data.as_posix()
    if re.search(r"[^\w/.-]", path):
        path = "'" + path.replace("'", "''") + "'"  # a text in YAML's quotes
    kind = "config" if isinstance(content, Draft) else f"example_{content}"
    template = shipped(f"config/new_campaign/{kind}.yaml").read_text(encoding="utf-8")
    config = template.format(name=allowed, raw_data=path)
    if isinstance(content, Draft):
        config += content.walking
    (folder / "config.yaml").write_text(config, encoding="utf-8")
    # it knows the settings of all commands
    from osl_analysis.commands.reference import write_schemas

    write_schemas(folder / "schemas")
    if not raw_data.is_absolute() and ".." not in raw_data.parts:
        (folder / raw_data).mkdir(parents=True)
    for source, described in sources.items():
        text = f"# yaml-language-server: $schema=../schemas/source.schema.json\n{described}"
        (folder / f"sources/{source}.yaml").write_text(text, encoding="utf-8")
    if not isinstance(content, Draft):
        simulation = shipped(f"config/new_campaign/simulation_{content}.yaml")
        shutil.copy(simulation, folder / "simulation.yaml")
        return
    told = {column for trial in content.trials for column in trial.cells}
    columns = [*COLUMNS, *(column for column in SELDOM if column in told)]
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(trial.cells for trial in content.trials)


def draft_campaign(folder: Path) -> Draft:
    """Say what the recordings below a folder are: source files for each kind of them, and a
    sheet."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings; check the path")
    draft = Draft()
    described = describe_recordings(folder, draft)
    if not described:
        why = f" ({', '.join(sorted(raw_files.suffixes()))})"
        if draft.refused:
            why = f", as {draft.refused[0]}"
        raise InputError(
            f"{folder}: no recording in it that can be read{why}; name the folder of the recordings"
        )
    for one in described:
        draft.open += [(one.file, text) for text in one.overview.open]
        if one.log is not None:
            computed = [guess for guess in one.log.guesses if guess.formula]
            draft.open += [(one.file, f"{guess.column}: {guess.formula}") for guess in computed]
    draft.open += cut_files(described)
    draft.sources = draft_sources(described)
    draft.trials = trials_of(described, draft.sources)
    join_session_log(draft, described)
    align_by_pulses(draft.sources, draft.trials)
    state_units_of_angles(draft, described)
    captures = [one for one in described if one.log is None]
    may_walk = any(
        trial.cells["experiment"] == "walking"
        or (trial.cells["experiment"] == UNNAMED and "mocap" in trial.cells)
        for trial in draft.trials
    )
    section = draft_walking([one.overview for one in captures]) if may_walk else []
    if section:
        draft.walking = "\n".join([*section, ""])
    elif may_walk:
        draft.open += unknown_segments(captures)
    axes_questions = list(unknown_axes(captures, draft.sources))
    draft.open += axes_questions
    is_asked = any(capture.overview.open for capture in captures)
    draft.has_open_captures = is_asked or bool(axes_questions)
    return draft


def describe_recordings(folder: Path, draft: Draft) -> list[Described]:
    """List what the recordings below a folder hold; those that cannot be read go into the draft.

    Files share a source file if one can describe them: format, clock, and the channels of a log.
    Captures of one laboratory have other markers in each trial, and may lack a pulse.
    """
    described: list[Described] = []
    names: dict[tuple[object, ...], str] = {}
    for path in raw_files.recordings_in(folder):
        try:
            overview = inspect_file(path)
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
        if not raw_files.is_capture(known_formats()[overview.format]):
            log = drafted_log(overview)
            recorder = known_recorder(overview)
            settings = {key: one for key, one in overview.settings.items() if key != "missing"}
            channels = [(*one.address.values(), one.unit) for one in overview.channels]
            layout = (overview.format, repr(settings), *channels)
        number = 1 + sum(one[0] == overview.format for one in names)
        own_name = overview.format if number == 1 else f"{overview.format}_{number}"
        source = names.setdefault(layout, recorder or own_name)
        described.append(Described(path.relative_to(folder), overview, source, log))
    return described


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


def trials_of(described: Sequence[Described], sources: Mapping[str, str]) -> list[DraftedTrial]:
    """Draft the trials, by the names of files, or else by what the source file of a log has: angle
    and torque of a joint, or current and torque of an actuator.

    Parameters
    ----------
    sources
        Texts of source files by name.
    """
    joints = {name for name, text in sources.items() if has_columns(text, "theta", "torque")}
    actuators = {name for name, text in sources.items() if has_columns(text, "torque_m", "current")}
    moved: dict[Path, str] = {}
    for one in described:
        if one.log is not None and one.source in joints:
            moved[one.file] = "torque_angle" if one.log.is_slow else "impedance"
        elif one.log is not None and one.source in actuators:
            moved[one.file] = "actuator"
    files = [(one.file, one.source, one.log is None) for one in described]
    trials = draft_trials(files, moved, has_fixed_plates(described))
    named: dict[str, set[str]] = {}
    for one in described:
        if one.source in joints:
            named.setdefault(one.source, set()).update(named_joint(one.overview.channels))
    for trial in trials:
        joint = named.get(trial.cells.get("log_source", ""), set())
        if len(joint) == 1:
            trial.cells["joint"] = next(iter(joint))
    return trials


def has_fixed_plates(described: Sequence[Described]) -> bool:
    """Whether captures have plates, but no platform's markers and no name of a perturbation."""
    captures = [one for one in described if one.log is None]
    if any(states_perturbation(one.file) for one in captures):
        return False
    channels = [channel for one in captures for channel in one.overview.channels]
    has_plates = any(channel.kind == "plate" for channel in channels)
    markers = [channel for channel in channels if channel.kind == "marker"]
    return has_plates and not any(segment_of(one.key)[1] == "platform" for one in markers)


def has_columns(source: str, *columns: str) -> bool:
    """Whether the text of a source file names channels for all columns."""
    return all(f"\n  {column}: {{" in source for column in columns)


def draft_sources(described: Sequence[Described]) -> dict[str, str]:
    """Draft a source file for each kind of recordings, by the one that tells most."""
    best: dict[str, Described] = {}
    for one in described:
        if one.source not in best or one.tells > best[one.source].tells:
            best[one.source] = one
    texts: dict[str, str] = {}
    for name, one in best.items():
        text = draft_source(one.overview, one.file.name, has_walking=False, log=one.log)
        own = shipped(f"config/sources/{name}.yaml")
        texts[name] = with_known(own.read_text(encoding="utf-8"), text) if own.is_file() else text
    return texts


def join_session_log(draft: Draft, described: Sequence[Described]) -> None:
    """Give the log of a whole session to every capture of one who walks, where its sync line has a
    pulse as long as each of them."""
    logs = {one.file.as_posix(): one for one in described if one.log is not None}
    captures = {one.file.as_posix(): one for one in described if one.log is None}
    alone = [trial for trial in draft.trials if "mocap" not in trial.cells]
    walks = [
        trial
        for trial in draft.trials
        if trial.cells["experiment"] == "walking" and "log" not in trial.cells
    ]
    if len(alone) != 1 or len(walks) < 2 or alone[0].cells["log"] not in logs:
        return
    session = logs[alone[0].cells["log"]]
    assert session.log is not None
    lengths = gate_lengths(session.log)
    of_walks = [captures[trial.cells["mocap"]] for trial in walks]
    is_of_all = all(is_gated(capture.overview, lengths) for capture in of_walks)
    if len(lengths) < len(walks) or not is_of_all:
        return
    for trial in walks:
        trial.cells.update(log=alone[0].cells["log"], log_source=session.source)
    draft.trials.remove(alone[0])
    side = stepping_leg([capture.overview for capture in of_walks]).side
    for name in {capture.source for capture in of_walks}:
        capture = next(one for one in of_walks if one.source == name)
        draft.sources[name] = with_session_log(draft.sources[name], capture.overview, side)


def align_by_pulses(sources: dict[str, str], trials: Sequence[DraftedTrial]) -> None:
    """State `clock: sync` in the source files of logs with pulses beside captures with pulses, and
    `clock: common` in those of OpenSim's tables beside its markers."""
    for name, text in sources.items():
        captures = {
            trial.cells.get("mocap_source", "")
            for trial in trials
            if trial.cells.get("log_source") == name
        }
        have_pulses = [has_columns(sources.get(capture, ""), "sync") for capture in captures]
        if has_columns(text, "sync") and any(have_pulses):
            sources[name] = text.replace('\nclock: "master"\n', '\nclock: "sync"\n')
        of_markers = any(sources.get(one, "").startswith("format: trc\n") for one in captures)
        if text.startswith("format: opensim\n") and of_markers:
            sources[name] = text.replace('\nclock: "master"\n', '\nclock: "common"\n')


def state_units_of_angles(draft: Draft, described: Sequence[Described]) -> None:
    """State the unit of the angle of logs beside captures, where the markers tell it."""
    by_file = {one.file.as_posix(): one for one in described}
    captures = [one.overview for one in described if one.log is None]
    for trial in draft.trials:
        if trial.cells["experiment"] != "walking" or "log" not in trial.cells:
            continue
        log = by_file.get(trial.cells["log"])
        capture = by_file.get(trial.cells.get("mocap", ""))
        if log is None or log.log is None or capture is None:
            continue
        text = draft.sources[log.source]
        if f'unit: "{UNKNOWN}"' in text:
            side = stepping_leg(captures).side
            draft.sources[log.source] = with_angle_unit(text, log.log, capture.overview, side)


def with_known(known: str, drafted: str) -> str:
    """The shipped source file of a recorder, with what else it has recorded.

    The section of the recorded signals is the last one of a shipped file, or stands there as a
    comment only.
    """
    section = "analogs" if re.search("^analogs:$", drafted, re.MULTILINE) else "channels"
    further = [
        line
        for line, column in re.findall(r"^(  ([a-z]\w*): .*\n)", drafted, re.MULTILINE)
        if f"\n  {column}: " not in known
    ]
    if further and not re.search(f"^{section}:$", known, re.MULTILINE):
        further.insert(0, f"{section}:\n")
    return "".join([known, *further])


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


def unknown_axes(
    captures: Sequence[Described], sources: Mapping[str, str]
) -> Iterator[tuple[Path, str]]:
    """Ask which axis of a TRC points up: the file does not say, and no plate lies beside it."""
    for capture in captures:
        if capture.overview.format == "trc" and "\naxes: " not in sources[capture.source]:
            yield (
                capture.file,
                "nothing tells which axis points up: state `axes` in the source file, [x, -z, y]"
                " where it is y, as in OpenSim",
            )


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


def left_to_decide(folder: Path, draft: Draft) -> list[str]:
    """What a user has to decide before the campaign runs, a line each."""
    lines = [*places_to_edit(folder, draft), *unaligned_clocks(folder, draft)]
    asked: dict[str, list[str]] = {}
    for file, text in draft.open:
        asked.setdefault(text, []).append(str(file))
    for trial in draft.trials:
        for text in trial.questions:
            question = f"{folder / 'trials.csv'}: {text}"
            asked.setdefault(question, []).append(trial.cells["trial"])
    return lines + [f"{text} ({listing(which, MOST_SHOWN)})" for text, which in asked.items()]


def places_to_edit(folder: Path, draft: Draft) -> Iterator[str]:
    """The places of each file that are to be edited."""
    edits = {folder / CAMPAIGN: re.findall(rf"(\w+): [^#\n]*{UNKNOWN}", draft.walking)}
    for name in draft.sources:
        path = folder / f"sources/{name}.yaml"
        edits[path] = to_be_edited(path)
    for path, places in edits.items():
        if places:
            are = "place is" if len(places) == 1 else "places are"
            yield f"{path}: {len(places)} {are} to be edited: {', '.join(places[:6])}"


def is_complete(folder: Path, draft: Draft) -> bool:
    """Whether no place of a draft is to be edited, no capture asks anything, its clocks are
    aligned, and some trial is analysed."""
    to_do = [*places_to_edit(folder, draft), *unaligned_clocks(folder, draft)]
    if UNKNOWN in draft.walking or draft.has_open_captures or to_do:
        return False
    return any(trial.cells["experiment"] != UNNAMED for trial in draft.trials)


def unaligned_clocks(folder: Path, draft: Draft) -> Iterator[str]:
    """Why the source files of a log and a capture of one trial do not align their clocks."""
    pairs = {
        (trial.cells["log_source"], trial.cells["mocap_source"])
        for trial in draft.trials
        if trial.cells.keys() >= {"log_source", "mocap_source"}
    }
    for pair in sorted(pairs):
        paths = [folder / f"sources/{name}.yaml" for name in pair]
        if any(to_be_edited(path) for path in paths):
            continue  # asked already
        try:
            raw_files.check_clocks(*[raw_files.read_source(path) for path in paths])
        except InputError as error:
            yield str(error)


def campaign_text(folder: Path, draft: Draft) -> str:
    """What is to be decided first, what the recordings were taken for, and the next command that
    can succeed."""
    questions = left_to_decide(folder, draft)
    lines: list[str] = []
    if questions:
        lines.append("to be decided:")
        lines += [f"  {text}" for text in questions[:MOST_QUESTIONS]]
        if len(questions) > MOST_QUESTIONS:
            lines.append(f"  and {len(questions) - MOST_QUESTIONS} more, marked in the files")
    lines += source_lines(draft)
    by_experiment: dict[str, list[str]] = {}
    for trial in draft.trials:
        by_experiment.setdefault(trial.cells["experiment"], []).append(trial.cells["trial"])
    texts = [f"{name}: {listing(trials, MOST_SHOWN)}" for name, trials in by_experiment.items()]
    lines.append(f"trials.csv: {'; '.join(texts)}")
    if draft.refused:
        lines += [f"not read: {printable(why)}" for why in draft.refused[:MOST_REFUSED]]
        if len(draft.refused) > MOST_REFUSED:
            more = len(draft.refused) - MOST_REFUSED
            lines.append(f"and {more} more files that were not read, which `inspect` tells")
    place = f"cd {shlex.quote(str(folder))}"
    if is_complete(folder, draft):
        lines.append(f"then: {place} && osl-analysis run")
    else:
        edit = "then: edit what is named above;"
        lines.append(f"{edit} {place} && osl-analysis run -n says what is left")
    return "\n".join(lines)


def source_lines(draft: Draft) -> list[str]:
    """The recordings of each source file, and what of it was guessed."""
    lines: list[str] = []
    for name, text in draft.sources.items():
        files = [
            trial.cells[role]
            for trial in draft.trials
            for role in ("log", "mocap")
            if trial.cells.get(f"{role}_source") == name
        ]
        lines.append(f"sources/{name}.yaml: {len(files)} recordings, {listing(files, MOST_SHOWN)}")
        guessed = guesses_text(text)
        if guessed:
            lines.append(f"  guessed, to be checked: {guessed}")
    if len(lines) > MOST_OF_SOURCES:
        shown = lines[: MOST_OF_SOURCES - 1]
        return [*shown, f"sources/: {len(draft.sources)} source files in all, with what is guessed"]
    return lines


def guesses_text(source: str) -> str:
    """The channels that a drafted source file names by a guess, with unit and sign."""
    channels: dict[str, dict[str, object]] = yaml.safe_load(source).get("channels") or {}
    texts: list[str] = []
    for line in guessed_lines(source):
        text = line.partition(":")[0]
        channel = channels.get(text, {})
        if channel.get("unit"):  # else the file states it
            text += f" in {channel['unit']}"
        if channel.get("sign") == -1:
            text += ", sign -1: it falls as the angle rises"
        texts.append(text)
    return "; ".join(texts)
