"""What cannot be is refused at ingest: values that nothing can reach, captures without names or without a sight."""

from pathlib import Path

import numpy as np
import pytest
from c3d_builder import write_c3d

from osl_analysis.columns import COLUMNS, FAMILIES
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.errors import InputError
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.formats.csv_table import MOST_CELLS
from osl_analysis.ingest.recording import LARGEST
from osl_analysis.trial import Trial, read_trial

LOG = "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: a, unit: UNIT}\n"
LOG += "  torque: {column: m, unit: N*m}\n"


def log_of(folder: Path, angle: float, torque: float, unit: str = "rad") -> Trial:
    """A log of four rows whose third has these values, ingested."""
    rows = [f"{k / 100},{angle if k == 2 else 0.1},{torque if k == 2 else k}" for k in range(4)]
    (folder / "log.csv").write_text("\n".join(["t,a,m", *rows]) + "\n")
    (folder / "s.yaml").write_text(LOG.replace("UNIT", unit))
    return ingested(folder, log="log.csv", log_source="s")


def capture_of(folder: Path, points: np.ndarray, experiment: str = "ingest_only", **parameters: object) -> Trial:
    """A capture without plates, ingested."""
    write_c3d(folder / "a.c3d", points, **parameters)  # type: ignore[arg-type]
    (folder / "s.yaml").write_text("format: c3d\nmarkers: all\nplates: none\n")
    return ingested(folder, experiment, mocap="a.c3d", mocap_source="s")


def ingested(folder: Path, experiment: str = "ingest_only", **files: str) -> Trial:
    ingest_trial({"trial": "a", "experiment": experiment, **files}, folder, folder, folder / "a.parquet")
    return read_trial(folder / "a.parquet")


def seen(frames: int = 6) -> np.ndarray:
    """Two points that are seen, in mm."""
    return np.concatenate([np.arange(1.0, 1 + frames * 6).reshape(frames, 2, 3), np.zeros((frames, 2, 1))], axis=2)


def test_every_unit_of_a_column_has_a_largest_value() -> None:
    units = {column.unit for name, column in COLUMNS.items() if name != "time"} | set(FAMILIES.values())
    assert units == set(LARGEST)


@pytest.mark.parametrize(
    ("angle", "torque", "unit", "told"),
    [
        (1e300, 0.0, "rad", r"theta is 1e\+300 rad at 0\.020 s, and beyond ±1e\+06 in 1 of 4 samples"),
        (-1.1e6, 0.0, "rad", r"theta is -1\.1e\+06 rad at 0\.020 s"),
        (0.0, 1e200, "rad", r"torque is 1e\+200 N\*m at 0\.020 s"),
        (1.7e308, 0.0, "rev", r"theta is inf rad at 0\.020 s"),  # overflows in the conversion
    ],
)
def test_values_that_nothing_can_reach_are_refused_by_file_column_value_and_remedy(
    tmp_path: Path, angle: float, torque: float, unit: str, told: str
) -> None:
    with pytest.raises(InputError, match=rf"log\.csv: {told}.*; correct its unit or scale in the source file, or"):
        log_of(tmp_path, angle, torque, unit)
    assert not (tmp_path / "a.parquet").exists()


def test_values_below_the_largest_are_left_to_fits_and_checks(tmp_path: Path) -> None:
    assert log_of(tmp_path, 0.9e6, -0.9e7).samples["theta"][2] == 0.9e6
    far = seen()
    far[:, :, 0] = 0.99e6
    assert capture_of(tmp_path, far).samples["marker_M1_x"][0] == pytest.approx(990.0)


def test_a_marker_at_the_end_of_single_precision_is_refused(tmp_path: Path) -> None:
    far = seen()
    far[3, 1, 2] = 1e38
    with pytest.raises(InputError, match=r"a\.c3d: marker_M2_z is 1e\+35 m at 0\.030 s, and beyond ±1000 in 1 of 6"):
        capture_of(tmp_path, far)


def test_points_without_names_are_refused_where_all_are_to_be_read(tmp_path: Path) -> None:
    told = "none of its 2 points has a name; label them"
    with pytest.raises(InputError, match=rf"a\.c3d: POINT:LABELS is empty: {told}"):
        capture_of(tmp_path, seen(), POINT__LABELS=["", ""])
    assert "marker_A_x" in capture_of(tmp_path, seen(), POINT__LABELS=["A", ""]).samples.columns
    path = tmp_path / "a.c3d"
    path.write_bytes(path.read_bytes().replace(b"LABELS", b"NOTHER", 1))  # the first is that of POINT
    with pytest.raises(InputError, match=rf"a\.c3d: POINT:LABELS is missing: {told}"):
        ingested(tmp_path, mocap="a.c3d", mocap_source="s")


def test_a_capture_without_anything_to_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.c3d: the source file names nothing that the file has: .*; name"):
        capture_of(tmp_path, seen(), POINT__LABELS=["*1", "*2"])


def test_markers_that_were_never_seen_are_refused_where_they_are_needed_and_told_elsewhere(tmp_path: Path) -> None:
    hidden = seen()
    hidden[:, :, 3] = -1.0
    for experiment in (name for name, facts in EXPERIMENTS.items() if facts.place == "walkway"):
        with pytest.raises(InputError, match=rf"none of its 2 markers .* experiment '{experiment}' needs them; "):
            capture_of(tmp_path, hidden, experiment)
    told = capture_of(tmp_path, hidden).provenance["warnings"]
    assert told == ["none of the 2 markers was seen in any of the 6 frames"]
    hidden[4, 0, 3] = 0.0
    assert capture_of(tmp_path, hidden, "walking").provenance["warnings"] == []


def test_a_walkway_trial_without_markers_is_refused(tmp_path: Path) -> None:
    log_of(tmp_path, 0.1, 1.0)
    with pytest.raises(InputError, match=r"trial a: no markers, and a trial of experiment 'static' needs them; label"):
        ingested(tmp_path, "static", log="log.csv", log_source="s")


def test_what_is_no_file_is_named_as_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(LOG.replace("UNIT", "rad"))
    (tmp_path / "folder").mkdir()
    for name, told in (
        ("/dev/zero", "a device or a pipe"),
        ("folder", "a folder"),
        ("x", "no such file"),
    ):
        with pytest.raises(InputError, match=rf"{name}: {told}.*; \w+"):
            ingested(tmp_path, log=name, log_source="s")


def test_names_that_a_file_lacks_are_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,a\n0,1\n1,2\n")
    (tmp_path / "s.yaml").write_text(LOG.replace("UNIT", "rad"))
    with pytest.raises(InputError, match=r"'m' is missing; the file has t, a; correct the name in the source file$"):
        ingested(tmp_path, log="log.csv", log_source="s")
    write_c3d(tmp_path / "a.c3d", seen())
    for field, told in (
        ("markers: [NOPE]", "no marker 'NOPE'; the file has M1"),
        ("plates: [3]", "no force plate 3"),
    ):
        (tmp_path / "s.yaml").write_text(f"format: c3d\n{field}\n")
        with pytest.raises(InputError, match=rf"a\.c3d: {told}.*; correct .* in the source file$"):
            ingested(tmp_path, mocap="a.c3d", mocap_source="s")


def test_a_delay_longer_than_the_log_is_refused_with_the_file(tmp_path: Path) -> None:
    log_of(tmp_path, 0.1, 1.0)
    source = LOG.replace("UNIT", "rad").replace("N*m}", "N*m, delay: 2 s}")
    (tmp_path / "s.yaml").write_text(source)
    with pytest.raises(InputError, match=rf"^{tmp_path}/log\.csv: torque: a delay of 2 s is .*; correct `delay`"):
        ingested(tmp_path, log="log.csv", log_source="s")


def test_a_long_name_does_not_fill_the_message_and_blank_lines_count_in_it(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"t,{'a' * 5000}\n\n0,1\n \t\n1,2\n")
    (tmp_path / "s.yaml").write_text(LOG.replace("UNIT", "rad"))
    with pytest.raises(InputError, match=rf"the file has t, {'a' * 80}\.\.\.; correct the name"):
        ingested(tmp_path, log="log.csv", log_source="s")
    (tmp_path / "log.csv").write_text("1," * (MOST_CELLS + 1))
    with pytest.raises(InputError, match=r"log\.csv: line 1 has 16386 cells, at most 16384 are read; write a row per"):
        ingested(tmp_path, log="log.csv", log_source="s")
    (tmp_path / "log.csv").write_text("t,a,m\n\n0,1,2\n \t\n1,2,x\n")
    with pytest.raises(InputError, match="line 5, column 'm': 'x' is not a number"):
        ingested(tmp_path, log="log.csv", log_source="s")
