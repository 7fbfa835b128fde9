"""The description beside the files of a ROS 2 bag (metadata.yaml): it lists them, and how many
messages each topic has."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import yaml

from osl_analysis.errors import InputError, listing

DESCRIPTION = "metadata.yaml"
REINDEX = (
    "write it again with `ros2 bag reindex`, or name one file of the recording as the trial's log"
)


@dataclass(frozen=True)
class Description:
    """What a description says."""

    files: list[Path]  # of the recording, in its order
    counts: Counter[str]  # messages of each topic in all of them


def read_description(folder: Path, is_whole: bool = True) -> Description:
    """Read the description in a folder.

    Raises
    ------
    InputError
        It has none, or one that cannot be read, or files of a `whole` recording are missing.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        raise InputError(
            f"{folder}: a folder without {DESCRIPTION}, which lists the files of a ROS 2 bag; name"
            f" the recording in it, or {REINDEX}"
        )
    text = path.read_bytes()
    try:
        if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text, yaml.CSafeLoader)):
            # a few nested ones would fill the memory
            raise ValueError("it has aliases, which no recorder writes")
        about = yaml.load(text, Loader=yaml.CSafeLoader)["rosbag2_bagfile_information"]
        # older ones begin with the folder
        names = [Path(str(name)).name for name in about["relative_file_paths"]]
        if not names or len(set(names)) < len(names):
            raise ValueError("relative_file_paths lists no file, or one twice")
        counts: Counter[str] = Counter()
        for topic in about["topics_with_message_count"]:
            counts[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason}); {REINDEX}"
        ) from error
    missing = [name for name in names if not (folder / name).is_file()]
    if is_whole and missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(names)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)}); copy them there, or name one file of the recording as"
            " the trial's log"
        )
    return Description([folder / name for name in names], counts)


def description_beside(path: Path) -> tuple[Description | None, str]:
    """The description beside one file of a bag, if it lists the file alone; else a remark if it
    lists several."""
    with suppress(InputError):
        description = read_description(path.parent, is_whole=False)
        if path not in description.files:
            return None, ""
        if len(description.files) == 1:
            return description, ""
        return None, (
            f"one of the {len(description.files)} files of a recording; name the folder"
            f" '{path.parent.name}' to read all"
        )
    return None, ""
