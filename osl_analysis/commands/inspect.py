"""What files of any laboratory hold, as lines or a table, and a first look at one bench trial of each source file.

Texts from files are untrusted: they are escaped when they are printed. A torque with the wrong sign or unit, or an
angle in degrees, shows in one trial as well as in fifty.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign import Campaign, open_campaign
from osl_analysis.commands.fit import FittedTrial, estimates_text, fit_of, fit_request, fit_trial
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config import read_config
from osl_analysis.errors import InputError, OslAnalysisError, printable, unexpected
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.files import CAMPAIGN
from osl_analysis.ingest.known_formats import FORMATS, NOT_READ, SUFFIXES, recognise
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import check_file
from osl_analysis.ingest.recording import Recording
from osl_analysis.judge.recording import CHECKS, examine, validate_rules
from osl_analysis.judge.table import Commanded, QualityRules
from osl_analysis.trial import Trial


@dataclass(frozen=True)
class FirstLook:
    """What the first trial of a source file gave."""

    trial: str
    experiment: str
    said: str  # the estimates with their doubts, or why there are none
    is_sound: bool  # whether it was fitted, without a doubt


def first_look(folder: Path) -> Iterator[FirstLook]:
    """The first trial of each experiment and source file of a folder's campaign, fitted. Nothing is left behind."""
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        first: dict[tuple[str, str], str] = {}
        for trial in campaign.trials(*(name for name, facts in EXPERIMENTS.items() if facts.place == "bench")):
            row = campaign.row(trial)
            first.setdefault((row["experiment"], row["log_source"] or row["mocap_source"]), trial)
        for trial in first.values():
            yield look(campaign, trial, CAMPAIGN)


def off_desired(estimates: pl.DataFrame, row: Mapping[str, Any]) -> str:
    """What a stiffness far from the K_d of an impedance trial may mean; empty if it is near, or no K_d is known."""
    K_d = row["K_d"]
    if row["experiment"] != "impedance" or K_d is None:
        return ""
    ratio = float(estimates["K"][-1]) / float(K_d)
    if 0.6 <= ratio <= 1.67:  # beyond, a unit or K_d is probably wrong: a joint renders K_d to some 20 %
        return ""
    return (
        f"K is {ratio:.3g} times the K_d = {float(K_d):g} N*m/rad of this trial: are K_d and the units of torque and "
        "angle right?"
    )


def fit_of_row(trial: Trial, row: Mapping[str, Any], device: Path | None, config: Path) -> FittedTrial:
    """The fit of a trial in memory, by what its row of a sheet says, drafted or not, as in the workflow.

    `device` is its parameter file. Raises as `fit_request` and `fit_trial`.
    """
    experiment = str(row["experiment"])
    condition: Any = {column: row.get(column) for column in fit_of(experiment).sheet}
    if experiment == "impedance":
        K_d, B_d = (None if row[name] is None else float(row[name]) for name in ("K_d", "B_d"))
        condition = DesiredImpedance(row["controller"], K_d, B_d)
    request = replace(fit_request(experiment, config, condition), windows=row.get("windows"))
    return fit_trial(experiment, trial, device, request)


def look(campaign: Campaign, name: str, config: Path) -> FirstLook:
    """Ingest and fit one trial. Nothing is written."""
    row, folders = campaign.row(name), campaign.config
    experiment = str(row["experiment"])
    try:
        trial = checked_trial(campaign.recording(name), folders.raw_data, folders.sources)
        fitted = fit_of_row(trial, row, campaign.device(name), config)
    except OslAnalysisError as error:
        return FirstLook(name, experiment, str(error), is_sound=False)
    except Exception as fault:  # a fault of the program in one recording must not hide the others
        return FirstLook(name, experiment, unexpected(fault), is_sound=False)
    far = off_desired(fitted.estimates, row)
    if far:
        return FirstLook(name, experiment, f"{far}\n{estimates_text(fitted.estimates)}", is_sound=False)
    doubts = [text for text in fitted.estimates["doubtful"].to_list() if text] if "doubtful" in fitted.estimates else []
    return FirstLook(name, experiment, estimates_text(fitted.estimates), is_sound=not doubts)


MOST_LETTERS = 60  # characters of a name that are printed
LISTED_SUFFIXES = (*NOT_READ, *SUFFIXES)  # endings of the files that `samples` lists


def inspect_file(path: Path) -> Overview:
    check_file(path)
    return FORMATS[recognise(path)].inspect(path)


def overview_text(overview: Overview) -> str:
    lines = [f"format: {overview.format}", *(f"{name}: {shortened(fact)}" for name, fact in overview.facts.items()), ""]
    lines += [channel_text(channel) for channel in overview.channels]
    lines += ["", *(f"! {printable(remark)}" for remark in (*overview.remarks, *overview.open))]
    return "\n".join(lines).rstrip()


def channel_text(channel: RecordedChannel) -> str:
    """One channel on one line: kind, name, unit, samples, rate, note, type."""
    name = " ".join(shortened(part) for part in channel.address.values())
    rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
    unit = f" [{shortened(channel.unit)}]" if channel.unit else ""
    notes = "".join(f"; {printable(note)}" for note in (channel.note, channel.type) if note)
    return f"{shortened(channel.kind):<14} {name}{unit}  {channel.count} samples{rate}{notes}"


def shortened(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe = printable(text)
    return safe if len(safe) <= MOST_LETTERS else f"{safe[:MOST_LETTERS]}..."


def samples_table(folder: Path, rules: QualityRules) -> str:
    """Markdown: a row per recording below a folder, with what it holds and what ingest and the quality checks say."""
    validate_rules(rules)
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in LISTED_SUFFIXES)
    if not paths:
        raise InputError(f"{folder}: no recordings below it ({', '.join(LISTED_SUFFIXES)}); name another folder")
    rows = ["| file | format | holds | ingest and quality |", "|---|---|---|---|"]
    for path in paths:
        cells = [cell.replace(f"{path}: ", "") for cell in (str(path.relative_to(folder)), *row_of(path, rules))]
        rows.append(f"| {' | '.join('<br>'.join(escaped(line) for line in cell.splitlines()) for cell in cells)} |")
    return "\n".join(rows)


def row_of(path: Path, rules: QualityRules) -> tuple[str, str, str]:
    try:
        overview = inspect_file(path)
    except InputError as error:
        return "", "", f"refused: {error}"
    has_topics = any("topic" in channel.address for channel in overview.channels)
    holds = topic_lines(overview) if has_topics else kind_lines(overview)
    judged = capture_says(path, overview.format, rules) if FORMATS[overview.format].is_capture else ()
    return overview.format, "\n".join(holds), "\n".join([*overview.remarks, *overview.open, *judged])


def topic_lines(overview: Overview) -> Iterator[str]:
    """The topics of a log; those of the same timing and size on one line."""
    numbers = Counter(channel.address["topic"] for channel in overview.channels if "field" in channel.address)
    alike: dict[str, dict[str, None]] = {}
    for channel in overview.channels:
        topic, rate = channel.address["topic"], f" at {channel.rate:.4g} Hz" if channel.rate else ""
        size = f"{channel.count} messages{rate}, numbers in each: {numbers[topic]}"
        alike.setdefault("; ".join(filter(None, [size, channel.note])), {})[topic] = None
    yield from (f"{', '.join(topics)}: {size}" for size, topics in alike.items())


def kind_lines(overview: Overview) -> Iterator[str]:
    """How many channels a file has of each kind and rate, and how much of them is missing."""
    yield from (f"{name}: {overview.facts[name]}" for name in ("frames", "rows") if name in overview.facts)
    for kind, rate in dict.fromkeys((channel.kind, channel.rate) for channel in overview.channels):
        alike = [channel for channel in overview.channels if (channel.kind, channel.rate) == (kind, rate)]
        missing = sum(channel.missing for channel in alike) / len(alike)
        count = f"{len(alike)} x {kind}{f' at {rate:g} Hz' if rate else ''}"
        notes = [f"{missing:.1%} missing"] * bool(missing) + [c.note for c in alike if kind == "plate"]
        yield "; ".join([count, *notes])


def capture_says(path: Path, name: str, rules: QualityRules) -> Iterator[str]:
    """What ingest and the quality checks say to all of a capture; where it is refused, to all but its plates."""
    plates = FORMATS[name].source.model_fields.get("plates")
    for options in [{}, {"plates": "none"}] if plates and plates.default == "all" else [{}]:
        source = FORMATS[name].source.model_validate({"format": name, **options})
        try:
            recording = FORMATS[name].read(path, source)
        except InputError as error:
            yield from [] if options else [f"refused: {error}"]
            continue
        yield "ok without plates" if options else "ok"
        yield from [*recording.warnings, *failures(recording, rules)]
        return


def failures(recording: Recording, rules: QualityRules) -> Iterator[str]:
    trial = Trial("sample", recording.samples, dict(recording.facts))
    for name, finding in examine(trial, "ingest_only", Commanded((), (), 1)).items():
        limit, check = rules.rule(name).limit, CHECKS[name]
        if finding.value is not None and check.failed(finding.value, limit):
            yield f"{name}: {finding.value:.4g} {check.unit}, threshold {limit:g} ({finding.remark})"


def escaped(text: str) -> str:
    """Text of a stranger's file for a Markdown table: nothing in it can be markup, HTML or a line of its own."""
    printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    plain = printable.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", plain)
