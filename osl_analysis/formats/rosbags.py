# SPDX-License-Identifier: Apache-2.0
"""The folder of a ROS 2 recording in MCAP: its description, and the files that this lists."""

from collections import Counter
from pathlib import Path

import yaml

from osl_analysis.base.errors import InputError, listing, naming, on_one_line, shortened
from osl_analysis.base.recording import Format, Recording
from osl_analysis.base.source_file import MessageSource
from osl_analysis.base.yaml_settings import check_size, text_in
from osl_analysis.formats import mcap
from osl_analysis.formats.reading import beginning

DESCRIPTION = "metadata.yaml"
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording"


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read the parts of a folder one after the other."""
    parts, counts = _described(path)
    log = mcap.Log(source)
    for part in parts:
        with naming(part):
            if not beginning(part).startswith(mcap.MAGIC):
                raise InputError(
                    "is no MCAP",
                    "convert the recording with `rosbags-convert --src FOLDER --dst NEW"
                    " --dst-storage mcap`, which stands beside `osl-analysis`",
                )
            log.take_file(part)
    return log.recording("rosbag2", counts)


def _described(folder: Path) -> tuple[list[Path], Counter[str]]:
    """The files of a recording in its order, and the messages of each topic in all of them.

    Raises
    ------
    InputError
        The description in the folder cannot be read, or files are missing.
    """
    path = folder / DESCRIPTION
    counts: Counter[str] = Counter()
    try:
        text = path.read_text(encoding="utf-8")
        with naming(path):
            check_size(text)
        about = yaml.load(text, yaml.CSafeLoader)["rosbag2_bagfile_information"]
        # older ones begin with the folder
        files = [folder / Path(name).name for name in about["relative_file_paths"]]
        for topic in about["topics_with_message_count"]:
            counts[text_in(topic["topic_metadata"]["name"])] += int(topic["message_count"])
    except InputError:
        raise
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = shortened(on_one_line(error))
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason})", REINDEX
        ) from error
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(files)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)})",
            f"copy them there, or {REINDEX}",
        )
    return files, counts


def _files_in(path: Path) -> list[Path]:
    """The description of a folder and the files that it lists."""
    return [path / DESCRIPTION, *_described(path)[0]]


FORMAT = Format(
    name="rosbag2",
    suffixes=(".db3", ".bag"),  # to say how they are converted
    begins=lambda begin: False,
    source=MessageSource,
    read=read,
    is_folder=lambda path: (path / DESCRIPTION).is_file(),
    files_in=_files_in,
)
