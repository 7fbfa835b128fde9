"""Several tables of a trial in one archive: it holds what was written, completely or not at all."""

import zipfile
from pathlib import Path

import polars as pl
import pytest

from osl_analysis.errors import InputError
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import archives, read_table, tables_of, write_table

PHASORS = pl.DataFrame({"trial": ["01", "01"], "gain": [0.1 + 0.2, 1e-17]})
SERIES = pl.DataFrame({"time": [0.0, 1.0], "torque": [None, float("nan")]})


def written(archive: Path) -> Path:
    with archives(), tables_of("measured"):
        write_table(PHASORS, archive / "phasors.csv")
        write_table(SERIES, archive / "series.csv")
    return archive


def fail_after_writing(*paths: Path) -> None:
    with archives():
        for archive in paths:
            write_table(SERIES, archive / "series.csv")
        raise RuntimeError


def test_tables_come_back_as_they_were_written(tmp_path: Path) -> None:
    archive = written(tmp_path / "fits/t_1.zip")
    assert read_table(archive, of="phasors").drop("data").equals(PHASORS)
    assert read_table(archive, of="series").drop("data").equals(SERIES, null_equal=True)
    assert list(archive.parent.iterdir()) == [archive]


def test_a_part_has_the_bytes_of_the_table_s_own_file_and_any_zip_reader_finds_it(tmp_path: Path) -> None:
    with tables_of("measured"):
        write_table(PHASORS, tmp_path / "phasors.csv")
    with zipfile.ZipFile(written(tmp_path / "t_1.zip")) as archive:
        assert archive.testzip() is None
        assert archive.infolist()[0].date_time == (1980, 1, 1, 0, 0, 0)  # the same tables make the same archive
        assert archive.read("phasors.csv") == (tmp_path / "phasors.csv").read_bytes()


def test_after_an_error_nothing_is_written_and_an_older_archive_stays(tmp_path: Path) -> None:
    before = written(tmp_path / "t_1.zip").read_bytes()
    with pytest.raises(RuntimeError):
        fail_after_writing(tmp_path / "t_1.zip", tmp_path / "t_2.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["t_1.zip"]
    assert (tmp_path / "t_1.zip").read_bytes() == before


def test_a_table_that_is_not_there_is_named(tmp_path: Path) -> None:
    archive = written(tmp_path / "t_1.zip")
    with pytest.raises(InputError, match=r"t_1\.zip/response\.csv: no such table .*run the step that writes it"):
        read_table(archive, of="response")
    archive.write_bytes(archive.read_bytes()[:100])
    with pytest.raises(InputError, match=r"t_1\.zip/series\.csv: no such table \(File is not a zip file\)"):
        read_table(archive, of="series")


def test_a_refusal_record_in_place_of_an_archive_is_told(tmp_path: Path) -> None:
    cause = Refusal("t_1", "t_1.mcap", "bench.fit_impedance_trial", "refused", "no stepped sine", "record again")
    write_refusals([cause], tmp_path / "t_1.zip")
    with pytest.raises(InputError, match="there is no result: trial t_1: no stepped sine; record again"):
        read_table(tmp_path / "t_1.zip", of="series")
