"""`osl-analysis init`: the folder of a new campaign, drafted from recordings if there are any, and
what the user has to decide before it runs."""

import csv
import json
import os
import re
import shlex
import shutil
from collections.abc import Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.campaign_start import check_start, source_problems
from osl_analysis.draft.draft_campaign import Draft, draft_campaign
from osl_analysis.draft.draft_sheet import UNNAMED
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.files import CAMPAIGN, seen_from, shipped
from osl_analysis.ingest.placeholders import UNKNOWN

COLUMNS = (
    *("trial", "experiment", "controller", "K_d", "B_d", "perturbed"),
    *("log", "log_source", "mocap", "mocap_source", "exclude"),
)
SELDOM = ("joint", "fixture")  # columns of a drafted sheet only where a trial has them
MOST_SHOWN = 4  # files, trials, questions in the text of `init`
MOST_PLACES = 6  # to be edited, in the text of `init`
MOST_REFUSED = 2  # files that were not read, in the text of `init`

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
    sources = {**draft.sources, **shipped_sources(RECORDERS[example] if example else recorders)}
    raw_data = Path("recordings") if recordings is None else seen_from(folder, recordings)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder, prefix=".campaign.") as place:
            campaign = Path(place) / "campaign"
            write_campaign(campaign, folder.resolve().name, raw_data, sources, example or draft)
            # the configuration comes last: a folder without it is no campaign
            for part in sorted(campaign.iterdir(), key=lambda path: path.name == CAMPAIGN.name):
                part.rename(folder / part.name)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made ({error.strerror}); choose another place"
        ) from error
    return draft


def shipped_sources(recorders: Sequence[str]) -> dict[str, str]:
    """Texts of the shipped source files of recorders, by name."""
    paths = {path.stem: path for path in sorted(shipped("config/sources").glob("*.yaml"))}
    for name in recorders:
        if name not in paths:
            raise InputError(
                f"no source file for a recorder '{name}'; there are"
                f" {', '.join(paths)}{nearest(name, [*paths])}"
            )
    return {name: paths[name].read_text(encoding="utf-8") for name in recorders}


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
    path = json.dumps(raw_data.as_posix(), ensure_ascii=False)
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
        settings = shipped(f"config/new_campaign/simulation_{content}.yaml")
        shutil.copy(settings, folder / "simulation.yaml")
        return
    columns = [*COLUMNS]
    columns += [name for name in SELDOM if any(name in trial.cells for trial in content.trials)]
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(trial.cells for trial in content.trials)


def left_to_decide(folder: Path, draft: Draft) -> tuple[list[str], bool]:
    """What a user has to decide, a line each; and whether a run can analyse some trial before: no
    place is to be edited, no capture asks anything, and nothing is refused at its start."""
    obstacles = places_to_edit(folder, draft) or first_look(folder)
    files_of: dict[str, list[str]] = {}
    for file, question in draft.open:
        files_of.setdefault(question, []).append(str(file))
    for trial in draft.trials:
        for question in trial.questions:
            text = f"{folder / 'trials.csv'}: {question}"
            files_of.setdefault(text, []).append(trial.cells["trial"])
    is_named = any(trial.cells["experiment"] != UNNAMED for trial in draft.trials)
    is_ready = is_named and not obstacles and not draft.has_open_captures
    texts = [f"{text} ({listing(files, MOST_SHOWN)})" for text, files in files_of.items()]
    return obstacles + texts, is_ready


def places_to_edit(folder: Path, draft: Draft) -> list[str]:
    """The places of each file that are to be edited."""
    places_of = {CAMPAIGN: re.findall(rf"(\w+): [^#\n]*{UNKNOWN}", draft.walking)}
    for name, source in draft.source_files.items():
        places_of[Path("sources", f"{name}.yaml")] = source.places
    texts: list[str] = []
    for path, places in places_of.items():
        if places:
            are = "place is" if len(places) == 1 else "places are"
            listed = ", ".join(places[:MOST_PLACES])
            texts.append(f"{folder / path}: {len(places)} {are} to be edited: {listed}")
    return texts


def first_look(folder: Path) -> list[str]:
    """What a run of a campaign would refuse before its first job, or of single trials."""
    problems: list[str] = []
    with chdir(folder):
        try:
            campaign = open_campaign(read_config(CAMPAIGN), None)
            problems += source_problems(campaign).values()
            check_start(campaign)
        except InputError as error:
            problems.append(str(error))
    return list(dict.fromkeys(problems))


def campaign_text(folder: Path, draft: Draft) -> str:
    """What is to be decided first, what the recordings were taken for, and the next command that
    can succeed."""
    questions, is_ready = left_to_decide(folder, draft)
    lines: list[str] = []
    if questions:
        lines.append("to be decided:")
        lines += some_of([f"  {text}" for text in questions], MOST_SHOWN, "in the files")
    lines += some_of(source_lines(draft), MOST_SHOWN, "on source files")
    by_experiment: dict[str, list[str]] = {}
    for trial in draft.trials:
        by_experiment.setdefault(trial.cells["experiment"], []).append(trial.cells["trial"])
    texts = [f"{name}: {listing(trials, MOST_SHOWN)}" for name, trials in by_experiment.items()]
    lines.append(f"trials.csv: {'; '.join(texts)}")
    refused = [f"not read: {printable(why)}" for why in draft.refused]
    lines += some_of(refused, MOST_REFUSED, "not read, which `inspect` tells")
    edit = "" if is_ready else "edit what is named above; "
    run = "osl-analysis run" if is_ready else "osl-analysis run -n says what is left"
    lines.append(f"then: {edit}cd {shlex.quote(str(folder))} && {run}")
    return "\n".join(lines)


def some_of(lines: Sequence[str], most: int, where: str) -> list[str]:
    """The first lines, and how many there are more."""
    if len(lines) <= most:
        return [*lines]
    return [*lines[:most], f"  and {len(lines) - most} more {where}"]


def source_lines(draft: Draft) -> list[str]:
    """The recordings of each source file, with what of it was guessed."""
    lines: list[str] = []
    for name, source in draft.source_files.items():
        files = [
            trial.cells[role]
            for trial in draft.trials
            for role in ("log", "mocap")
            if trial.cells.get(f"{role}_source") == name
        ]
        line = f"sources/{name}.yaml: {len(files)} recordings, {listing(files, MOST_SHOWN)}"
        guessed = [] if source.known else [entry.guess for entry in source.named if entry.guess]
        if guessed:
            line = f"{line}\n  guessed, to be checked: {'; '.join(guessed)}"
        lines.append(line)
    return lines
