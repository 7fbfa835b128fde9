"""Stamps that come late, twice or not at all: the rule of `stamps.py`, and that its every use is reported."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap_builder import HEADER, SAMPLE, SAMPLE_NAME, stamped, write_log, write_topics

from osl_analysis.errors import InputError
from osl_analysis.ingest.message_log import McapSource, read_mcap_log
from osl_analysis.ingest.recording import Recording

MILLISECOND = 1_000_000
COUNT = 200


def source(field: str = "angle", **options: Any) -> McapSource:
    channels = {
        "theta": {"topic": "/lab", "field": field, "unit": "rad"},
        "torque": {"topic": "/lab", "field": "torque", "unit": "N*m"},
    }
    return McapSource.model_validate({"format": "mcap", "time": {"source": "header"}, "channels": channels, **options})


def messages(stamps: list[int]) -> list[tuple[int, dict[str, Any]]]:
    """Logged a millisecond apart, stamped as given [ms]; the angle is the stamp."""
    return [
        (i * MILLISECOND, stamped(stamp * MILLISECOND, angle=float(stamp), torque=0.0, sync=False)[1])
        for i, stamp in enumerate(stamps)
    ]


def recording(folder: Path, stamps: list[int]) -> Recording:
    return read_mcap_log(write_log(folder / "log.mcap", messages(stamps)), source())


def test_a_message_that_comes_late_is_put_in_the_order_of_the_stamps(tmp_path: Path) -> None:
    stamps = list(range(COUNT))
    stamps[7], stamps[8] = stamps[8], stamps[7]
    stamps.insert(150, stamps.pop(90))
    read = recording(tmp_path, stamps)
    np.testing.assert_array_equal(read.samples["theta"], np.arange(COUNT))
    assert read.facts["stamps"]["/lab"] == {"late": 2, "repeated": 0, "contradicted": 0}
    assert read.warnings == ["log.mcap: topic '/lab': 2 messages came late and were put in the order of their stamps"]


def test_a_clock_that_is_set_back_is_refused(tmp_path: Path) -> None:
    stamps = [*range(2000, 2000 + COUNT), *range(500, 600)]
    with pytest.raises(InputError, match=r"time goes back by 1.699000 s at message 201 of 300; the clock was set"):
        recording(tmp_path, stamps)


def test_a_message_that_is_repeated_counts_once(tmp_path: Path) -> None:
    read = recording(tmp_path, sorted([*range(COUNT), 5, 20]))
    np.testing.assert_array_equal(read.samples["theta"], np.arange(COUNT))
    assert read.facts["stamps"]["/lab"] == {"late": 0, "repeated": 2, "contradicted": 0}


def test_stamps_that_stand_still_are_refused_though_nothing_contradicts(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="199 of 200 messages have the stamp of an earlier one; stamps must be their"):
        recording(tmp_path, [0] * COUNT)


def test_of_messages_that_contradict_each_other_the_first_holds_as_long_as_they_are_few(tmp_path: Path) -> None:
    log = messages(list(range(COUNT)))
    log[17][1]["header"] = log[16][1]["header"]
    path = write_log(tmp_path / "log.mcap", log)
    read = read_mcap_log(path, source())
    assert read.samples["theta"].to_list() == [float(i) for i in range(COUNT) if i != 17]
    assert read.facts["stamps"]["/lab"]["contradicted"] == 1
    with pytest.raises(InputError, match="1 of 200 messages have the stamp of an earlier one"):
        read_mcap_log(path, source(largest_loss=0.0))


def test_two_channels_of_a_topic_that_each_hold_one_field_become_one_row(tmp_path: Path) -> None:
    other = ("lab_msgs/msg/Other", SAMPLE.replace("float32 angle", "float64 other"))
    log = messages(list(range(20)))
    topics = {
        "/lab": (*other, [(t, {**m, "other": 1.0, "torque": 3.0}) for t, m in log]),
        "/lab#2": (SAMPLE_NAME, SAMPLE, log),
    }
    channels = {
        "theta": {"topic": "/lab", "field": "angle", "unit": "rad"},
        "theta_m": {"topic": "/lab", "field": "other", "unit": "rad"},
    }
    content = {"format": "mcap", "time": {"source": "header"}, "channels": channels}
    read = read_mcap_log(write_topics(tmp_path / "log.mcap", topics), McapSource.model_validate(content))
    assert read.samples["theta"].to_list() == list(range(20))
    assert read.samples["theta_m"].to_list() == [1.0] * 20


def test_two_channels_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    log = messages(list(range(20)))
    other = [(time, {**fields, "angle": -1.0}) for time, fields in log]
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, log), "/lab#2": (SAMPLE_NAME, SAMPLE, other)}
    with pytest.raises(InputError, match="20 of 40 messages have the stamp of an earlier one and other values"):
        read_mcap_log(write_topics(tmp_path / "log.mcap", topics), source())


def test_a_message_without_stamp_is_refused_not_put_at_zero(tmp_path: Path) -> None:
    bare = ("lab_msgs/msg/Bare", "float32 angle\nfloat64 torque")
    log = messages(list(range(5)))
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, log), "/lab#2": (*bare, [(9, {"angle": 1.0, "torque": 0.0})])}
    with pytest.raises(InputError, match=r"1 of 6 messages have no 'header.stamp'; write source: log"):
        read_mcap_log(write_topics(tmp_path / "log.mcap", topics), source())


def test_a_stamp_that_is_no_time_is_refused(tmp_path: Path) -> None:
    log = [(0, {"header": {"stamp": {"sec": 5.5, "nanosec": 0.0}}, "angle": 0.0, "torque": 0.0})]
    schema = SAMPLE.split("bool")[0] + HEADER.replace("int32 sec", "float64 sec").replace("uint32 nano", "float64 nano")
    schema = schema.replace("builtin_interfaces/Time", "lab_msgs/Time").replace("string frame_id\n", "")
    with pytest.raises(InputError, match=r"header.stamp.sec is 5.5 in message 1, which is not a time"):
        read_mcap_log(write_log(tmp_path / "log.mcap", log, schema), source())


def test_topics_of_different_rates_keep_their_own_rows_and_nothing_is_invented(tmp_path: Path) -> None:
    fast, slow = messages(list(range(0, 60, 2))), messages(list(range(1, 60, 10)))
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, fast), "/slow": (SAMPLE_NAME, SAMPLE, slow)}
    channels = {
        "theta": {"topic": "/lab", "field": "angle", "unit": "rad"},
        "theta_m": {"topic": "/slow", "field": "angle", "unit": "rad"},
    }
    content = {"format": "mcap", "time": {"source": "header"}, "channels": channels}
    samples = read_mcap_log(write_topics(tmp_path / "log.mcap", topics), McapSource.model_validate(content)).samples
    assert samples["theta"].drop_nulls().to_list() == list(range(0, 60, 2))
    assert samples["theta_m"].drop_nulls().to_list() == list(range(1, 60, 10))
    assert samples.select(pl.col("theta").is_null() ^ pl.col("theta_m").is_null()).to_series().all()


def test_a_clock_that_is_set_back_by_less_than_a_second_is_refused_as_its_messages_fall_among_others(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match=r"time goes back from .* s to .* s at message 151 of 250, and 49 messages"):
        recording(tmp_path, [*range(0, 300, 2), *range(201, 401, 2)])


def test_messages_that_are_late_together_fill_the_gap_that_they_left(tmp_path: Path) -> None:
    read = recording(tmp_path, [*range(100), *range(150, COUNT), *range(100, 150)])
    assert read.samples["time"].is_sorted()
    assert read.facts["stamps"]["/lab"]["late"] == 50


def test_stamps_rounded_to_more_than_a_sampling_step_are_kept_for_the_time_base(tmp_path: Path) -> None:
    log = messages([round(1000 * i / 1024) for i in range(COUNT)])
    log = [(time, {**fields, "angle": float(i)}) for i, (time, fields) in enumerate(log)]
    read = read_mcap_log(write_log(tmp_path / "log.mcap", log), source(largest_loss=0.0))
    assert read.samples["theta"].to_list() == list(range(COUNT))
    assert (read.samples["time"].diff() == 0).sum() == 5  # 200 messages on 195 ticks


def test_two_topics_with_rounded_stamps_keep_every_message_in_a_row_of_its_own(tmp_path: Path) -> None:
    stamps = [round(1000 * i / 1024) for i in range(COUNT)]
    logs = [[(t, {**m, "angle": float(i)}) for i, (t, m) in enumerate(messages(s))] for s in (stamps, stamps[:-1])]
    topics = {"/lab": (SAMPLE_NAME, SAMPLE, logs[0]), "/other": (SAMPLE_NAME, SAMPLE, logs[1])}
    channels = {
        "theta": {"topic": "/lab", "field": "angle", "unit": "rad"},
        "theta_m": {"topic": "/other", "field": "angle", "unit": "rad"},
    }
    content = {"format": "mcap", "time": {"source": "header"}, "channels": channels}
    samples = read_mcap_log(write_topics(tmp_path / "log.mcap", topics), McapSource.model_validate(content)).samples
    assert samples["theta"].drop_nulls().to_list() == list(range(COUNT))
    assert samples["theta_m"].drop_nulls().to_list() == list(range(COUNT - 1))


def test_a_clock_that_stands_for_a_while_is_not_rounded(tmp_path: Path) -> None:
    stamps = [*range(100), *[100] * 10, *range(110, COUNT)]
    log = [(t, {**m, "angle": float(i)}) for i, (t, m) in enumerate(messages(stamps))]
    with pytest.raises(InputError, match="9 of 200 messages have the stamp of an earlier one"):
        read_mcap_log(write_log(tmp_path / "log.mcap", log), source())
