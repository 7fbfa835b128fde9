"""A look at each recording of a folder as it comes.

Texts from files are untrusted: they are escaped when they are printed."""

import json
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import polars as pl

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import Config, read_config
from osl_analysis.commands.estimates import printed_units
from osl_analysis.commands.first_look import fit_of_row
from osl_analysis.commands.fit_results import Fit
from osl_analysis.commands.siblings import (
    beside_siblings,
    comparable,
    compared_in,
    kind_of,
    read_notes,
)
from osl_analysis.commands.trials import checked_trial, inspect_file
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import InputError, OslAnalysisError, listing, printable, unexpected
from osl_analysis.files import write_text
from osl_analysis.formats import recognise
from osl_analysis.ingest.draft import draft_source, guessed_lines, to_be_edited
from osl_analysis.ingest.draft_sheet import UNNAMED, draft_trials, trial_name
from osl_analysis.ingest.examine import Commanded, examine, measured_table
from osl_analysis.ingest.raw_files import read_source, recorded_files, recordings_in
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.judge.recording_checks import judged_table
from osl_analysis.judge.words import finding_text
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.trial import Trial

State = list[int]  # size [bytes] and date [ns] of a recording's files
LOOKS_S = 0.5  # between two looks into the folder
RESTS_S = 4.0  # for which a recording has not grown that is taken for complete
LONG_REST_S = 20.0  # the same of one that is empty, or grew after it had rested before


@dataclass
class Arrivals:
    """Which recordings in a folder are complete and new."""

    folder: Path
    # that were examined, by their path in the folder
    seen: dict[str, State] = field(default_factory=dict)
    # others, and since when they rest [s]
    growing: dict[str, tuple[State, float]] = field(default_factory=dict)

    def complete(self, now: float) -> list[tuple[Path, State]]:
        """Recordings that are new, or other than when they were examined, and have rested. The
        caller enters them in `seen` once they are examined."""
        complete: list[tuple[Path, State]] = []
        for path in recordings_in(self.folder):
            name = path.relative_to(self.folder).as_posix()
            try:
                stats = [file.stat() for file in recorded_files(path)]
            except OSError:  # it is gone
                continue
            state = [
                sum(stat.st_size for stat in stats),
                max((stat.st_mtime_ns for stat in stats), default=0),
            ]
            if self.seen.get(name) == state:
                continue
            before, since = self.growing.get(name, (None, now))
            may_grow_again = name in self.seen or state[0] == 0
            if before != state:
                self.growing[name] = (state, now)
            elif now - since >= (LONG_REST_S if may_grow_again else RESTS_S):
                complete.append((path, state))
        return complete


class WatchedBench:
    """What recordings are examined with, from a configuration and, if it has one, its sample sheet,
    which may name a recording. `source` is a stated source file; without one: the sheet's, else one
    of the folder that fits, else a guess. `output` is the folder of pictures and of the notes on
    what was examined."""

    def __init__(self, config_path: Path, source: Path | None, output: Path) -> None:
        self.config_path = config_path
        self.output = output
        self.config = read_config(config_path, of_any=True)
        self.source: str | None = None
        if source is not None:
            read_source(source)
            self.source = source.stem
            self.config = self.config.model_copy(update={"sources": source.parent})
        # what is not checked on any recording of this kind, which the first one says
        self.told: set[str] = set()
        has_sheet = self.config.simulation is None and self.config.sheet.is_file()
        self.campaign = open_campaign(self.config, None) if has_sheet else None


def watched_lines(folder: Path, bench: WatchedBench) -> Iterator[str]:
    """A line for each recording in a folder, and for each that comes, as soon as it is complete. It
    never ends."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the one that the recorder writes to")
    notes = bench.output / "examined.json"
    arrivals = Arrivals(folder, read_notes(notes))
    analysed = read_notes(notes)
    while True:
        for path, state in arrivals.complete(time.monotonic()):
            line, is_analysed = recording_line(path, folder, bench)
            name = path.relative_to(folder).as_posix()
            arrivals.seen[name] = state
            if is_analysed:  # a restart tries the others again
                analysed[name] = state
                write_text(notes, json.dumps(analysed, indent=1) + "\n")
            yield line
        time.sleep(LOOKS_S)


def recording_line(path: Path, folder: Path, bench: WatchedBench) -> tuple[str, bool]:
    """What is said of one recording: estimates with intervals, quality, doubts, and where its
    picture is, of measured and modelled torque; and whether it could be analysed."""
    begin = f"{time.strftime('%H:%M:%S')} {path.relative_to(folder).as_posix()}: "
    try:
        return begin + "; ".join(examined(path, folder, bench)), True
    except OslAnalysisError as error:
        return f"{begin}REFUSED: {str(error).replace(f'{path}: ', '')}", False
    # a fault of the program in one recording must not end the watch over the others
    except Exception as fault:
        return f"{begin}FAILED: {unexpected(fault)}", False


def examined(path: Path, folder: Path, bench: WatchedBench) -> Iterator[str]:
    """What is said of one recording, part by part; errors are the caller's."""
    with TemporaryDirectory() as place:
        described = row_of_recording(path, folder, bench, Path(place))
        row = described.row
        experiment = str(row["experiment"])
        if not row["log"]:  # a capture, whose fits need all crossings of the campaign
            yield f"{experiment.replace('_', ' ')} capture, skipped: `osl-analysis run` analyses it"
            return
        trial = checked_trial(row, path.parent, described.sources)
    remarks = [*described.guesses]
    remarks += [printable(text) for text in trial.provenance.get("warnings", [])]
    accepted = str(row.get("accept") or "").split()
    remarks.append(quality_text(trial, experiment, bench.config, accepted))
    if EXPERIMENTS[experiment].place != "bench":
        yield from remarks
        return

    fitted = fit_of_row(trial, row, device_of_row(row, bench.config), bench.config_path)
    estimates = fitted.row
    yield ", ".join(estimate_texts(estimates))
    if "VAF" in estimates:
        yield f"VAF {estimates['VAF']:.2f} %"
    yield from (f"DOUBTFUL: {text}" for text in fitted.sentences(Grade.DOUBTS))
    yield beside_siblings(
        path.relative_to(folder).as_posix(),
        kind_of(row),
        comparable(trial, row, estimates),
        bench.output / "measured.json",
    )
    yield from remarks
    yield from unchecked_texts(fitted, bench)
    yield from (f"REMARK: {text}" for text in fitted.sentences(Grade.NOTES))
    if not fitted.series.is_empty():
        yield drawn_picture(fitted, bench.output / f"{row['trial']}.png")


def unchecked_texts(fitted: Fit, bench: WatchedBench) -> Iterator[str]:
    """What could not be checked, as far as no earlier recording has told it."""
    for finding in fitted.findings[-1] if fitted.findings else ():
        if finding.grade is Grade.UNCHECKED and finding.name not in bench.told:
            bench.told.add(finding.name)
            yield f"NOT CHECKED: {finding_text(finding, fitted.row)}"


def drawn_picture(fitted: Fit, picture: Path) -> str:
    """Draw measured and modelled torque; the name of the picture, or why there is none."""
    from osl_analysis.commands.figure import draw_table  # matplotlib takes half a second

    try:
        draw_table("torque", fitted.series, [picture])
    except OslAnalysisError as error:
        return f"no picture: {error}"
    return str(picture)


def estimate_texts(estimates: Mapping[str, Any]) -> Iterator[str]:
    """Each estimate with its interval and unit, as `K 300 ± 2 N·m/rad`."""
    for name in compared_in(estimates):
        high = estimates.get(f"{name}_high")
        half_width = "" if high is None else f" ± {high - estimates[name]:.2g}"
        yield f"{name} {estimates[name]:.4g}{half_width} {printed_units().get(name, '')}".rstrip()


def device_of_row(row: Mapping[str, Any], config: Config) -> Path | None:
    """The parameter file of the configuration where it is that of the row's joint, as for a
    campaign's trial."""
    device = config.parameters
    if device is None or row.get("joint") not in (None, joint_of(device)):
        return None
    return device


@dataclass(frozen=True)
class DescribedRecording:
    """How a recording is read."""

    row: Mapping[str, Any]  # of a sample sheet
    sources: Path  # folder of its source file
    guesses: Sequence[str] = ()  # what of it is a guess, in words


def row_of_recording(
    path: Path, folder: Path, bench: WatchedBench, place: Path
) -> DescribedRecording:
    """Find how to read a recording.

    The sheet decides; else the stated source file; else one of the campaign's that fits; else a
    draft, which is written to `place`.

    Raises
    ------
    InputError
        The draft has open places.
    """
    stated = row_of_sheet(path, bench)
    if stated is not None:
        return DescribedRecording(stated, bench.config.sources)
    sources = bench.config.sources
    source = bench.source
    guesses: list[str] = []
    if source is None and bench.campaign is not None:
        source = fitting_source(path, sources)
    if source is None:
        sources = place
        source = "draft"
        guesses = drafted_guesses(path, place / "draft.yaml")
    ((cells, _),) = draft_trials([(Path(path.name), source, False)])
    columns = ("log_part", "mocap", "mocap_source", "K_d", "B_d", "controller")
    name = trial_name(Path(path.relative_to(folder).as_posix().replace("/", "_")))
    row = {**dict.fromkeys(columns), **cells, "trial": name}
    # a recording with angle and torque whose name and sheet tell none
    if row["experiment"] == UNNAMED:
        row["experiment"] = "impedance"
        guesses.append("taken for an impedance trial")
    return DescribedRecording(row, sources, guesses)


def row_of_sheet(path: Path, bench: WatchedBench) -> dict[str, Any] | None:
    """The row of the campaign's sheet that names a recording; None without one."""
    if bench.campaign is None:
        return None
    for row in bench.campaign.rows.values():
        for role in ("log", "mocap"):
            if row[role] and (bench.config.raw_data / row[role]).resolve() == path.resolve():
                return {**row, role: path.name}
    return None


def fitting_source(path: Path, sources: Path) -> str | None:
    """The first source file of a folder by which a recording can be read; None without one."""
    for file in sorted(sources.glob("*.yaml")):
        row = {"trial": path.stem, "log": path.name, "log_source": file.stem}
        with suppress(OslAnalysisError):
            if read_source(file).format == recognise(path).name:
                checked_trial(row, path.parent, sources)
                return file.stem
    return None


def drafted_guesses(path: Path, draft: Path) -> list[str]:
    """Draft a source file for a recording, and tell what of it is a guess. Raises InputError: it
    has open places."""
    overview = inspect_file(path)
    text = draft_source(overview, path.name)
    draft.write_text(text, encoding="utf-8")
    still_open = to_be_edited(draft)
    if still_open:
        questions = [f"open are {listing(still_open, 4)}", *overview.remarks, *overview.open]
        raise InputError(
            f"{path}: its channels cannot be guessed: {'; '.join(map(printable, questions))}; edit"
            " the draft of `osl-analysis inspect`, and name it by --source"
        )
    channels = [line.split("#")[0].strip() for line in guessed_lines(text)]
    guesses = [f"channels are guessed: {listing(channels, 4)}"] if channels else []
    return guesses + [printable(question) for question in overview.open]


def quality_text(trial: Trial, experiment: str, config: Config, accepted: Collection[str]) -> str:
    """The checks that a trial does not pass, and that are not accepted; `quality ok` if there are
    none."""
    commanded = Commanded(**{name: getattr(config.dynamometer, name) for name in PROTOCOL})
    measured = measured_table(trial.name, examine(trial, experiment, commanded))
    table = judged_table(measured, config.quality, {trial.name: accepted})
    failed = table.filter(pl.col("verdict").is_in(["flag", "exclude"]))
    if failed.is_empty():
        return "quality ok"
    named = []
    for row in failed.to_dicts():  # key, cause, what was found, and what to do
        kind = FINDINGS[CHECKS[row["check"]].finding]
        what_to_do = ", ".join(filter(None, [row["remark"], kind.remedy]))
        named.append(f"{row['verdict']} {row['check']}: {kind.title}, {what_to_do}")
    return f"QUALITY {', '.join(named)}"
