"""What a log of messages holds, in MCAP or a bag of ROS: channels with rates and gaps, and what is damaged or odd."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.messages import ChannelSurvey, MessageFile, describe_message, survey_channels
from osl_analysis.formats.object_messages import FieldDescription
from osl_analysis.formats.rosbag import read_rosbag1, read_rosbag2
from osl_analysis.ingest.overview import Overview, RecordedChannel, gaps_text, rate_of
from osl_analysis.ingest.stamps import check_not_set

MOST_FIELDS = 500  # of one topic
NANOSECOND = 1e-9
UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides has other ones."""
STAMP = "header."  # what every message of ROS has, and no signal is in


def inspect_mcap(path: Path) -> Overview:
    """Topics with schema, encoding, rate and gaps by log time, every field of each, and what is damaged."""
    return inspect_messages(read_mcap(path), "mcap")


def inspect_rosbag1(path: Path) -> Overview:
    """The same for a ROS 1 bag; raises InputError as `read_rosbag1`."""
    return inspect_messages(read_rosbag1(path), "rosbag1")


def inspect_rosbag2(path: Path) -> Overview:
    """The same for a ROS 2 bag; raises InputError as `read_rosbag2`."""
    return inspect_messages(read_rosbag2(path), "rosbag2")


def inspect_messages(file: MessageFile, name: str) -> Overview:
    """The same for a log of messages in any container, whose format is called `name` in source files."""
    try:
        surveys = survey_channels(file)
    except InputError as error:
        if str(file.path) in str(error):
            raise
        raise InputError(f"{file.path}: {error}") from error
    remarks = list(file.damage.all_remarks())
    remarks += [remark for survey in surveys for remark in clock_remarks(survey)]
    described = [(survey, fields_of(survey, remarks)) for survey in surveys]
    channels = [channel for survey, fields in described for channel in channels_of(survey, fields)]
    stamped = any(field.path.startswith(f"{STAMP}stamp") for _, fields in described for field in fields)
    settings = {"clock": "master", "time": {"source": "header" if stamped else "log"}}
    return Overview(name, facts_of(file), channels, remarks, settings)


def facts_of(file: MessageFile) -> dict[str, str]:
    """Size, what was read, what was lost, and whether checksums cover it."""
    damage = file.damage
    lost = damage.messages_lost()
    return {
        "bytes": str(file.size),
        "chunks": str(damage.chunks),
        "messages": str(damage.messages),
        "messages lost": "the file does not tell" if lost is None else str(lost),
        "checksums": damage.crc(),
    }


def clock_remarks(survey: ChannelSurvey) -> Iterator[str]:
    """What ingest will say of a channel's log times, if they go back."""
    if survey.log_time.size < 2:
        return
    log_time = survey.log_time
    table = pl.DataFrame({"stamp": log_time, "message": np.arange(log_time.size)})
    try:
        check_not_set(survey.channel.topic, table, "its log times cannot be used")
    except InputError as error:
        yield str(error)


def fields_of(survey: ChannelSurvey, remarks: list[str]) -> list[FieldDescription]:
    """The fields of a channel's first message, or else of its schema; what cannot be described is remarked."""
    reason = ""
    for message in dict.fromkeys([survey.first, None]):
        try:
            fields = describe_message(survey.channel, survey.schema, message)
            if fields or not reason:  # JSON has no schema to tell what a message does not
                return fields
        except (ValueError, RecursionError) as error:
            reason = reason or " ".join(str(error).split())
    remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
    return []


def channels_of(survey: ChannelSurvey, fields: list[FieldDescription]) -> Iterator[RecordedChannel]:
    """A topic's numbers, one by one as a source file names them; the topic alone where there are none."""
    topic, encoding = survey.channel.topic, survey.channel.message_encoding
    kind = f"{survey.schema.name} ({encoding})" if survey.schema else encoding
    log_time = survey.log_time
    stamps = (log_time - log_time[:1].sum()) * NANOSECOND
    rate = rate_of(stamps)
    timing = gaps_text(stamps) or ("" if survey.log_time.size else "empty")
    numbers = [(path, field) for field in fields if not field.path.startswith(STAMP) for path in field.addresses()]
    for path, field in numbers[:MOST_FIELDS]:
        array = "" if field.length is None else f"[{field.length}]"
        address = {"topic": topic, "field": path}
        samples = 0 if field.length == 0 else survey.log_time.size
        unit = standard_unit(survey.schema.name if survey.schema else "", path)
        own_rate = rate if samples else None
        yield RecordedChannel(kind, address, "", samples, own_rate, timing, f"{field.type}{array}", likely_unit=unit)
    if len(numbers) > MOST_FIELDS or not numbers:
        more = f"and {len(numbers) - MOST_FIELDS} more numbers" if numbers else ""
        yield RecordedChannel(kind, {"topic": topic}, "", survey.log_time.size, rate, timing, more)


def standard_unit(kind: str, path: str) -> str:
    """The unit of a field of a standard message; empty for any other one."""
    units = UNITS.get(kind.replace("/msg/", "/"), {})
    return next((unit for field, unit in units.items() if path.startswith(field)), "")
