"""`osl-analysis init`: the folder of a new campaign, drafted from recordings if there are any, and
what the user has to decide before it runs."""

import csv
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.campaign_start import check_start, source_problems
from osl_analysis.draft.draft_campaign import Draft, draft_campaign
from osl_analysis.draft.draft_sheet import UNNAMED
from osl_analysis.draft.draft_source import Entry
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.files import CAMPAIGN, seen_from, shipped
from osl_analysis.ingest.placeholders import UNKNOWN

COLUMNS = (
    *("trial", "experiment", "controller", "K_d", "B_d", "perturbed"),
    *("log", "log_source", "mocap", "mocap_source", "exclude"),
)
SELDOM = ("joint", "fixture")  # columns of a drafted sheet only where a trial has them
MOST_SHOWN = 4  # files or trials of one kind in the text of `init`
MOST_REFUSED = 2  # files that were not read, in the text of `init`
MOST_QUESTIONS = 4  # in the text of `init`; the files have all of them
MOST_OF_SOURCES = 4  # lines on source files in the text of `init`


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


def left_to_decide(folder: Path, draft: Draft) -> list[str]:
    """What a user has to decide before the campaign runs, a line each."""
    lines = list(places_to_edit(folder, draft)) or first_look(folder)
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
    for name, source in draft.source_files.items():
        edits[folder / f"sources/{name}.yaml"] = source.places
    for path, places in edits.items():
        if places:
            are = "place is" if len(places) == 1 else "places are"
            yield f"{path}: {len(places)} {are} to be edited: {', '.join(places[:6])}"


def is_ready(folder: Path, draft: Draft) -> bool:
    """Whether a run of a drafted campaign can analyse some trial: no place is to be edited, no
    capture asks anything, and nothing is refused at its start."""
    is_named = any(trial.cells["experiment"] != UNNAMED for trial in draft.trials)
    is_edited = is_named and not draft.has_open_captures and not [*places_to_edit(folder, draft)]
    return is_edited and not first_look(folder)


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
    if is_ready(folder, draft):
        lines.append(f"then: {place} && osl-analysis run")
    else:
        edit = "then: edit what is named above;"
        lines.append(f"{edit} {place} && osl-analysis run -n says what is left")
    return "\n".join(lines)


def source_lines(draft: Draft) -> list[str]:
    """The recordings of each source file, and what of it was guessed."""
    lines: list[str] = []
    for name, source in draft.source_files.items():
        files = [
            trial.cells[role]
            for trial in draft.trials
            for role in ("log", "mocap")
            if trial.cells.get(f"{role}_source") == name
        ]
        lines.append(f"sources/{name}.yaml: {len(files)} recordings, {listing(files, MOST_SHOWN)}")
        guessed = [] if source.known else [guess_text(entry) for entry in source.named]
        if any(guessed):
            lines.append(f"  guessed, to be checked: {'; '.join(filter(None, guessed))}")
    if len(lines) > MOST_OF_SOURCES:
        shown = lines[: MOST_OF_SOURCES - 1]
        return [*shown, f"sources/: {len(draft.source_files)} source files, with what is guessed"]
    return lines


def guess_text(entry: Entry) -> str:
    """A channel that is named by a guess, with unit and sign; empty of another."""
    if "guess" not in entry.remark.partition(";")[0]:
        return ""
    sign = ", sign -1: it falls as the angle rises" if "sign" in entry.fields else ""
    return f"{entry.name} in {entry.fields['unit']}{sign}"
