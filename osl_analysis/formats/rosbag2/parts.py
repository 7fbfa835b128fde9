"""A ROS 2 bag: one file, or a folder with the parts of one recording, which are read as one log."""

from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.mcap.mcap_file import read_mcap
from osl_analysis.formats.mcap.walk import MAGIC as MCAP
from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.rosbag2.database import MAGIC as SQLITE
from osl_analysis.formats.rosbag2.database import read_database
from osl_analysis.formats.rosbag2.metadata import Metadata, parts_of, read_metadata
from osl_analysis.formats.split_log import SplitLog


def read_rosbag2(path: Path) -> MessageFile:
    """Open a bag: a database of sqlite3, or the folder of a recording in sqlite3 or MCAP.

    Raises
    ------
    InputError
        A part is missing or cannot be opened, or the folder has no `metadata.yaml`.
    """
    if not path.is_dir():
        return read_database(path)
    described, files = read_metadata(path), parts_of(path)
    parts = [part_of(file, described) for file in files]
    for part in parts:
        part.damage.finished |= part.kind == "bag"  # its description is that of the whole
    return SplitLog(path, parts, described.counts, Budget(sum(file.stat().st_size for file in files)))


def part_of(path: Path, described: Metadata) -> MessageFile:
    """One file of a recording."""
    with path.open("rb") as file:
        begin = file.read(len(SQLITE))
    if begin.startswith(MCAP):
        return read_mcap(path)
    if begin == SQLITE:
        return read_database(path, described)
    raise InputError(
        f"{path}: neither a database of sqlite3 nor MCAP (it begins with {begin[:8]!r}); copy it again, or record again"
    )
