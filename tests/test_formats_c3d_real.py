"""C3D files that others recorded: decoded as they are meant, or refused with the reason."""

import warnings
from pathlib import Path

import c3d
import ezc3d
import numpy as np
import pytest
from c3d_builder import REAL_DATA, write_c3d

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d import read_c3d

C3D = REAL_DATA / "c3d"
needs_real_data = pytest.mark.skipif(not C3D.is_dir(), reason="real data are not here")
UNREADABLE = {
    "Optotrak_truncated_29_of_1149.c3d": "truncated: it declares 1149 frames and holds 29",
    "s18_bad_parameter_section.c3d": "the parameter section is damaged after 'LABELS'",
}
MISREAD_BY_EZC3D = ["Eb015si.c3d", "mac_s11_evart_types3344.c3d", "bts_561xxa01_anonym.C3D"]
REAL_FILES = sorted(p for p in C3D.glob("*") if p.stat().st_size > 1024) if C3D.is_dir() else []
READ_BY_EZC3D = [path for path in REAL_FILES if path.name not in (*UNREADABLE, *MISREAD_BY_EZC3D)]


@needs_real_data
def test_a_real_file_that_cannot_be_trusted_is_refused_with_the_reason() -> None:
    for name, problem in UNREADABLE.items():
        with pytest.raises(InputError, match=problem):
            read_c3d(C3D / name)


@pytest.mark.parametrize("path", READ_BY_EZC3D, ids=lambda path: path.stem)
def test_points_analogs_and_parameters_of_real_files_equal_ezc3ds(path: Path) -> None:
    recording, theirs, compared = read_c3d(path), ezc3d.c3d(str(path)), 0
    points = theirs["data"]["points"][:3].transpose(2, 1, 0)
    unseen = (theirs["data"]["meta_points"]["residuals"][0].T < 0) | (points == 0).all(axis=2)
    np.testing.assert_array_equal(recording.points, np.where(unseen[:, :, None], np.nan, points))
    if recording.header.channels and "UNSIGNED" not in recording.header.texts("ANALOG:FORMAT"):
        np.testing.assert_allclose(recording.analogs, theirs["data"]["analogs"][0].T, rtol=1e-12, atol=1e-12)
    for group, values in theirs["parameters"].items():
        for name in values.keys() - {"__METADATA__"} if group else ():
            value, other = recording.header.parameters.get(f"{group}:{name}".upper()), values[name]["value"]
            if isinstance(value, list):
                known = [one.encode("latin-1", "surrogateescape") for one in other]
                assert [one.encode("latin-1", "replace") for one in value] == known
            elif value is not None:  # else a name that ezc3d adds
                np.testing.assert_array_equal(value.ravel(order="F"), np.ravel(other, order="F"))
            compared += value is not None
    assert compared >= 10


@needs_real_data
@pytest.mark.parametrize(
    "name", ["Eb015si.c3d", "bts_561xxa01_anonym.C3D", "c3dorg_s10_TYPE-3.c3d", "opensim_jogging_300_1500.c3d"]
)
def test_points_of_real_files_equal_those_of_the_c3d_package(name: str) -> None:
    found = read_c3d(C3D / name).points
    with (C3D / name).open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it comments on every oddity of a file
        theirs = np.array([points[:, :4] for _, points, _ in c3d.Reader(file).read_frames()])
    seen = ~np.isnan(found).any(axis=2)
    assert seen.mean() > 0.5
    np.testing.assert_allclose(found[seen], theirs[:, :, :3][seen], rtol=1e-6, atol=1e-4)


@needs_real_data
def test_markers_move_like_a_body_where_the_rate_of_the_analogs_contradicts_the_header() -> None:
    step = np.linalg.norm(np.diff(read_c3d(C3D / "mac_s11_evart_types3344.c3d").points, axis=0), axis=2)
    assert np.nanquantile(step, 0.99) < 150.0  # mm in a frame; misplaced frames jump by metres


def test_a_byte_of_a_parameter_has_no_sign_and_a_second_parameter_goes_on_with_its_labels(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", np.ones((4, 2, 4)), OWN__KIND=bytes([1, 255]), POINT__LABELS2=["A\0"])
    assert read_c3d(path).header.texts("POINT:LABELS") == ["M1", "M2", "A"]
    assert read_c3d(path).header.numbers("OWN:KIND").tolist() == [1, 255]


def test_frames_beyond_those_that_the_header_can_count_are_all_read(tmp_path: Path) -> None:
    words = {"TRIAL__ACTUAL_START_FIELD": np.array([32767, 0]), "TRIAL__ACTUAL_END_FIELD": np.array([32770, 1])}
    long, many = {"POINT__LONG_FRAMES": np.array([65540.0])}, {"POINT__LABELS": ["A"]}  # beyond a signed word
    for shape, more in (((65540, 1), words), ((65540, 1), long), ((1, 40000), many)):
        path = write_c3d(tmp_path / "a.c3d", np.ones((*shape, 4)), **more)
        assert read_c3d(path).points.shape == (*shape, 3)
