# SPDX-License-Identifier: Apache-2.0
"""`osl-analysis init`: the folder of a new campaign, drafted from recordings if there are any, and
what the user has to decide before it runs; and the JSON schemas of its YAML files."""

import json
import os
import re
import shlex
from collections import Counter
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import polars as pl
from pydantic.json_schema import models_json_schema

from osl_analysis.base.errors import InputError, first_of, listing, printable
from osl_analysis.base.files import CAMPAIGN, seen_from, shipped, write_text
from osl_analysis.campaign.configuration import Config
from osl_analysis.commands.run import check_simulator, first_look
from osl_analysis.config.sheet import SOURCES
from osl_analysis.draft.draft_campaign import Draft, draft_campaign
from osl_analysis.draft.draft_sheet import UNNAMED
from osl_analysis.formats import known_formats
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings

DRAFTED_COLUMNS = (
    *("trial", "experiment", "controller", "K_d", "B_d", "perturbed"),
    *("log", "log_source", "mocap", "mocap_source", "exclude"),
)
MOST_TOLD = 4  # questions, source files, or names in a line, that the text of `init` tells

OF_LEG = "config.yaml: `parameters`, a file with n_T; with it theta_m tells the delay of the torque"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
SCHEMA_OF_SOURCES = "# yaml-language-server: $schema=../schemas/source.schema.json\n"

Example = Literal["bench", "walking"]
EXAMPLE_SOURCES = {
    "bench": ("dynamometer",),
    "walking": ("leg", "vicon"),
}
"""Source files of what the simulator records, by example."""


def new_campaign(
    folder: Path,
    recordings: Path | None = None,
    example: Example | None = None,
) -> Draft:
    """Make a folder with a campaign, and say what was drafted.

    Parameters
    ----------
    folder
        New or empty. It is whole or not there.
    recordings
        A folder of recordings, for which sheet and source files are drafted. They stay there.
    example
        A small simulated campaign instead, of the bench or of a walkway.

    Raises
    ------
    InputError
        The folder is not empty, or a library of the simulator is not installed.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder}: is no empty folder", "name a new one, nothing is overwritten")
    if example:
        check_simulator()
    draft = Draft() if recordings is None else draft_campaign(recordings)
    raw_data = Path("recordings") if recordings is None else seen_from(folder, recordings)
    sources = {name: source.text for name, source in draft.source_files.items()}
    files = {"config.yaml": configuration(folder.resolve().name, raw_data, draft, example)}
    if example:
        for name in EXAMPLE_SOURCES[example]:
            sources[name] = shipped(f"config/sources/{name}.yaml").read_text(encoding="utf-8")
        settings = shipped(f"config/new_campaign/simulation_{example}.yaml")
        files["simulation.yaml"] = settings.read_text(encoding="utf-8")
    else:
        columns = dict.fromkeys(DRAFTED_COLUMNS, pl.String)
        for trial in draft.trials:
            columns.update(dict.fromkeys(trial.cells, pl.String))
        sheet = pl.DataFrame([trial.cells for trial in draft.trials], columns)
        files["trials.csv"] = sheet.write_csv()
    for name, described in sources.items():
        files[f"sources/{name}.yaml"] = f"{SCHEMA_OF_SOURCES}{described}"
    for name, schema in schemas().items():
        text = json.dumps({"$schema": DRAFT, **schema}, indent=1, ensure_ascii=False)
        files[f"schemas/{name}.schema.json"] = f"{text}\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder, prefix=".campaign.") as place:
            campaign = Path(place) / "campaign"
            (campaign / "sources").mkdir(parents=True)  # of no recording there is no file
            if recordings is None:
                (campaign / raw_data).mkdir()
            for name, text in files.items():
                write_text(campaign / name, text)
            # the configuration comes last: a folder without it is no campaign
            for part in sorted(campaign.iterdir(), key=lambda path: path.name == CAMPAIGN.name):
                part.rename(folder / part.name)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made ({error.strerror})", "choose another place"
        ) from error
    return draft


def configuration(name: str, raw_data: Path, draft: Draft, example: Example | None) -> str:
    """The configuration of a campaign, with what is to be decided as comments at its end."""
    allowed = re.sub(r"[^A-Za-z0-9_-]", "_", name).strip("_") or "campaign"
    path = json.dumps(raw_data.as_posix(), ensure_ascii=False)
    kind = f"example_{example}" if example else "config"
    template = shipped(f"config/new_campaign/{kind}.yaml").read_text(encoding="utf-8")
    questions = [f"# to be decided: {printable(text)}\n" for text in questions_of(draft)]
    return "".join([template.format(name=allowed, raw_data=path), draft.walking, *questions])


def questions_of(draft: Draft) -> list[str]:
    """What a user has to decide, a line each, with the files or trials that it concerns."""
    concerned: dict[str, list[str]] = {}
    for question, name in draft.open:
        concerned.setdefault(question, []).append(name)
    for trial in draft.trials:
        if trial.question:
            name = trial.cells["trial"]
            concerned.setdefault(f"trials.csv: {trial.question}", []).append(name)
    for name, source in draft.source_files.items():
        if "theta_m" in source.named:
            concerned.setdefault(OF_LEG, []).append(f"sources/{name}.yaml")
    return [f"{text} ({listing(names, MOST_TOLD)})" for text, names in concerned.items()]


def left_to_decide(folder: Path, draft: Draft) -> tuple[list[str], bool]:
    """What a user has to decide, a line each; and whether a run can analyse some trial before:
    nothing is refused at its start, and no recording asks anything."""
    with chdir(folder):
        obstacles = first_look()
    is_named = any(trial.cells["experiment"] != UNNAMED for trial in draft.trials)
    is_ready = is_named and not obstacles and not draft.open
    return [*obstacles, *questions_of(draft)], is_ready


def campaign_text(folder: Path, draft: Draft) -> str:
    """What is to be decided first, what the recordings were taken for, and the next command that
    can succeed."""
    questions, is_ready = left_to_decide(folder, draft)
    lines = []
    if questions:
        lines.append("to be decided:")
        where = " in config.yaml and by `osl-analysis run -n`"
        lines += [f"  {text}" for text in first_of(questions, MOST_TOLD, where)]
    lines += first_of(source_lines(draft), MOST_TOLD, " in sources/")
    experiments = Counter(trial.cells["experiment"] for trial in draft.trials)
    counts = [f"{count} {experiment}" for experiment, count in experiments.items()]
    pairs = sum("log_2" in trial.cells for trial in draft.trials)
    if pairs:
        counts.append(f"{pairs} of them of two files")
    lines.append(f"trials.csv: {', '.join(counts)}")
    refused = [f"not read: {why}" for why in draft.refused]
    lines += first_of(refused, MOST_TOLD, " of which `osl-analysis inspect` tells more")
    command = f"cd {shlex.quote(str(folder))} && osl-analysis run"
    if not is_ready:
        command = f"edit what is named above; {command} -n says what is left"
    lines.append(f"then: {command}")
    return "\n".join(lines)


def source_lines(draft: Draft) -> list[str]:
    """The channels that each source file names, and for how many recordings."""
    cells = [trial.cells for trial in draft.trials]
    uses = Counter(row.get(role) for row in cells for role in SOURCES)
    lines = []
    for name, source in draft.source_files.items():
        guesses = [entry.guess for entry in source.named.values()] or ["all markers"]
        lines.append(f"sources/{name}.yaml, {uses[name]} x: {listing(guesses, MOST_TOLD)}")
    return lines


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each kind of file, by the name of its file without `.schema.json`."""
    schema_of = {
        "config": Config.model_json_schema(),
        "parameters": ParameterFile.model_json_schema(),
        "simulation": SimulationSettings.model_json_schema(),
        "gait_laboratory": WalkingSettings.model_json_schema(),
    }
    # a campaign's configuration overrides fields of the default, and needs none
    config = schema_of["config"]
    for definition in (config, *config["$defs"].values()):
        definition.pop("required", None)

    models = {name: known.source for name, known in known_formats().items()}
    places, content = models_json_schema(
        [(model, "validation") for model in dict.fromkeys(models.values())]
    )
    conditions_on_formats = [
        {"if": {"properties": {"format": {"const": name}}}, "then": places[model, "validation"]}
        for name, model in models.items()
    ]
    schema_of["source"] = {
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(models)}},
        "allOf": conditions_on_formats,
        **content,
    }
    return schema_of
