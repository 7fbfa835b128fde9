"""MCAP logs: canonical columns out, whatever the file's build; damage and mistakes are one-line errors."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_builder import HEADER, SAMPLE, SAMPLE_NAME, stamped, write_log, write_topics

from osl_analysis.errors import InputError
from osl_analysis.ingest.log_overview import inspect_mcap
from osl_analysis.ingest.message_log import McapSource, joined_on_stamp, read_mcap_log

REAL_DATA = Path(__file__).parents[2] / "shared" / "real_data"
DEGREE = math.pi / 180
MILLISECOND = 1_000_000
START = 1_700_000_000 * 10**9


def source(time: str = "header", **channels: dict[str, Any]) -> McapSource:
    """Channels on `/lab`; without any, theta from `angle` in degrees."""
    channels = channels or {"theta": {"field": "angle", "unit": "deg"}}
    full = {column: {"topic": "/lab", **channel} for column, channel in channels.items()}
    return McapSource.model_validate({"format": "mcap", "time": {"source": time}, "channels": full})


def samples(count: int = 50) -> list[tuple[int, dict[str, Any]]]:
    """Angle i deg, torque i^2 / 8, one message per millisecond."""
    return [stamped(START + i * MILLISECOND, angle=float(i), torque=i * i / 8, sync=i % 7 == 0) for i in range(count)]


def refused(path: Path, log_source: McapSource) -> str:
    with pytest.raises(InputError) as caught:
        read_mcap_log(path, log_source)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


def test_values_are_converted_by_offset_unit_and_sign(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples())
    log_source = source(
        theta={"field": "angle", "unit": "deg", "offset": 2.0, "sign": -1},
        torque={"field": "torque", "unit": "N·mm"},
        sync={"field": "sync", "unit": "V"},
    )
    recording = read_mcap_log(path, log_source)
    i = np.arange(50)
    np.testing.assert_allclose(recording.samples["theta"], -(i + 2) * DEGREE, rtol=1e-15)
    np.testing.assert_allclose(recording.samples["torque"], i**2 / 8000, rtol=1e-15)
    np.testing.assert_array_equal(recording.samples["sync"], i % 7 == 0)


def test_time_is_the_header_stamp_from_its_first_exact_to_the_nanosecond(tmp_path: Path) -> None:
    stamps = [0, 1, 2_000_000, 999_999_999, 1_000_000_001]
    path = write_log(tmp_path / "log.mcap", [stamped(START + s, angle=0.0) for s in stamps])
    recording = read_mcap_log(path, source())
    np.testing.assert_allclose(recording.samples["time"], np.array(stamps) / 1e9, rtol=1e-15, atol=0)
    assert recording.facts["time"] == {"source": "header.stamp", "stamps": "auto", "start_ns": START}


def test_time_is_the_log_time_where_the_source_says_so(tmp_path: Path) -> None:
    late = [(log_time + i * 500, fields) for i, (log_time, fields) in enumerate(samples())]
    recording = read_mcap_log(write_log(tmp_path / "log.mcap", late), source("log"))
    np.testing.assert_allclose(np.diff(recording.samples["time"]), 1e-3 + 5e-7, rtol=1e-9)
    assert recording.facts["time"]["source"] == "log"


def test_log_time_is_not_publish_time() -> None:
    path = REAL_DATA / "mcap" / "pj_test_publish_vs_log_time.mcap"
    if not path.exists():
        pytest.skip("real data are not here")
    channel = {"theta": {"topic": "/sensor/value", "field": "data", "unit": "rad"}}
    log_source = McapSource.model_validate({"format": "mcap", "time": {"source": "log"}, "channels": channel})
    with path.open("rb") as file:
        logged = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert read_mcap_log(path, log_source).facts["time"]["start_ns"] == min(logged)


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4},
        {"use_chunking": False},
        {"chunk_size": 300},
        {"index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
        {"use_summary_offsets": False, "enable_data_crcs": True},
    ],
    ids=lambda options: " ".join(options),
)
def test_the_files_build_does_not_change_what_is_read(tmp_path: Path, options: dict[str, Any]) -> None:
    plain = read_mcap_log(write_log(tmp_path / "plain.mcap", samples()), source())
    built = read_mcap_log(write_log(tmp_path / "built.mcap", samples(), **options), source())
    assert built.samples.equals(plain.samples)


@pytest.mark.parametrize("time", ["header", "log"])
@pytest.mark.parametrize("order", [np.random.default_rng(0).permutation(50), np.roll(np.arange(50), 20)])
def test_messages_in_any_file_order_come_in_the_order_of_their_sequence_numbers(
    tmp_path: Path, order: np.ndarray, time: str
) -> None:
    log = [stamped(START + 100 * i * MILLISECOND, angle=float(i), torque=0.0, sync=False) for i in range(50)]
    path = write_log(tmp_path / "log.mcap", [log[i] for i in order], chunk_size=300, sequences=order.tolist())
    recording = read_mcap_log(path, source(time))
    np.testing.assert_allclose(recording.samples["theta"], np.arange(50) * DEGREE)
    assert recording.facts["stamps"]["/lab"]["late"] == 0


@pytest.mark.parametrize("by", [0.5, 3600.0])
@pytest.mark.parametrize("time", ["header", "log"])
@pytest.mark.parametrize("numbered", [False, True])
@pytest.mark.parametrize("is_sorted", [False, True])
def test_a_clock_that_is_set_back_while_recording_is_refused(
    tmp_path: Path, by: float, time: str, numbered: bool, is_sorted: bool
) -> None:
    if is_sorted and not (numbered and by < 1):
        pytest.skip("sorted since, without numbers: nothing tells; by an hour: a gap of an hour, which a fit refuses")
    back = [START + i * 10 * MILLISECOND - (round(by * 1e9) if i >= 100 else 0) for i in range(200)]
    log = [stamped(stamp, angle=float(i), torque=0.0, sync=False) for i, stamp in enumerate(back)]
    order = np.argsort([t for t, _ in log], kind="stable") if is_sorted else np.arange(200)
    numbers = order.tolist() if numbered else [0] * 200
    path = write_log(tmp_path / "log.mcap", [log[i] for i in order], chunk_size=900, sequences=numbers)
    message = refused(path, source(time))
    assert "at message 101 of 200" in message
    assert "the clock was set while recording: its times cannot be used: record again, or exclude the trial" in message
    assert is_sorted or "the clock was set while recording" in " ".join(inspect_mcap(path).remarks)


def test_sequence_numbers_of_a_restarted_publisher_do_not_move_its_messages(tmp_path: Path) -> None:
    numbers = [*range(100, 130), *range(20)]
    path = write_log(tmp_path / "log.mcap", samples(), sequences=numbers)
    recording = read_mcap_log(path, source())
    np.testing.assert_allclose(recording.samples["theta"], np.arange(50) * DEGREE)
    assert recording.facts["stamps"]["/lab"]["late"] == 0


def test_sequence_numbers_that_are_missing_are_remarked(tmp_path: Path) -> None:
    log = samples()
    path = write_log(tmp_path / "log.mcap", [*log[:20], *log[23:]], sequences=[*range(20), *range(23, 50)])
    remark = "log.mcap: the sequence numbers of topic '/lab' say that 3 messages beside its 47 are not in the file"
    assert remark in read_mcap_log(path, source()).warnings
    every_other = write_log(tmp_path / "log.mcap", log, sequences=list(range(0, 100, 2)))
    assert read_mcap_log(every_other, source()).warnings == []


def test_two_channels_of_one_topic_are_one(tmp_path: Path) -> None:
    log = samples()
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, log[::2]), "/lab#2": (SAMPLE_NAME, SAMPLE, log[1::2])}
    recording = read_mcap_log(write_topics(tmp_path / "log.mcap", topics), source())
    np.testing.assert_allclose(recording.samples["theta"], np.arange(50) * DEGREE)


def test_topics_of_different_rates_leave_nulls_where_one_has_no_sample(tmp_path: Path) -> None:
    log = samples(6)
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, log), "/slow": (SAMPLE_NAME, SAMPLE, log[1::3])}
    log_source = source(
        theta={"field": "angle", "unit": "deg"}, torque={"topic": "/slow", "field": "torque", "unit": "Nm"}
    )
    recording = read_mcap_log(write_topics(tmp_path / "log.mcap", topics), log_source)
    assert recording.samples["torque"].to_list() == [None, 1 / 8, None, None, 16 / 8, None]
    assert recording.samples["theta"].null_count() == 0


def test_a_field_that_some_messages_lack_is_null_there(tmp_path: Path) -> None:
    schema = SAMPLE.replace("float32 angle", "float64[] angles")
    log = [stamped(i * MILLISECOND, angles=[1.0] * (1 + i % 2), torque=1.0, sync=False) for i in range(4)]
    path = write_log(tmp_path / "log.mcap", log, schema)
    recording = read_mcap_log(path, source(theta={"field": "angles[1]", "unit": "rad"}))
    assert recording.samples["theta"].to_list() == [None, 1.0, None, 1.0]


def test_no_single_flipped_bit_changes_what_is_read_unnoticed(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples(), chunk_size=800)
    intact, content = read_mcap_log(path, source()).samples, path.read_bytes()
    random = np.random.default_rng(0)
    lossy = source().model_copy(update={"largest_loss": 0.9})
    noticed = 0
    for _ in range(400):
        damaged = bytearray(content)
        damaged[random.integers(len(content))] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        recording = read_mcap_log(path, lossy)
        same = recording.samples.equals(intact)
        assert same or not recording.facts["damage"]["complete"]
        stamps = (recording.samples["time"] * 1000).round().cast(int) + recording.facts["time"]["start_ns"] // 10**6
        assert set(stamps) <= set(range(START // 10**6, START // 10**6 + 50))
        noticed += not same
    assert noticed > 100


def test_a_chunk_that_is_no_longer_seen_as_one_is_missed(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples(), chunk_size=800)
    with path.open("rb") as file:
        last_chunk = make_reader(file).get_summary().chunk_indexes[-1].chunk_start_offset
    content = bytearray(path.read_bytes())
    assert content[last_chunk] == Opcode.CHUNK
    content[last_chunk] = 0x7F
    path.write_bytes(content)
    assert "it declares 50 messages and holds" in refused(path, source())


def test_a_changed_value_outside_of_chunks_fails_the_data_checksum(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples(20), use_chunking=False, enable_data_crcs=True)
    content = path.read_bytes()
    path.write_bytes(content.replace(np.float32(13).tobytes(), np.float32(14).tobytes()))
    assert "the checksum of the data section does not match" in refused(path, source())


def test_a_log_whose_recorder_was_killed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        number = writer.register_schema(SAMPLE_NAME, "ros2msg", SAMPLE.encode())
        writer.register_channel("/lab", "cdr", number)
    message = refused(path, source())
    assert "no topic '/lab' (the file has none)" in message
    assert "no footer: the recorder did not finish" in message


@pytest.mark.parametrize(
    ("options", "covered"),
    [
        ({}, True),
        ({"enable_crcs": False}, False),
        ({"enable_crcs": False, "enable_data_crcs": True}, True),
        ({"use_chunking": False}, False),
        ({"use_chunking": False, "enable_data_crcs": True}, True),
    ],
)
def test_messages_that_no_checksum_covers_are_reported(tmp_path: Path, options: dict[str, Any], covered: bool) -> None:
    recording = read_mcap_log(write_log(tmp_path / "log.mcap", samples(), **options), source())
    report = "log.mcap: not verifiable: no checksum covers 50 of 50 messages"
    assert recording.warnings == ([] if covered else [report])
    assert recording.facts["damage"]["crc"] == ("checked" if covered else "absent")


def test_a_text_file_is_no_mcap(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_text("time,angle\n0,1\n")
    assert "not an MCAP file (it begins with b'time,ang')" in refused(path, source())


def test_a_missing_topic_is_refused_with_the_topics_there_are(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples())
    assert "no topic '/leg' (the file has /lab); correct `topic`" in refused(
        path, source(theta={"topic": "/leg", "field": "angle", "unit": "rad"})
    )


def test_a_topic_without_messages_is_refused(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", [])
    assert "topic '/lab' has no messages" in refused(path, source())


def test_a_log_without_header_stamps_is_refused_when_they_are_asked_for(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", [(0, {"angle": 1.0})], "float64 angle", "lab_msgs/msg/Bare")
    assert "topic '/lab' has no field 'header.stamp' with seconds and nanoseconds" in refused(path, source())


def test_an_infinite_value_is_refused_by_channel_and_message(tmp_path: Path) -> None:
    log = samples()
    log[17][1]["angle"] = math.inf
    message = refused(write_log(tmp_path / "log.mcap", log), source())
    assert "topic /lab, field angle: inf in sample 18 of 50, at 0.017 s" in message


def test_failed_readings_are_counted_and_refused_beyond_the_stated_share(tmp_path: Path) -> None:
    log = samples()
    log[17][1]["angle"] = math.nan
    path = write_log(tmp_path / "log.mcap", log)
    message = refused(path, source())
    assert "topic /lab, field angle: NaN in 1 of 50 samples, first at 0.017 s; at most 1.0% may be" in message
    read = read_mcap_log(path, source().model_copy(update={"most_missing": 0.1}))
    assert read.facts["missing"]["theta"] == read.samples["theta"].is_nan().sum() == 1
    assert "log.mcap: theta is NaN in 1 of 50 rows" in read.warnings


def test_another_encoding_is_refused_by_its_name() -> None:
    path = REAL_DATA / "mcap" / "pj_test_unsupported_encoding.mcap"
    if not path.exists():
        pytest.skip("real data are not here")
    with pytest.raises(InputError, match=r"topic '/proto/data' is encoded as protobuf \(proto\)"):
        read_mcap_log(path, source(theta={"topic": "/proto/data", "field": "x", "unit": "rad"}))


def test_a_bad_schema_hurts_its_own_topic_only() -> None:
    path = REAL_DATA / "mcap" / "pj_test_bad_schema.mcap"
    if not path.exists():
        pytest.skip("real data are not here")
    good = source("log", theta={"topic": "/good/data", "field": "data", "unit": "rad"})
    assert len(read_mcap_log(path, good).samples) == 10
    bad = source("log", theta={"topic": "/bad/data", "field": "data", "unit": "rad"})
    with pytest.raises(InputError, match="schema broken_msgs/Garbage"):
        read_mcap_log(path, bad)


def test_a_device_s_counter_is_read_beside_its_channel(tmp_path: Path) -> None:
    log = [(time, {**fields, "seq": 7 + 2 * row}) for row, (time, fields) in enumerate(samples())]
    path = write_log(tmp_path / "log.mcap", log, SAMPLE.replace("bool sync", "bool sync\nuint32 seq"))
    counted = source(theta={"topic": "/lab", "field": "angle", "unit": "rad", "counter": "seq"})
    read = read_mcap_log(path, counted)
    assert read.samples["theta_counter"].to_list() == [7 + 2 * row for row in range(len(log))]
    assert read.columns["theta"]["counter"] == "seq"
    assert "no field 'count'" in refused(
        path, source(theta={**counted.channels["theta"].model_dump(), "counter": "count"})
    )


def test_a_missing_topic_among_many_is_refused_with_forty_of_them(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for number in range(300):
            writer.add_message(writer.register_channel(f"/t{number:03}", "json", 0), 0, b"{}", 0)
        writer.finish()
    said = refused(path, source())
    assert "/t039, ... (300 in all)); correct `topic` in the source file, or exclude the trial" in said
    assert "/t040" not in said


def test_an_array_without_an_element_is_blamed_on_the_source_file_with_the_elements_there_are(tmp_path: Path) -> None:
    schema = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] effort\n" + HEADER
    log = [stamped(i, name=["left", "right"], position=[1.0, 2.0], effort=[]) for i in range(3)]
    path = write_log(tmp_path / "log.mcap", log, schema, "sensor_msgs/msg/JointState")
    said = refused(path, source(theta={"topic": "/lab", "field": "position", "unit": "rad"}))
    assert "topic '/lab': field 'position' is an array of 2, not one number" in said
    assert "position[name=left], position[name=right]); name a number, or one element of an array, as `field`" in said
    assert "damaged" not in said
    mislabelled = refused(path, source(theta={"topic": "/lab", "field": "position[name=joint]", "unit": "rad"}))
    assert mislabelled.endswith(
        "has no field 'position[name=joint]' (it has position[name=left], position[name=right]); correct `field` in "
        "the source file, or exclude the trial if its log is not the right one"
    )


@pytest.mark.parametrize("kind", ["bool", "float64"])
def test_a_truth_value_is_a_level_and_no_angle(tmp_path: Path, kind: str) -> None:
    schema = f"std_msgs/Header header\n{kind} on\n" + HEADER
    log = [stamped(i, on=i % 2) for i in range(3)]
    path = write_log(tmp_path / "log.mcap", log, schema, SAMPLE_NAME)
    level = read_mcap_log(path, source(sync={"topic": "/lab", "field": "on", "unit": "V"}))
    assert level.samples["sync"].to_list() == [0.0, 1.0, 0.0]
    angle = source(theta={"topic": "/lab", "field": "on", "unit": "rad"})
    if kind == "bool":
        assert "field 'on' is false in message 1, a truth value and no number in rad; name a number" in refused(
            path, angle
        )
    else:
        assert read_mcap_log(path, angle).samples["theta"].to_list() == [0.0, 1.0, 0.0]


def test_a_delay_that_is_longer_than_the_log_names_the_log(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", samples())
    late = {"topic": "/lab", "field": "angle", "unit": "rad", "delay": "1e7 s"}
    assert refused(path, source(theta=late)).startswith(f"{path}: theta: a delay of 1e+07 s")


def topic(rng: np.random.Generator, *names: str) -> pl.DataFrame:
    """Some of sixty stamps, with columns of which some values are NaN and some null, and a counter."""
    stamp = np.sort(rng.choice(60, rng.integers(3, 40), replace=False)).astype(np.int64)
    columns = {name: np.where(rng.random(len(stamp)) < 0.1, np.nan, rng.standard_normal(len(stamp))) for name in names}
    null = pl.Series(rng.random(len(stamp)) < 0.1)
    made = {name: pl.Series(values).set(null, None) for name, values in columns.items()}
    return pl.DataFrame({"stamp": stamp, **made, f"{names[0]}_counter": np.arange(len(stamp))})


@pytest.mark.parametrize("seed", range(10))
def test_topics_are_joined_as_by_a_full_join_that_is_sorted(seed):
    rng = np.random.default_rng(seed)
    tables = [topic(rng, "theta", "current"), topic(rng, "torque"), topic(rng, "command")]
    expected = tables[0]
    for table in tables[1:]:
        expected = expected.join(table, on="stamp", how="full", coalesce=True)
    found = joined_on_stamp([table.clone() for table in tables])
    assert found.schema == expected.schema
    assert found.equals(expected.sort("stamp"), null_equal=True)


def test_topics_of_the_same_stamps_share_their_rows():
    stamp = np.array([3, 5, 9])
    tables = [pl.DataFrame({"stamp": stamp, name: stamp * 0.5}) for name in ("a", "b")]
    assert joined_on_stamp(tables).columns == ["stamp", "a", "b"]
    assert len(joined_on_stamp(tables)) == 3
