"""Recordings examined as they come, while the rig is still warm: a line and a picture for each that is complete."""

import json
import os
import re
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import polars as pl

from osl_analysis.campaign import Campaign, open_campaign
from osl_analysis.commands.figure import draw_table
from osl_analysis.commands.fit import UNITS, estimated
from osl_analysis.commands.inspect import fit_of_row, inspect_file, off_desired
from osl_analysis.commands.new_campaign import recordings_in
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config import Config, read_config
from osl_analysis.errors import InputError, OslAnalysisError, listing, printable, unexpected
from osl_analysis.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.files import atomic_path
from osl_analysis.formats.rosbag import recorded_files
from osl_analysis.ingest.draft import UNNAMED, Recorded, draft_source, draft_trials, guessed_lines, trial_name
from osl_analysis.ingest.known_formats import read_source, recognise
from osl_analysis.ingest.overview import open_places
from osl_analysis.judge.recording import CHECKS, examine, quality_table
from osl_analysis.judge.table import Commanded
from osl_analysis.parameters import joint_of
from osl_analysis.sheet import JOINT
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import dotted, read_mapping

QUIET_S = 4.0  # A recording is complete if nothing was written to it for this long [s]; up to 20 s if it paused before

State = tuple[int, int]  # size [bytes] and date of the last change [ns] of all files of a recording


@dataclass
class Arrivals:
    """Which recordings in a folder are complete and new."""

    folder: Path
    seen: dict[str, State] = field(default_factory=dict)
    """Recordings that were examined, by their path in the folder."""
    growing: dict[str, tuple[State, float]] = field(default_factory=dict)
    """Those that are not, with the time [s] since which they have been as they are."""
    pauses: dict[str, float] = field(default_factory=dict)
    """The longest time [s] between two changes of a recording that was seen to grow."""

    def complete(self, now: float) -> list[tuple[Path, State]]:
        """Recordings that are new, or other than when they were examined, and rest: they have not changed for
        `QUIET_S`, or twice as long as they paused before, and no process writes to them.

        The caller enters them in `seen` once they are examined.
        """
        found = []
        for path in recordings_in(self.folder):
            name, state = path.relative_to(self.folder).as_posix(), recording_state(path)
            if state is None or self.seen.get(name) == state:
                continue
            before, since = self.growing.get(name, (None, now))
            if before != state:
                grew = before is not None or name in self.seen
                self.pauses[name] = max(self.pauses.get(name, 0.0), now - since if grew else 0.0)
                since = now
            self.growing[name] = (state, since)
            quiet = min(max(QUIET_S, 2 * self.pauses.get(name, 0.0)), 20.0)
            if before == state and now - since >= quiet and not is_written(path):
                found.append((path, state))
        return found


def recording_state(path: Path) -> State | None:
    """Size and date of a recording, of all files of one that is a folder; None if it is gone or empty."""
    try:
        states = [file.stat() for file in recorded_files(path)]
    except OSError:
        return None
    size = sum(state.st_size for state in states)
    return (size, max(state.st_mtime_ns for state in states)) if size else None


def is_written(path: Path) -> bool:
    """Whether a process of this machine has a file of a recording open for writing, as far as the system tells (Linux,
    by the last digit of the file's flags)."""
    files = {str(file.resolve()) for file in recorded_files(path)}
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with suppress(OSError):  # it is closed again, or belongs to somebody else
            flags = link.parents[1] / "fdinfo" / link.name
            if os.readlink(link) in files and re.search(r"^flags:\s*\d*[12]$", flags.read_text(), re.MULTILINE):
                return True
    return False


def read_notes(path: Path) -> dict[str, State]:
    """The recordings that were examined before; none without notes, or with damaged ones."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): (int(size), int(date)) for name, (size, date) in content.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def write_notes(path: Path, seen: Mapping[str, State]) -> None:
    """Note what was examined, so that a restart does not repeat it."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")


MOST_FAILED = 4  # largest number of failed checks in a line


@dataclass(frozen=True)
class WatchedBench:
    config_path: Path
    config: Config
    campaign: Campaign | None  # the campaign whose sheet may name a recording; None without a sheet
    source: str | None
    """The source file that describes the recordings; None: the sheet's, else one of the folder that fits, else a
    guess."""
    output: Path  # folder of pictures and of the notes on what was examined


def bench_of(config_path: Path, source: Path | None, output: Path) -> WatchedBench:
    """What recordings are examined with, from a configuration and, if it has one, its sample sheet."""
    config = read_config(config_path)
    if source is not None:
        read_source(source)
        config = config.model_copy(update={"sources": source.parent})
    campaign = open_campaign(config, None) if config.simulation is None and config.sheet.is_file() else None
    return WatchedBench(config_path, config, campaign, None if source is None else source.stem, output)


def watch(folder: Path, bench: WatchedBench) -> Iterator[str]:
    """A line for each recording in a folder, and for each that comes, as soon as it is complete. It never ends."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the one that the recorder writes to")
    notes = bench.output / "examined.json"
    arrivals = Arrivals(folder, read_notes(notes))
    while True:
        for path, state in arrivals.complete(time.monotonic()):
            said = recording_line(path, folder, bench)
            arrivals.seen[path.relative_to(folder).as_posix()] = state
            write_notes(notes, arrivals.seen)
            yield said
        time.sleep(0.5)


def recording_line(path: Path, folder: Path, bench: WatchedBench) -> str:
    """What is said of one recording: estimates with intervals, quality, doubts, and where its picture is."""
    stamp, name = time.strftime("%H:%M:%S"), path.relative_to(folder).as_posix()
    try:
        return f"{stamp} {name}: {examined(path, folder, bench)}"
    except OslAnalysisError as error:
        return f"{stamp} {name}: REFUSED: {str(error).replace(f'{path}: ', '')}"
    except Exception as fault:  # a fault of the program in one recording must not end the watch over the others
        return f"{stamp} {name}: FAILED: {unexpected(fault)}"


def examined(path: Path, folder: Path, bench: WatchedBench) -> str:
    """The same, without the name. Measured and modelled torque are drawn."""
    with TemporaryDirectory() as place:
        row, sources, said = row_of_recording(path, folder, bench, Path(place))
        trial = checked_trial(row, path.parent, sources)
    accepted = str(row.get("accept") or "").split()
    said = [*said, quality_text(trial, str(row["experiment"]), bench.config, accepted)]
    if EXPERIMENTS[str(row["experiment"])].place != "bench":
        return "; ".join(said)
    fitted = fit_of_row(trial, row, device_of_row(row, bench.config), bench.config_path)
    far = off_desired(fitted.estimates, row)
    said = [estimates_line(fitted.estimates), *[f"LOOK AT IT: {far}"] * bool(far), *said]
    if fitted.series.is_empty():
        return "; ".join(said)
    picture = bench.output / f"{row['trial']}.png"
    try:
        draw_table("torque", fitted.series, [picture])
    except OslAnalysisError as error:
        return "; ".join([*said, f"no picture: {error}"])
    return "; ".join([*said, str(picture)])


def device_of_row(row: Mapping[str, Any], config: Config) -> Path | None:
    """The parameter file of the configuration where it is that of the row's joint, as for a campaign's trial."""
    device = config.parameters
    return device if device is not None and joint_of(device) == (row.get("joint") or JOINT) else None


def row_of_recording(
    path: Path, folder: Path, bench: WatchedBench, place: Path
) -> tuple[Mapping[str, Any], Path, list[str]]:
    """A row for a recording, the folder of its source file, and what of it is a guess.

    The sheet decides; else the stated source file; else one of the campaign's that fits; else a draft in `place`.
    """
    named = row_in_sheet(path, bench)
    if named is not None:
        return {**named, "log": path.name}, bench.config.sources, []
    relative = path.relative_to(folder)
    if bench.source is not None:
        source, sources, said = bench.source, bench.config.sources, list[str]()
    else:
        source, sources, said = fitting_source(path, bench, place)
    (trial,) = draft_trials([Recorded(Path(path.name), source, is_capture=False)])
    row = dict.fromkeys(("log_part", "mocap", "mocap_source", "K_d", "B_d", "controller")) | trial.cells
    row["trial"] = trial_name(Path(relative.as_posix().replace("/", "_")))
    if row["experiment"] == UNNAMED:  # a recording with angle and torque whose name and sheet tell none
        row["experiment"], said = "impedance", [*said, "taken for an impedance trial"]
    return row, sources, said


def row_in_sheet(path: Path, bench: WatchedBench) -> Mapping[str, Any] | None:
    """The row of the sample sheet that names a recording as its log; None if none does."""
    if bench.campaign is None:
        return None
    for trial in bench.campaign.trials():
        row = bench.campaign.row(trial)
        if row["log"] and (bench.config.raw_data / row["log"]).resolve() == path.resolve():
            return row
    return None


def fitting_source(path: Path, bench: WatchedBench, place: Path) -> tuple[str, Path, list[str]]:
    """Name and folder of a source file for a recording, and what of it is a guess."""
    found = recognise(path)
    for file in sorted(bench.config.sources.glob("*.yaml")) if bench.source is None and bench.campaign else ():
        try:
            if read_source(file).format != found:
                continue
            checked_trial({"trial": path.stem, "log": path.name, "log_source": file.stem}, path.parent, file.parent)
        except OslAnalysisError:
            continue
        return file.stem, file.parent, []
    overview = inspect_file(path)
    text = draft_source(overview, path.name, named=True)
    (place / "draft.yaml").write_text(text, encoding="utf-8")
    guesses = [line.split("#")[0].strip() for line in guessed_lines(text)]
    places = [f"`{dotted(one)}`" for one in open_places(read_mapping(place / "draft.yaml"))]
    if places:
        questions = "; ".join(printable(text) for text in overview.open) or f"open are {listing(places, MOST_FAILED)}"
        raise InputError(
            f"{path}: its channels cannot be guessed: {questions}; edit the draft of `osl-analysis inspect`, and name "
            "it by --source"
        )
    said = [f"channels are guessed: {listing(guesses, MOST_FAILED)}"] * bool(guesses)
    return "draft", place, [*said, *(printable(text) for text in overview.open)]


def quality_text(trial: Trial, experiment: str, config: Config, accepted: Collection[str]) -> str:
    """The checks that a trial does not pass, and that are not accepted; `quality ok` if there are none."""
    commanded = Commanded(**{name: getattr(config.dynamometer, name) for name in PROTOCOL})
    table = quality_table(trial.name, examine(trial, experiment, commanded), config.quality, accepted)
    failed = table.filter(pl.col("verdict").is_in(["flag", "exclude"]))
    if failed.is_empty():
        return "quality ok"
    named = [failed_check(row["verdict"], row["check"], row["remark"]) for row in failed.to_dicts()]
    return f"QUALITY {listing(named, MOST_FAILED)}"


def failed_check(verdict: str, name: str, remark: str) -> str:
    """A check that a trial does not pass: its key, cause, what was found, and what to do."""
    cause = CHECKS[name].cause
    return f"{verdict} {name}: {cause.name}, {', '.join(filter(None, [remark.replace('; ', ', '), cause.remedy]))}"


def estimates_line(estimates: pl.DataFrame) -> str:
    """The estimates of the fit to all data, with 95 % intervals, and its doubts."""
    row = estimates.to_dicts()[-1]
    values = []
    for name in (n for n in estimated(row) if n not in ("offset", "drift")):
        high = row.get(f"{name}_high")
        half = "" if high is None else f" ± {high - row[name]:.2g}"
        values.append(f"{name} {row[name]:.4g}{half} {UNITS.get(name, '')}".rstrip())
    quality = [f"VAF {row['VAF']:.2f} %"] if "VAF" in row else []
    doubts = f"; DOUBTFUL: {row['doubtful']}" if row.get("doubtful") else ""
    return f"{'; '.join([', '.join(values), *quality])}{doubts}"
