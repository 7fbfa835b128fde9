"""Make the folder of a new campaign: configuration, sample sheet, source files and the schemas of these."""

import csv
import os
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.commands.reference import write_schemas
from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.files import shipped
from osl_analysis.formats.rosbag import DESCRIPTION as BAG_DESCRIPTION
from osl_analysis.ingest.draft import DraftedTrial, Recorded, draft_source, draft_trials, guessed_lines
from osl_analysis.ingest.known_formats import FORMATS, SUFFIXES
from osl_analysis.ingest.overview import Overview, open_places
from osl_analysis.yaml_settings import read_mapping

SCHEMA = "# yaml-language-server: $schema=../schemas/source.schema.json\n"


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide."""

    sources: dict[str, str] = field(default_factory=dict)  # texts of the source files, by name
    recordings: list[Recorded] = field(default_factory=list)
    open: list[tuple[Path, str]] = field(default_factory=list)
    """What the files themselves leave open, as which of two clocks counts: file and question."""
    refused: list[str] = field(default_factory=list)
    """Files that are no recordings, or cannot be read, with the reason."""
    trials: list[DraftedTrial] = field(default_factory=list)


def new_campaign(
    folder: Path, recorders: Sequence[str] = (), recordings: Path | None = None, example: bool = False
) -> Draft:
    """Make a folder with a campaign, and say what was drafted. The folder is whole or not there.

    recorders: names of shipped source files to begin from. recordings: a folder of recordings, for which sheet and
    source files are drafted; they stay where they are. example: a small simulated campaign instead.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        what = "exists and is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: {what}; name a new folder, nothing is overwritten")
    draft = Draft() if recordings is None else draft_campaign(recordings)
    where = "recordings" if recordings is None else os.path.relpath(recordings.resolve(), folder.resolve())
    raw_data = Path(where)
    names = sorted({"dynamometer", "dynamometer_nodes"}) if example else [known_recorder(name) for name in recorders]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as place:
            made = Path(place) / "campaign"
            write_campaign(made, folder.name, raw_data, draft, example)
            for name in names:
                text = shipped(f"config/sources/{name}.yaml").read_text(encoding="utf-8")
                (made / f"sources/{name}.yaml").write_text(SCHEMA + text, encoding="utf-8")
            if folder.is_dir():
                folder.rmdir()
            made.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another place") from error
    return draft


def known_recorder(name: str) -> str:
    names = sorted(path.stem for path in shipped("config/sources").glob("*.yaml"))
    if name not in names:
        raise InputError(f"no source file for a recorder '{name}'; there are {', '.join(names)}{nearest(name, names)}")
    return name


def write_campaign(folder: Path, name: str, raw_data: Path, draft: Draft, example: bool) -> None:
    (folder / "sources").mkdir(parents=True)
    allowed = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in name).strip("_") or "campaign"
    template = shipped(f"config/new_campaign/{'example' if example else 'config'}.yaml").read_text(encoding="utf-8")
    text = template.format(name=allowed, raw_data=quoted(raw_data.as_posix()))
    (folder / "config.yaml").write_text(text, encoding="utf-8")
    write_schemas(folder / "schemas")
    if not raw_data.is_absolute() and ".." not in raw_data.parts:
        (folder / raw_data).mkdir(parents=True)
    if example:
        shutil.copy(shipped("config/new_campaign/simulation.yaml"), folder / "simulation.yaml")
        return
    for source, content in draft.sources.items():
        (folder / f"sources/{source}.yaml").write_text(SCHEMA + content, encoding="utf-8")
    columns = [
        "trial",
        "experiment",
        "controller",
        "K_d",
        "B_d",
        "perturbed",
        "log",
        "log_source",
        "mocap",
        "mocap_source",
        "exclude",
    ]
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(trial.cells for trial in draft.trials)


def quoted(text: str) -> str:
    """A path as a YAML text, in quotes where it has more than letters, digits and the signs of a path."""
    plain = all(character.isalnum() or character in "/._-" for character in text)
    return text if plain else "'" + text.replace("'", "''") + "'"


def draft_campaign(folder: Path) -> Draft:
    """What the recordings below a folder are: source files for each kind of them, and a sheet."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings; check the path")
    draft, layouts = Draft(), dict[tuple[object, ...], str]()
    overviews: dict[str, tuple[Overview, str]] = {}
    for path in recordings_in(folder):
        try:
            overview = inspect_file(path)
        except InputError as error:
            draft.refused.append(str(error))
            continue
        source = layouts.setdefault(layout(overview), new_name(overview.format, layouts.values()))
        if source not in overviews or len(overview.channels) > len(overviews[source][0].channels):
            overviews[source] = (overview, path.name)
        is_capture = FORMATS[overview.format].is_capture
        draft.open += [(path.relative_to(folder), text) for text in overview.open]
        draft.recordings.append(Recorded(path.relative_to(folder), source, is_capture))
    if not draft.recordings:
        why = f", as {draft.refused[0]}" if draft.refused else f" ({', '.join(sorted(SUFFIXES))})"
        raise InputError(f"{folder}: no recording in it that can be read{why}; name the folder of the recordings")
    draft.sources = {name: draft_source(overview, file, named=True) for name, (overview, file) in overviews.items()}
    draft.trials = draft_trials(draft.recordings)
    return draft


def recordings_in(folder: Path) -> Iterable[Path]:
    """Files and bag folders below a folder that may be recordings, by their endings."""
    bags = {path.parent for path in folder.rglob(BAG_DESCRIPTION)}
    files = [
        path
        for path in folder.rglob("*")
        if path.is_file() and path.suffix.lower() in SUFFIXES and not any(bag in path.parents for bag in bags)
    ]
    return sorted([*bags, *files])


def layout(overview: Overview) -> tuple[object, ...]:
    """What two files share that one source file can describe: format, clock, and the channels of a log.

    Captures of one laboratory have other markers in each trial.
    """
    if FORMATS[overview.format].is_capture:
        return (overview.format,)
    channels = tuple((*channel.address.values(), channel.unit) for channel in overview.channels)
    return (overview.format, repr(overview.settings), channels)


def new_name(name: str, taken: Iterable[str]) -> str:
    """A name for a source file: the format's, with a number where there are several."""
    used, number = set(taken), 1
    while (free := name if number == 1 else f"{name}_{number}") in used:
        number += 1
    return free


def left_to_decide(folder: Path, draft: Draft) -> list[str]:
    """What a user has to decide before the campaign runs, a line each."""
    lines = []
    for name in draft.sources:
        path = folder / f"sources/{name}.yaml"
        if places := list(open_places(read_mapping(path))):
            named = ", ".join(place[-1] for place in places[:6])
            lines.append(f"{path}: {len(places)} places are to be edited: {named}")
    alike: dict[str, list[str]] = {}
    for trial in draft.trials:
        for text in trial.open:
            alike.setdefault(f"{folder / 'trials.csv'}: {text}", []).append(trial.cells["trial"])
    for file, text in draft.open:
        alike.setdefault(text, []).append(str(file))
    return [*lines, *(f"{text} ({listing(which, 6)})" for text, which in alike.items())]


def drafted_text(draft: Draft) -> str:
    """What the recordings were taken for: files by source, channels named by a guess, and what is not read."""
    lines = []
    for name, text in draft.sources.items():
        files = [str(one.path) for one in draft.recordings if one.source == name]
        named = ", ".join(files[:4]) + ", ..." * (len(files) > 4)
        lines.append(f"sources/{name}.yaml: {len(files)} recordings, {named}")
        lines += [f"    {line}" for line in guessed_lines(text)]
    lines.append("trials.csv, from the names of the files:")
    for cells in (trial.cells for trial in draft.trials[:30]):
        more = [f"{name} {cells[name]}" for name in ("controller", "K_d", "B_d", "perturbed") if name in cells]
        lines.append("    " + ", ".join([f"{cells['trial']}: {cells['experiment']}", *more]))
    lines += [f"    and {len(draft.trials) - 30} more"] * (len(draft.trials) > 30)
    return "\n".join([*lines, *(f"not read: {text}" for text in draft.refused)])
