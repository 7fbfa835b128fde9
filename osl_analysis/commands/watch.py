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
from osl_analysis.commands import fit as fits
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
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.judge.recording_checks import judged_table
from osl_analysis.judge.words import finding_text
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
        """The trial, and whether it is refused or doubtful."""
        result = "doubtful" if self.doubts else "ok"
        if self.is_refused:
            result = "refused"
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
                warnings = [f"warning: {text}" for text in recorded.provenance["warnings"]]
                yield FirstLook(trial, experiment, text.splitlines(), doubts_of(fitted), warnings)


def doubts_of(fitted: fits.Fit) -> list[str]:
    """The doubts about each row of a fit, in words."""
    doubts = []
    for row, findings in zip(fitted.table.to_dicts(), fitted.findings, strict=False):
        for finding in findings:
            if finding.grade is Grade.DOUBTS:
                doubts.append(finding_text(finding, row))
    return doubts


def first_trials(campaign: Campaign) -> list[tuple[str, str]]:
    """The first trial of each experiment on a bench and source file, with its experiment."""
    first: dict[tuple[str, str], str] = {}
    on_bench = [name for name, facts in EXPERIMENTS.items() if facts.place == "bench"]
    for trial in campaign.trials(*on_bench):
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
    segments = sorted(find_segments(known), key=lambda segment: segment.frequency_hz)
    cycles = {segment.frequency_hz: segment.cycles for segment in segments}
    amplitudes = {round(np.rad2deg(segment.commanded or 0.0), 1) for segment in segments}
    protocol = {
        "amplitudes_deg": sorted(amplitudes),
        "frequencies_hz": list(cycles),
        "cycles": list(cycles.values()),
    }
    lines = [f"# dynamometer:  # as {trial.name} was recorded"]
    for name, values in protocol.items():
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

LOOKS_S = 0.5  # between two looks into the folder
RESTS_S = 4.0  # for which a recording has not grown that is taken for complete
LONG_REST_S = 20.0  # the same of one that is empty, or grew after it had rested before
FEWEST_SIBLINGS = 3  # recordings of one kind with which another is compared
FAR = 4.0  # standard deviations from the siblings' median
LEAST_SHARE = 0.01  # standard deviation of an estimate, at least
LEAST_SHARE_OF_EXTENT = 0.05  # the same of duration, rate and range of the angle


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


def read_notes(path: Path) -> dict[str, Any]:
    """What was noted of recordings that were examined before, by name; nothing without notes, or
    with damaged ones."""
    with suppress(OSError, ValueError, TypeError):
        return dict(json.loads(path.read_text(encoding="utf-8")))
    return {}


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


def kind_of(row: Mapping[str, Any]) -> list[str]:
    """Experiment, joint, side, controller, K_d and B_d of a recording: of these equal ones are
    compared."""
    kind = [str(row.get(name) or "") for name in ("experiment", "joint", "side", "controller")]
    for name in ("K_d", "B_d"):
        kind.append("" if row.get(name) is None else f"{float(row[name]):g}")
    return kind


def unchecked_texts(fitted: fits.Fit, bench: WatchedBench) -> Iterator[str]:
    """What could not be checked, as far as no earlier recording has told it."""
    for finding in fitted.findings[-1] if fitted.findings else ():
        if finding.grade is Grade.UNCHECKED and finding.name not in bench.told:
            bench.told.add(finding.name)
            yield f"NOT CHECKED: {finding_text(finding, fitted.row)}"


def drawn_picture(fitted: fits.Fit, picture: Path) -> str:
    """Draw measured and modelled torque; the name of the picture, or why there is none."""
    from osl_analysis.commands.figure import draw_table  # matplotlib takes half a second

    try:
        draw_table("torque", fitted.series, [picture])
    except OslAnalysisError as error:
        return f"no picture: {error}"
    return str(picture)


def compared_in(estimates: Mapping[str, Any]) -> list[str]:
    """The estimates that are told and compared: those of the joint, and none of the load cell."""
    return [name for name in estimated(estimates) if name not in ("offset", "drift")]


def estimate_texts(estimates: Mapping[str, Any]) -> Iterator[str]:
    """Each estimate with its interval and unit, as `K 300 ± 2 N·m/rad`."""
    for name in compared_in(estimates):
        high = estimates.get(f"{name}_high")
        half_width = "" if high is None else f" ± {high - estimates[name]:.2g}"
        yield f"{name} {estimates[name]:.4g}{half_width} {printed_units().get(name, '')}".rstrip()


def comparable(
    trial: Trial, row: Mapping[str, Any], estimates: Mapping[str, Any]
) -> dict[str, tuple[float, float]]:
    """Numbers that are alike in recordings of one kind, each with the smallest standard deviation
    that it is granted: a share of an estimate or its standard error, a share of duration, rate and
    range; and the signs of channels. Of impedance trials without K_d nothing is compared: any two
    of these may have been asked for another."""
    numbers: dict[str, tuple[float, float]] = {}
    if row.get("experiment") == "impedance" and row.get("K_d") is None:
        return numbers
    for name in compared_in(estimates):
        value = float(estimates[name])
        se = float(estimates.get(f"{name}_se") or 0.0)
        numbers[name] = (value, max(se, LEAST_SHARE * abs(value)))
    time_s = trial.samples["time"].to_numpy()
    duration_s = time_s[-1] - time_s[0]
    extents = {"duration in s": duration_s, "rate in Hz": (len(time_s) - 1) / duration_s}
    if "theta" in trial.samples.columns:
        low, high = np.nanquantile(trial.samples["theta"].to_numpy(), (0.01, 0.99))
        extents["range of the angle in deg"] = np.rad2deg(high - low)
    for name, value in extents.items():
        numbers[name] = (float(value), LEAST_SHARE_OF_EXTENT * float(value))
    # a guessed sign makes any torque resist
    for name, channel in trial.provenance.get("columns", {}).items():
        numbers[f"sign of {name}"] = (float(channel["sign"]), 0.1)
    return numbers


def beside_siblings(
    name: str, kind: Sequence[str], numbers: Mapping[str, tuple[float, float]], notes: Path
) -> str:
    """Whether a recording is like those of its kind before it, joint, controller and what was asked
    for, by median and median absolute deviation of each number. What it has is added to the
    notes."""
    noted = read_notes(notes)
    siblings = [
        note["numbers"]
        for sibling_name, note in noted.items()
        if sibling_name != name and note["kind"] == list(kind)
    ]
    values = {key: value for key, (value, _) in numbers.items()}
    noted[name] = {"kind": list(kind), "numbers": values}
    with suppress(OslAnalysisError):  # the picture says why nothing is written there
        write_text(notes, json.dumps(noted, indent=1) + "\n")

    differences = []
    n_siblings = 0
    for key, (value, least_sd) in numbers.items():
        of_siblings = [sibling[key] for sibling in siblings if key in sibling]
        if len(of_siblings) < FEWEST_SIBLINGS:
            continue
        n_siblings = max(n_siblings, len(of_siblings))
        median = float(np.median(of_siblings))
        sd = max(scipy.stats.median_abs_deviation(of_siblings, scale="normal"), least_sd)
        if abs(value - median) > FAR * sd:
            differences.append(f"{key} is {value:.3g}, theirs {median:.3g} ± {sd:.1g}")
    if differences:
        return (
            f"DIFFERS from its {n_siblings} siblings: {listing(differences, 4)}: look for what"
            " changed on the bench"
        )
    if n_siblings:
        return f"like its {n_siblings} siblings"
    if not numbers:
        return "no siblings: no K_d is stated"
    return f"{len(siblings)} siblings to compare with, {FEWEST_SIBLINGS} are needed"


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
