"""All formats: which one a file is of, and how another one is added."""

from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from osl_analysis import formats
from osl_analysis.errors import InputError
from osl_analysis.formats import GROUP, _cells, _text, known_formats, recognise
from osl_analysis.recording import Channel, Format, Recording, Rows
from osl_analysis.source_file import LogSource

TRC_WITHOUT_LAST_BREAK = "\n".join(
    (
        "PathFileType\t4\t(X/Y/Z)\ta.trc",
        "DataRate\tNumFrames\tNumMarkers\tUnits",
        "100\t2\t1\tmm",
        "Frame#\tTime\tHEEL",
        "\t\tX1\tY1\tZ1",
        "1\t0.00\t1.5\t2.5\t3.5",
        "2\t0.01\t1.5\t2.5\t3.5",
    )
)


class ToySource(LogSource):
    """The source file of a toy format."""


def read_toy(path: Path, source: ToySource | None) -> Recording:
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
def with_toy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A package that offers a format by the entry point group."""
    point = EntryPoint("toy", "toy_package:FORMAT", GROUP)
    monkeypatch.setattr(EntryPoint, "load", lambda self: TOY)

    def entry_points(group: str) -> EntryPoints:
        return EntryPoints([point] if group == GROUP else [])

    monkeypatch.setattr(formats, "entry_points", entry_points)
    known_formats.cache_clear()
    yield
    known_formats.cache_clear()


@pytest.mark.usefixtures("with_toy")
def test_another_package_adds_a_format_by_an_entry_point(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_text("TOY11 2 3")

    recording = formats.read(tmp_path / "a.dat")

    assert recognise(tmp_path / "a.dat") is TOY
    assert recording.find({"column": "a"}).values.tolist() == [1, 2, 3]


@pytest.mark.parametrize("error", [TypeError, KeyError])
def test_a_fault_of_a_reader_of_this_package_is_no_damage_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    faulty = "def is_last_whole(cells):\n    raise error('a fault of ours')\n"
    names = {"error": error}
    exec(compile(faulty, _cells.__file__, "exec"), names)  # as if it stood in that module
    monkeypatch.setattr(_text, "is_last_whole", names["is_last_whole"])
    path = tmp_path / "a.trc"
    path.write_text(TRC_WITHOUT_LAST_BREAK)

    with pytest.raises(error, match="a fault of ours"):
        formats.read(path)


def test_an_error_of_a_compiled_library_tells_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled code has no frame of its own: its error seems to be raised where it was called."""
    faulty = "def is_last_whole(cells):\n    raise error('corrupt statistics')\n"
    names = {"error": pl.exceptions.ComputeError}
    exec(compile(faulty, _cells.__file__, "exec"), names)
    monkeypatch.setattr(_text, "is_last_whole", names["is_last_whole"])
    path = tmp_path / "a.trc"
    path.write_text(TRC_WITHOUT_LAST_BREAK)

    with pytest.raises(InputError, match="corrupt statistics"):
        formats.read(path)


def test_a_library_that_meets_what_it_did_not_expect_tells_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise TypeError("no len() of None")

    monkeypatch.setattr(_text, "is_last_whole", fails)  # a frame outside of the package
    path = tmp_path / "a.trc"
    path.write_text(TRC_WITHOUT_LAST_BREAK)

    with pytest.raises(InputError, match=r"cannot be read \(no len"):
        formats.read(path)


@pytest.mark.usefixtures("with_toy")
def test_any_error_of_a_reader_is_one_sentence_with_file_and_remedy(tmp_path: Path) -> None:
    path = tmp_path / "a.toy"
    path.write_text("TOY1")

    with pytest.raises(InputError) as caught:
        formats.read(path)

    assert str(caught.value).startswith(f"{path}: cannot be read (")
    assert str(caught.value).endswith("; copy the file again, or export it anew")


def test_an_empty_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.c3d").touch()

    with pytest.raises(InputError, match=r"a\.c3d: the file is empty; copy or record it again"):
        recognise(tmp_path / "a.c3d")
