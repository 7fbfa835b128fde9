"""Files of every container that are cut off, or lack what they state: they are refused, or it is
told, exactly or as not known."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import polars as pl
import pytest
from c3d_builder import write_c3d
from mcap.writer import CompressionType
from mcap_builder import SAMPLE, SAMPLE_NAME, stamped, write_log
from mcap_ros2._dynamic import serialize_dynamic
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.io import savemat
from test_formats_mat import write_mat73

from osl_analysis.errors import InputError
from osl_analysis.formats import known_formats, read, recognise
from osl_analysis.ingest.overview import inspect_recording
from osl_analysis.ingest.raw_files import read_converted
from osl_analysis.recording import End

ROWS = 600
RATE = 250  # Hz
TEXT = (".csv", ".jsonl", ".mot", ".trc")


def signals(first: int) -> dict[str, np.ndarray]:
    """Time [s], angle [deg] and torque [N*m], with noise, from row `first` on."""
    rows = first + np.arange(ROWS)
    noise = np.random.default_rng(first).normal(size=(2, ROWS))
    return {
        "t": np.round(5 + rows / RATE, 6),
        "a": 3 * np.sin(rows / 27) + 1e-3 * noise[0],
        "f": 15 * np.cos(rows / 25) + 0.05 * noise[1],
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


def write_mat5(path: Path, first: int) -> Path:
    savemat(path, {**signals(first), "other": np.arange(300.0)})
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
TRC = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n"
TRC += f"{RATE}\t{ROWS}\t1\tmm\n"
TRC += "Frame#\tTime\tHEEL\t\t\n\t\tX1\tY1\tZ1\n\n"
TABLE = {"axes": ["x", "-z", "y"]}
NEXUS = f"Trajectories\n{RATE}\n,,HEEL,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n"
COLUMN, NONE = by("column"), CompressionType.NONE
KINDS = [
    Kind("csv", "a.csv", write_text, COLUMN),
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
    Kind("mat 7.3", "a.mat", lambda path, first: write_mat73(path, **signals(first)),
    by("variable")),
    Kind("tdms", "a.tdms", write_tdms, by("channel")),
    Kind("tdms, timed", "a.tdms", partial(write_tdms, timed=True), by("channel", {})),
    Kind("c3d", "a.c3d", write_capture, ANALOGS),
    Kind("mcap", "a.mcap", write_mcap, MESSAGES),
    Kind("mcap, no chunks", "a.mcap", partial(write_mcap, use_chunking=False), MESSAGES),
    Kind("mcap, no CRC", "a.mcap", partial(write_mcap, compression=NONE, enable_crcs=False),
    MESSAGES),
    Kind("db3", "a", write_bag, MESSAGES),
    Kind("db3, alone", "a", lambda path, first: alone(write_bag(path, first)), MESSAGES),
    Kind("mcap of ROS", "a", partial(write_bag, storage="MCAP"), MESSAGES),
]  # fmt: skip

OF_CSV = known_formats()["csv"].source.model_validate({"format": "csv", **COLUMN})


@pytest.mark.parametrize("share", [0.3, 0.9])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_file_that_is_cut_off_is_refused_or_its_end_is_missing_or_not_known(
    kind: Kind, share: float, tmp_path: Path
) -> None:
    """Cut where a row or a segment ends: text and TDMS do not say how long they are."""
    path = kind.write(tmp_path / kind.file, 0)
    known = recognise(path)
    source = known.source.model_validate({"format": known.name, **kind.source})
    files = [part for part in [*path.rglob("*"), path] if part.is_file()]
    largest = max(files, key=lambda part: part.stat().st_size)
    content = largest.read_bytes()
    is_text = path.suffix in TEXT
    mark = b"\n" if is_text else b"TDSm" if path.suffix == ".tdms" else b""
    end = content.find(mark, int(share * len(content)))
    if end <= 0:
        pytest.skip("its last segment begins before")
    largest.write_bytes(content[: end + is_text])

    try:
        loss = read(path, source).loss
    except InputError:
        return
    is_told = loss.end is not End.WHOLE or bool(loss.lost)
    assert is_told or loss.expected == loss.read == ROWS  # only the index behind it was cut off
    assert is_text or is_told or loss.remarks


def test_a_number_of_samples_above_a_table_tells_that_its_end_is_missing(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(60))
    for above, complete, end_missing in (
        ("Samples: 60\n", True, False), ("# Number of frames: 120\n", False, True),
        ("Subject: 120\n", None, False),
        ("Samples,60,60\n", True, False), ("Total samples=600\n", False, True),
        ("Samples: 1.5 s\n", None, False),
    ):  # fmt: skip
        (tmp_path / "a.csv").write_text(above + "t,a,f\n" + rows)
        losses = read_converted(tmp_path / "a.csv", OF_CSV).losses
        told = losses.get("complete", True), losses.get("end_missing", False)
        assert told == (complete, end_missing)
        assert losses.get("lost") is None


def test_numbers_of_any_size_are_refused_and_numpy_warns_of_none(tmp_path: Path) -> None:
    for name in "taf":
        (written := signals(0))[name][300:302] = -1.7e308, 1.7e308
        pl.DataFrame(written).write_csv(path := tmp_path / "a.csv")
        inspect_recording(path)
        with pytest.raises(InputError):
            read_converted(path, OF_CSV)


def test_chunks_that_were_never_written_are_lost_and_not_zeros(tmp_path: Path) -> None:
    written, source = signals(0), {"format": "mat", **by("variable")}
    for name, time, first in (
        ("end.mat", {}, 0),
        ("middle.mat", {}, 30),
        ("rate.mat", {"time": {"rate": 250}}, 30),
    ):
        write_mat73(tmp_path / name, **signals(0))
        with h5py.File(tmp_path / name, "a") as file:
            del file["f"]
            kept = np.r_[:first, first + 20 : ROWS] if first else np.arange(ROWS - 20)
            torque = file.create_dataset("f", (1, ROWS), "f8", chunks=(1, 10))
            torque.attrs["MATLAB_class"] = np.bytes_("double")
            torque[0, kept] = written["f"][kept]
        described = known_formats()["mat"].source.model_validate(source | time)
        recording = read_converted(tmp_path / name, source=described)
        known = recording.samples.drop_nulls("torque")
        np.testing.assert_array_equal(known["torque"], written["f"][kept])
        np.testing.assert_allclose(known["theta"], recording.samples["theta"].to_numpy()[kept])
        assert any(f"has no value in 20 of {ROWS}" in text for text in recording.warnings)
