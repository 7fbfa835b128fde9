"""Known formats: one table leads to everything; a mistake in a source file is refused by field, with the remedy."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml

from osl_analysis.commands.inspect import inspect_file, row_of
from osl_analysis.commands.trials import ingest_trial
from osl_analysis.config.configuration import read_section
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS, KnownFormat, read_source, recognise
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source import Keys, Source
from osl_analysis.judge.table import QualityRules
from osl_analysis.simulator.mcap_writer import DYNAMOMETER, write_mcap
from osl_analysis.simulator.vicon import C3dRecording, write_c3d
from osl_analysis.trial import read_trial

ROOT = Path(__file__).parents[1]
SHIPPED = sorted((ROOT / "config" / "sources").glob("*.yaml"))
LOG = {
    "format": "mcap",
    "time": {"source": "header"},
    "channels": {"theta": {"topic": "/lab", "field": "angle", "unit": "deg"}},
}
CAPTURE = {"format": "c3d"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_source_file_is_valid(path: Path) -> None:
    assert read_source(path).format in FORMATS


def channel(column: str, **fields: object) -> dict[str, object]:
    """A source file of a log with one channel."""
    return {**LOG, "channels": {column: {"topic": "/lab", "field": "angle", **fields}}}


OUTPUT = {"label": "LAnkleMoment", "component": "x", "unit": "N*mm"}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (
            channel("torque", unit="deg"),
            "source.yaml: line 5: channels.torque.unit: 'deg' is not allowed: unit 'deg' m",
        ),
        (channel("time", unit="s"), "time is not a channel"),
        (channel("theta", unit="deg", sign=0), "sign"),
        ({"format": "xlsx"}, "format: 'xlsx' is not allowed"),
        ({**LOG, "channels": {}}, "channels: name at least one"),
        ({**CAPTURE, "plates": "first"}, "plates: 'first' is not allowed: write all, none or a list"),
        ({**CAPTURE, "plate_units": {"force": "N", "moment": "mm"}}, "unit 'mm' measures [m]"),
        ({**CAPTURE, "outputs": {"reference_ankle_moment_left": OUTPUT}}, "unit 'N*mm' measures [N*m]"),
    ],
)
def test_a_mistake_in_a_source_file_is_refused_by_its_field(
    tmp_path: Path, content: dict[str, object], told: str
) -> None:
    path = tmp_path / "source.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError) as caught:
        read_source(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert told in message


def read_toy(path: Path, source: Source) -> Recording:
    content = json.loads(path.read_bytes().removeprefix(b"TOY1"))
    columns = {name: one.to_si(np.array(content[one.name]), "rad") for name, one in source.channels.items()}
    time = np.arange(len(content["angle"])) / 100
    return Recording(pl.DataFrame({"time": time, **columns}), {n: c.origin(n) for n, c in source.channels.items()})


def inspect_toy(path: Path) -> Overview:
    content = json.loads(path.read_bytes().removeprefix(b"TOY1"))
    return Overview("toy", {"rows": "3"}, [RecordedChannel("column", {"key": key}) for key in content])


def test_an_entry_in_the_table_makes_a_format_known_to_ingest_inspect_draft_and_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new format touches its decoder in formats/, its keys, reader and overview in ingest/, the table and a test."""
    keys = Keys("channels", "key", kinds={"channel.key": (str, ...)})
    toy = KnownFormat("toy", lambda begin: begin.startswith(b"TOY1"), (".toy",), read_toy, inspect_toy, keys)
    monkeypatch.setitem(FORMATS, "toy", toy)
    (tmp_path / "a.dat").write_bytes(b'TOY1{"angle": [0, 90, 180]}')
    drafted = draft_source(inspect_file(tmp_path / "a.dat"), "a.dat")
    (tmp_path / "toy.yaml").write_text(drafted.replace("NAME_1", "theta").replace('UNKNOWN"', 'deg"'))
    row = {"trial": "a", "log": "a.dat", "log_source": "toy"}
    ingest_trial(row, tmp_path, tmp_path, tmp_path / "a.parquet")
    theta = read_trial(tmp_path / "a.parquet").samples["theta"]
    np.testing.assert_allclose(theta, [0, np.pi / 2, np.pi])
    rules = read_section(ROOT / "config/config.yaml", "quality", QualityRules)
    assert row_of(tmp_path / "a.dat", rules) == ("toy", "rows: 3\n1 x column", "")


def test_a_file_is_recognised_by_its_content_and_where_that_says_nothing_by_its_name(tmp_path: Path) -> None:
    named = {"a.c3d": b"no C3D file", "a.mcap": b"text", "a.csv": b"a,b\n1,2\n", "a.log": b"a,b\n1,2\n"}
    for name, content in named.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "b.csv").write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    (tmp_path / "c.csv").write_text('Trajectories\n100\n,,A,,\n"Frame","Sub Frame",X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n')
    recognised = {path.name: recognise(path) for path in tmp_path.iterdir()}
    by_name = {"a.c3d": "c3d", "a.mcap": "mcap", "a.csv": "csv", "a.log": "csv"}
    assert recognised == {**by_name, "b.csv": "mcap", "c.csv": "nexus_csv"}


TIME = 5.0 + np.arange(200) / 500


def log_source(name: str) -> Source:
    return read_source(ROOT / "config/sources" / f"{name}.yaml")


def test_the_dynamometers_log_gives_the_resisting_torque(tmp_path: Path) -> None:
    fields = ("joint_angle", "load_cell_torque", "actuator_angle", "motor_current", "commanded_angle")
    columns = {field: np.float32(np.sin(TIME + i)) for i, field in enumerate(fields)}
    write_mcap(tmp_path / "log.mcap", DYNAMOMETER, TIME, columns)
    recording = FORMATS["mcap"].read(tmp_path / "log.mcap", log_source("dynamometer"))
    mapped = {"theta": 0, "torque": 1, "theta_m": 2, "current": 3, "theta_command": 4}
    for column, field in mapped.items():
        sign = -1 if column == "torque" else 1  # the load cell measures what the joint exerts
        np.testing.assert_array_equal(recording.samples[column], sign * columns[fields[field]].astype(float))
    np.testing.assert_allclose(recording.samples["time"], TIME - TIME[0], atol=1e-9)
    assert recording.warnings == []


def test_vicons_file_gives_markers_the_ground_reaction_and_both_pulses(tmp_path: Path) -> None:
    frames, ratio = 30, 5
    points = np.random.default_rng(0).normal(1.0, 0.2, (frames, 2, 3))
    points[4:7, 1] = np.nan
    corners = np.array([[0.6, 0.5, 0.0], [0.6, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    foot, force = np.array([0.4, 0.2, 0.0]), np.array([20.0, -30.0, 700.0])
    centre, depth = corners.mean(axis=0), 0.041
    axes = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # rows: the plate's x, y and z in the laboratory
    about_sensors = axes @ np.cross(foot - centre + [0, 0, depth], force)
    channels = np.concatenate([axes @ force, about_sensors * 1000, [5.0, 0.0]])
    recording = C3dRecording(
        labels=("FOOT1", "PLAT1"),
        points=points,
        point_rate_hz=300,
        channels=("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1", "Sync", "Trigger"),
        units=("N", "N", "N", "Nmm", "Nmm", "Nmm", "V", "V"),
        analogs=np.tile(channels, (frames * ratio, 1)),
        analog_rate_hz=1500,
        corners=corners,
        origin=np.array([0.0, 0.0, -depth]),
    )
    write_c3d(tmp_path / "a.c3d", recording)
    source = read_source(ROOT / "config/sources" / "vicon.yaml")
    samples = FORMATS["c3d"].read(tmp_path / "a.c3d", source).samples
    for axis, name in enumerate("xyz"):
        for i, label in enumerate(recording.labels):
            seen = samples[f"marker_{label}_{name}"].drop_nulls().to_numpy()
            np.testing.assert_allclose(seen, points[:, i, axis], atol=1e-6)
        assert samples[f"plate1_force_{name}"][7] == pytest.approx(force[axis], rel=1e-6)
        expected = np.cross(foot - centre, force)[axis]
        assert samples[f"plate1_moment_{name}"][7] == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert samples["sync"].unique().to_list() == [5.0]
    assert samples["trigger"].unique().to_list() == [0.0]
