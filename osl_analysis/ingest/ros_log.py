"""Logs in the bags of ROS 1 and ROS 2: what a source file of each is, their readers, and what they hold."""

from pathlib import Path
from typing import Literal

from osl_analysis.formats.rosbag1.parts import read_rosbag1
from osl_analysis.formats.rosbag2.parts import read_rosbag2
from osl_analysis.ingest.log_overview import inspect_messages
from osl_analysis.ingest.message_log import MessageSource, read_message_log
from osl_analysis.ingest.overview import Overview
from osl_analysis.ingest.recording import Recording


class Rosbag1Source(MessageSource):
    """A log in a bag of ROS 1, or in the bags of a split recording, whose folder is named."""

    format: Literal["rosbag1"]
    """Format of the file or folder."""


class Rosbag2Source(MessageSource):
    """A log in a bag of ROS 2: a database of sqlite3, or the folder of a recording with its `metadata.yaml`."""

    format: Literal["rosbag2"]
    """Format of the file or folder."""


def read_rosbag1_log(path: Path, source: Rosbag1Source) -> Recording:
    """The columns that the source file maps, in SI units; raises InputError as `read_rosbag1`, `read_message_log`."""
    return read_message_log(read_rosbag1(path), source)


def read_rosbag2_log(path: Path, source: Rosbag2Source) -> Recording:
    """The columns that the source file maps, in SI units; raises InputError as `read_rosbag2`, `read_message_log`."""
    return read_message_log(read_rosbag2(path), source)


def inspect_rosbag1(path: Path) -> Overview:
    """Topics, rates and fields of a ROS 1 bag; raises InputError as `read_rosbag1`."""
    return inspect_messages(read_rosbag1(path), "rosbag1")


def inspect_rosbag2(path: Path) -> Overview:
    """Topics, rates and fields of a ROS 2 bag; raises InputError as `read_rosbag2`."""
    return inspect_messages(read_rosbag2(path), "rosbag2")
