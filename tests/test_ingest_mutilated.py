"""Files with bytes that were cut, moved or flipped give samples, or one line that says why not."""

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_ingest_json_log as json_lines
import test_ingest_mcap_log as mcap
import test_ingest_nexus_capture as nexus
import test_ingest_opensim as opensim
import test_ingest_tdms_log as tdms
from bag_builder import write_bag1, write_bag2
from c3d_builder import write_c3d
from mcap_builder import write_log
from test_formats_rosbags import CHANNELS

from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.raw_files import FORMATS

SEEDS = range(12)


def nexus_export(path: Path) -> Path:
    path.write_text(nexus.DEVICES + nexus.TRAJECTORIES + nexus.MODEL)
    return path


BAG = {"time": {"source": "header"}, "channels": CHANNELS}
WRITERS: dict[str, tuple[Any, dict[str, Any]]] = {
    "bag of ROS 1": (lambda path: write_bag1(path, range(60), "LZ4", 800), {"format": "rosbag1", **BAG}),
    "bag of ROS 2": (lambda path: write_bag2(path, range(60)) / f"{path.name}.db3", {"format": "rosbag2", **BAG}),
    "JSON lines": (lambda path: json_lines.write(path, json_lines.rust_lines(60)), json_lines.SOURCE),
    "TDMS": (lambda path: tdms.bench(path, 3), tdms.SOURCE),
    "TRC": (lambda path: opensim.write_trc(path, opensim.walk()), {"format": "trc"}),
    "table of OpenSim": (opensim.write_mot, opensim.MOT),
    "C3D": (lambda path: write_c3d(path, np.ones((6, 3, 4)), np.ones((24, 2))), {"format": "c3d"}),
    "Nexus": (nexus_export, {"format": "nexus_csv"}),
    "MCAP": (lambda path: write_log(path, mcap.samples(), chunk_size=800), mcap.source().model_dump(exclude_none=True)),
}


def mutilated(content: bytes, chance: random.Random) -> bytes:
    """The content with one kind of damage."""
    place, other = chance.randrange(len(content)), chance.randrange(len(content))
    kind = chance.randrange(5)
    if kind == 0:
        return content[:place]
    if kind == 4:  # where it stands for a length, an absurd one
        return (
            content[:place] + chance.choice([0, 2**31, 2**63, 2**64 - 1]).to_bytes(8, "little") + content[place + 8 :]
        )
    if kind == 1:
        return content[:place] + content[place + chance.randrange(1, 40) :]
    if kind == 2:
        return content[:place] + content[other : other + chance.randrange(60)] + content[place:]
    damaged = bytearray(content)
    for _ in range(chance.choice([1, 2, 8])):
        damaged[chance.randrange(len(content))] = chance.choice([0, 255, chance.randrange(256)])
    return bytes(damaged)


@pytest.mark.parametrize("what", WRITERS)
def test_a_mutilated_file_is_samples_or_a_sentence(tmp_path: Path, what: str) -> None:
    write, described = WRITERS[what]
    path = Path(write(tmp_path / "whole"))
    known, content = FORMATS[described["format"]], path.read_bytes()
    source = known.source.model_validate(described)
    for seed in SEEDS:
        path.write_bytes(mutilated(content, random.Random(seed)))
        for attempt in (lambda: known.read(path, source), lambda: draft_source(known.inspect(path), "a")):
            try:
                attempt()
            except InputError as error:
                message = str(error)
                assert message.startswith(str(path))
                assert len(message.splitlines()) == 1
                assert len(message) < 1500
