"""Recordings on their way in: ingest and quality control of one trial in one job, the samples being
examined while they are in memory; what files of any laboratory hold, and a drafted campaign. Texts
from files are untrusted: they are escaped when they are printed."""

import csv
import os
import re
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.files import CAMPAIGN, shipped
from osl_analysis.formats.rosbag import DESCRIPTION
from osl_analysis.ingest import draft as drafts
from osl_analysis.ingest import raw_files
from osl_analysis.ingest.examine import Commanded, check_ranges, examine, measured_table
from osl_analysis.ingest.overview import Overview
from osl_analysis.ingest.source import UNKNOWN
from osl_analysis.signals.grid import with_stamp_evidence
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, unusual, write_trial
from osl_analysis.yaml_settings import read_mapping


def ingest_trial(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    output: Path,
    needed_columns: Sequence[str] = (),
) -> Trial:
    """The trial of one row of the sheet, written as Parquet to `output`; arguments and errors as in
    `checked_trial`."""
    trial = checked_trial(row, raw_folder, sources_folder, needed_columns)
    write_trial(trial, output)
    return trial


def checked_trial(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str] = (),
) -> Trial:
    """The trial of one row of the sheet, from its files relative to `raw_folder`, with the
    `needed_columns`."""
    trial = raw_files.trial_from_files(row, raw_folder, sources_folder)
    raw_files.check_columns(trial, row.get("experiment"), needed_columns)
    facts = EXPERIMENTS.get(str(row.get("experiment")))
    # those of the log tell all
    if facts is not None and facts.place == "walkway" and not needed_columns:
        raw_files.check_markers(trial, row["experiment"])
    check_ranges(trial)
    return with_stamp_evidence(trial)


def ingest_and_check(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str],
    commanded: Commanded,
    trial: Path,
    quality: Path,
) -> None:
    """Write the trial of one row of the sheet, and to `quality` a row for each check, without
    limits and verdicts."""
    record = ingest_trial(row, raw_folder, sources_folder, trial, needed_columns)
    write_table(
        measured_table(record.name, examine(record, str(row["experiment"]), commanded)), quality
    )


def inspect_file(path: Path) -> Overview:
    raw_files.check_file(path)
    return raw_files.FORMATS[raw_files.recognise(path)].inspect(path)


def overview_text(overview: Overview) -> str:
    """The facts on a file, a line per channel (kind, name, unit, samples, rate, note, type), and
    the remarks."""
    lines = [
        f"format: {overview.format}",
        *(f"{name}: {shortened(fact)}" for name, fact in overview.facts.items()),
        "",
    ]
    for channel in overview.channels:
        name = " ".join(shortened(part) for part in channel.address.values())
        rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
        unit = f" [{shortened(channel.unit)}]" if channel.unit else ""
        notes = "".join(f"; {printable(note)}" for note in (channel.note, channel.type) if note)
        count = f"  {channel.count} samples" * (channel.kind != "plate")
        lines.append(f"{shortened(channel.kind):<14} {name}{unit}{count}{rate}{notes}")
    lines += ["", *(f"! {printable(remark)}" for remark in (*overview.remarks, *overview.open))]
    return "\n".join(lines).rstrip()


def shortened(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe, most = printable(text), 60  # characters
    return safe if len(safe) <= most else f"{safe[:most]}..."


def is_folder_of_recordings(path: Path) -> bool:
    """Whether a path is a folder, and not that of one ROS 2 bag, which is one recording."""
    return path.is_dir() and not (path / DESCRIPTION).is_file()


def folder_text(folder: Path) -> str:
    """What each recording below a folder holds, with remarks, or why it is refused.

    Raises
    ------
    InputError
        There is no recording below the folder.
    """
    paths = raw_files.recordings_in(folder)
    if not paths:
        endings = ", ".join(raw_files.SUFFIXES)
        raise InputError(f"{folder}: no recordings below it ({endings}); name another folder")
    return "\n".join(line for path in paths for line in recording_lines(path, folder))


def recording_lines(path: Path, folder: Path) -> list[str]:
    """A line with the channels of one recording, counted by kind and rate, and one per remark."""
    name = printable(str(path.relative_to(folder)))
    try:
        overview = inspect_file(path)
    except InputError as error:
        reason = str(error).replace(f"{path}: ", "")
        return [f"{name}: refused: {reason}"]
    counts = Counter(
        (shortened(channel.address.get("topic", channel.kind)), channel.rate)
        for channel in overview.channels
    )
    holds = []
    for (kind, rate), count in counts.items():
        at_rate = f" at {rate:.4g} Hz" if rate else ""
        holds.append(f"{count} x {kind}{at_rate}")
    remarks = [printable(remark) for remark in (*overview.remarks, *overview.open)]
    return [
        f"{name}: {overview.format}, {', '.join(holds)}",
        *(f"    ! {remark}" for remark in remarks),
    ]


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide."""

    sources: dict[str, str] = field(default_factory=dict)  # texts of the source files, by name
    # file and question, as which of two clocks counts
    open: list[tuple[Path, str]] = field(default_factory=list)
    # files that are no recordings, or cannot be read, with the reason
    refused: list[str] = field(default_factory=list)
    # cells and questions of each
    trials: list[tuple[dict[str, str], list[str]]] = field(default_factory=list)
    walking: str = ""  # section of the configuration


def new_campaign(
    folder: Path,
    recorders: Sequence[str] = (),
    recordings: Path | None = None,
    example: bool = False,
) -> Draft:
    """Make a folder with a campaign, and say what was drafted. The folder is whole or not there.
    recorders: names of shipped source files to begin from. recordings: a folder of recordings, for
    which sheet and source files are drafted; they stay where they are. example: a small simulated
    campaign instead."""
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        what = "exists and is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: {what}; name a new folder, nothing is overwritten")
    draft = Draft() if recordings is None else draft_campaign(recordings)
    known = sorted(path.stem for path in shipped("config/sources").glob("*.yaml"))
    for name in recorders:
        if name not in known:
            like = nearest(name, known)
            raise InputError(
                f"no source file for a recorder '{name}'; there are {', '.join(known)}{like}"
            )
    names = ("dynamometer", "dynamometer_nodes") if example else recorders
    texts = {
        name: shipped(f"config/sources/{name}.yaml").read_text(encoding="utf-8") for name in names
    }
    raw_data = Path(
        os.path.relpath(recordings.resolve(), folder.resolve()) if recordings else "recordings"
    )
    name = folder.resolve().name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder, prefix=".campaign.") as place:
            made = Path(place) / "campaign"
            write_campaign(
                made, name, raw_data, {**draft.sources, **texts}, None if example else draft
            )
            # the configuration comes last: a folder without it is no campaign
            for part in sorted(made.iterdir(), key=lambda path: path.name == CAMPAIGN.name):
                part.rename(folder / part.name)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made ({error.strerror}); choose another place"
        ) from error
    return draft


def write_campaign(
    folder: Path, name: str, raw_data: Path, sources: Mapping[str, str], draft: Draft | None
) -> None:
    """The files of a campaign; `sources` are texts of source files by name; without a draft it is
    the example."""
    (folder / "sources").mkdir(parents=True)
    allowed = (
        "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in name).strip("_")
        or "campaign"
    )
    kind, path = "config" if draft else "example", raw_data.as_posix()
    template = shipped(f"config/new_campaign/{kind}.yaml").read_text(encoding="utf-8")
    # a text in YAML's quotes
    if not all(character.isalnum() or character in "/._-" for character in path):
        path = "'" + path.replace("'", "''") + "'"
    config = template.format(name=allowed, raw_data=path) + (draft.walking if draft else "")
    (folder / "config.yaml").write_text(config, encoding="utf-8")
    # it knows the settings of all commands
    from osl_analysis.commands.reference import write_schemas

    write_schemas(folder / "schemas")
    if not raw_data.is_absolute() and ".." not in raw_data.parts:
        (folder / raw_data).mkdir(parents=True)
    for source, content in sources.items():
        text = f"# yaml-language-server: $schema=../schemas/source.schema.json\n{content}"
        (folder / f"sources/{source}.yaml").write_text(text, encoding="utf-8")
    if draft is None:
        shutil.copy(shipped("config/new_campaign/simulation.yaml"), folder / "simulation.yaml")
        return
    named = ("trial", "experiment", "controller", "K_d", "B_d", "perturbed")
    columns = [*named, "log", "log_source", "mocap", "mocap_source", "exclude"]
    columns += ["joint"] * any("joint" in cells for cells, _ in draft.trials)
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(cells for cells, _ in draft.trials)


def draft_campaign(folder: Path) -> Draft:
    """What the recordings below a folder are: source files for each kind of them, and a sheet."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings; check the path")
    draft, layouts = Draft(), dict[tuple[object, ...], str]()
    overviews: dict[str, tuple[tuple[int, int], Overview, str, drafts.DraftedLog | None]] = {}
    recordings, captures, slow, rows = (
        [],
        dict[Path, Overview](),
        set[Path](),
        dict[Path, tuple[str, int]](),
    )
    for path in raw_files.recordings_in(folder):
        try:
            overview = inspect_file(path)
        except InputError as error:
            draft.refused.append(str(error))
            continue
        name, file = overview.format, path.relative_to(folder)
        is_capture = raw_files.FORMATS[name].is_capture
        # What files share that one source file can describe: format, clock, and the channels of a
        # log. Captures of one laboratory have other markers in each trial, and may lack a pulse.
        channels = tuple((*channel.address.values(), channel.unit) for channel in overview.channels)
        settings = repr(
            {key: value for key, value in overview.settings.items() if key != "missing"}
        )
        same = drafts.pulse_channels(overview) if is_capture else (settings, channels)
        layout, number = (name, *same), 1 + sum(one[0] == name for one in layouts)
        known = "" if is_capture else known_recorder(overview)
        source = layouts.setdefault(layout, known or (name if number == 1 else f"{name}_{number}"))
        log = None if is_capture else drafts.drafted_log(overview)
        moving = sum(not guess.no_signal for guess in log.guesses) if log else 0
        # what tells most
        if source not in overviews or (len(channels), moving) > overviews[source][0]:
            overviews[source] = ((len(channels), moving), overview, path.name, log)
        draft.open += [(file, text) for text in overview.open]
        recordings.append((file, source, is_capture))
        captures |= {file: overview} if is_capture else {}
        slow |= {file} if log and drafts.turns_slowly(log) else set()
        if "end" in overview.facts:  # as of a text, half of which looks whole
            rows[file] = source, max(one.count for one in overview.channels)
    for source in dict.fromkeys(of for of, _ in rows.values()):
        alike = {file: count for file, (of, count) in rows.items() if of == source}
        is_unusual, usual = unusual(np.array([*alike.values()]))
        short = [file for file in compress(alike, is_unusual) if alike[file] < usual]
        draft.open += [
            (file, f"{alike[file]} rows, {usual:.0f} in most like it: was its end cut off?")
            for file in short
        ]
    if not recordings:
        why = (
            f", as {draft.refused[0]}"
            if draft.refused
            else f" ({', '.join(sorted(raw_files.SUFFIXES))})"
        )
        raise InputError(
            f"{folder}: no recording in it that can be read{why}; name the folder of the recordings"
        )
    for name, (_, overview, file_name, log) in overviews.items():
        text, own = (
            drafts.draft_source(overview, file_name, False, log),
            shipped(f"config/sources/{name}.yaml"),
        )
        if own.is_file():  # a recorder that is known, and what else it has recorded
            known, named = (
                own.read_text(encoding="utf-8"),
                re.findall(r"^(  ([a-z]\w*): .*\n)", text, re.MULTILINE),
            )
            text = known + "".join(line for line, column in named if f"\n  {column}: " not in known)
        draft.sources[name] = text
    joints = [
        name
        for name, text in draft.sources.items()
        if "\n  theta: {" in text and "\n  torque: {" in text
    ]
    moved = {
        file: "torque_angle" if file in slow else "impedance"
        for file, source, _ in recordings
        if source in joints
    }
    draft.trials = drafts.draft_trials(recordings, moved)
    known_joint = {name: drafts.named_joint(overviews[name][1].channels) for name in joints}
    for cells, _ in draft.trials:
        for joint in known_joint.get(cells.get("log_source", ""), ()):
            cells["joint"] = joint
    may_walk = any(
        cells["experiment"] == "walking"
        or (cells["experiment"] == drafts.UNNAMED and "mocap" in cells)
        for cells, _ in draft.trials
    )
    section = drafts.draft_walking([*captures.values()]) if may_walk and captures else []
    if section:
        draft.walking = "\n".join([*section, ""])
    elif any(one.kind == "plate" for capture in captures.values() for one in capture.channels):
        labels = {
            one.key
            for capture in captures.values()
            for one in capture.channels
            if one.kind == "marker"
        }
        said = (
            "force plates and markers whose names tell no segment: a walking analysis needs"
            " `walking.markers` in "
        )
        said += f"config.yaml (docs/walking.md#the-configuration), of {listing(sorted(labels), 40)}"
        draft.open += [(file, said) for file in captures]
    return draft


def known_recorder(overview: Overview) -> str:
    """The shipped source file of which a log has every channel, three or more; empty if there is
    none."""
    there, found = [{*one.address.values()} for one in overview.channels], {2: ""}
    for path in shipped("config/sources").glob("*.yaml"):
        content, keys = read_mapping(path), {"topic", "field", "column", "variable"}
        wanted = [
            {str(one[key]) for key in keys & one.keys()}
            for one in content.get("channels", {}).values()
        ]
        if content["format"] == overview.format and all(one in there for one in wanted):
            found.setdefault(len(wanted), path.stem)
    return found[max(found)]


def left_to_decide(folder: Path, draft: Draft) -> list[str]:
    """What a user has to decide before the campaign runs, a line each."""
    edits = {folder / CAMPAIGN: re.findall(rf"(\w+): [^#\n]*{UNKNOWN}", draft.walking)}
    for path in (folder / f"sources/{name}.yaml" for name in draft.sources):
        edits[path] = drafts.to_be_edited(path)
    told = [
        f"{path}: {len(k)} place{' is' if len(k) == 1 else 's are'} to be edited:"
        f" {', '.join(k[:6])}"
        for path, k in edits.items()
        if k
    ]
    alike: dict[str, list[str]] = {}
    for cells, questions in draft.trials:
        for text in questions:
            alike.setdefault(f"{folder / 'trials.csv'}: {text}", []).append(cells["trial"])
    for file, text in draft.open:
        alike.setdefault(text, []).append(str(file))
    return [*told, *(f"{text} ({listing(which, 6)})" for text, which in alike.items())]


def drafted_text(draft: Draft) -> str:
    """What the recordings were taken for: files by source, channels named by a guess, and what is
    not read."""
    lines, most = [], 30
    for name, text in draft.sources.items():
        roles = [(cells, role) for cells, _ in draft.trials for role in ("log", "mocap")]
        files = [cells[role] for cells, role in roles if cells.get(f"{role}_source") == name]
        named = ", ".join(files[:4]) + ", ..." * (len(files) > 4)
        lines.append(f"sources/{name}.yaml: {len(files)} recordings, {named}")
        lines += [f"    {line}" for line in drafts.guessed_lines(text)]
        lines += [f"    {line}" for line in text.splitlines() if "# left out: " in line]
    lines += ["config.yaml:", *(f"    {line}" for line in draft.walking.splitlines())] * bool(
        draft.walking
    )
    lines.append("trials.csv, from the names of the files, else from what moves in them:")
    for cells, _ in draft.trials[:most]:
        more = [
            f"{name} {cells[name]}"
            for name in ("controller", "K_d", "B_d", "perturbed")
            if name in cells
        ]
        lines.append("    " + ", ".join([f"{cells['trial']}: {cells['experiment']}", *more]))
    lines += [f"    and {len(draft.trials) - most} more"] * (len(draft.trials) > most)
    return "\n".join([*lines, *(f"not read: {text}" for text in draft.refused)])
