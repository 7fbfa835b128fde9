# SPDX-License-Identifier: Apache-2.0
"""Known formats: one table leads to everything; a mistake in a source file is refused by field,
with the remedy. Files of formats that are not read are told by what they hold: one line with what
it is and what to do."""

import gzip
import json
import re

import numpy as np
import pytest
import yaml
from c3d_builder import write_c3d
from conftest import ROOT, refused_with
from recognised_files import refusal_by

from osl_analysis.base.source_file import MarkerSource
from osl_analysis.formats import known_formats, read, recognise
from osl_analysis.formats.mcap import MAGIC
from osl_analysis.ingest.raw_files import read_source, trial_from_files

LOG = {"format": "mcap", "time": {"source": "header"}, "channels": {}}


def test_every_shipped_source_file_is_valid():
    formats = {read_source(path).format for path in (ROOT / "config/sources").glob("*.yaml")}
    assert {"csv", "mcap", "c3d", "nexus_csv", "mat"} <= formats
    for known in known_formats().values():
        if issubclass(known.source, MarkerSource):
            continue
        channel = known.source.model_fields["channels"].annotation
        setting = channel.__args__[1]
        assert {"counter", setting.ADDRESS} <= {*setting.model_fields}, known.name


def channel(column, **fields):
    """A source file of a log with one channel."""
    return {**LOG, "channels": {column: {"topic": "/lab", "field": "angle", **fields}}}


MISTAKES = [
    (channel("torque", unit="deg"), "source.yaml: line 5: channels.torque.unit: 'deg'"),
    (
        {
            **LOG,
            "channels": {
                name: {"topic": "/lab", "field": "a", "unit": unit}
                for name, unit in (("theta", "rad"), ("torque", "N*m"), ("sync", "V"))
            },
        },
        "'a' .*theta",
    ),
    (channel("time", unit="s"), "channels.*time"),
    ({"format": "xlsx"}, "'xlsx'.* table"),
    (LOG, "channels: "),
    ({"format": "c3d", "plates": "first"}, "plates: 'first'.*'all'"),
    (
        {
            "format": "c3d",
            "outputs": {
                "reference_ankle_moment_left": {
                    "label": "LAnkleMoment",
                    "component": "x",
                    "unit": "N*mm",
                }
            },
        },
        r"'N\*mm'",
    ),
]


@pytest.mark.parametrize(("content", "told"), MISTAKES)
def test_a_mistake_in_a_source_is_refused_by_its_field(tmp_path, content, told):
    (tmp_path / "source.yaml").write_text(yaml.safe_dump(content))
    assert re.search(told, refusal_by(read_source, tmp_path / "source.yaml"))


BENCH = "t,angle\n0,1\n0.01,2\n0.02,3\n"


@pytest.mark.parametrize(
    ("what", "content"),
    [
        ("no header", b"Format Version,1.23,Take Name,walk\n,,Marker\n0,0.0,1\n"),
        ("markers beside it", b"NO_OF_SAMPLES\t3\nFREQUENCY\t100\n1\t0\t0.5\n"),
        ("HTML", b"<html><table><tr><td>1</td></tr></table></html>"),
        ("JSON", json.dumps([{"t": 0.0}], indent=2).encode()),
        ("ZIP", b"PK\x03\x04" + bytes(26) + b"log.csv"),
        ("no whole index", b"#ROSBAG V2.0\n" + bytes(2000)),
        ("database", b"SQLite format 3\0" + bytes(2000)),
        ("D-Flow", b"TimeStamp\tFrameNumber\tRANK.PosX\tFP1.ForX\n0.1\t1\t0.5\t0.7\n"),
        ("", gzip.compress(BENCH.encode(), mtime=0)),
        ("savetxt", b"\x93NUMPY\x01\0" + bytes(20)),
        ("savetxt", b"PK\x03\x04" + bytes(26) + b"t.npy"),
        ("write_parquet", b"ARROW1\0\0" + bytes(20)),
        ("", bytes(2000)),
    ],
)
def test_a_file_of_another_format_is_named_whatever_it_is_called(tmp_path, what, content):
    for name in ("log.csv", "log.c3d"):
        (tmp_path / name).write_bytes(content)
        assert re.search(rf"{name}: .*{what}", refusal_by(read, tmp_path / name))


def test_a_table_is_not_taken_for_another_format_whatever_it_is_called(tmp_path):
    python = "<__main__.Joint object at 0x7fe6>.output_position,time\n1,0\n"
    for text in (
        BENCH,
        python,
        "CDF,MZ\n1,2\n",
        "# endheader follows\nt,angle\n0,1\n",
    ):
        for name in ("a.xls", "a.log"):
            (tmp_path / name).write_text(text)
            assert recognise(tmp_path / name).name == "csv"


SOURCE = "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: angle, unit: deg}\n"


def ingested(folder, name, content):
    """A trial from one file, by a source file."""
    (folder / name).write_bytes(content)
    (folder / "source.yaml").write_text(SOURCE)
    return trial_from_files({"trial": "a", "log": name, "log_source": "source"}, folder, folder)


def test_a_source_file_of_another_format_is_refused_with_the_right_one(
    tmp_path,
):
    capture = write_c3d(tmp_path / "b.csv", np.ones((4, 2, 4)), np.ones((8, 1))).read_bytes()
    for content, said in (
        (MAGIC + bytes(100), "`format: mcap`"),
        (capture, "`format: c3d`"),
        (b"\x01\x00\x02", r"a\.csv: "),
    ):
        with refused_with(said):
            ingested(tmp_path, "a.csv", content)
    assert ingested(tmp_path, "d.c3d", BENCH.encode())
