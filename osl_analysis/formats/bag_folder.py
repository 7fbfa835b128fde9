"""A recording that is a folder: the description and the files of a ROS 2 bag, or the bags of a split one of ROS 1."""

from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.rosbag1.parts import bags_in, split_parts
from osl_analysis.formats.rosbag2.metadata import NAME, REINDEX, parts_of, read_metadata


def folder_format(folder: Path) -> str:
    """Name of the format of the recording in a folder. What holds bags of ROS 1 and no description is of ROS 1."""
    is_first = not (folder / NAME).is_file() and bool(bags_in(folder))
    return "rosbag1" if is_first else "rosbag2"


def files_in(folder: Path) -> list[Path]:
    """The files of the recording in a folder: all that a trial is made of.

    Raises
    ------
    InputError
        It is no recording, or a file of it is missing.
    """
    if folder_format(folder) == "rosbag1":
        return split_parts(folder)
    if not (folder / NAME).is_file():
        raise InputError(
            f"{folder}: a folder that is no ROS 2 bag (it has no `{NAME}` that lists its files); name the recording in "
            f"it; {REINDEX}"
        )
    return [folder / NAME, *parts_of(folder)]


def recorded_files(path: Path) -> list[Path]:
    """The files of a log: itself, or those of a recording that is a folder, also where some are missing.

    A folder that is no recording stands for itself.
    """
    if not path.is_dir():
        return [path]
    try:
        if folder_format(path) == "rosbag1":
            return split_parts(path)
        return [path / NAME, *(path / part for part in read_metadata(path).parts)]
    except InputError:
        return [path]
