"""Source files: a mistake is refused when the file is read, by field, with the remedy."""

from pathlib import Path

import pytest
import yaml

from osl_analysis.errors import InputError
from osl_analysis.ingest.known_formats import FORMATS, read_source

SHIPPED = sorted((Path(__file__).parents[1] / "config" / "sources").glob("*.yaml"))
LOG = {
    "format": "mcap",
    "time": {"source": "header"},
    "channels": {"theta": {"topic": "/lab", "field": "angle", "unit": "deg"}},
}
CAPTURE = {"format": "c3d"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_source_file_is_valid(path: Path) -> None:
    assert read_source(path).format in FORMATS


def refused(tmp_path: Path, content: object) -> str:
    path = tmp_path / "source.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError) as caught:
        read_source(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


def test_an_unknown_column_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    channels = {"thetta": {"topic": "/lab", "field": "angle", "unit": "deg"}}
    assert "'thetta' is no canonical column; the columns are theta, theta_m" in refused(
        tmp_path, {**LOG, "channels": channels}
    )


def test_a_unit_that_cannot_become_the_columns_is_refused(tmp_path: Path) -> None:
    channels = {"torque": {"topic": "/lab", "field": "t", "unit": "deg"}}
    assert "torque: unit 'deg' measures [rad]" in refused(tmp_path, {**LOG, "channels": channels})


def test_time_is_not_a_channel(tmp_path: Path) -> None:
    channels = {"time": {"topic": "/lab", "field": "t", "unit": "s"}}
    assert "time is no channel" in refused(tmp_path, {**LOG, "channels": channels})


def test_a_misspelt_field_is_refused(tmp_path: Path) -> None:
    assert "unknown field 'chanels'" in refused(tmp_path, {**LOG, "chanels": {}})


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    assert "format: 'xlsx' is not allowed" in refused(tmp_path, {"format": "xlsx"})


def test_a_sign_is_one_or_minus_one(tmp_path: Path) -> None:
    channels = {"theta": {"topic": "/lab", "field": "angle", "unit": "deg", "sign": 0}}
    assert "sign" in refused(tmp_path, {**LOG, "channels": channels})


def test_a_clock_to_be_aligned_needs_the_sync_column(tmp_path: Path) -> None:
    assert "needs the column sync" in refused(tmp_path, {**LOG, "clock": "sync"})


def test_plates_are_all_none_or_a_list(tmp_path: Path) -> None:
    assert "plates: 'first' is not allowed: write all, none or a list" in refused(
        tmp_path, {**CAPTURE, "plates": "first"}
    )


def test_plate_units_must_measure_force_and_moment(tmp_path: Path) -> None:
    units = {"force": "N", "moment": "mm"}
    assert "unit 'mm' measures [m]" in refused(tmp_path, {**CAPTURE, "plate_units": units})


def test_a_model_output_needs_a_unit_of_its_column(tmp_path: Path) -> None:
    output = {"label": "LAnkleMoment", "component": "x", "unit": "N*mm"}
    outputs = {"reference_ankle_moment_left": output}
    assert "unit 'N*mm' measures [N*m]" in refused(tmp_path, {**CAPTURE, "outputs": outputs})
