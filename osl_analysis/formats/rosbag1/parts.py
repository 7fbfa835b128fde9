"""A recording of ROS 1 in several bags, as `rosbag record --split` leaves it: `rec_0.bag`, `rec_1.bag`."""

import re
from pathlib import Path

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.rosbag1.scan import read_bag
from osl_analysis.formats.split_log import SplitLog

PART = re.compile(r"(?P<name>.*)_(?P<number>\d+)\.bag(\.active)?")
"""How `rosbag record --split` names its files; the one that it was writing when it was killed is still `active`."""
DATE = re.compile(r"\d{4}(-\d\d){5}")
"""When a file was begun, in its name; each has its own."""
REMEDY = "keep the files of one recording in the folder, or name one bag as the trial's log"


def bags_in(folder: Path) -> list[Path]:
    """The bags of ROS 1 in a folder."""
    return sorted(path for path in folder.iterdir() if path.name.endswith((".bag", ".bag.active")))


def split_parts(folder: Path) -> list[Path]:
    """The bags of one recording, in the order of recording.

    Earlier ones may be absent: `rosbag record --max-splits` deletes them.

    Raises
    ------
    InputError
        The folder has bags that are no parts, parts of several recordings, or a part between others is missing.
    """
    bags = bags_in(folder)
    named = {path: PART.fullmatch(path.name) for path in bags}
    strangers = [path.name for path, name in named.items() if name is None]
    if strangers:
        raise InputError(
            f"{folder}: {listing(strangers)} cannot be a file of a split recording of ROS 1, which are called "
            f"NAME_0.bag, NAME_1.bag; {REMEDY}"
        )
    number_of = {path: int(name["number"]) for path, name in named.items() if name}
    numbers = sorted(number_of.values())
    names = sorted({DATE.sub("DATE", name["name"]) for name in named.values() if name})
    if len(names) > 1 or len(set(numbers)) < len(numbers):
        raise InputError(f"{folder}: files of several recordings ({listing([path.name for path in bags])}); {REMEDY}")
    missing = sorted(set(range(numbers[0], numbers[-1] + 1)) - set(numbers))
    if missing:
        raise InputError(
            f"{folder}: the file{'s' * (len(missing) > 1)} {listing([f'{names[0]}_{one}.bag' for one in missing])} of "
            f"the recording cannot be found; copy what is missing there, or name one bag as the trial's log"
        )
    return sorted(bags, key=lambda path: number_of[path])


def read_rosbag1(path: Path) -> MessageFile:
    """Open a bag, or the folder of a recording in several bags, which are read as one log.

    Raises
    ------
    InputError
        A bag cannot be opened, or the folder is refused by `split_parts`.
    """
    if not path.is_dir():
        return read_bag(path)
    files = split_parts(path)
    log = SplitLog(path, [read_bag(file) for file in files], None, Budget(sum(file.stat().st_size for file in files)))
    first = PART.fullmatch(files[0].name)
    if first and int(first["number"]) > 0:
        log.damage.remark(f"the recording begins with '{files[0].name}': its files before that are not here")
    return log
