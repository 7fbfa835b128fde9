"""Several tables of a trial in one archive: it holds what was written, completely or not at all."""

import zipfile

import polars as pl
import pytest

from osl_analysis.errors import InputError
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import archives, read_table, tables_of, write_table

TABLES = {
    "phasors": pl.DataFrame({"trial": ["01", "01"], "gain": [0.1 + 0.2, 1e-17]}),
    "series": pl.DataFrame({"time": [0.0, 1.0], "torque": [None, float("nan")]}),
}


def written(path):
    with archives(), tables_of("measured"):
        for name, table in TABLES.items():
            write_table(table, path / f"{name}.csv")
    return path


def test_tables_come_back_as_they_were_written_and_any_zip_reader_finds_them(tmp_path):
    path = written(tmp_path / "fits/t_1.zip")
    for name, table in TABLES.items():
        assert read_table(path, of=name).drop("data").equals(table, null_equal=True)
    assert list(path.parent.iterdir()) == [path]
    with tables_of("measured"):
        write_table(TABLES["phasors"], tmp_path / "phasors.csv")
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.infolist()[0].date_time == (1980, 1, 1, 0, 0, 0)  # the same tables make the same archive
        assert archive.read("phasors.csv") == (tmp_path / "phasors.csv").read_bytes()


def fail_after_writing(*paths):
    for archive in paths:
        write_table(TABLES["series"], archive / "series.csv")
    write_table(None, paths[0] / "series.csv")


def test_after_an_error_nothing_is_written_and_an_older_archive_stays(tmp_path):
    before = written(tmp_path / "t_1.zip").read_bytes()
    with pytest.raises(AttributeError), archives():
        fail_after_writing(tmp_path / "t_1.zip", tmp_path / "t_2.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["t_1.zip"]
    assert (tmp_path / "t_1.zip").read_bytes() == before


def test_a_table_that_is_not_there_and_a_refusal_in_its_place_are_named(tmp_path):
    archive = written(tmp_path / "t_1.zip")
    with pytest.raises(InputError, match=r"t_1\.zip/response\.csv: no such table .*run the step that writes it"):
        read_table(archive, of="response")
    archive.write_bytes(archive.read_bytes()[:100])
    with pytest.raises(InputError, match=r"t_1\.zip/series\.csv: no such table \(File is not a zip file\)"):
        read_table(archive, of="series")
    cause = Refusal("t_1", "t_1.mcap", "bench.fit_trial", "refused", "no stepped sine", "record again")
    write_refusals([cause], archive)
    with pytest.raises(InputError, match="there is no result: trial t_1: no stepped sine; record again"):
        read_table(archive, of="series")
