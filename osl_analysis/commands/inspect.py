"""First contact with recordings: what files of any laboratory hold, a drafted campaign, and a look at each as it comes.
Texts from files are untrusted: they are escaped when they are printed."""

import csv
import json
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zlib import crc32

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign.campaign import Campaign, open_campaign
from osl_analysis.campaign.configuration import Config, read_config
from osl_analysis.commands.bench import (
    UNIT_OF,
    Fit,
    estimated,
    estimates_text,
    experiment_of,
    fit_settings,
    fit_trial,
    job_of,
)
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import InputError, OslAnalysisError, listing, nearest, printable, unexpected
from osl_analysis.files import CAMPAIGN, shipped, write_text
from osl_analysis.formats.rosbag import recorded_files
from osl_analysis.ingest import draft as drafts
from osl_analysis.ingest.examine import Commanded, examine, measured_table
from osl_analysis.ingest.overview import Overview
from osl_analysis.ingest.raw_files import FORMATS, SUFFIXES, check_file, read_source, recognise, recordings_in
from osl_analysis.ingest.source import UNKNOWN, open_places
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.limits import CHECKS, judged_table
from osl_analysis.judge.words import check_words
from osl_analysis.model.parameters import joint_of
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness, find_segments, stated_protocol
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import dotted, read_mapping


def first_look(folder: Path) -> Iterator[str]:
    """What the first trial of each experiment and source file of a folder's campaign gives. Nothing is left behind."""
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        for trial, experiment in first_trials(campaign):
            row, is_sound = campaign.row(trial), False
            try:
                recorded = checked_trial(campaign.recording(trial), config.raw_data, config.sources)
                fitted = fit_of_row(recorded, row, campaign.device(trial), CAMPAIGN)
                is_sound = not any(one.grade is Grade.DOUBTS for of_row in fitted.findings for one in of_row)
                said = estimates_text(fitted.table, fitted.findings)
            except OslAnalysisError as error:
                said = str(error)
            except Exception as fault:  # a fault of the program in one recording must not hide the others
                said = unexpected(fault)
            title = f"first trial of experiment {experiment}, {trial}: {'ok' if is_sound else 'LOOK AT IT'}"
            yield "\n  ".join([title, *said.splitlines()])


def first_trials(campaign: Campaign) -> list[tuple[str, str]]:
    """The first trial of each experiment on a bench and source file, with its experiment."""
    first: dict[tuple[str, str], str] = {}
    for trial in campaign.trials(*(name for name, facts in EXPERIMENTS.items() if facts.place == "bench")):
        row = campaign.row(trial)
        first.setdefault((row["experiment"], row["log_source"] or row["mocap_source"]), trial)
    return [(trial, experiment) for (experiment, _), trial in first.items()]


def note_protocol(folder: Path) -> None:
    """Write the stepped sine that the first trial with one did into the configuration of a new campaign, as a comment:
    who commanded it states it by removing the `#`."""
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        sines = [trial for trial, experiment in first_trials(campaign) if EXPERIMENTS[experiment].stepped_sine]
        for name in sines:
            with suppress(OslAnalysisError):  # the first look has said why
                trial = checked_trial(campaign.recording(name), config.raw_data, config.sources)
                if found := recorded_protocol(trial, config.dynamometer.gap_limits):
                    lines = [f"# dynamometer:  # as {name} was recorded"]
                    lines += [f"#   {field_name}: {value}" for field_name, value in found.items()]
                    text = CAMPAIGN.read_text(encoding="utf-8")
                    write_text(CAMPAIGN, text.replace("# dynamometer:\n", "\n".join([*lines, ""])))
                    return


def recorded_protocol(trial: Trial, limits: GapLimits) -> dict[str, str]:
    """The stepped sine that a trial did, as fields of `dynamometer`; empty where it did none."""
    angle = uniform_signals(trial, ["theta"], limits)
    known = Likeness(angle.time, angle["theta"], stated_protocol(None, None, None, None))
    if known.kind != "stepped sine":
        return {}
    found = sorted(find_segments(known), key=lambda one: one.frequency_hz)
    sizes = sorted({round(np.rad2deg(one.commanded or 0.0), 1) for one in found})
    cycles = {one.frequency_hz: one.cycles for one in found}
    own = {"amplitudes_deg": sizes, "frequencies_hz": [*cycles], "cycles": [*cycles.values()]}
    return {name: f"[{', '.join(f'{value:g}' for value in values)}]" for name, values in own.items()}


def fit_of_row(trial: Trial, row: Mapping[str, Any], device: Path | None, config: Path) -> Fit:
    """The fit of a trial in memory, by what its row of a sheet says, drafted or not, as in the workflow. `device` is
    its parameter file. Raises as `fit_trial`."""
    experiment = experiment_of(str(row["experiment"]), config)
    condition: Any = {column: row.get(column) for column in job_of(experiment).sheet}
    if experiment == "impedance":
        K_d, B_d = (None if row[name] is None else float(row[name]) for name in ("K_d", "B_d"))
        condition = DesiredImpedance(row["controller"], K_d, B_d)
    return fit_trial(experiment, trial, device, *fit_settings(experiment, config), condition, row.get("windows"))


def inspect_file(path: Path) -> Overview:
    check_file(path)
    return FORMATS[recognise(path)].inspect(path)


def overview_text(overview: Overview) -> str:
    """The facts on a file, a line per channel (kind, name, unit, samples, rate, note, type), and the remarks."""
    lines = [f"format: {overview.format}", *(f"{name}: {shortened(fact)}" for name, fact in overview.facts.items()), ""]
    for channel in overview.channels:
        name = " ".join(shortened(part) for part in channel.address.values())
        rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
        unit = f" [{shortened(channel.unit)}]" if channel.unit else ""
        notes = "".join(f"; {printable(note)}" for note in (channel.note, channel.type) if note)
        lines.append(f"{shortened(channel.kind):<14} {name}{unit}  {channel.count} samples{rate}{notes}")
    lines += ["", *(f"! {printable(remark)}" for remark in (*overview.remarks, *overview.open))]
    return "\n".join(lines).rstrip()


def shortened(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe, most = printable(text), 60  # characters
    return safe if len(safe) <= most else f"{safe[:most]}..."


def samples_table(folder: Path) -> str:
    """Markdown: a row per recording below a folder, with the number of its channels by kind and rate, and remarks."""
    paths = list(recordings_in(folder))
    if not paths:
        raise InputError(f"{folder}: no recordings below it ({', '.join(SUFFIXES)}); name another folder")
    rows = ["| file | format | holds | remarks |", "|---|---|---|---|"]
    for path in paths:
        try:
            overview = inspect_file(path)
            kinds = Counter((channel.address.get("topic", channel.kind), channel.rate) for channel in overview.channels)
            holds = [f"{n} x {what}{f' at {rate:.4g} Hz' if rate else ''}" for (what, rate), n in kinds.items()]
            cells = [overview.format, "\n".join(holds), "\n".join([*overview.remarks, *overview.open])]
        except InputError as error:
            cells = ["", "", f"refused: {error}".replace(f"{path}: ", "")]
        lines = [[escaped(line) for line in cell.splitlines()] for cell in (str(path.relative_to(folder)), *cells)]
        rows.append(f"| {' | '.join('<br>'.join(cell) for cell in lines)} |")
    return "\n".join(rows)


def escaped(text: str) -> str:
    """Text of a stranger's file for a Markdown table: nothing in it can be markup, HTML or a line of its own."""
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    plain = shown.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", plain)


@dataclass
class Draft:
    """What the recordings of a folder were taken for, and what the user has to decide."""

    sources: dict[str, str] = field(default_factory=dict)  # texts of the source files, by name
    open: list[tuple[Path, str]] = field(default_factory=list)  # file and question, as which of two clocks counts
    refused: list[str] = field(default_factory=list)  # files that are no recordings, or cannot be read, with the reason
    trials: list[tuple[dict[str, str], list[str]]] = field(default_factory=list)  # cells and questions of each
    walking: str = ""  # section of the configuration


def new_campaign(
    folder: Path, recorders: Sequence[str] = (), recordings: Path | None = None, example: bool = False
) -> Draft:
    """Make a folder with a campaign, and say what was drafted. The folder is whole or not there. recorders: names of
    shipped source files to begin from. recordings: a folder of recordings, for which sheet and source files are
    drafted; they stay where they are. example: a small simulated campaign instead."""
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        what = "exists and is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: {what}; name a new folder, nothing is overwritten")
    draft = Draft() if recordings is None else draft_campaign(recordings)
    known = sorted(path.stem for path in shipped("config/sources").glob("*.yaml"))
    for name in recorders:
        if name not in known:
            like = nearest(name, known)
            raise InputError(f"no source file for a recorder '{name}'; there are {', '.join(known)}{like}")
    names = ("dynamometer", "dynamometer_nodes") if example else recorders
    texts = {name: shipped(f"config/sources/{name}.yaml").read_text(encoding="utf-8") for name in names}
    raw_data = Path(os.path.relpath(recordings.resolve(), folder.resolve()) if recordings else "recordings")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as place:
            made = Path(place) / "campaign"
            write_campaign(made, folder.name, raw_data, {**draft.sources, **texts}, None if example else draft)
            if folder.is_dir():
                folder.rmdir()
            made.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another place") from error
    return draft


def write_campaign(folder: Path, name: str, raw_data: Path, sources: Mapping[str, str], draft: Draft | None) -> None:
    """The files of a campaign; `sources` are texts of source files by name; without a draft it is the example."""
    (folder / "sources").mkdir(parents=True)
    allowed = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in name).strip("_") or "campaign"
    kind, path = "config" if draft else "example", raw_data.as_posix()
    template = shipped(f"config/new_campaign/{kind}.yaml").read_text(encoding="utf-8")
    if not all(character.isalnum() or character in "/._-" for character in path):  # a text in YAML's quotes
        path = "'" + path.replace("'", "''") + "'"
    config = template.format(name=allowed, raw_data=path) + (draft.walking if draft else "")
    (folder / "config.yaml").write_text(config, encoding="utf-8")
    from osl_analysis.commands.reference import write_schemas  # it knows the settings of all commands

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
    columns = [*named, "log", "log_source", "mocap", "mocap_source", "exclude", "joint"]
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(cells for cells, _ in draft.trials)


def draft_campaign(folder: Path) -> Draft:
    """What the recordings below a folder are: source files for each kind of them, and a sheet."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings; check the path")
    draft, layouts = Draft(), dict[tuple[object, ...], str]()
    overviews: dict[str, tuple[tuple[int, int], Overview, str]] = {}
    recordings, captures = [], dict[Path, Overview]()
    for path in recordings_in(folder):
        try:
            overview = inspect_file(path)
        except InputError as error:
            draft.refused.append(str(error))
            continue
        name, is_capture, file = overview.format, FORMATS[overview.format].is_capture, path.relative_to(folder)
        # What files share that one source file can describe: format, clock, and the channels of a log. Captures of one
        # laboratory have other markers in each trial, and may lack a pulse.
        channels = tuple((*channel.address.values(), channel.unit) for channel in overview.channels)
        settings = repr({key: value for key, value in overview.settings.items() if key != "missing"})
        same = drafts.pulse_channels(overview) if is_capture else (settings, channels)
        layout, number = (name, *same), 1 + sum(one[0] == name for one in layouts)
        known = "" if is_capture else known_recorder(overview)
        source = layouts.setdefault(layout, known or (name if number == 1 else f"{name}_{number}"))
        moving = 0 if is_capture else sum(not drafts.no_signal(channel) for channel in overview.channels)
        if source not in overviews or (len(channels), moving) > overviews[source][0]:  # what tells most
            overviews[source] = ((len(channels), moving), overview, path.name)
        draft.open += [(file, text) for text in overview.open]
        recordings.append((file, source, is_capture))
        captures |= {file: overview} if is_capture else {}
    if not recordings:
        why = f", as {draft.refused[0]}" if draft.refused else f" ({', '.join(sorted(SUFFIXES))})"
        raise InputError(f"{folder}: no recording in it that can be read{why}; name the folder of the recordings")
    for name, (_, overview, file_name) in overviews.items():
        text, own = drafts.draft_source(overview, file_name, walking=False), shipped(f"config/sources/{name}.yaml")
        if own.is_file():  # a recorder that is known, and what else it has recorded
            known, named = own.read_text(encoding="utf-8"), re.findall(r"^(  ([a-z]\w*): .*\n)", text, re.MULTILINE)
            text = known + "".join(line for line, column in named if f"\n  {column}: " not in known)
        draft.sources[name] = text
    joints = [name for name, text in draft.sources.items() if "\n  theta: {" in text and "\n  torque: {" in text]
    moved = {file: drafts.told_by_motion(one) for file, one in captures.items()}
    moved |= {file: {"experiment": "impedance"} for file, source, _ in recordings if source in joints}
    draft.trials = drafts.draft_trials(recordings, moved)
    if any(cells["experiment"] == "walking" for cells, _ in draft.trials):
        draft.walking = "\n".join([*drafts.draft_walking([*captures.values()]), ""])
    return draft


def known_recorder(overview: Overview) -> str:
    """The shipped source file of which a log has every channel, three or more; empty if there is none."""
    there, found = [{*one.address.values()} for one in overview.channels], {2: ""}
    for path in shipped("config/sources").glob("*.yaml"):
        content, keys = read_mapping(path), {"topic", "field", "column", "variable"}
        wanted = [{str(one[key]) for key in keys & one.keys()} for one in content.get("channels", {}).values()]
        if content["format"] == overview.format and all(one in there for one in wanted):
            found.setdefault(len(wanted), path.stem)
    return found[max(found)]


def left_to_decide(folder: Path, draft: Draft) -> list[str]:
    """What a user has to decide before the campaign runs, a line each."""
    edits = {folder / CAMPAIGN: re.findall(rf"(\w+): [^#\n]*{UNKNOWN}", draft.walking)}
    for path in (folder / f"sources/{name}.yaml" for name in draft.sources):
        edits[path] = [place[-1] for place in open_places(read_mapping(path))]
    told = [f"{path}: {len(k)} places are to be edited: {', '.join(k[:6])}" for path, k in edits.items() if k]
    alike: dict[str, list[str]] = {}
    for cells, questions in draft.trials:
        for text in questions:
            alike.setdefault(f"{folder / 'trials.csv'}: {text}", []).append(cells["trial"])
    for file, text in draft.open:
        alike.setdefault(text, []).append(str(file))
    return [*told, *(f"{text} ({listing(which, 6)})" for text, which in alike.items())]


def drafted_text(draft: Draft) -> str:
    """What the recordings were taken for: files by source, channels named by a guess, and what is not read."""
    lines, most = [], 30
    for name, text in draft.sources.items():
        roles = [(cells, role) for cells, _ in draft.trials for role in ("log", "mocap")]
        files = [cells[role] for cells, role in roles if cells.get(f"{role}_source") == name]
        named = ", ".join(files[:4]) + ", ..." * (len(files) > 4)
        lines.append(f"sources/{name}.yaml: {len(files)} recordings, {named}")
        lines += [f"    {line}" for line in drafts.guessed_lines(text)]
        lines += [f"    {line}" for line in text.splitlines() if "# left out: " in line]
    lines += ["config.yaml:", *(f"    {line}" for line in draft.walking.splitlines())] * bool(draft.walking)
    lines.append("trials.csv, from the names of the files, else from what moves in them:")
    for cells, _ in draft.trials[:most]:
        more = [f"{name} {cells[name]}" for name in ("controller", "K_d", "B_d", "perturbed") if name in cells]
        lines.append("    " + ", ".join([f"{cells['trial']}: {cells['experiment']}", *more]))
    lines += [f"    and {len(draft.trials) - most} more"] * (len(draft.trials) > most)
    return "\n".join([*lines, *(f"not read: {text}" for text in draft.refused)])


State = tuple[int, ...]  # size [bytes] and date [ns] of a recording's files; of a refused one what it was read by


@dataclass
class Arrivals:
    """Which recordings in a folder are complete and new."""

    folder: Path
    seen: dict[str, State] = field(default_factory=dict)  # that were examined, by their path in the folder
    growing: dict[str, tuple[State, float]] = field(default_factory=dict)  # others, and since when they rest [s]

    def complete(self, now: float) -> list[tuple[Path, State]]:
        """Recordings that are new, or other than when they were examined, and have rested for 4 s; for 20 s if they
        are empty, or grew after they had rested before. The caller enters them in `seen` once they are examined."""
        found: list[tuple[Path, State]] = []
        for path in recordings_in(self.folder):
            name = path.relative_to(self.folder).as_posix()
            try:
                stats = [file.stat() for file in recorded_files(path)]
            except OSError:  # it is gone
                continue
            state = (sum(stat.st_size for stat in stats), max((stat.st_mtime_ns for stat in stats), default=0))
            if self.seen.get(name, ())[:2] == state:
                continue
            before, since = self.growing.get(name, (None, now))
            if before != state:
                self.growing[name] = (state, now)
            elif now - since >= (20.0 if name in self.seen or not state[0] else 4.0):
                found.append((path, state))
        return found


def read_notes(path: Path) -> dict[str, State]:
    """The recordings that were examined before; none without notes, or with damaged ones."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): (int(size), int(date), *map(int, by)) for name, (size, date, *by) in content.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


class WatchedBench:
    """What recordings are examined with, from a configuration and, if it has one, its sample sheet, which may name a
    recording. `source` is a stated source file; without one: the sheet's, else one of the folder that fits, else a
    guess. `output` is the folder of pictures and of the notes on what was examined."""

    def __init__(self, config_path: Path, source: Path | None, output: Path) -> None:
        self.config_path, self.config, self.output = config_path, read_config(config_path), output
        self.stated = source  # by the user
        self.source = None if source is None else source.stem
        if source is not None:
            read_source(source)
            self.config = self.config.model_copy(update={"sources": source.parent})
        has_sheet = self.config.simulation is None and self.config.sheet.is_file()
        self.campaign = open_campaign(self.config, None) if has_sheet else None
        self.read = self.files_state()

    def files_state(self) -> int:
        """A number for configuration, sheet and source files as they are now."""
        files = sorted({self.config_path, self.config.sheet, *self.config.sources.glob("*.yaml")})
        return crc32(str([self.stated, *((one, one.stat().st_mtime_ns) for one in files if one.is_file())]).encode())


def watched_lines(folder: Path, bench: WatchedBench) -> Iterator[str]:
    """A line for each recording in a folder, and for each that comes, as soon as it is complete. It never ends."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the one that the recorder writes to")
    notes = bench.output / "examined.json"
    arrivals = Arrivals(folder, read_notes(notes))
    while True:
        if bench.files_state() != bench.read:
            with suppress(OslAnalysisError):  # a file that is being edited
                bench = WatchedBench(bench.config_path, bench.stated, bench.output)
        arrivals.seen = {name: one for name, one in arrivals.seen.items() if one[2:] in ((), (bench.read,))}
        for path, state in arrivals.complete(time.monotonic()):
            said = recording_line(path, folder, bench)
            refused = re.search(": (REFUSED|FAILED): ", said) is not None
            arrivals.seen[path.relative_to(folder).as_posix()] = (*state, *[bench.read] * refused)
            write_text(notes, json.dumps(arrivals.seen, indent=1) + "\n")  # a restart does not repeat these
            yield said
        time.sleep(0.5)


def recording_line(path: Path, folder: Path, bench: WatchedBench) -> str:
    """What is said of one recording: estimates with intervals, quality, doubts, and where its picture is, of measured
    and modelled torque."""
    stamp, name = time.strftime("%H:%M:%S"), path.relative_to(folder).as_posix()
    try:
        said = "; ".join(examined(path, folder, bench))
    except OslAnalysisError as error:
        said = f"REFUSED: {str(error).replace(f'{path}: ', '')}"
    except Exception as fault:  # a fault of the program in one recording must not end the watch over the others
        said = f"FAILED: {unexpected(fault)}"
    return f"{stamp} {name}: {said}"


def examined(path: Path, folder: Path, bench: WatchedBench) -> Iterator[str]:
    with TemporaryDirectory() as place:
        row, sources, said = row_of_recording(path, folder, bench, Path(place))
        trial = checked_trial(row, path.parent, sources)
    accepted = str(row.get("accept") or "").split()
    warned = [printable(text) for text in trial.provenance.get("warnings", [])]
    said = [*said, *warned, quality_text(trial, str(row["experiment"]), bench.config, accepted)]
    if EXPERIMENTS[str(row["experiment"])].place != "bench":
        yield from said
        return
    fitted = fit_of_row(trial, row, device_of_row(row, bench.config), bench.config_path)
    estimates = fitted.table.to_dicts()[-1]  # those of the fit to all data
    values = []
    for name in (n for n in estimated(estimates) if n not in ("offset", "drift")):
        high = estimates.get(f"{name}_high")
        half = "" if high is None else f" ± {high - estimates[name]:.2g}"
        values.append(f"{name} {estimates[name]:.4g}{half} {UNIT_OF.get(name, '')}".rstrip())
    yield ", ".join(values)
    if "VAF" in estimates:
        yield f"VAF {estimates['VAF']:.2f} %"
    yield from (f"DOUBTFUL: {text}" for text in fitted.said(Grade.DOUBTS))
    kind = [str(row[name]) if row.get(name) else "" for name in ("experiment", "joint", "side", "controller")]
    name = path.relative_to(folder).as_posix()
    yield from beside_siblings(name, kind, comparable(trial, row, estimates), bench.output / "measured.json")
    yield from said
    yield from (f"NOT CHECKED: {text}" for text in fitted.said(Grade.UNCHECKED))
    yield from (f"REMARK: {text}" for text in fitted.said(Grade.NOTES))
    if not fitted.series.is_empty():
        picture = bench.output / f"{row['trial']}.png"
        try:
            from osl_analysis.commands.figure import draw_table  # matplotlib takes half a second

            draw_table("torque", fitted.series, [picture])
            yield str(picture)
        except OslAnalysisError as error:
            yield f"no picture: {error}"


FEWEST_SIBLINGS, UNLIKE = 3, 4.0  # recordings, and standard deviations beyond which one differs from these


def comparable(trial: Trial, row: Mapping[str, Any], estimates: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Numbers that are alike in recordings of one kind, each with the smallest standard deviation that it is granted:
    1 % of an estimate or its standard error, 5 % of duration, rate and range. An impedance that was asked for counts
    beside the same one, and K/K_d, with 5 %, beside all; one that nobody stated is not compared."""
    found = dict[str, tuple[float, float]]()
    K_d, B_d = (None if row.get(name) is None else float(row[name]) for name in ("K_d", "B_d"))
    condition = "" if K_d is None else f" of K_d {K_d:g}"
    commanded = row.get("experiment") != "impedance" or K_d is not None  # else each may have been asked for another K
    for name in (n for n in estimated(estimates) if commanded and n not in ("offset", "drift")):
        value, se = float(estimates[name]), float(estimates.get(f"{name}_se") or 0.0)
        of = condition if name == "K" or not condition or B_d is None else f"{condition}, B_d {B_d:g}"
        found[name + of] = value, max(se, 0.01 * abs(value))
    if K_d:
        found["K/K_d"] = estimates["K"] / K_d, 0.05 * estimates["K"] / K_d
    time_s = trial.samples["time"].to_numpy()
    extents = {"duration in s": time_s[-1] - time_s[0], "rate in Hz": (len(time_s) - 1) / (time_s[-1] - time_s[0])}
    if "theta" in trial.samples.columns:
        low, high = np.nanquantile(trial.samples["theta"].to_numpy(), (0.01, 0.99))
        extents["range of the angle in deg"] = np.rad2deg(high - low)
    return found | {name: (float(value), 0.05 * float(value)) for name, value in extents.items()}


def beside_siblings(
    name: str, kind: Sequence[str], numbers: Mapping[str, tuple[float, float]], notes: Path
) -> Iterator[str]:
    """Whether a recording is like those of its kind before it, by median and median absolute deviation of each number.
    What it has is added to the notes."""
    try:
        known: dict[str, Any] = json.loads(notes.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    siblings = [one["numbers"] for other, one in known.items() if other != name and one["kind"] == list(kind)]
    known[name] = {"kind": list(kind), "numbers": {key: value for key, (value, _) in numbers.items()}}
    with suppress(OslAnalysisError):  # the picture says why nothing is written there
        write_text(notes, json.dumps(known, indent=1) + "\n")
    far, most = list[str](), 0
    for key, (value, least) in numbers.items():
        others = [one[key] for one in siblings if key in one]
        if len(others) >= FEWEST_SIBLINGS:
            most = max(most, len(others))
            middle = float(np.median(others))
            spread = max(scipy.stats.median_abs_deviation(others, scale="normal"), least)
            if abs(value - middle) > UNLIKE * spread:
                far.append(f"{key} is {value:.3g}, theirs {middle:.3g} ± {spread:.1g}")
    if far:
        yield f"DIFFERS from its {most} siblings: {listing(far, 4)}: look for what changed on the bench"
    elif most:
        yield f"like its {most} siblings"


def device_of_row(row: Mapping[str, Any], config: Config) -> Path | None:
    """The parameter file of the configuration where it is that of the row's joint, as for a campaign's trial."""
    device = config.parameters
    return device if device is not None and row.get("joint") in (None, joint_of(device)) else None


def row_of_recording(
    path: Path, folder: Path, bench: WatchedBench, place: Path
) -> tuple[Mapping[str, Any], Path, list[str]]:
    """A row for a recording, the folder of its source file, and what of it is a guess. The sheet decides; else the
    stated source file; else one of the campaign's that fits; else a draft in `place`."""
    for named in bench.campaign.rows.values() if bench.campaign else ():
        if named["log"] and (bench.config.raw_data / named["log"]).resolve() == path.resolve():
            return {**named, "log": path.name}, bench.config.sources, []
    sources, source, said = bench.config.sources, bench.source, list[str]()
    for file in sorted(sources.glob("*.yaml")) if bench.campaign and source is None else ():
        with suppress(OslAnalysisError):
            if read_source(file).format == recognise(path):
                checked_trial({"trial": path.stem, "log": path.name, "log_source": file.stem}, path.parent, sources)
                source = file.stem
                break
    if source is None:
        overview = inspect_file(path)
        text, sources, source = drafts.draft_source(overview, path.name), place, "draft"
        (place / "draft.yaml").write_text(text, encoding="utf-8")
        still_open = [f"`{dotted(one)}`" for one in open_places(read_mapping(place / "draft.yaml"))]
        if still_open:
            cut = [one for one in overview.remarks if re.search("not complete|truncated|cut off|missing|damaged", one)]
            questions = "; ".join(map(printable, [*cut, *overview.open])) or f"open are {listing(still_open, 4)}"
            raise InputError(
                f"{path}: its channels cannot be guessed: {questions}; edit the draft of `osl-analysis inspect`, and "
                "name it by --source"
            )
        guesses = [line.split("#")[0].strip() for line in drafts.guessed_lines(text)]
        said = [f"channels are guessed: {listing(guesses, 4)}"] * bool(guesses)
        said += [printable(one) for one in overview.open]
    ((cells, _),) = drafts.draft_trials([(Path(path.name), source, False)])
    row = dict.fromkeys(("log_part", "mocap", "mocap_source", "K_d", "B_d", "controller")) | cells
    row["trial"] = drafts.trial_name(Path(path.relative_to(folder).as_posix().replace("/", "_")))
    if row["experiment"] == drafts.UNNAMED:  # a recording with angle and torque whose name and sheet tell none
        row["experiment"], said = "impedance", [*said, "taken for an impedance trial"]
    return row, sources, said


def quality_text(trial: Trial, experiment: str, config: Config, accepted: Collection[str]) -> str:
    """The checks that a trial does not pass, and that are not accepted; `quality ok` if there are none."""
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
