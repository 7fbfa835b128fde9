"""One log in every format of rows: the same columns, the same refusals, a draft that reads it; and damage is told."""

import json
import random
from pathlib import Path

import numpy as np
import pytest
import test_ingest_mcap_log as mcap
import test_ingest_nexus_capture as nexus
import test_ingest_opensim as opensim
from c3d_builder import write_c3d
from mcap_builder import write_log
from nptdms import ChannelObject, TdmsWriter
from recognised_files import refusal_by
from test_formats_mat import write_mat, write_mat73
from test_formats_rosbags import CHANNELS, write_bag1, write_bag2

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.raw_files import FORMATS, read_source

TIME = np.arange(40) / 500
ANGLE, TORQUE = np.sin(40 * TIME), 30 * np.sin(40 * TIME)
LOG = {"t": 1e3 * TIME + 7, "angle": np.rad2deg(ANGLE), "torque": -1e3 * TORQUE}


def write_text(path, columns, sign=","):
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([sign.join(columns), *(sign.join(map(str, row)) for row in rows)]) + "\n")
    return path


def write_table(path, columns):
    write_text(path, columns, "\t")
    path.write_text(f"grf\nnRows={len(TIME)}\nendheader\n{path.read_text()}")
    return path


def write_json(path, columns):
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    path.write_text("".join(json.dumps(dict(zip(columns, row, strict=True))) + "\n" for row in rows))
    return path


def write_tdms(path, columns):
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("Bench", name, np.asarray(one)) for name, one in columns.items()])
    return path


WRITERS = {
    "csv": ("csv", "column", write_text),
    "json_lines": ("json_lines", "field", write_json),
    "mat": ("mat", "variable", lambda path, columns: write_mat(path, **columns)),
    "mat 7.3": ("mat", "variable", lambda path, columns: write_mat73(path, **columns)),
    "tdms": ("tdms", "channel", write_tdms),
    "opensim": ("opensim", "column", write_table),
}
EVERY = pytest.mark.parametrize("what", WRITERS)


def described(what, **counted):
    """The usual source file of a log in a format."""
    name, key, _ = WRITERS[what]
    theta, torque = {key: "angle", "unit": "deg", **counted}, {key: "torque", "unit": "Nmm", "sign": -1}
    content = {"format": name, "time": {key: "t", "unit": "ms"}, "channels": {"theta": theta, "torque": torque}}
    return FORMATS[name].source.model_validate(content)


@EVERY
def test_a_log_gives_the_same_columns_in_every_format(tmp_path, what):
    path = WRITERS[what][2](tmp_path / "log", {**LOG, "count": np.arange(7, 47)})
    recording = FORMATS[WRITERS[what][0]].read(path, described(what, counter="count"))
    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(recording.samples[column], expected, atol=1e-12)
    assert recording.samples["theta_counter"].to_list() == list(range(7, 47))
    assert recording.columns["torque"]["unit"] == "Nmm"
    assert recording.facts["time"]["start"] == 7
    assert recording.facts["rates_hz"]["log"] == pytest.approx(500)


LATE = TIME > 0.039


@EVERY
@pytest.mark.parametrize(
    ("changes", "counted", "told"),
    [
        ({"torque": np.where(LATE, np.nan, TORQUE)}, {}, "in 20 of 40 "),
        ({"torque": np.where(LATE, np.inf, TORQUE)}, {}, "inf"),
        ({"t": np.full(40, 3.0)}, {}, "time stands still at 3 in all 40 "),
        ({"t": -TIME}, {}, "time goes from"),
        ({"t": np.where(LATE, np.nan, TIME)}, {}, "no time in "),
        ({"angle": None, "angel": ANGLE}, {}, "angel"),
        ({}, {"counter": "angle"}, "is no count of samples, a whole number below"),
    ],
)
def test_what_cannot_be_a_log_is_refused_in_every_format(tmp_path, what, changes, counted, told):
    columns = {name: one for name, one in {**LOG, **changes}.items() if one is not None}
    path = WRITERS[what][2](tmp_path / "log", columns)
    assert told in refusal_by(FORMATS[WRITERS[what][0]].read, path, described(what, **counted))


@EVERY
def test_a_draft_becomes_a_source_file_by_naming_two_signals_and_a_unit(tmp_path, what):
    columns = {"time": TIME, "ankle_deg": np.rad2deg(ANGLE), "moment": TORQUE}
    path = WRITERS[what][2](tmp_path / f"log.{WRITERS[what][0]}", columns)
    (tmp_path / "s.yaml").write_text(
        draft_source(inspect_file(path), path.name).replace("NAME_1", "theta").replace("NAME_2", "torque")
        .replace("UNKNOWN", "N*m")
    )  # fmt: skip
    samples = FORMATS[WRITERS[what][0]].read(path, read_source(tmp_path / "s.yaml")).samples
    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(samples[column], expected, atol=1e-12)


def nexus_export(path):
    path.write_text(nexus.DEVICES + nexus.TRAJECTORIES + nexus.MODEL)
    return path


BAG = {"time": {"source": "header"}, "channels": CHANNELS}
OTHERS = {
    "bag of ROS 1": (lambda path: write_bag1(path, range(60), "LZ4", 800), {"format": "rosbag1", **BAG}),
    "bag of ROS 2": (lambda path: write_bag2(path, range(60)) / f"{path.name}.db3", {"format": "rosbag2", **BAG}),
    "TRC": (lambda path: opensim.write_trc(path, opensim.walk()), {"format": "trc"}),
    "C3D": (lambda path: write_c3d(path, np.ones((6, 3, 4)), np.ones((24, 2))), {"format": "c3d"}),
    "Nexus": (nexus_export, {"format": "nexus_csv"}),
    "MCAP": (lambda path: write_log(path, mcap.samples(), chunk_size=800), mcap.source().model_dump(exclude_none=True)),
}


def mutilated(content: bytes, chance: random.Random) -> bytes:
    """The content with one kind of damage: cut, shortened, repeated, with other bytes, or with an absurd length."""
    place, other, kind = chance.randrange(len(content)), chance.randrange(len(content)), chance.randrange(5)
    absurd = chance.choice([0, 2**31, 2**63, 2**64 - 1]).to_bytes(8, "little")
    damaged = bytearray(content)
    for _ in range(chance.choice([1, 2, 8])):
        damaged[chance.randrange(len(content))] = chance.choice([0, 255, chance.randrange(256)])
    return (
        content[:place],
        content[:place] + content[place + chance.randrange(1, 40) :],
        content[:place] + content[other : other + chance.randrange(60)] + content[place:],
        bytes(damaged),
        content[:place] + absurd + content[place + 8 :],
    )[kind]


@pytest.mark.parametrize("what", [*OTHERS, "json_lines", "tdms", "opensim"])
def test_a_mutilated_file_is_samples_or_a_sentence(tmp_path: Path, what: str) -> None:
    if what in OTHERS:
        write, content = OTHERS[what]
        path, source = Path(write(tmp_path / "whole")), FORMATS[content["format"]].source.model_validate(content)
    else:
        path, source = WRITERS[what][2](tmp_path / "whole", LOG), described(what)
    known, whole = FORMATS[source.format], path.read_bytes()
    for seed in range(12):
        path.write_bytes(mutilated(whole, random.Random(seed)))
        for attempt in (lambda: known.read(path, source), lambda: draft_source(known.inspect(path), "a")):
            try:
                attempt()
            except InputError as error:
                message = str(error)
                assert message.startswith(str(path))
                assert len(message.splitlines()) == 1
                assert len(message) < 1500
