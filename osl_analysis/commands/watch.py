"""A look at recordings: at the first ones of a new campaign, and at each as it comes.

Texts from files are untrusted: they are escaped when they are printed."""

import json
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import Config, read_config
from osl_analysis.commands import bench as fits
from osl_analysis.commands.estimates import estimated, estimates_text, printed_units
from osl_analysis.commands.trials import checked_trial, inspect_file
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import InputError, OslAnalysisError, listing, printable, unexpected
from osl_analysis.files import CAMPAIGN, write_text
from osl_analysis.formats import recognise
from osl_analysis.ingest.draft import draft_source, guessed_lines, to_be_edited
from osl_analysis.ingest.draft_sheet import UNNAMED, draft_trials, trial_name
from osl_analysis.ingest.examine import Commanded, examine, measured_table
from osl_analysis.ingest.raw_files import read_source, recorded_files, recordings_in
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.limits import CHECKS, judged_table
from osl_analysis.judge.words import check_words, finding_text
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness, find_segments, stated_protocol
from osl_analysis.trial import Trial


@dataclass(frozen=True)
class FirstLook:
    """What the first trial of an experiment and source file gives."""

    trial: str
    experiment: str
    lines: Sequence[str]  # its estimates and findings, or why it is refused
    doubts: Sequence[str] = ()
    warnings: Sequence[str] = ()  # of its recordings, as rows that were left out
    is_refused: bool = False

    @property
    def title(self) -> str:
        """The trial, and what became of it."""
        result = "refused" if self.is_refused else "doubtful" if self.doubts else "ok"
        return f"first trial of experiment {self.experiment}, {self.trial}: {result}"

    @property
    def text(self) -> str:
        """All of it."""
        return "\n  ".join([self.title, *self.lines, *self.warnings])


def first_look(folder: Path, is_new: bool = False) -> Iterator[FirstLook]:
    """What the first trial of each experiment and source file of a folder's campaign gives.

    Of a new campaign, the stepped sine of the first trial that has one goes into the configuration
    as a comment. Nothing else is left behind.
    """
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        for trial, experiment in first_trials(campaign):
            try:
                recorded = checked_trial(campaign.recording(trial), config.raw_data, config.sources)
                if is_new and EXPERIMENTS[experiment].stepped_sine:
                    with suppress(OslAnalysisError):  # the fit says why
                        is_new = not note_protocol(recorded, config)
                row = campaign.row(trial)
                fitted = fit_of_row(recorded, row, campaign.device(trial), CAMPAIGN)
            except OslAnalysisError as error:
                yield FirstLook(trial, experiment, [str(error)], is_refused=True)
            # a fault of the program in one recording must not hide the others
            except Exception as fault:
                yield FirstLook(trial, experiment, [unexpected(fault)], is_refused=True)
            else:
                text = estimates_text(fitted.table, fitted.findings)
                doubts = [
                    finding_text(finding, estimates)
                    for estimates, of_row in zip(
                        fitted.table.to_dicts(), fitted.findings, strict=False
                    )
                    for finding in of_row
                    if finding.grade is Grade.DOUBTS
                ]
                warnings = [f"warning: {text}" for text in recorded.provenance["warnings"]]
                yield FirstLook(trial, experiment, text.splitlines(), doubts, warnings)


def first_trials(campaign: Campaign) -> list[tuple[str, str]]:
    """The first trial of each experiment on a bench and source file, with its experiment."""
    first: dict[tuple[str, str], str] = {}
    for trial in campaign.trials(
        *(name for name, facts in EXPERIMENTS.items() if facts.place == "bench")
    ):
        row = campaign.row(trial)
        first.setdefault((row["experiment"], row["log_source"] or row["mocap_source"]), trial)
    return [(trial, experiment) for (experiment, _), trial in first.items()]


def note_protocol(trial: Trial, config: Config) -> bool:
    """Write the stepped sine of a trial into the configuration, as a comment; whether it has
    one."""
    angle = uniform_signals(trial, ["theta"], config.dynamometer.gap_limits)
    known = Likeness(angle.time, angle["theta"], stated_protocol(None, None, None, None))
    if known.kind != "stepped sine":
        return False
    found = sorted(find_segments(known), key=lambda one: one.frequency_hz)
    sizes = sorted({round(np.rad2deg(one.commanded or 0.0), 1) for one in found})
    cycles = {one.frequency_hz: one.cycles for one in found}
    lines = [f"# dynamometer:  # as {trial.name} was recorded"]
    for name, values in (
        ("amplitudes_deg", sizes),
        ("frequencies_hz", cycles),
        ("cycles", cycles.values()),
    ):
        lines.append(f"#   {name}: [{', '.join(f'{value:.3g}' for value in values)}]")
    text = CAMPAIGN.read_text(encoding="utf-8")
    write_text(CAMPAIGN, text.replace("# dynamometer:\n", "\n".join([*lines, ""])))
    return True


def fit_of_row(trial: Trial, row: Mapping[str, Any], device: Path | None, config: Path) -> fits.Fit:
    """The fit of a trial in memory, by its row of a sheet, as in the workflow. `device` is its
    parameter file."""
    experiment = str(row["experiment"])
    condition: Any = {column: row.get(column) for column in fits.job_of(experiment).sheet}
    if experiment == "impedance":
        K_d, B_d = (None if row[name] is None else float(row[name]) for name in ("K_d", "B_d"))
        condition = DesiredImpedance(row["controller"], K_d, B_d)
    chosen = fits.fit_settings(experiment, config)
    return fits.fit_trial(experiment, trial, device, *chosen, condition, row.get("windows"))


State = list[int]  # size [bytes] and date [ns] of a recording's files


@dataclass
class Arrivals:
    """Which recordings in a folder are complete and new."""

    folder: Path
    # that were examined, by their path in the folder
    seen: dict[str, State] = field(default_factory=dict)
    # others, and since when they rest [s]
    growing: dict[str, tuple[State, float]] = field(default_factory=dict)

    def complete(self, now: float) -> list[tuple[Path, State]]:
        """Recordings that are new, or other than when they were examined, and have rested for 4 s;
        for 20 s if they are empty, or grew after they had rested before. The caller enters them in
        `seen` once they are examined."""
        found: list[tuple[Path, State]] = []
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
            if before != state:
                self.growing[name] = (state, now)
            elif now - since >= (20.0 if name in self.seen or not state[0] else 4.0):
                found.append((path, state))
        return found


def read_notes(path: Path) -> dict[str, Any]:
    """What was noted of recordings that were examined before, by name; nothing without notes, or
    with damaged ones."""
    with suppress(OSError, ValueError, TypeError):
        return {**json.loads(path.read_text(encoding="utf-8"))}
    return {}


class WatchedBench:
    """What recordings are examined with, from a configuration and, if it has one, its sample sheet,
    which may name a recording. `source` is a stated source file; without one: the sheet's, else one
    of the folder that fits, else a guess. `output` is the folder of pictures and of the notes on
    what was examined."""

    def __init__(self, config_path: Path, source: Path | None, output: Path) -> None:
        self.config_path, self.config, self.output = (
            config_path,
            read_config(config_path, of_any=True),
            output,
        )
        self.source = None if source is None else source.stem
        if source is not None:
            read_source(source)
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
    arrivals, noted = Arrivals(folder, read_notes(notes)), read_notes(notes)
    while True:
        for path, state in arrivals.complete(time.monotonic()):
            (said, is_analysed), name = (
                recording_line(path, folder, bench),
                path.relative_to(folder).as_posix(),
            )
            arrivals.seen[name] = state
            if is_analysed:  # a restart tries the others again
                noted[name] = state
                write_text(notes, json.dumps(noted, indent=1) + "\n")
            yield said
        time.sleep(0.5)


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
    with TemporaryDirectory() as place:
        row, sources, said = row_of_recording(path, folder, bench, Path(place))
        if not row["log"]:  # a capture, whose fits need all crossings of the campaign
            yield (
                f"{str(row['experiment']).replace('_', ' ')} capture, skipped: `osl-analysis run`"
                " analyses it"
            )
            return
        trial = checked_trial(row, path.parent, sources)
    accepted = str(row.get("accept") or "").split()
    warned = [printable(text) for text in trial.provenance.get("warnings", [])]
    said = [*said, *warned, quality_text(trial, str(row["experiment"]), bench.config, accepted)]
    if EXPERIMENTS[str(row["experiment"])].place != "bench":
        yield from said
        return
    fitted = fit_of_row(trial, row, device_of_row(row, bench.config), bench.config_path)
    estimates = fitted.table.to_dicts()[-1]  # those of the fit to all data
    yield ", ".join(estimates_said(estimates))
    if "VAF" in estimates:
        yield f"VAF {estimates['VAF']:.2f} %"
    yield from (f"DOUBTFUL: {text}" for text in fitted.sentences(Grade.DOUBTS))
    kind = [
        str(row[name]) if row.get(name) else ""
        for name in ("experiment", "joint", "side", "controller")
    ]
    kind += ["" if row.get(name) is None else f"{float(row[name]):g}" for name in ("K_d", "B_d")]
    name = path.relative_to(folder).as_posix()
    yield from beside_siblings(
        name, kind, comparable(trial, row, estimates), bench.output / "measured.json"
    )
    yield from said
    for one in fitted.findings[-1] if fitted.findings else ():
        if one.grade is Grade.UNCHECKED and one.cause not in bench.told:
            bench.told.add(one.cause)
            yield f"NOT CHECKED: {finding_text(one, fitted.row)}"
    yield from (f"REMARK: {text}" for text in fitted.sentences(Grade.NOTES))
    if not fitted.series.is_empty():
        picture = bench.output / f"{row['trial']}.png"
        try:
            from osl_analysis.commands.figure import draw_table  # matplotlib takes half a second

            draw_table("torque", fitted.series, [picture])
            yield str(picture)
        except OslAnalysisError as error:
            yield f"no picture: {error}"


def compared_in(estimates: Mapping[str, Any]) -> list[str]:
    return [name for name in estimated(estimates) if name not in ("offset", "drift")]


def estimates_said(estimates: Mapping[str, Any]) -> Iterator[str]:
    for name in compared_in(estimates):
        high = estimates.get(f"{name}_high")
        half = "" if high is None else f" ± {high - estimates[name]:.2g}"
        yield f"{name} {estimates[name]:.4g}{half} {printed_units().get(name, '')}".rstrip()


def comparable(
    trial: Trial, row: Mapping[str, Any], estimates: Mapping[str, Any]
) -> dict[str, tuple[float, float]]:
    """Numbers that are alike in recordings of one kind, each with the smallest standard deviation
    that it is granted: 1 % of an estimate or its standard error, 5 % of duration, rate and range;
    and the signs of channels. Of impedance trials without K_d nothing is compared: any two of these
    may have been asked for another."""
    found = dict[str, tuple[float, float]]()
    if row.get("experiment") == "impedance" and row.get("K_d") is None:
        return found
    for name in compared_in(estimates):
        value, se = float(estimates[name]), float(estimates.get(f"{name}_se") or 0.0)
        found[name] = value, max(se, 0.01 * abs(value))
    time_s = trial.samples["time"].to_numpy()
    extents = {
        "duration in s": time_s[-1] - time_s[0],
        "rate in Hz": (len(time_s) - 1) / (time_s[-1] - time_s[0]),
    }
    if "theta" in trial.samples.columns:
        low, high = np.nanquantile(trial.samples["theta"].to_numpy(), (0.01, 0.99))
        extents["range of the angle in deg"] = np.rad2deg(high - low)
    found |= {name: (float(value), 0.05 * float(value)) for name, value in extents.items()}
    mapped = trial.provenance.get("columns", {})  # a guessed sign makes any torque resist
    return found | {f"sign of {name}": (float(one["sign"]), 0.1) for name, one in mapped.items()}


def beside_siblings(
    name: str, kind: Sequence[str], numbers: Mapping[str, tuple[float, float]], notes: Path
) -> Iterator[str]:
    """Whether a recording is like three or more of its kind before it, joint, controller and what
    was asked for, by median and median absolute deviation of each number. What it has is added to
    the notes."""
    known = read_notes(notes)
    siblings = [
        one["numbers"]
        for other, one in known.items()
        if other != name and one["kind"] == list(kind)
    ]
    known[name] = {
        "kind": list(kind),
        "numbers": {key: value for key, (value, _) in numbers.items()},
    }
    with suppress(OslAnalysisError):  # the picture says why nothing is written there
        write_text(notes, json.dumps(known, indent=1) + "\n")
    far, most = list[str](), 0
    for key, (value, least) in numbers.items():
        others = [one[key] for one in siblings if key in one]
        if len(others) >= 3:
            most = max(most, len(others))
            middle = float(np.median(others))
            spread = max(scipy.stats.median_abs_deviation(others, scale="normal"), least)
            if abs(value - middle) > 4 * spread:
                far.append(f"{key} is {value:.3g}, theirs {middle:.3g} ± {spread:.1g}")
    if far:
        yield (
            f"DIFFERS from its {most} siblings: {listing(far, 4)}: look for what changed on the"
            " bench"
        )
    elif most:
        yield f"like its {most} siblings"
    else:
        yield (
            f"{len(siblings)} siblings to compare with, 3 are needed"
            if numbers
            else "no siblings: no K_d is stated"
        )


def device_of_row(row: Mapping[str, Any], config: Config) -> Path | None:
    """The parameter file of the configuration where it is that of the row's joint, as for a
    campaign's trial."""
    device = config.parameters
    return device if device is not None and row.get("joint") in (None, joint_of(device)) else None


def row_of_recording(
    path: Path, folder: Path, bench: WatchedBench, place: Path
) -> tuple[Mapping[str, Any], Path, list[str]]:
    """A row for a recording, the folder of its source file, and what of it is a guess. The sheet
    decides; else the stated source file; else one of the campaign's that fits; else a draft in
    `place`."""
    for named in bench.campaign.rows.values() if bench.campaign else ():
        for role in ("log", "mocap"):
            if named[role] and (bench.config.raw_data / named[role]).resolve() == path.resolve():
                return {**named, role: path.name}, bench.config.sources, []
    sources, source, said = bench.config.sources, bench.source, list[str]()
    for file in sorted(sources.glob("*.yaml")) if bench.campaign and source is None else ():
        with suppress(OslAnalysisError):
            if read_source(file).format == recognise(path).name:
                checked_trial(
                    {"trial": path.stem, "log": path.name, "log_source": file.stem},
                    path.parent,
                    sources,
                )
                source = file.stem
                break
    if source is None:
        overview = inspect_file(path)
        text = draft_source(overview, path.name)
        sources = place
        source = "draft"
        (place / "draft.yaml").write_text(text, encoding="utf-8")
        still_open = to_be_edited(place / "draft.yaml")
        if still_open:
            asked = [f"open are {listing(still_open, 4)}", *overview.remarks, *overview.open]
            questions = "; ".join(map(printable, asked))
            raise InputError(
                f"{path}: its channels cannot be guessed: {questions}; edit the draft of"
                " `osl-analysis inspect`, and name it by --source"
            )
        guesses = [line.split("#")[0].strip() for line in guessed_lines(text)]
        said = [f"channels are guessed: {listing(guesses, 4)}"] * bool(guesses)
        said += [printable(one) for one in overview.open]
    ((cells, _),) = draft_trials([(Path(path.name), source, False)])
    row = dict.fromkeys(("log_part", "mocap", "mocap_source", "K_d", "B_d", "controller")) | cells
    row["trial"] = trial_name(Path(path.relative_to(folder).as_posix().replace("/", "_")))
    # a recording with angle and torque whose name and sheet tell none
    if row["experiment"] == UNNAMED:
        row["experiment"], said = "impedance", [*said, "taken for an impedance trial"]
    return row, sources, said


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
        cause = CHECKS[row["check"]].cause
        what_to_do = ", ".join(filter(None, [row["remark"], check_words(cause).remedy]))
        named.append(f"{row['verdict']} {row['check']}: {cause}, {what_to_do}")
    return f"QUALITY {', '.join(named)}"
