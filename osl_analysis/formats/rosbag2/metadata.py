"""`metadata.yaml`, the description of a ROS 2 bag: its parts, its topics and how many messages each should have."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.errors import InputError, listing

NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
LARGEST = 1 << 22
"""Bytes; one that recorders write has some kB."""
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording as the trial's log"


@dataclass(frozen=True)
class Metadata:
    """The description of one bag."""

    parts: tuple[str, ...]
    """Names of its files, in the order of recording, without their folder."""
    counts: Counter[str] = field(default_factory=Counter)
    """Messages of each topic in all parts."""
    types: Mapping[str, str] = field(default_factory=dict)
    """Type of each topic's messages."""
    distribution: str = ""
    """Distribution of ROS that recorded it, such as `humble`; empty where it is not said."""
    compression: str = ""
    """What was compressed, `file` or `message`; empty if nothing was."""
    storage: str = ""
    """`sqlite3` or `mcap`."""


def read_metadata(folder: Path) -> Metadata:
    """The description in a folder.

    Raises
    ------
    InputError
        There is none, or it is not what ROS 2 writes.
    """
    path = folder / NAME
    if not path.is_file():
        raise InputError(f"{folder}: a folder without {NAME}, which lists the parts of a bag; {REINDEX}")
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: {path.stat().st_size} bytes are too many for the description of a bag; {REINDEX}")
    try:
        content = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
        return metadata_of(content[ROOT])
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: no YAML ({' '.join(str(error).split())[:120]}); {REINDEX}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not the description of a ROS 2 bag ({error!s:.80}); {REINDEX}") from error


def metadata_of(said: Mapping[str, Any]) -> Metadata:
    """The fields that are used. A key that is absent raises KeyError, a value of another kind TypeError or so."""
    topics = [(one["topic_metadata"], int(one["message_count"])) for one in said["topics_with_message_count"]]
    parts = tuple(Path(str(part)).name for part in said["relative_file_paths"])  # older ones begin with the folder
    if not parts or len(set(parts)) < len(parts):
        raise ValueError("relative_file_paths lists no file, or one twice")
    counts = Counter[str]()
    for topic, count in topics:
        counts[str(topic["name"])] += count
    return Metadata(
        parts,
        counts,
        {str(topic["name"]): str(topic["type"]) for topic, _ in topics},
        str(said.get("ros_distro") or ""),
        str(said.get("compression_mode") or "").lower() if said.get("compression_format") else "",
        str(said.get("storage_identifier") or ""),
    )


def parts_of(folder: Path) -> list[Path]:
    """The files of the bag in a folder, in the order of recording.

    Raises
    ------
    InputError
        There is no description, a file that it lists is missing, or the files are compressed as a whole.
    """
    described = read_metadata(folder)
    missing = [name for name in described.parts if not (folder / name).is_file()]
    unpacked = [name.removesuffix(".zstd") for name in missing]
    if described.compression == "file" or any(name.endswith(".zstd") for name in described.parts):
        raise InputError(
            f"{folder}: its files are compressed as a whole ({listing(described.parts)}); unpack them with `zstd -d`, "
            "then run `ros2 bag reindex`"
        )
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(described.parts)} files that {NAME} lists are missing "
            f"({listing(unpacked)}); copy them there, or name one file of the recording as the trial's log"
        )
    return [folder / name for name in described.parts]


def siblings(path: Path) -> tuple[Metadata | None, str]:
    """The description beside one file of a bag, if it lists the file; and a remark for the user, or an empty text."""
    try:
        described = read_metadata(path.parent)
    except InputError:
        return None, ""
    if path.name not in described.parts:
        return None, ""
    if len(described.parts) == 1:
        return described, ""
    return described, (
        f"one of the {len(described.parts)} files of a recording; name the folder '{path.parent.name}' to read all"
    )
