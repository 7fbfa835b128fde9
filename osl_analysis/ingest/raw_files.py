"""The raw files of one trial: recognised, read by their source files, and joined to canonical
samples."""

import hashlib
import math
import os
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, naming, nearest, printable, quoted
from osl_analysis.ingest import overview
from osl_analysis.ingest import source as sources
from osl_analysis.ingest.captures import (
    plate_count,
    read_c3d_capture,
    read_nexus_capture,
    read_trc_capture,
)
from osl_analysis.ingest.clock import ClockFit, aligned_clock
from osl_analysis.ingest.logs import read_message_log, read_table_log
from osl_analysis.ingest.overview import Overview, inspect_messages
from osl_analysis.old_formats.binary_table import FIRST_BYTES, is_table_file, refuse_others
from osl_analysis.old_formats.c3d import BLOCK, is_c3d, parse_header
from osl_analysis.old_formats.csv_table import begins_with_rows, is_text
from osl_analysis.old_formats.gait_text import is_nexus, is_opensim, is_trc
from osl_analysis.old_formats.json_lines import is_json_lines
from osl_analysis.old_formats.mat import is_mat
from osl_analysis.old_formats.mcap import MAGIC
from osl_analysis.old_formats.rosbag import ANY_BAG1, DESCRIPTION, SQLITE, files_in
from osl_analysis.old_formats.table import copied_runs, noise_in, noise_of_pieces
from osl_analysis.old_formats.tdms import is_tdms
from osl_analysis.refusal import check_not_refused
from osl_analysis.signals import run_edges
from osl_analysis.trial import COLUMNS, Array, Trial, median, unit_of
from osl_analysis.yaml_settings import dotted, field_line, read_mapping, read_yaml

# reads a file by its source file, of the format's class
FileReader = Callable[[Path, Any], sources.Recording]
FileLister = Callable[[Path], Overview]  # lists what a file holds, without a source file


@dataclass(frozen=True)
class KnownFormat:
    source: type[sources.Source]  # the model of its source files
    begins: Callable[[bytes], bool]  # whether a file that begins with these bytes is of this format
    suffixes: tuple[str, ...]
    """Endings of files of this format, for files that are not recognised by their first bytes."""
    reader: FileReader
    lister: FileLister

    @property
    def is_capture(self) -> bool:
        """Whether its files come from a motion-capture laboratory."""
        return not issubclass(self.source, sources.LogSource)

    # values of damaged files may be of any size: our checks tell them, not numpy
    @np.errstate(all="ignore")
    def read(self, path: Path, source: sources.Source) -> sources.Recording:
        """A file as canonical columns in SI units, by its source file. Raises InputError, which
        names the file."""
        with naming(path):
            recording = self.reader(path, source)
            tell_no_sensor(recording)
            tell_copies(recording)
            tell_odd_steps(recording)
            tell_leaps_of_markers(recording)
        said = (*recording.damage.all_remarks(recording.topics is not None), *recording.warnings)
        return replace(recording, warnings=[f"{printable(path.name)}: {text}" for text in said])

    @np.errstate(all="ignore")
    def inspect(self, path: Path) -> Overview:
        """What a file holds. Raises InputError, which names the file."""
        with naming(path):
            return self.lister(path)


def begins_with(mark: bytes) -> Callable[[bytes], bool]:
    return lambda begin: begin.startswith(mark)


TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc")
BINARY = (
    ".xlsx",
    ".xls",
    ".ods",
    ".parquet",
    ".feather",
    ".arrow",
    ".arrows",
    ".ipc",
    ".npy",
    ".npz",
    ".h5",
    ".hdf5",
)
KNOWN: Mapping[str, tuple[Callable[[bytes], bool], tuple[str, ...], FileReader, FileLister]] = {
    "mcap": (begins_with(MAGIC), (".mcap",), read_message_log, partial(inspect_messages, "mcap")),
    "rosbag1": (
        begins_with(ANY_BAG1),
        (".bag",),
        read_message_log,
        partial(inspect_messages, "rosbag1"),
    ),
    "rosbag2": (
        begins_with(SQLITE),
        (".db3",),
        read_message_log,
        partial(inspect_messages, "rosbag2"),
    ),
    "c3d": (is_c3d, (".c3d",), read_c3d_capture, overview.inspect_c3d),
    "nexus_csv": (is_nexus, (), read_nexus_capture, overview.inspect_nexus),
    "mat": (is_mat, (".mat",), read_table_log, overview.inspect_mat),
    "tdms": (is_tdms, (".tdms",), read_table_log, overview.inspect_tdms),
    "trc": (is_trc, (".trc",), read_trc_capture, overview.inspect_trc),
    "opensim": (is_opensim, (".mot", ".sto"), read_table_log, overview.inspect_opensim),
    "json_lines": (is_json_lines, (".jsonl", ".ndjson"), read_table_log, overview.inspect_json),
    "table": (is_table_file, BINARY, read_table_log, partial(overview.inspect_table, "table")),
    "csv": (is_text, TEXT_SUFFIXES, read_table_log, partial(overview.inspect_table, "csv")),
}
FORMATS = {name: KnownFormat(sources.SOURCES[name], *facts) for name, facts in KNOWN.items()}
# of recordings that are read
SUFFIXES = tuple(suffix for known in FORMATS.values() for suffix in known.suffixes)
ENDINGS_OF_ANY = ("", ".log", ".json")  # of recordings, and of much else


def recordings_in(folder: Path) -> list[Path]:
    """Files and bag folders below a folder that may be recordings, by their endings, or of
    `ENDINGS_OF_ANY` by what they begin with."""
    bags = {path.parent for path in folder.rglob(DESCRIPTION)}
    files = (
        path for path in folder.rglob("*") if path.suffix.lower() in (*SUFFIXES, *ENDINGS_OF_ANY)
    )
    files = (
        path
        for path in files
        if path.is_file() and (path.suffix.lower() in SUFFIXES or begins_as_recording(path))
    )
    return sorted([*bags, *(path for path in files if not bags & {*path.parents})])


def begins_as_recording(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            begin = file.read(FIRST_BYTES)
    except OSError:
        return False
    named = any(one.begins(begin) for name, one in FORMATS.items() if name != "csv")
    return named or (is_text(begin) and begins_with_rows(begin))


def read_source(path: Path) -> sources.Source:
    """A source file, checked: columns are canonical, every unit converts to its column's."""
    content = read_mapping(path)
    name, places = str(content.get("format", "")), list(sources.open_places(content))
    if name not in FORMATS:
        said = (
            f"line {field_line(path, ('format',))}: format: '{name}' is not allowed"
            if name
            else "format is missing"
        )
        raise InputError(
            f"{path}: {said}: write one of {', '.join(FORMATS)}{nearest(name, FORMATS)}"
        )
    if places:
        where = listing(
            [f"`{dotted(place)}` in line {field_line(path, place)}" for place in places], 6
        )
        are = "place is" if len(places) == 1 else "places are"
        what = (
            f"{path}: a draft of `osl-analysis inspect` in which {len(places)} {are} to be edited:"
            f" {where}"
        )
        what += (
            "; give each signal that you need its canonical name"
            f" ({', '.join(c for c in COLUMNS if c != 'time')})"
        )
        raise InputError(
            f"{what}, state each {sources.UNKNOWN}, and delete the other lines of `channels`"
        )
    source = read_yaml(path, FORMATS[name].source)
    source.written_in(path)
    return source


def check_clocks(log: sources.Source, mocap: sources.Source) -> None:
    """Refuse source files of a log and of motion capture that do not state how the log's clock is
    aligned."""
    clocks = {one.clock for one in (log, mocap) if isinstance(one, sources.LogSource)}
    shared, maps = getattr(mocap, "shared", None), getattr(log, "channels", {})
    angle, edges = (
        shared is not None and shared.column in maps,
        "sync" in getattr(mocap, "analogs", clocks),
    )
    aligns = {
        "sync": edges or angle,
        "shared": angle,
        "common": mocap.format == "trc",
        "master": False,
    }
    if not all(aligns[one] for one in clocks):
        said = (
            f"{log.place('clock')}: '{', '.join(clocks)}' does not align the log with motion"
            " capture of this trial"
        )
        said += "; write clock: sync and map the column sync in both source files, or clock"
        raise InputError(
            f"{said}: shared and name an angle of the log under `shared` in that of motion capture"
        )


def check_plates(source: sources.Source, captures: Sequence[Path], of_walking: int) -> None:
    """Refuse a force plate, of a source file or of the walking analysis (0: none), that none of
    some captures in C3D has by their headers. What one of many lacks, or cannot be read, its ingest
    tells."""
    counts, stated = dict[int, Path](), getattr(source, "plates", ())
    for path in captures:
        # header and parameters end before block 512
        with suppress(OSError, InputError), path.open("rb") as file:
            counts[plate_count(parse_header(file.read(512 * BLOCK)))] = path
    most = max(counts, default=0)
    asked = [(one, source.place("plates")) for one in (stated if isinstance(stated, tuple) else ())]
    for number, place in (*asked, (of_walking, "`walking.plate` in the configuration")):
        if counts and number > most:
            raise InputError(
                f"{place}: no force plate {number}; {counts[most]} has {most}, counted from 1;"
                " correct it"
            )


def recognise(path: Path) -> str:
    """Name of a file's format, by its first bytes, or else by its ending; other text is CSV."""
    begin, found = formats_of(path)
    known = [name for name, one in FORMATS.items() if path.suffix.lower() in one.suffixes]
    # text is often called `.xls`
    found += [name for name in known if name != "table" or not is_text(begin)]
    found += ["csv"] * is_text(begin)
    if not found:
        said = f"{path}: neither MCAP, C3D nor text (it begins with {quoted(begin[:8])})"
        raise InputError(f"{said}; export it as one of these")
    return found[0]


def formats_of(path: Path, stated: str = "csv") -> tuple[bytes, list[str]]:
    """What a file begins with, and the formats that tells, the stated one alone if among them; none
    for plain text."""
    if path.is_dir():
        return b"", ["rosbag2"]
    with path.open("rb") as file:
        begin = file.read(FIRST_BYTES)
    refuse_others(path, begin)
    asked = [stated] if stated != "csv" and FORMATS[stated].begins(begin) else FORMATS
    return begin, [name for name in asked if name != "csv" and FORMATS[name].begins(begin)]


def trial_from_files(row: Mapping[str, Any], raw_folder: Path, sources_folder: Path) -> Trial:
    """The trial whose raw files, relative to `raw_folder`, one row of the sample sheet names. `row`
    has the sheet's columns (`config/sheet.py`). A value that is not text (None, NA) counts as
    empty. Raises InputError: A file is missing, empty or not what its source file says, changes
    while it is read, holds values that nothing can reach, or the recordings do not fit together."""
    said = {column: value.strip() for column, value in row.items() if isinstance(value, str)}
    name, files = (
        said.get("trial", ""),
        {role: said[role] for role in ("log", "mocap") if said.get(role)},
    )
    if not files:
        raise InputError(
            f"trial {name}: the sheet names no file; fill in log or mocap, or exclude the trial"
        )
    recordings, identities, by_role = {}, {}, dict[str, sources.Source]()
    for role, given in files.items():
        path, source = raw_folder / given, said.get(f"{role}_source", "")
        if not source:
            raise InputError(
                f"trial {name}: {role}_source is empty; name the file in {sources_folder} for"
                f" {given}"
            )
        check_file(path)
        parts = files_in(path) if path.is_dir() else [path]
        before = [written_at(part) for part in parts]
        every, described = (
            [identity_of(part) for part in parts],
            read_source(sources_folder / f"{source}.yaml"),
        )
        check_copies(path, every)
        known, by_role[role] = FORMATS[described.format], described
        if len(by_role) == 2:
            check_clocks(by_role["log"], by_role["mocap"])
        if not known.is_capture:
            described = described.of_part(said.get("log_part", ""))
        begin, found = formats_of(path, described.format)
        if (found and described.format not in found) or (
            described.format == "csv" and not is_text(begin)
        ):
            what = f"is {found[0]}" if found else f"is no text (it begins with {quoted(begin[:8])})"
            other = f"write `format: {found[0]}`, or correct {role}_source" if found else ""
            remedy = other or "name the recording itself"
            if path.is_dir():
                what, remedy = (
                    f"a folder with a recording in {found[0]}",
                    f"{remedy}, or name a file in it",
                )
            raise InputError(f"{path}: {what}, its source file says {described.format}; {remedy}")
        try:
            recordings[role] = known.read(path, described)
            with naming(path):
                sources.check_sizes(recordings[role])
        finally:  # also where it cannot be read: it may have changed in between
            for part, then in zip(parts, before, strict=True):
                if not part.is_file() or written_at(part) != then:
                    what = "the file changed while it was read"
                    raise InputError(
                        f"{part}: {what}; wait until it is recorded or copied, then run again"
                    )
        if path.is_dir():  # of a folder size and hash of all files together, and those of each
            together = hashlib.sha256("".join(one["sha256"] for one in every).encode()).hexdigest()
            every = [
                {"bytes": sum(one["bytes"] for one in every), "sha256": together, "parts": every}
            ]
        identities[role] = {**every[0], "path": given, "source": source}
    with naming(f"trial {name} ({', '.join(files.values())})"):
        trial = assemble(
            name, recordings, identities, getattr(by_role.get("mocap"), "shared", None)
        )
    fixture = {
        column.removeprefix("fixture_"): x
        for column, x in row.items()
        if column.startswith("fixture_")
    }
    if any(fixture.values()) and "torque" in trial.columns:  # the time base takes its torque off
        trial.provenance["columns"]["torque"]["fixture"] = {
            name: x for name, x in fixture.items() if x is not None
        }
    return trial


own_version = cache(version)  # `version` takes 4 ms
MOST_HELD = 6  # most samples for which a sensor may hold a value
LEAST_COPIED = 4  # fewest consecutive samples that count as a copy of another place
AROUND = 1000  # samples before and behind such a run that tell whether the motion itself repeats
NO_SENSOR = ("V", "N*m/rad", "N*m*s/rad")  # units of pulses and gains, which repeat themselves


def surprise(scatter: float, level: float) -> float:
    """-ln of the probability that two readings with noise of this SD (`scatter`) and step (`level`)
    are equal."""
    return math.log(2 * math.pi**0.5 * scatter / max(level, 1e-300)) if scatter else 0.0


def read_values(recording: sources.Recording, column: str) -> tuple[NDArray[np.intp], Array]:
    """The rows (n,) in which a column has a reading, and the readings (n,)."""
    values = recording.samples[column].to_numpy()
    rows = np.flatnonzero(np.isfinite(values))
    return rows, values if rows.size == values.size else values[rows]


def channels_with_noise(
    recording: sources.Recording,
) -> list[tuple[str, NDArray[np.intp], Array, float]]:
    """The measured channels with noise: name, rows (n,), readings (n,) without held ones, and the
    `surprise` of two equal readings in the channel's quietest piece."""
    parts = list[tuple[str, NDArray[np.intp], Array, float]]()
    # by the length of their pieces
    alike: dict[int, list[tuple[str, NDArray[np.intp], Array, Array]]] = {}
    for column in recording.columns:
        if column.endswith("_command") or unit_of(column) in NO_SENSOR:
            continue
        (rows, x), origin = read_values(recording, column), recording.columns[column]
        factor = math.prod(origin.get(key, 1) for key in ("sign", "scale", "factor")) or 1
        x = x / factor - origin.get("offset", 0)  # as the file has them
        fresh = np.flatnonzero(np.append(True, x[1:] != x[:-1]))
        if (
            1 < fresh.size < 0.75 * x.size
            and np.mean((steps := np.diff(fresh)) == np.median(steps)) > 0.8
        ):
            rows, x = rows[fresh], x[fresh]
        piece = np.linspace(0, x.size - min(x.size, 200), 8).astype(int)[:, None] + np.arange(
            min(x.size, 200)
        )
        alike.setdefault(piece.shape[1], []).append((column, rows, x, x[piece]))
    for group in alike.values():
        noise = noise_of_pieces(np.concatenate([pieces for *_, pieces in group]))
        for k, (column, rows, x, _) in enumerate(group):
            if quietest := surprise(*min(noise[8 * k : 8 * k + 8])):
                parts.append((column, rows, x, quietest))
    return parts


def tell_copies(recording: sources.Recording) -> None:
    """Count as lost the samples of a channel that are copies of another place, or of another
    channel: more of them than noise repeats in one of a million channels. Commands, pulses, and
    motions without noise may repeat themselves."""
    lost, found = (
        np.zeros(recording.samples.height, bool),
        dict[tuple[int, int, int, str], list[str]](),
    )
    time, parts = recording.samples["time"], channels_with_noise(recording)
    ends = np.cumsum([0, *(x.size + 1 for _, _, x, _ in parts)]).tolist()
    if not parts:
        return
    every, rows = np.zeros(ends[-1]), np.zeros(ends[-1], np.int64)
    # behind each a word that is nowhere else: no run goes on into the next
    for k, (_, own, x, _) in enumerate(parts):
        every[ends[k] : ends[k + 1] - 1], rows[ends[k] : ends[k + 1] - 1] = x, own
        every[ends[k + 1] - 1] = 1e200 * (k + 1)
    enough, beside = 2 * math.log(every.size + 1) + math.log(1e6), math.log(2 * AROUND + 1)

    def part_of(place: int) -> int:
        return int(np.searchsorted(ends, place, side="right")) - 1

    def proves(run: slice, lag: int) -> bool:
        own, other = part_of(run.start), part_of(run.start + lag)
        changes = int(np.count_nonzero(np.diff(every[run])))
        # the most that what follows can be
        if changes * (parts[own][3] if own == other else beside) <= enough:
            return False
        begin = max(ends[own], ends[other] - lag, run.start - AROUND)
        end = max(run.stop, min(ends[own + 1] - 1, ends[other + 1] - 1 - lag, run.stop + AROUND))
        scatter, level = noise_in(parts[own][2], slice(run.start - ends[own], run.stop - ends[own]))
        at = np.r_[begin : run.start, run.stop : end]
        apart = np.abs(every[at + lag] - every[at])
        alike = (np.count_nonzero(apart < 1.5 * level) + 1) / (at.size + 1)
        if at.size > 100:  # of readings of many digits the density near 0 tells what no count does
            alike *= np.clip(
                1.5 * level / max(float(np.partition(apart, 9)[9]), 1e-300), 1e-300, 1.0
            )
        each = [-math.log(alike), *[parts[own][3], surprise(scatter, level)] * (own == other)]
        return changes * min(each) > enough

    # units, taken off again, leave rounding
    words = ((every + 0.0).view(np.int64) + (1 << 15)) >> 16
    least = max(LEAST_COPIED, int(enough / max(beside, *(one[3] for one in parts))))
    for start, stop, other in copied_runs(words, least, proves):
        name, there = (parts[part_of(place)][0] for place in (start, other))
        key = (int(rows[start]), int(rows[stop - 1]) + 1, int(rows[other]), there * (there != name))
        found.setdefault(key, []).append(name)
    for (start, stop, other, of), names in found.items():
        if not lost[start:stop].all():
            at, there = (f"{time[row]:.3f} s" for row in (start, other))
            what = (
                f"{stop - start} samples of {listing(names, 4)} from {at} on are"
                f" those{f' of {of}' * bool(of)} from"
            )
            said = f"{what} {there} on: a part of the file was written over another, or twice"
            recording.damage.lose(said, 0, None, 0)  # what was copied beside may prove nothing
            lost[start:stop] = True
            for column in names:
                facts = recording.columns[column]
                facts["no_sensor"] = max(facts.get("no_sensor") or 0, stop - start)
    if found:
        damage, (number, *_) = (
            recording.damage,
            next(iter((recording.topics or {"": [0]}).values())),
        )
        damage.read = damage.read or Counter({0: lost.size})
        damage.misfits[number] += int(lost.sum())


def tell_no_sensor(recording: sources.Recording) -> None:
    """Remark where a channel has values that no sensor gives, except those that all channels hold
    until the trigger."""
    times, each = recording.samples["time"].to_numpy(), dict[str, tuple[Array, Array]]()
    for column in (one for one in recording.columns if one in sources.SELDOM_REPEAT):
        rows, x = read_values(recording, column)
        each[column] = times if rows.size == times.size else times[rows], x
    held = [(time, int(np.argmax(x != x[0]))) for time, x in each.values() if (x != x[:1]).any()]
    begin = min((float(time[count * (count > 1)]) for time, count in held), default=0.0)
    if min((count for _, count in held), default=0) > MOST_HELD:
        said = (
            f"all channels hold one value up to {begin:.3f} s, as before a trigger, or where bytes"
            " are lost"
        )
        recording.damage.remarks.append(said)
        recording.damage.uncounted = True
    for column, (time, x) in each.items():
        x, time = x[(first := np.searchsorted(time, begin)) :], time[first:]
        angle = each["theta"][1][first:] if "theta" in each else None
        wrong = sources.values_of_no_sensor(column, time, x, recording.columns[column], angle)
        recording.columns[column]["no_sensor"] = None if wrong is None else int(wrong.sum())
        if wrong is not None and wrong.any():
            what = (
                f"{np.count_nonzero(wrong)} samples of {column} are values that no sensor gives,"
                " the first at"
            )
            recording.damage.remarks.append(
                f"{what} {time[int(np.argmax(wrong))]:.3f} s: bytes may be lost"
            )
            recording.damage.is_doubted = True


def tell_odd_steps(recording: sources.Recording) -> None:
    """Remark where the time of all or of one channel has an odd step, if nine of ten steps are
    alike."""
    alike = defaultdict[bytes, list[str]](list)
    for column in recording.samples.select(pl.exclude("time").is_not_null()):
        alike[column.to_numpy().tobytes()].append(column.name)
    for present, names in alike.items():
        time = recording.samples["time"].to_numpy()[np.flatnonzero(np.frombuffer(present, bool))]
        steps = np.diff(time)
        usual = median(steps) if steps.size else 0.0
        odd = np.abs(steps - usual) > 0.1 * usual
        if (
            0 < (count := np.count_nonzero(odd)) <= 0.1 * odd.size > 10
            and np.ptp(steps[~odd]) < 0.05 * usual
        ):
            at, of = int(np.argmax(odd)), f" of {listing(names, 4)}" * (len(alike) > 1)
            said = (
                f"time{of} goes on by {steps[at]:.4g} s at {time[at]:.3f} s, where steps are"
                f" {usual:.4g} s, {count} "
            )
            said += "times so or otherwise: samples are missing there, or their stamps are wrong"
            recording.damage.remarks.append(said)
            recording.damage.is_doubted |= not recording.damage.lost()


def tell_leaps_of_markers(recording: sources.Recording) -> None:
    """Remark where four in five coordinates of markers leave their curves in one frame, which
    masses cannot do, or where one does so and comes back, farther than if cameras confuse two
    markers."""
    share = recording.samples.select(pl.col("^marker_.*$").is_finite().mean())  # of its frames
    markers = [one for one in share.columns if (share[one][0] or 0) > 0.5]
    if not markers:
        return
    seen = recording.samples.select("time", *markers).filter(
        pl.any_horizontal(pl.col(markers).is_not_null())
    )
    time, told, leaping = seen["time"].to_numpy(), list[str](), np.zeros(seen.height)
    for name in markers:
        bends, finite = sources.bends_of(x := seen[name].to_numpy()), np.isfinite(x)
        leaping += bends > 25
        if not finite.all():
            bends = sources.bends_of(x := x[finite])
        if bends.max() > sources.FAR:
            leaps = [(a, b) for a, b in sources.leaps_of(x, bends, sources.FAR) if a < b]
            far = [a for a, b in leaps if bends[a : b + 2].max() > sources.FAR]
            said = f"{name} leaves its curve and comes back {len(far)} times, first at"
            told += [f"{said} {at:.3f} s: bytes may be lost" for at in time[finite][far[:1]]]
    if frames := run_edges(leaping / len(markers) >= 0.8).tolist():
        first = (
            f"{len(frames)} times all markers leap in one frame, first at"
            f" {time[frames[0][0] + 1]:.3f} s"
        )
        told.insert(0, f"{first}: frames are missing there, or a part of the file was moved")
    recording.damage.remarks += told
    recording.damage.is_doubted |= bool(told)


def check_columns(trial: Trial, experiment: str | None, needed: Sequence[str]) -> None:
    """Refuse a trial without a column that every trial of its experiment needs."""
    missing = [column for column in needed if column not in trial.samples.columns]
    if missing:
        raise InputError(
            f"trial {trial.name}: no column {', '.join(missing)}, which a trial of experiment"
            f" '{experiment}' needs; map it to its channel under `channels` in the source file, or"
            " correct `experiment` in the sheet"
        )


def check_markers(trial: Trial, experiment: str | None) -> None:
    """Refuse a trial without a marker that was ever seen, for an experiment whose analysis follows
    markers."""
    markers = [column for column in trial.samples.columns if column.startswith("marker_")]
    if any(trial.samples[column].is_finite().any() for column in markers):
        return
    seen = f"none of its {len(markers) // 3} markers was ever seen" if markers else "no markers"
    said = f"trial {trial.name}: {seen}, and a trial of experiment '{experiment}' needs them"
    raise InputError(
        f"{said}; label them in the capture and export it again, or exclude the trial in the sheet"
    )


def check_file(path: Path) -> None:
    """Refuse a file that is missing or empty, and what is no recording: a device, a pipe, a folder
    without parts."""
    if path.is_dir():
        files_in(path)
        return
    if path.exists() and not path.is_file():
        raise InputError(
            f"{path}: a device or a pipe, not a recording; name a file, or copy its content"
            " into one"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file; correct the sample sheet, or copy the file there")
    check_not_refused(path)
    if path.stat().st_size == 0:
        raise InputError(
            f"{path}: the file is empty; copy or record it again, or exclude the trial in the sheet"
        )


def check_copies(path: Path, parts: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a recording of which a part is a copy of another."""
    first: dict[str, str] = {}
    for part in parts:
        if (other := first.setdefault(part["sha256"], part["path"])) != part["path"]:
            said = (
                f"{path}: its file {part['path']} is a copy of {other}, so that what it should hold"
                " is missing"
            )
            raise InputError(f"{said}; copy the recording again")


def written_at(path: Path) -> tuple[int, ...]:
    """Facts on a file that change if it is written to, or replaced, while it is read."""
    with path.open("rb") as file:  # opening makes a network file system ask its server again
        known = os.fstat(file.fileno())
    return known.st_ino, known.st_size, known.st_mtime_ns, known.st_ctime_ns


def identity_of(path: Path) -> dict[str, Any]:
    """What identifies a raw file in the provenance."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return {"path": path.name, "bytes": file.tell(), "sha256": digest}


def assemble(
    name: str,
    recordings: Mapping[str, sources.Recording],
    files: Mapping[str, Mapping[str, Any]],
    shared: sources.SharedAngle | None = None,
) -> Trial:
    """A trial of the recordings `log`, `mocap` or both; with both, the log's clock is fitted to
    motion capture's. `files` identifies the file of each recording, `shared` an angle that aligns
    the clocks without sync edges. The log's rows before and after motion capture are counted and
    not used. The column `sync` is motion capture's."""
    facts = {role: dict(recordings[role].facts) for role in ("log", "mocap") if role in recordings}
    columns = {
        of: {"file": role, **origin}
        for role in facts
        for of, origin in recordings[role].columns.items()
    }
    damage = {role: losses for role in facts if (losses := recordings[role].losses)}
    software = {"name": "osl-analysis", "version": own_version("osl-analysis")}
    provenance: dict[str, Any] = {"software": software, "files": dict(files), "columns": columns}
    provenance["plates"] = [plate for one in facts.values() for plate in one.pop("plates", [])]
    provenance["warnings"] = [
        printable(warning) for role in facts for warning in recordings[role].warnings
    ]
    provenance |= ({"damage": damage} if damage else {}) | facts
    if len(recordings) == 1:
        return Trial(name, recordings[next(iter(facts))].samples, provenance)
    log, mocap = recordings["log"], recordings["mocap"]
    both = sorted((set(log.columns) & set(mocap.columns)) - {"sync"})
    if both:
        raise InputError(
            f"column '{both[0]}' is mapped in log and motion capture; remove it from one source"
            " file"
        )
    fit, warnings = aligned_clock(log, mocap, shared)
    on_master, end = fit.to_master(log.samples["time"].to_numpy()), float(mocap.samples["time"][-1])
    clock = {
        **asdict(fit),
        "rows_before": int((on_master < 0.0).sum()),
        "rows_after": int((on_master > end).sum()),
    }
    warnings = [*provenance["warnings"], *warnings]
    return Trial(
        name, merged(log, mocap, fit), {**provenance, "warnings": warnings, "clock": clock}
    )


def merged(log: sources.Recording, mocap: sources.Recording, fit: ClockFit) -> pl.DataFrame:
    """The rows of both in the order of motion capture's time [s]; rows of the same nanosecond
    become one row."""
    log_time = pl.Series("log_time", fit.to_master(log.samples["time"].to_numpy()))
    own = log.samples.drop("time", "sync", strict=False).insert_column(0, log_time)
    rows = own.filter(log_time.is_between(0.0, float(mocap.samples["time"][-1])))
    if rows.is_empty():
        raise InputError(
            "log and motion capture do not overlap in time; check that they are of the same trial"
        )
    keyed = []  # by whole nanoseconds, on which tables can be joined; floats would not match
    for one, column in ((mocap.samples, "time"), (rows, "log_time")):
        keyed.append(one.with_columns(key=(pl.col(column) / 1e-9).round().cast(pl.Int64)))
    joined = keyed[0].join(keyed[1], on="key", how="full", coalesce=True)
    return (
        joined.sort("key")
        .with_columns(time=pl.coalesce("time", "log_time"))
        .drop("key", "log_time")
    )
