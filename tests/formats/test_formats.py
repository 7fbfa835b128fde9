# SPDX-License-Identifier: Apache-2.0
"""All formats: which one a file is of, and how another one is added."""

from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest
from conftest import refused_with

from osl_analysis import formats
from osl_analysis.base.recording import Channel, Format, Recording, Rows
from osl_analysis.base.source_file import LogSource
from osl_analysis.formats import known_formats, reading, recognise
from osl_analysis.formats.reading import ENTRY_POINTS


class ToySource(LogSource):
    """The source file of a toy format."""


def read_toy(path, source):
    if path.stem == "ours":
        Recording("toy", None).find({})
    values = np.array([float(cell) for cell in path.read_text()[4:].split()])
    if values.size < 2:
        raise KeyError("end")
    rows = Rows(values.size, rate_hz=100.0)
    return Recording("toy", [Channel({"column": "a"}, rows, lambda: values, "a")])


TOY = Format(
    name="toy",
    suffixes=(".toy",),
    begins=lambda begin: begin.startswith(b"TOY1"),
    source=ToySource,
    read=read_toy,
)


@pytest.fixture
def with_toy(monkeypatch):
    """A package that offers a format by the entry point group."""
    point = EntryPoint("toy", "toy_package:FORMAT", ENTRY_POINTS)
    monkeypatch.setattr(EntryPoint, "load", lambda self: TOY)

    def entry_points(group):
        return EntryPoints([point] if group == ENTRY_POINTS else [])

    monkeypatch.setattr(reading, "entry_points", entry_points)
    known_formats.cache_clear()
    yield
    known_formats.cache_clear()


@pytest.mark.usefixtures("with_toy")
def test_another_package_adds_a_format_by_an_entry_point(tmp_path):
    (tmp_path / "a.dat").write_text("TOY11 2 3")

    recording = formats.read(tmp_path / "a.dat")

    assert recognise(tmp_path / "a.dat") is TOY
    assert recording.find({"column": "a"}).values.tolist() == [1, 2, 3]


@pytest.mark.usefixtures("with_toy")
def test_a_fault_of_this_package_is_no_damage_of_the_file(tmp_path):
    (tmp_path / "ours.toy").write_text("TOY1")

    with pytest.raises(TypeError):
        formats.read(tmp_path / "ours.toy")


@pytest.mark.usefixtures("with_toy")
def test_any_error_of_a_reader_is_one_sentence_with_file_and_remedy(tmp_path):
    path = tmp_path / "a.toy"
    path.write_text("TOY1")

    with refused_with(f"^{path}: .*; "):
        formats.read(path)


def test_an_empty_file_is_named(tmp_path):
    (tmp_path / "a.c3d").touch()

    with refused_with(r"a\.c3d:.*file"):
        formats.read(tmp_path / "a.c3d")
