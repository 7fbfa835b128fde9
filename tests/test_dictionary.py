"""The data dictionary: every column has a unit and a meaning, and the page in docs/ is the one that the code makes."""

import polars as pl
import pytest
from test_walking_overground import gait_trial

from osl_analysis.dictionary import described_columns, described_tables
from osl_analysis.figures import FIGURES, drawing_of
from osl_analysis.study.performance import performance_table
from osl_analysis.table import TEXT_COLUMNS
from osl_analysis.walking.overground import overground_rows
from osl_analysis.walking.settings import OvergroundAnalysis


def described(place):
    (table,) = [table for table in described_tables() if table.place == place]
    return table.columns


@pytest.mark.parametrize("table", described_tables(), ids=lambda table: table.place)
def test_every_description_has_a_unit_and_a_sentence_that_a_table_of_the_page_can_hold(table):
    assert table.rows
    for column in table.columns.values():
        assert column.unit.strip(), column.name
        assert len(column.meaning) > 10, column.name
        assert column.meaning == column.meaning.strip().removesuffix("."), column.name


def test_endings_covariances_and_shared_columns_are_written_out():
    columns = described("tables/impedance")
    assert columns["K_se"].unit == "N*m/rad"
    assert columns["K_se"].meaning == "standard error of K"
    assert columns["cov_K_B"].unit == "(N*m/rad) * (N*m*s/rad)"
    assert {"cov_K_I", "cov_B_I", "VAF", "controller", "trial", "I_amplitudes_high"} <= set(columns)
    assert "cov_B_K" not in columns
    (column,) = described_columns("x", "m | a length", {})
    assert (column.name, column.unit, column.meaning) == ("x", "m", "a length")


@pytest.mark.parametrize("name", FIGURES)
def test_the_columns_that_a_figure_draws_are_described(name):
    assert set(drawing_of(name).columns) <= set(described(f"figures/{name}"))


def test_the_tables_of_the_study_and_of_overground_trials_are_described():
    batches = described("study/batches/*")
    assert {"value", "se", "low", "high"} < set(batches)
    numbers = {name: [1.0, 2.0, 4.0] for name in batches} | {"truth": [1.0, 1.0, 1.0]}
    estimates = pl.DataFrame(numbers | {name: ["x"] * 3 for name, column in batches.items() if column.unit == "text"})
    assert set(described("study/study")) - {"data"} == set(performance_table(estimates).columns)
    (row,) = overground_rows(gait_trial(), OvergroundAnalysis(load_on_n=50, body_mass_kg=70))
    assert set(described("tables/ankle_moment")) - {"joint", "data"} == set(row)


def test_columns_that_are_read_as_text_are_described_as_text_and_tables_of_trials_by_those_that_gather_them():
    text = {column.name for table in described_tables() for column in table.columns.values() if column.unit == "text"}
    assert set(TEXT_COLUMNS) <= text
    assert [t.place for t in described_tables() if t.describes("fits/walking/walking_01.csv")] == ["tables/walking"]
    assert not any(t.describes("fits/unknown/walking_01.csv") for t in described_tables())
    assert pl.Series([t.place for t in described_tables()]).is_unique().all()
