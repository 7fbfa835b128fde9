"""C3D files that others recorded: decoded as they are meant, or refused with the reason."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest
from c3d_builder import REAL_DATA

from osl_analysis.errors import InputError
from osl_analysis.ingest.c3d_file import read_c3d
from osl_analysis.ingest.c3d_header import read_header

C3D = REAL_DATA / "c3d"
needs_real_data = pytest.mark.skipif(not C3D.is_dir(), reason="real data are not here")
REAL_FILES = sorted(p for p in C3D.glob("*") if p.stat().st_size > 1024) if C3D.is_dir() else []
UNREADABLE = {
    "Eb015si.c3d": "written for a processor MIPS; only Intel and DEC are read",
    "Optotrak_truncated_29_of_1149.c3d": "truncated: it declares 1149 frames and holds 29",
    "s18_bad_parameter_section.c3d": "damaged C3D file: the parameter section is damaged",
    "mac_s11_evart_types3344.c3d": "correct POINT:RATE and ANALOG:RATE",
    "bts_561xxa01_anonym.C3D": "correct POINT:RATE and ANALOG:RATE",
}
READABLE = [path for path in REAL_FILES if path.name not in UNREADABLE]


@needs_real_data
@pytest.mark.parametrize(("name", "problem"), UNREADABLE.items(), ids=lambda value: value.split(".")[0])
def test_a_real_file_that_cannot_be_trusted_is_refused_with_the_reason(name: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        read_c3d(C3D / name)


@pytest.mark.parametrize("path", READABLE, ids=lambda path: path.stem)
def test_parameters_of_real_files_equal_ezc3ds(path: Path) -> None:
    header, compared = read_header(path), 0
    for group, values in ezc3d.c3d(str(path))["parameters"].items():
        for name, parameter in values.items():
            mine = header.parameters.get(f"{group}:{name}".upper())
            if mine is None or group == "":
                continue  # a name that ezc3d adds
            theirs = parameter["value"]
            if isinstance(mine, list):
                assert [text.encode("latin-1", "replace") for text in mine] == [
                    text.encode("latin-1", "surrogateescape") for text in theirs
                ]
            else:
                np.testing.assert_array_equal(mine.ravel(order="F"), np.ravel(theirs, order="F"))
            compared += 1
    assert compared >= 10


@pytest.mark.parametrize("path", READABLE, ids=lambda path: path.stem)
def test_points_of_real_files_are_the_numbers_in_the_file(path: Path) -> None:
    recording = read_c3d(path)
    header, content = recording.header, path.read_bytes()
    if header.integers or content[(content[0] - 1) * 512 + 3] != 84:
        pytest.skip("only floats of Intel files are numbers as they stand")
    width = 4 * header.points + header.channels * header.samples_per_frame
    raw = np.frombuffer(content, "<f4", header.frames * width, header.data_start).reshape(header.frames, width)
    raw_points = raw[:, : 4 * header.points].reshape(header.frames, header.points, 4)
    unseen = (raw_points[:, :, 3] < 0) | (raw_points[:, :, :3] == 0).all(axis=2)
    expected = np.where(unseen[:, :, None], np.nan, raw_points[:, :, :3].astype(float))
    np.testing.assert_array_equal(recording.points, expected)


@needs_real_data
def test_one_trial_stored_in_four_ways_is_one_trial() -> None:
    files = [read_c3d(C3D / f"Eb015{kind}.c3d") for kind in ("pi", "pr", "vi", "vr")]
    for other in files[1:]:
        np.testing.assert_allclose(other.points, files[0].points, atol=0.0834)  # mm, one integer step
        np.testing.assert_allclose(other.analogs, files[0].analogs, rtol=1e-4, atol=1e-3)


@needs_real_data
def test_unsigned_offsets_of_a_real_plate_are_read_as_unsigned() -> None:
    recording = read_c3d(C3D / "vicon_shd01_unsigned_offsets_missing_plate2.c3d")
    content, header = (C3D / recording.path.name).read_bytes(), recording.header
    width = 4 * header.points + header.channels * header.samples_per_frame
    raw = np.frombuffer(content, "<f4", header.frames * width, header.data_start).reshape(header.frames, width)
    samples = raw[:, 4 * header.points :].reshape(-1, header.channels).astype(float)
    offset, scale = header.numbers("ANALOG:OFFSET") % 65536, header.numbers("ANALOG:SCALE")
    np.testing.assert_allclose(recording.analogs, (samples - offset) * scale, rtol=1e-9, atol=1e-6)
