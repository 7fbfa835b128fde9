# SPDX-License-Identifier: Apache-2.0
"""MCAP logs: canonical columns out, whatever the file's build; damage and mistakes are one-line
errors."""

import math
import re
from functools import partial

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap_builder import SAMPLE, SAMPLE_NAME, stamped, write_log, write_topics
from recognised_files import refusal_by, source_of

from osl_analysis.ingest.raw_files import read_converted

MILLISECOND = 1_000_000
START = 1_700_000_000 * 10**9
RADIANS = {"theta": {"field": "angle", "unit": "rad"}}
OTHER = {"field": "angle", "unit": "rad", "topic": "/other"}
COUNT = 200


def source(time="header", loss=0.01, **channels):
    """Channels on `/lab`; without any, theta from `angle` in degrees."""
    channels = channels or {"theta": {"field": "angle", "unit": "deg"}}
    full = {column: {"topic": "/lab", **channel} for column, channel in channels.items()}
    return source_of("mcap", time={"source": time}, channels=full, largest_loss=loss)


def samples(count=50):
    """Angle i deg, torque i^2 / 8, one message per millisecond."""
    return [
        stamped(START + i * MILLISECOND, angle=float(i), torque=i * i / 8, sync=i % 7 == 0)
        for i in range(count)
    ]


def messages(stamps, count=False):
    """Logged a millisecond apart, stamped as given [ms]; the angle is the stamp, or counts the
    messages."""
    made = [(s, stamped(s * MILLISECOND, torque=0.0, sync=False)[1]) for s in stamps]
    return [
        (i * MILLISECOND, {**one, "angle": float(i if count else s)})
        for i, (s, one) in enumerate(made)
    ]


read = read_converted
refused = partial(refusal_by, read)


def of_stamps(folder, stamps, loss=0.01):
    return read(write_log(folder / "log.mcap", messages(stamps)), source(loss=loss, **RADIANS))


def of_topics(folder, topics, **channels):
    """The samples of topics, written as (type, schema, messages) or as messages of the usual
    type."""
    full = {
        name: (SAMPLE_NAME, SAMPLE, one) if isinstance(one, list) else one
        for name, one in topics.items()
    }
    return read(write_topics(folder / "log.mcap", full), source(**(channels or RADIANS))).samples


def test_time_is_the_header_stamp_from_its_first_exact_to_the_nanosecond(tmp_path):
    stamps = [0, 1, 2_000_000, 999_999_999, 1_000_000_001]
    recording = read(
        write_log(tmp_path / "log.mcap", [stamped(START + s, angle=0.0) for s in stamps]), source()
    )
    np.testing.assert_allclose(
        recording.samples["time"], np.array(stamps) / 1e9, rtol=1e-15, atol=0
    )
    assert recording.facts["time"] == {
        "source": "header",
        "field": "header.stamp",
        "stamps": "auto",
        "start_ns": START,
    }


@pytest.mark.parametrize("by", [0.5, 3600.0])
@pytest.mark.parametrize("time", ["header", "log"])
def test_a_clock_that_is_set_back_while_recording_is_refused(tmp_path, by, time):
    back = [START + i * 10 * MILLISECOND - (round(by * 1e9) if i >= 100 else 0) for i in range(200)]
    log = [stamped(stamp, angle=float(i), torque=0.0, sync=False) for i, stamp in enumerate(back)]

    message = refused(write_log(tmp_path / "log.mcap", log, chunk_size=900), source(time))

    assert re.search("'/lab'.* 101 .* 200", message)


def test_a_topic_that_gives_no_samples_is_refused(tmp_path):
    infinite = samples()
    path = tmp_path / "log.mcap"
    infinite[17][1]["angle"] = math.inf
    for log, schema, told in (
        ([], SAMPLE, "'/lab'"),
        (
            [(0, {"angle": 1.0})],
            "float64 angle",
            "'header.stamp'.*angle.*`field`",
        ),
        (infinite, SAMPLE, "inf .* 18 .* 50.* 0.017 s"),
    ):
        message = refused(write_log(path, log, schema, "lab_msgs/msg/Other"), source())
        assert re.search(told, message)
    leg = {"topic": "/leg", "field": "angle", "unit": "deg"}
    assert re.search("'/leg'.* /lab", refused(path, source(theta=leg)))


def test_a_message_that_comes_late_is_put_in_the_order_of_the_stamps(tmp_path):
    stamps = list(range(COUNT))
    stamps[7], stamps[8] = stamps[8], stamps[7]
    stamps.insert(150, stamps.pop(90))
    found = of_stamps(tmp_path, stamps)
    np.testing.assert_array_equal(found.samples["theta"], np.arange(COUNT))
    (warning,) = found.warnings
    assert re.search("log.mcap: .*'/lab'.* 2 ", warning)


def test_more_than_the_stated_share_of_lost_messages_is_refused(tmp_path):
    path = write_log(
        tmp_path / "log.mcap", samples(60), chunk_size=400, compression=CompressionType.NONE
    )
    content = bytearray(path.read_bytes())
    content[content.index(np.float32(30).tobytes())] ^= 1  # its chunk has another checksum
    path.write_bytes(content)

    read_count = read(path, source(loss=0.5)).losses["read"]

    percent = 100 * (60 - read_count) / 60
    assert 40 < read_count < 60
    said = f"{percent:.3g} %.*'/lab'.* 1 %.*`largest_loss`"
    assert re.search(said, refused(path, source()))


def test_a_message_that_is_repeated_counts_once(tmp_path):
    found = of_stamps(tmp_path, sorted([*range(COUNT), 5, 20]))
    np.testing.assert_array_equal(found.samples["theta"], np.arange(COUNT))
    assert " 2 " in found.warnings[-1]
    # no clock set back
    sent_twice = of_stamps(tmp_path, [*range(100), *range(80, 92), *range(100, COUNT)], loss=0.2)
    assert " 12 " in sent_twice.warnings[-1]


def test_stamps_that_stand_still_are_refused_and_are_not_taken_for_rounded(tmp_path):
    path = tmp_path / "log.mcap"
    for stamps, told in (
        ([0] * COUNT, "zero .* 200 .*source: log"),
        (
            [*range(100), *[100] * 10, *range(110, COUNT)],
            " 9 .* 200 ",
        ),
    ):
        log = write_log(path, messages(stamps, count=len({*stamps}) > 1))
        assert re.search(told, refused(log, source(**RADIANS)))


def test_topics_of_different_rates_keep_their_own_rows(
    tmp_path,
):
    topics = {"/lab": messages(range(0, 60, 2)), "/other": messages([*range(1, 60, 10), 58])}
    found = of_topics(tmp_path, topics, **RADIANS, theta_m=OTHER)
    assert found["theta"].drop_nulls().to_list() == list(range(0, 60, 2))
    assert found["theta_m"].drop_nulls().to_list() == [*range(1, 60, 10), 58]
    assert found.drop_nulls()["theta"].to_list() == [58]


def test_stamps_rounded_to_more_than_a_step_are_kept_for_the_time_base(
    tmp_path,
):
    stamps = [round(1000 * i / 1024) for i in range(COUNT)]
    log = messages(stamps, count=True)
    found = read(write_log(tmp_path / "log.mcap", log), source(loss=0.0, **RADIANS))
    assert (found.samples["time"].diff() == 0).sum() == 5  # 200 messages on 195 ticks
    both = of_topics(tmp_path, {"/lab": log, "/other": log}, **RADIANS, theta_m=OTHER)
    assert both["theta"].drop_nulls().to_list() == list(range(COUNT))
    assert both["theta"].null_count() == COUNT
