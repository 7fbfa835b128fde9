"""LabVIEW's TDMS gives canonical columns by the timing of its channels or a channel of time, and else is refused."""

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from c3d_builder import REAL_DATA
from nptdms import ChannelObject, RootObject, TdmsWriter
from recognised_files import read_recognised, refusal_of

from osl_analysis.commands.inspect import inspect_file, overview_text
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source

ROWS = 100
START = np.datetime64("2024-05-01T12:00:00")
ANGLE = np.linspace(-10.0, 10.0, ROWS)
TORQUE = 40.0 * np.sin(np.arange(ROWS) / 7)
SOURCE = {
    "format": "tdms",
    "channels": {
        "theta": {"channel": "Bench/Angle"},
        "torque": {"channel": "Torque", "unit": "lbf*in", "sign": -1},
    },
}


def timing(step: float = 1e-3, offset: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"wf_increment": step, "wf_start_offset": offset, "wf_start_time": START, "wf_samples": 1, **more}


def write(path: Path, channels: list[tuple[str, Any, dict[str, Any]]], segments: int = 1) -> Path:
    """Channels of the group Bench, in as many segments."""
    with TdmsWriter(path) as writer:
        for part in range(segments):
            cut = [np.array_split(np.asarray(values), segments)[part] for _, values, _ in channels]
            named = zip(channels, cut, strict=True)
            objects = [ChannelObject("Bench", name, values, about) for (name, _, about), values in named]
            writer.write_segment([RootObject({"author": "lab"}), *objects])
    return path


def bench(path: Path, segments: int = 1, **options: Any) -> Path:
    angle = ("Angle", ANGLE, timing(unit_string="Degrees", **options))
    return write(path, [angle, ("Torque", np.float32(TORQUE), timing(unit_string="Volts"))], segments)


read = partial(read_recognised, **SOURCE)
refused = partial(refusal_of, **SOURCE)


@pytest.mark.parametrize("segments", [1, 7])
def test_channels_with_timing_give_canonical_columns(tmp_path: Path, segments: int) -> None:
    recording = read(bench(tmp_path / "a.tdms", segments))
    newton_metres = 4.4482216152605 * 0.0254  # lbf and in by definition
    torque = -np.float32(TORQUE).astype(float) * newton_metres
    for column, expected in (("time", np.arange(ROWS) * 1e-3), ("theta", np.radians(ANGLE)), ("torque", torque)):
        np.testing.assert_allclose(recording.samples[column], expected, rtol=1e-12, atol=1e-12)
    assert recording.columns["theta"]["unit"] == "Degrees"


def test_an_index_beside_the_file_is_not_looked_at(tmp_path: Path) -> None:
    bench(tmp_path / "a.tdms")
    (tmp_path / "a.tdms_index").write_bytes(b"TDSh, that of another file")
    assert len(read(tmp_path / "a.tdms").samples) == ROWS
    (tmp_path / "c.tdms").write_bytes(b"TDSh\0\0")
    assert "the index of a TDMS file; name the .tdms file beside it" in refused(tmp_path / "c.tdms")


def test_channels_of_other_rates_have_rows_of_their_own(tmp_path: Path) -> None:
    angle, later = ("Angle", ANGLE, timing(unit_string="deg")), {**timing(5e-3, 0.001)}
    later["wf_start_time"] = START + np.timedelta64(1500, "us")
    recording = read(write(tmp_path / "a.tdms", [angle, ("Torque", TORQUE[:20], later)]))
    torque = recording.samples.drop_nulls("torque")
    np.testing.assert_allclose(recording.samples.drop_nulls("theta")["time"], np.arange(ROWS) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(torque["time"], 0.0025 + np.arange(20) * 5e-3, atol=1e-12)
    np.testing.assert_allclose(torque["torque"] / torque["torque"][1], TORQUE[:20] / TORQUE[1], atol=1e-12)
    assert len(recording.samples) == 120
    late = write(tmp_path / "b.tdms", [angle, ("Torque", TORQUE, timing(1e-3, 60.0))])
    assert "its channels do not overlap in time" in refused(late)


def test_without_timing_the_file_is_refused_until_the_source_file_tells_it(tmp_path: Path) -> None:
    stamps = START + np.arange(ROWS) * np.timedelta64(2, "ms")
    deg = {"unit_string": "deg"}
    channels = [("Angle", ANGLE, deg), ("Torque", TORQUE, {}), ("t", np.arange(ROWS) * 5.0, {}), ("Stamp", stamps, {})]
    path = write(tmp_path / "a.tdms", channels)
    said = refused(path)
    assert "channel 'Bench/Angle' has no timing (`wf_increment` among its properties); name the channel of time" in said
    for time, step in (({"rate": 400}, 2.5e-3), ({"channel": "t", "unit": "ms"}, 5e-3), ({"channel": "Stamp"}, 2e-3)):
        np.testing.assert_allclose(read(path, time=time).samples["time"], np.arange(ROWS) * step, atol=1e-9)
    assert "the unit is empty" in refused(path, time={"channel": "t"})
    zero = write(tmp_path / "b.tdms", [("Angle", ANGLE, timing(0.0)), ("Torque", TORQUE, timing(0.0))])
    assert "has no timing" in refused(zero)


def test_a_channel_that_cannot_be_a_signal_is_refused(tmp_path: Path) -> None:
    angle, torque = ("Angle", ANGLE, timing(unit_string="deg")), ("Torque", TORQUE, timing())
    for channels, reason in (
        ([angle, ("Torque", np.empty(0), timing())], "'Bench/Torque' is empty"),
        ([("Angle", ANGLE, {}), ("Torque", TORQUE[:50], {})], "'Bench/Torque' has 50 values and 'Bench/Angle' has 100"),
        ([angle, ("Torque", ["a"] * ROWS, timing())], "'Bench/Torque' holds text and no numbers"),
        ([angle, ("Torqe", TORQUE, timing())], "did you mean 'Torqe'?"),
        ([("Angle", ANGLE, timing(unit_string="furlongs")), torque], "measures [m]"),
    ):
        time = {"time": {"rate": 100}} if "has 50" in reason else {}
        assert reason in refused(write(tmp_path / "a.tdms", channels), **time)


def test_a_file_that_is_cut_off_is_read_up_to_there_with_a_warning_or_refused(tmp_path: Path) -> None:
    path = bench(tmp_path / "a.tdms", 4)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    assert len(read(path, channels={"theta": {"channel": "Angle"}}).samples) == ROWS
    recording = read(path)
    assert recording.samples.null_count().row(0, named=True) == {"time": 0, "theta": 0, "torque": 25}
    assert any("the last segment is not complete" in text for text in recording.warnings)
    damage = recording.facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (False, None)
    path.write_bytes(whole[: whole.rindex(b"TDSm") + 20])  # within the head of a segment
    assert any("how much is missing is not known" in text for text in read(path).warnings)
    declared = bench(path).read_bytes().replace(np.uint64(ROWS).tobytes(), np.uint64(1 << 40).tobytes())
    for content, reason in (
        (whole[:40], "holds no channels, or is cut off before them"),
        (whole[:28] + b"\xff" * 40 + whole[68:], "damaged or of a kind that is not read"),
        (declared, "the length of a segment contradicts that of its channels"),
    ):
        path.write_bytes(content)
        assert reason in refused(path)


def test_a_missing_library_is_named_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bench(tmp_path / "a.tdms")
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(InputError, match=r"needs nptdms, which is not installed; pip install 'osl-analysis\[tdms\]'"):
        read(path)


def test_the_draft_has_units_and_no_clock_where_channels_have_timing(tmp_path: Path) -> None:
    overview = inspect_file(bench(tmp_path / "a.tdms"))
    assert "Bench/Angle [Degrees]  100 samples at 1000 Hz; from -10 to 10; float64" in overview_text(overview)
    draft = yaml.safe_load(draft_source(overview, "a.tdms"))
    assert "time" not in draft
    assert draft["channels"]["NAME_1"] == {"channel": "Bench/Angle", "unit": "Degrees"}


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
def test_a_real_file_of_daqmx_is_scaled_as_its_properties_say() -> None:
    """Rows of seven 16-bit integers stand before its last segment; they are decoded here by hand."""
    path = REAL_DATA / "tdms" / "raw1.tdms"
    recording = read(path, channels={"sync": {"channel": "Third Chan", "unit": "V"}})
    content = path.read_bytes()
    end = content.rindex(b"TDSm")
    counts = np.frombuffer(content[end - 2000 * 7 * 2 : end], "<i2").reshape(2000, 7)[:, 2]
    np.testing.assert_allclose(recording.samples["sync"], counts * 0.0003051850947599719, rtol=1e-12)
