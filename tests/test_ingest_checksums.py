"""`SHA256SUMS` beside recordings: a file that changed is refused by name."""

import hashlib
from pathlib import Path

import pytest
from click.testing import CliRunner

from osl_analysis.cli import main
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import trial_from_files

ROWS = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(100))
SOURCE = """format: csv
time: {column: t, unit: s}
channels:
  theta: {column: a, unit: deg}
  torque: {column: f, unit: N*m}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "day1").mkdir()
    (tmp_path / "day1/a.csv").write_text("t,a,f\n" + ROWS)
    (tmp_path / "s.yaml").write_text(SOURCE)
    return tmp_path


def ingested(folder: Path) -> list[str]:
    """What the trial is warned of."""
    row = {"trial": "a", "log": "day1/a.csv", "log_source": "s"}
    warnings: list[str] = trial_from_files(row, folder, folder).provenance["warnings"]
    return warnings


def line_of(path: Path, name: str) -> str:
    return f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {name}\n"


@pytest.mark.parametrize("place", ["", "day1/"])
def test_a_file_as_it_was_listed_is_read(folder: Path, place: str) -> None:
    path = folder / "day1/a.csv"
    (folder / f"{place}SHA256SUMS").write_text(line_of(path, "day1/a.csv".removeprefix(place)))

    assert ingested(folder) == []


@pytest.mark.parametrize("place", ["", "day1/"])
def test_a_file_that_changed_is_refused_by_name(folder: Path, place: str) -> None:
    path = folder / "day1/a.csv"
    (folder / f"{place}SHA256SUMS").write_text(line_of(path, "day1/a.csv".removeprefix(place)))
    path.write_text(path.read_text().replace("0.5,1,0", "0.5,1,3"))

    with pytest.raises(InputError, match=r"day1/a\.csv: changed since .*SHA256SUMS was written"):
        ingested(folder)


def test_a_file_that_the_list_does_not_name_is_remarked(folder: Path) -> None:
    (folder / "SHA256SUMS").write_text("0" * 64 + "  other.csv\n")

    (warning,) = ingested(folder)

    assert "day1/a.csv is not listed in" in warning


def test_a_list_that_is_none_is_refused_by_its_line(folder: Path) -> None:
    (folder / "SHA256SUMS").write_text("\nday1/a.csv\n")

    with pytest.raises(InputError, match="SHA256SUMS: line 2 is not a SHA-256"):
        ingested(folder)


def test_init_writes_the_list_that_sha256sum_writes(folder: Path, tmp_path: Path) -> None:
    arguments = ["init", str(tmp_path / "mine"), "--from", str(folder / "day1"), "--checksums"]

    result = CliRunner().invoke(main, arguments)

    assert result.exit_code == 0, result.output
    listed = (folder / "day1/SHA256SUMS").read_text()
    assert listed == line_of(folder / "day1/a.csv", "a.csv")


def test_a_list_is_never_overwritten(folder: Path, tmp_path: Path) -> None:
    (folder / "day1/SHA256SUMS").write_text("")
    arguments = ["init", str(tmp_path / "mine"), "--from", str(folder / "day1"), "--checksums"]

    result = CliRunner().invoke(main, arguments)

    assert result.exit_code == 1
    assert "SHA256SUMS: exists, and is kept" in result.output
