"""A log in MCAP, and in the bags of ROS: what a source file of each is, and its reader.

All three hold messages by topic; `message_log.py` reads them alike.
"""

from pathlib import Path
from typing import Literal

from osl_analysis.formats.mcap.mcap_file import read_mcap
from osl_analysis.formats.rosbag2.metadata import siblings
from osl_analysis.ingest.message_log import LogChannel, MessageSource, TimeSource, read_message_log
from osl_analysis.ingest.recording import Recording

__all__ = ["LogChannel", "McapSource", "TimeSource", "read_mcap_log"]


class McapSource(MessageSource):
    """A log in MCAP."""

    format: Literal["mcap"]
    """Format of the file."""


def read_mcap_log(path: Path, source: McapSource) -> Recording:
    """The columns that the source file maps, in SI units (`read_message_log`).

    Raises
    ------
    InputError
        The file is two logs, or `read_message_log` refuses it.
    """
    file = read_mcap(path)
    remark = siblings(path)[1]
    if remark:
        file.damage.remark(remark)
    return read_message_log(file, source)
