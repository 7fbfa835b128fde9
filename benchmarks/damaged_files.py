"""Files of every container, damaged at random: what of the damage is told, refused, harmless, or
silent.

Run from the repository: `python benchmarks/damaged_files.py [files] [seed]`, 5,000 files and seed 0
unless told, two minutes; the suite reads a few hundred (`tests/test_damage.py`). Each file holds an
angle and a torque of one joint that a multisine moves, with noise. It is cut, or a block of 16 to
4096 bytes is zeroed, lost, copied over another, put in the place of another, or another recording
is appended, or one bit is flipped; one in ten has up to eight of these. It prints, by container and
by damage, how many files are

told: a part is lost, or may be, says the ledger, or a warning that the whole file does not have;
refused: by `InputError`, in one line; harmless: every value is as it was written; limit: a wrong or
a missing value that nothing in the file tells: rows behind the last one of a container that does
not
    say how long it is; values that leave their curve by less than `OWN` times what their channel
    does elsewhere, as those of sound recordings may; a stamp that is off by less than a tenth of a
    step; up to six zeros at the beginning of a channel, which a recorder writes before the sensor
    answers;
silent: any other wrong or missing value, whatever a fit may doubt later. Each is printed, with what
it does to a fit; wrong count: a stated number of lost rows is another one, by more than the two
halves at the ends of a stretch.

Then the same of two blocks of one channel that changed places, by the motion of a joint. Any other
error than `InputError`, and more than 10 s or 300 MB for a file, ends the run."""

import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import polars as pl
from mcap.writer import CompressionType
from mcap_ros2._dynamic import serialize_dynamic
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.io import savemat
from scipy.signal import butter, sosfiltfilt

from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.raw_files import FORMATS, recognise
from osl_analysis.ingest.source import Recording, values_of_no_sensor

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from c3d_builder import write_c3d
from mcap_builder import SAMPLE, SAMPLE_NAME, stamped, write_log
from test_formats_mat import write_mat73

ROWS, SECOND_RUN = 600, 2000
RATE = 250  # Hz
# times as far as elsewhere: sound ones do at a blow; of time: steps
OWN = {"theta": 4.0, "torque": 4.0, "time": 0.1}
OF_MARKERS = 40.0  # cameras take one marker for another
LONGEST, MOST_MEMORY = 10.0, 300 << 20


def signals(first: int) -> dict[str, np.ndarray]:
    """Time [s], angle [deg] and torque [N*m] of a joint (K 300, B 5, I 0.02) from row `first`
    on."""
    k, noise = first + np.arange(ROWS), np.random.default_rng(first).normal(size=(2, ROWS))
    w = 2 * np.pi * np.array([0.7, 1.1, 1.9, 2.7, 3.7])
    phase, size = (
        np.multiply.outer(k / RATE, w) + np.array([0, 1, 2, 3, 0.5]),
        0.02 / np.sqrt(w / w[0]),
    )
    theta, omega, alpha = (
        np.sin(phase) @ size,
        np.cos(phase) @ (size * w),
        -np.sin(phase) @ (size * w**2),
    )
    angle = np.rad2deg(theta) + 1e-3 * noise[0]
    return {
        "t": np.round(5 + k / RATE, 6),
        "a": angle,
        "f": 300 * theta + 5 * omega + 0.02 * alpha + 0.05 * noise[1],
    }


def rows_of(first: int) -> Iterator[tuple[float, ...]]:
    return zip(*(values.tolist() for values in signals(first).values()), strict=True)


def write_text(
    path: Path, first: int, head: str = "t,a,f\n", sign: str = ",", begin: str = ""
) -> Path:
    """A line per row; `begin` is what stands before its cells, by the number of the row."""
    lines = [
        begin.format(k=k, one=k + 1, time=k / RATE) + sign.join(map(str, row))
        for k, row in enumerate(rows_of(first))
    ]
    path.write_text(head + "\n".join(lines) + "\n")
    return path


def write_frame(path: Path, first: int, write: Callable[[pl.DataFrame, Path], object]) -> Path:
    write(pl.DataFrame(signals(first)), path)
    return path


def write_numpy(path: Path, first: int) -> Path:
    (
        np.save(path, np.column_stack([*signals(first).values()]))
        if path.suffix == ".npy"
        else np.savez(path, **signals(first))
    )
    return path


def write_mat5(path: Path, first: int, **options: Any) -> Path:
    savemat(path, {**signals(first), "other": np.arange(300.0)}, **options)
    return path


def write_h5(path: Path, first: int) -> Path:
    with h5py.File(path, "w") as file:
        file.update(signals(first))
    return path


def write_tdms(path: Path, first: int, timed: bool = False) -> Path:
    start = np.datetime64("2026-01-01") + np.timedelta64(first, "s")
    about = (
        {"wf_increment": 1 / RATE, "wf_start_time": start, "wf_start_offset": 0.0} if timed else {}
    )
    with TdmsWriter(path) as writer:
        for part in np.array_split(np.arange(ROWS), 4):
            own = signals(first).items()
            writer.write_segment(
                [ChannelObject("lab", name, values[part], about) for name, values in own]
            )
    return path


def write_capture(path: Path, first: int) -> Path:
    """A marker and two analog channels."""
    _, angle, torque = signals(first).values()
    marker = np.column_stack([angle + 200, torque + 300, angle - torque + 900, np.zeros(ROWS)])[
        :, None
    ]
    return write_c3d(path, marker, np.column_stack([angle, torque]), rate=RATE)


def messages(first: int) -> list[tuple[int, dict[str, Any]]]:
    rows = enumerate(rows_of(first), start=first)
    return [stamped(k * 10**9 // RATE, angle=a, torque=f, sync=False) for k, (_, a, f) in rows]


def write_mcap(path: Path, first: int, **options: Any) -> Path:
    return write_log(path, messages(first), chunk_size=1500, **options)


def write_bag(
    folder: Path, first: int, storage: str = "SQLITE3", part: slice = slice(None)
) -> Path:
    writer, encode = (
        Writer(folder, version=9, storage_plugin=StoragePlugin[storage]),
        serialize_dynamic(SAMPLE_NAME, SAMPLE),
    )
    with writer:
        lab = writer.add_connection("/lab", SAMPLE_NAME, msgdef=SAMPLE, rihs01="RIHS01_" + 64 * "0")
        for logged, fields in messages(first)[part]:
            writer.write(lab, logged, encode[SAMPLE_NAME](fields))
    return folder


def alone(folder: Path) -> Path:
    """A database without the description beside it."""
    (folder / "metadata.yaml").unlink()
    return next(folder.glob("*.db3"))


class Kind(NamedTuple):
    """How files of one container are written and read."""

    name: str
    file: str
    write: Callable[[Path, int], Path]
    source: dict[str, Any]


def by(key: str, time: dict[str, Any] | None = None, **names: str) -> dict[str, Any]:
    """A source file with angle and torque under a key of the format."""
    channels = {
        "theta": {key: names.get("a", "a"), "unit": "deg"},
        "torque": {key: names.get("f", "f"), "unit": "N*m"},
    }
    return {
        "time": {key: names.get("t", "t"), "unit": "s"} if time is None else time,
        "channels": channels,
        "most_missing": 0.5,
    }


LAB = {
    name: {"topic": "/lab", "field": field, "unit": unit}
    for name, field, unit in (("theta", "angle", "deg"), ("torque", "torque", "N*m"))
}
MESSAGES: dict[str, Any] = {"time": {"source": "header"}, "channels": LAB, "largest_loss": 1.0}
ANALOGS = {
    "analogs": {
        "theta": {"channel": "A1", "unit": "deg"},
        "torque": {"channel": "A2", "unit": "N*m"},
    }
}
MOT = f"walk\nnRows={ROWS}\nnColumns=3\ninDegrees=yes\nendheader\nt\ta\tf\n"
TRC = f"PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n{RATE}\t{ROWS}\t1\tmm\n"
TRC += "Frame#\tTime\tHEEL\t\t\n\t\tX1\tY1\tZ1\n\n"
TABLE = {"axes": ["x", "-z", "y"]}
NEXUS = f"Trajectories\n{RATE}\n,,HEEL,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n"
COLUMN, NONE = by("column"), CompressionType.NONE
KINDS = [
    Kind("csv", "a.csv", write_text, COLUMN),
    Kind("tsv", "a.tsv", partial(write_text, head="t\ta\tf\n", sign="\t"), COLUMN),
    Kind("JSONL", "a.jsonl", partial(write_frame, write=pl.DataFrame.write_ndjson), by("field")),
    Kind("OpenSim", "a.mot", partial(write_text, head=MOT, sign="\t"), COLUMN),
    Kind("TRC", "a.trc", partial(write_text, head=TRC, sign="\t", begin="{one}\t{time:.6f}\t"),
    TABLE),
    Kind("Nexus", "nexus.csv", partial(write_text, head=NEXUS, begin="{one},0,"), {}),
    Kind("xlsx", "a.xlsx", partial(write_frame, write=pl.DataFrame.write_excel), COLUMN),
    Kind("parquet", "a.parquet", partial(write_frame, write=pl.DataFrame.write_parquet), COLUMN),
    Kind("feather", "a.feather", partial(write_frame, write=pl.DataFrame.write_ipc), COLUMN),
    Kind("npy", "a.npy", write_numpy, by("column", t="1", a="2", f="3")),
    Kind("npz", "a.npz", write_numpy, COLUMN),
    Kind("h5", "a.h5", write_h5, COLUMN),
    Kind("mat 5", "a.mat", write_mat5, by("variable")),
    Kind("mat 5, packed", "a.mat", partial(write_mat5, do_compression=True), by("variable")),
    Kind("mat 7.3", "a.mat", lambda path, first: write_mat73(path, **signals(first)),
    by("variable")),
    Kind("tdms", "a.tdms", write_tdms, by("channel")),
    Kind("tdms, timed", "a.tdms", partial(write_tdms, timed=True), by("channel", {})),
    Kind("c3d", "a.c3d", write_capture, ANALOGS),
    Kind("mcap", "a.mcap", write_mcap, MESSAGES),
    Kind("mcap, plain", "a.mcap", partial(write_mcap, compression=NONE), MESSAGES),
    Kind("mcap, no chunks", "a.mcap", partial(write_mcap, use_chunking=False), MESSAGES),
    Kind("mcap, no CRC", "a.mcap", partial(write_mcap, compression=NONE, enable_crcs=False),
    MESSAGES),
    Kind("db3", "a", write_bag, MESSAGES),
    Kind("db3, alone", "a", lambda path, first: alone(write_bag(path, first)), MESSAGES),
    Kind("mcap of ROS", "a", partial(write_bag, storage="MCAP"), MESSAGES),
]  # fmt: skip

Samples = tuple[np.ndarray, pl.DataFrame]


def samples_of(recording: Recording) -> Samples:
    """Times [0.1 ms] of the recorder's clock, and the other columns."""
    facts = recording.facts.get("time", {})
    start = facts.get("start_ns", 0) / 1e9 or facts.get("start", 0.0)
    return np.rint((recording.samples["time"].to_numpy() + start) * 1e4).astype(
        np.int64
    ), recording.samples.drop("time")


def damaged(content: bytes, other: bytes, chance: random.Random) -> tuple[str, bytes]:
    """The bytes of a file after one mishap, and its name."""
    what = chance.choice(
        ["cut", "cut", "zeroed", "lost", "appended", "end", "flipped", "copied", "swapped"]
    )
    at, size = chance.randrange(len(content)), 1 << chance.randint(4, 12)
    if what in ("cut", "end"):
        return (
            "cut",
            content[: at if what == "cut" else max(1, len(content) - chance.randint(1, 40))],
        )
    if what == "flipped":
        return (
            what,
            content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :],
        )
    if what == "lost":
        return what, content[:at] + content[at + size :]
    if what == "appended":
        return what, content + other
    if what == "swapped" and len(content) > 2 * size:
        one, two = sorted(chance.sample(range(0, len(content) - size + 1, size), 2))
        block, other = content[one : one + size], content[two : two + size]
        return (
            what,
            content[:one] + other + content[one + size : two] + block + content[two + size :],
        )
    at -= at % 16
    source = chance.randrange(len(content)) // 16 * 16
    block = (
        bytes(min(size, len(content) - at)) if what == "zeroed" else content[source : source + size]
    )
    return what, content[:at] + block + content[at + len(block) :]


def off_curve(values: np.ndarray) -> np.ndarray:
    """How far values (n,) leave the curve of those beside them: the largest third difference of
    four with each."""
    bends = np.abs(np.diff(np.nan_to_num(values.astype(np.float64)), 3))
    return np.max([np.pad(bends, (k, 3 - k)) for k in range(4)], axis=0)


def fitted(recording: Recording) -> np.ndarray:
    """K [N*m/rad] and VAF [%] by least squares on angle, velocity, acceleration and an offset."""
    time, theta, torque = (
        recording.samples[name].to_numpy() for name in ("time", "theta", "torque")
    )
    omega = np.gradient(theta, time)
    columns = np.column_stack([theta, omega, np.gradient(omega, time), np.ones_like(theta)])
    found, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    return np.array([found[0], 100 - 100 * np.var(torque - columns @ found) / np.var(torque)])


def judge(recording: Recording, whole: Recording, runs: tuple[Samples, Samples]) -> str:
    """What became of a damaged file that is read, by `whole`, as it was read before, and both runs'
    samples."""
    time, values = samples_of(recording)
    right, channels = np.zeros(time.size, bool), {"time": (time, runs[0][0])}
    wrong = {"time": ~np.isin(time, np.concatenate([one for one, _ in runs]))}
    for of_run, truth in runs:
        place = np.minimum(np.searchsorted(of_run, time), of_run.size - 1)
        same, every = of_run[place] == time, dict[str, np.ndarray]()
        for name in [one for one in values.columns if one in truth.columns]:
            read, written = values[name].to_numpy().astype(float), truth[name].to_numpy()
            every[name] = (read == written[place]) | np.isnan(read)
            if of_run is runs[0][0]:
                wrong[name], channels[name] = same & ~every[name], (read, written)
        right |= same & np.all([*every.values()], axis=0)
    there = np.unique(time[right & np.isin(time, runs[0][0])])
    absent, damage = runs[0][0].size - there.size, recording.damage
    report = damage.report(recording.topics)
    lost, is_doubted = report["lost"], damage.lost() is None or report["complete"] is False
    told = is_doubted or bool({*recording.warnings} - {*whole.warnings})
    if told:
        is_right = lost is None or abs(lost - absent) <= 2 or not absent
        return "told" if is_right else f"wrong count: {lost} of {absent}"
    if right.all() and not absent:
        return "harmless"
    if right.all() and damage.end_unknown and (there == runs[0][0][: there.size]).all():
        return "limit"
    far = {}
    for name, rows in wrong.items():
        if name == "time" and rows.any():
            far[name] = float(np.abs(np.diff(time) / np.median(np.diff(time)) - 1).max())
        elif rows.any():
            read, written = channels[name]
            if rows[6:].any() or read[rows].any():
                far[name] = float(off_curve(read)[rows].max() / (off_curve(written).max() or 1e-9))
    is_limit = (
        all(one <= OWN.get(name, OF_MARKERS) for name, one in far.items())
        and time.size == runs[0][0].size
    )
    if is_limit:
        return "limit"
    (K, VAF), (K_whole, VAF_whole) = fitted(recording), fitted(whole)
    said = f"K {K:.1f} for {K_whole:.1f}, VAF {VAF:.2f} for {VAF_whole:.2f}"
    return f"silent: {far}, {(~right).sum()} wrong and {absent} absent; {said}"


def cases(count: int, seed: int, folder: Path) -> Iterator[tuple[str, str, str]]:
    """Damage `count` files, kind by kind; gives the container, what was done and what became of
    it."""
    for number, kind in enumerate(KINDS):
        one, two = (
            kind.write(made(folder / f"{number} {first}") / kind.file, first)
            for first in (0, SECOND_RUN)
        )
        known = FORMATS[recognise(one)]
        read = partial(
            known.read,
            source=known.source.model_validate({"format": recognise(one), **kind.source}),
        )
        whole, runs = read(one), (samples_of(read(one)), samples_of(read(two)))
        parts = [part for part in sorted(one.rglob("*")) if part.suffix in (".db3", ".mcap")] or [
            one
        ]
        for case in range(count // len(KINDS)):
            chance = random.Random(f"{seed} {kind.name} {case}")
            part, done, start, before = (
                chance.choice(parts),
                Counter[str](),
                time.process_time(),
                most_memory(),
            )
            content = bad = part.read_bytes()
            twin = (two if part == one else next(two.glob(f"*{part.suffix}"))).read_bytes()
            for _ in range(1 if chance.random() < 0.9 else chance.randint(2, 8)):
                what, bad = damaged(bad, twin, chance) if bad else ("cut", bad)
                done[what] += 1
            part.write_bytes(bad)
            try:
                became = judge(read(one), whole, runs)
                with suppress(InputError):
                    draft_source(known.inspect(one), one.name)
            except InputError as error:
                became = "refused" if str(error).isprintable() else "WRONG: no line"
            except Exception as error:
                became = f"WRONG: {error!r}"
            finally:
                part.write_bytes(content)
            if time.process_time() - start > LONGEST or most_memory() > MOST_MEMORY + before:
                became = "WRONG: too much time or memory"
            said = f" (case {case} of seed {seed}, {len(bad)} of {len(content)} bytes)" * (
                became[:5] in ("WRONG", "silen", "wrong")
            )
            yield kind.name, what if done.total() == 1 else "several", became + said


def most_memory() -> int:
    """Of this process until now [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def moved(motion: str, chance: np.random.Generator, seconds: float = 20.0) -> dict[str, np.ndarray]:
    """Angle [rad], in steps of an encoder of 18 bits, and torque [N*m] of the same joint at 500
    Hz."""
    time = np.arange(0, seconds, 1 / 500)
    if motion == "steps":
        theta = sosfiltfilt(
            butter(2, 8, fs=500, output="sos"), np.repeat(chance.choice([-0.05, 0.05], 50), 200)
        )
    else:
        hz = {
            "sine": np.array([2.0]),
            "multisine": np.geomspace(0.7, 5.1, 6),
            "noise": np.arange(0.2, 15, 0.2),
        }[motion]
        phase = 2 * np.pi * np.multiply.outer(time, hz) + chance.uniform(0, 2 * np.pi, hz.size)
        theta = np.sin(phase) @ np.full(hz.size, 0.07 / hz.size**0.75)
    omega = np.gradient(theta, time)
    torque = (
        300 * theta
        + 5 * omega
        + 0.02 * np.gradient(omega, time)
        + 0.05 * chance.normal(size=time.size)
    )
    return {"theta": np.round(theta / (2 * np.pi / 2**18)) * 2 * np.pi / 2**18, "torque": torque}


def exchanged(motion: str, channel: str, seed: int) -> str:
    """What is said of two blocks of a channel, of 2 to 512 samples, that changed places. The leaps
    of a torque at two of their four borders are those of a load that is put on and taken off;
    nothing tells it where others are hidden."""
    chance = np.random.default_rng(seed)
    sound = moved(motion, chance)[channel]
    size = int(2 ** chance.uniform(1, 9))
    one = int(chance.integers(0, sound.size - 2 * size))
    two, read = int(chance.integers(one + size, sound.size - size + 1)), sound.copy()
    read[one : one + size], read[two : two + size] = (
        sound[two : two + size],
        sound[one : one + size],
    )
    found = values_of_no_sensor(channel, np.arange(sound.size) / 500, read, {})
    if found is not None and found.any():
        return "told"
    most = OWN[channel] * off_curve(sound).max()
    # a load that was put on, and taken off
    for begin in (one, one + size) if channel == "torque" else ():
        put_on, off = read.copy(), read - sound
        put_on[begin : begin + two - one] -= off[begin] - off[begin - 1]
        if off_curve(put_on).max() <= most:
            return "limit"
    return "limit" if off_curve(read).max() <= most else "silent"


COLUMNS = ("told", "refused", "harmless", "limit", "silent", "wrong count")


def print_table(counts: Counter[tuple[str, str]]) -> None:
    rows, columns = (
        dict.fromkeys(row for row, _ in counts),
        [one for one in COLUMNS if any(one in key for key in counts)],
    )
    print(f"\n| | {' | '.join(columns)} |\n|---{'|---' * len(columns)}|")
    for row in rows:
        print(f"| {row} | {' | '.join(str(counts[row, one]) for one in columns)} |")
    totals = [sum(counts[row, one] for row in rows) for one in columns]
    print(f"| all {sum(totals)} | {' | '.join(map(str, totals))} |")


def main() -> None:
    count, seed = (int(one) for one in [*sys.argv[1:], *("5000", "0")[len(sys.argv) - 1 :]])
    by_kind, by_damage = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    with tempfile.TemporaryDirectory() as scratch:
        for kind, done, became in cases(count, seed, Path(scratch)):
            if became.startswith("WRONG"):
                raise SystemExit(f"{kind}, {done}: {became}")
            short, _, more = became.partition(": ")
            if more:
                print(f"{kind}, {done}: {became}", file=sys.stderr, flush=True)
            by_kind[kind, short] += 1
            by_damage[done, short] += 1
    print_table(by_kind)
    print_table(by_damage)
    motions, channels = ("multisine", "sine", "noise", "steps"), ("theta", "torque")
    each = [
        (motion, channel) for motion in motions for channel in channels for _ in range(count // 80)
    ]
    changed = Counter(
        (f"{channel}, {motion}", exchanged(motion, channel, k))
        for k, (motion, channel) in enumerate(each)
    )
    print_table(changed)


if __name__ == "__main__":
    main()
