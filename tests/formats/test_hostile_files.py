# SPDX-License-Identifier: Apache-2.0
"""Files that lead to other files of the reader's machine, or that unpack to more than they seem."""

import json
import struct
import tracemalloc
import zlib
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import h5py
import lz4.frame
import numpy as np
import polars as pl
import pytest
import zstandard
from conftest import refused_with
from log_builders import write_mat
from mcap.writer import CompressionType, Writer

from osl_analysis import formats
from osl_analysis.base import memory
from osl_analysis.base.memory import check_unpacked

ZEROS = bytes(300 * 10**6)
"""What a bomb unpacks to."""


def external_storage(path: Path) -> None:
    (path.parent / "secret").write_bytes(bytes(800))
    with h5py.File(path, "w") as file:
        file.create_dataset("torque", (100,), "f8", external=[(path.parent / "secret", 0, 800)])


def virtual(path: Path) -> None:
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource(path.parent / "secret.h5", "x", (100,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("bench/torque", layout)


def link(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["angle"] = np.arange(100.0)
        file["torque"] = h5py.ExternalLink(str(path.parent / "secret.h5"), "/x")


def in_matlab(write):
    """The same in MATLAB's version 7.3."""

    def write_mat73(path: Path) -> None:
        write(path)
        data = path.read_bytes()
        path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + data)

    return write_mat73


@pytest.mark.parametrize("ending", ["h5", "mat"])
@pytest.mark.parametrize("write", [external_storage, virtual, link])
def test_hdf5_that_is_stored_in_other_files_is_refused_by_name(tmp_path, write, ending):
    path = tmp_path / f"a.{ending}"
    (in_matlab(write) if ending == "mat" else write)(path)

    with refused_with(r"torque is stored in other files"):
        formats.read(path)


def mcap(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=10**9)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        for stamp in range(3):
            writer.add_message(channel, stamp, ZEROS[: 10**8], stamp)
        writer.finish()


def mat5(path: Path) -> None:
    write_mat(path, torque=np.zeros(100))
    packed = zlib.compress(struct.pack("<II", 14, len(ZEROS)) + ZEROS)
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:  # never written, and so of no size
        file.create_dataset("torque", (10**8,), "f8", chunks=(10**6,))


def xlsx(path: Path) -> None:
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("xl/torque.xml", ZEROS)


def parquet(path: Path) -> None:
    pl.DataFrame({"torque": pl.repeat(0.0, 10**7, eager=True)}).write_parquet(path)


@pytest.mark.parametrize("write", [mcap, mat5, hdf5, xlsx, parquet])
def test_what_unpacks_to_much_more_is_refused_before_it_does(tmp_path, write):
    path = tmp_path / "a.mat" if write is mat5 else tmp_path / f"a.{write.__name__}"
    write(path)

    with refused_with("would unpack to .* MB"):
        formats.read(path)


@pytest.mark.parametrize("pack", [zstandard.compress, lz4.frame.compress])
def test_a_chunk_that_is_larger_than_it_states_is_lost(tmp_path, pack):
    packed = pack(ZEROS)
    name = b"zstd" if pack is zstandard.compress else b"lz4"
    fields = struct.pack("<QQQII", 0, 0, 1000, 0, len(name)) + name
    chunk = fields + struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(chunk)) + chunk)
    tracemalloc.start()

    recording = formats.read(path)

    assert tracemalloc.get_traced_memory()[1] < len(ZEROS) / 10
    tracemalloc.stop()
    assert any(
        "unpacks to other than its 1000 bytes" in message for message in recording.loss.remarks
    )


def test_what_a_job_has_no_memory_for_is_no_fault_of_the_file(tmp_path, monkeypatch):
    (tmp_path / "a.mat").write_bytes(bytes(10**6))
    monkeypatch.setenv("OSL_MEMORY_MB", "90")

    with pytest.raises(memory.MemoryLimitError, match="90 MB here"):
        check_unpacked(tmp_path / "a.mat", 10**8)


def test_jobs_share_the_memory_of_the_machine(monkeypatch):
    monkeypatch.setattr(memory, "memory_limits", lambda: [20 * 10**9])

    assert memory.allowed_memory(4) == 4 * 10**9
    assert memory.allowed_memory(1000) == 10**9


def test_a_line_that_no_row_of_a_log_has_is_refused_at_once(tmp_path):
    (tmp_path / "a.csv").write_text("1," * 10**6)

    with refused_with(r"a\.csv: has a line of more than 1000000 letters"):
        formats.read(tmp_path / "a.csv")


def test_cells_of_thousands_of_digits_are_read_in_time_proportional_to_them(tmp_path):
    cell = "1" * 100_000
    (tmp_path / "a.csv").write_text("t,a\n" + f"{cell}:{cell},1\n" * 3)

    with refused_with("a.csv: "):
        formats.read(tmp_path / "a.csv")


def test_messages_whose_keys_are_data_are_refused(tmp_path):
    lines = [json.dumps({f"{line}_{key}": 0 for key in range(1000)}) for line in range(3)]
    (tmp_path / "a.jsonl").write_text("\n".join(lines))

    with refused_with("3000 fields"):
        formats.read(tmp_path / "a.jsonl")
