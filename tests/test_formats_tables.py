"""Tables in formats of programs, and TDMS."""

from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
import xlsxwriter

from osl_analysis import formats
from osl_analysis.errors import InputError
from osl_analysis.recording import Recording

TIME = np.arange(50) / 500  # s
ANGLE = 5 * np.sin(9 * TIME)
TORQUE = 30 * np.sin(9 * TIME + 0.3)
FRAME = pl.DataFrame({"time_s": TIME, "ankle_angle_deg": ANGLE, "torque_Nm": TORQUE})


def numbers(recording: Recording, name: str, key: str = "column") -> np.ndarray:
    return np.asarray(recording.find({key: name}).read())


# --- tables -------------------------------------------------------------------------------------


def write_frame(path: Path) -> Path:
    if path.suffix == ".parquet":
        FRAME.write_parquet(path)
    elif path.suffix == ".feather":
        FRAME.write_ipc(path)
    elif path.suffix == ".arrows":
        FRAME.write_ipc_stream(path)
    elif path.suffix == ".xlsx":
        FRAME.write_excel(path)
    elif path.suffix == ".h5":
        write_hdf5(path)
    elif path.suffix == ".npy":
        np.save(path, FRAME.to_numpy(structured=True))
    else:
        np.savez(path, **{name: FRAME[name].to_numpy() for name in FRAME.columns})
    return path


def test_a_workbook_is_its_largest_sheet_by_the_rules_of_text(tmp_path: Path) -> None:
    with xlsxwriter.Workbook(tmp_path / "a.xlsx") as book:
        book.add_worksheet("notes").write_row(0, 0, ["Bench 3", "rig B"])
        sheet = book.add_worksheet("data")
        sheet.write_row(0, 0, ["Angle", "Torque"])
        sheet.write_row(1, 0, ["deg", "Nm"])
        for row, values in enumerate(zip(ANGLE, TORQUE, strict=True), start=2):
            sheet.write_row(row, 0, values)

    recording = formats.read(tmp_path / "a.xlsx")

    assert [(one.name, one.unit) for one in recording.channels] == [
        ("Angle", "deg"), ("Torque", "Nm"),
    ]  # fmt: skip
    np.testing.assert_allclose(numbers(recording, "Torque"), TORQUE, atol=1e-9)
    assert "sheet 'data' is read, the largest; not read: notes" in recording.loss.remarks
    assert recording.channels[0].rows.place(0) == "row 3"


def write_hdf5(path: Path) -> Path:
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = 500
        file["run/angle"] = ANGLE
        file["run/torque [Nm]"] = TORQUE
        file["run/angle"].attrs["units"] = "deg"
        file["emg/raw"] = np.arange(500.0)
    return path


def test_a_part_of_an_archive_that_does_not_match_its_checksum_is_refused(tmp_path: Path) -> None:
    path = write_frame(tmp_path / "a.npz")
    content = bytearray(path.read_bytes())
    content[content.index(TORQUE.tobytes()) + 100] ^= 1
    path.write_bytes(content)

    with pytest.raises(InputError, match=r"cannot be read .*torque_Nm\.npy.*; copy"):
        formats.read(path)


@pytest.mark.parametrize("suffix", ["parquet", "feather", "npy", "npz", "h5", "xlsx"])
def test_a_file_that_is_cut_is_refused_in_one_sentence(tmp_path: Path, suffix: str) -> None:
    path = write_frame(tmp_path / f"a.{suffix}")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    with pytest.raises(InputError, match=r"^[^\n]*a\.[^\n]*; copy the file again, or exp[^\n]*$"):
        formats.read(path)


# --- TDMS ---------------------------------------------------------------------------------------


