"""Known formats: one table leads to everything; a mistake in a source file is refused by field, with the remedy."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml

from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.inspect import inspect_file, row_of
from osl_analysis.commands.trials import ingest_trial
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS, KnownFormat, read_source, recognise
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source import Source, model_of
from osl_analysis.judge.table import QualityRules
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
    model = model_of("toy", "channels", "key", kinds={"channel.key": (str, ...)})
    toy = KnownFormat(model, lambda begin: begin.startswith(b"TOY1"), (".toy",), read_toy, inspect_toy)
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
