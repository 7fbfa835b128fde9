# SPDX-License-Identifier: Apache-2.0
"""Tables read back as they were written, and every column has a unit and a meaning in the data
dictionary."""

import csv
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest
from conftest import refused_with
from hypothesis import example, given
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from osl_analysis.base.files import package_yaml
from osl_analysis.base.table import (
    read_table,
    with_places,
    write_table,
)
from osl_analysis.base.yaml_settings import read_mapping
from osl_analysis.commands.run import check_working_folder
from osl_analysis.dictionary.described import HERE


@pytest.mark.parametrize(
    "path", [*HERE.glob("*.yaml"), *HERE.parent.glob("figures/*.yaml")], ids=lambda path: path.name
)
def test_our_files_are_alike_in_yaml_1_1_and_1_2_and_repeat_no_key(path):
    assert package_yaml(path) == read_mapping(path)


@given(st.lists(st.one_of(st.none(), st.floats(allow_infinity=False)), min_size=1, max_size=8))
def test_every_number_null_and_nan_reads_back_to_the_last_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("tables") / "t.csv"
    table = pl.DataFrame({"n": range(len(numbers)), "value": pl.Series(numbers, dtype=pl.Float64)})
    write_table(table, path)
    assert_frame_equal(read_table(path), table, check_column_order=False, check_exact=True)


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\x00\r")), min_size=1))
@example(["=1+2", "+1", "-x", "@a", "'=b", "''c", "\t1", "-5 %", "'d"])
def test_no_text_is_a_formula_of_a_spreadsheet_and_each_reads_back(tmp_path_factory, texts):
    path = tmp_path_factory.mktemp("tables") / "t.csv"
    table = pl.DataFrame({"n": range(len(texts)), "remark": texts})

    write_table(table, path)

    with path.open(newline="", encoding="utf-8") as file:
        assert not any(row["remark"].startswith(tuple("=+-@\t")) for row in csv.DictReader(file))
    assert read_table(path)["remark"].fill_null("").to_list() == texts


@pytest.mark.parametrize("late", [["1"] * 4999 + ["1.5"], [None] * 4999 + [1.5]])
def test_names_of_digits_are_text_and_an_empty_column_holds_numbers(tmp_path, late):
    table = pl.DataFrame({"trial": "01", "amplitude_deg": None, "K": late})
    write_table(table, tmp_path / "a/b/t.csv")
    read = read_table(tmp_path / "a/b/t.csv")
    assert read.row(-1, named=True) == {"trial": "01", "amplitude_deg": None, "K": 1.5}
    assert read["amplitude_deg"].dtype == pl.Float64
    assert {*with_places(table.drop("trial"), {}).columns} == {"amplitude_deg", "K"}


def test_a_blank_line_and_a_trial_that_was_not_analysed_are_no_rows(tmp_path):
    text = "\ntrial,K,status\na,1,analysed\n\nb,2,\n\nc,,not analysed\n"
    (tmp_path / "t.csv").write_text(text)
    read = read_table(tmp_path / "t.csv", ["K"])
    assert read.select("trial", "K", "status").rows() == [("a", 1, "analysed"), ("b", 2, None)]


def test_a_folder_that_cannot_be_written_to_or_is_full_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "raw_data").mkdir()
    for name in (".snakemake/log", "results/tables"):
        (tmp_path / name).mkdir(parents=True)
        check_working_folder(Path("results"))
        monkeypatch.setattr(
            "os.access", lambda path, mode, name=name: str(path) not in (name, "raw_data")
        )
        with refused_with(f"{tmp_path}/{name}:"):
            check_working_folder(Path("results"))
        monkeypatch.undo()
        monkeypatch.chdir(tmp_path)
    for free in (9, 10):  # MB
        room = SimpleNamespace(total=10**9, free=free * 10**6)
        monkeypatch.setattr("shutil.disk_usage", lambda path, room=room: room)
        with refused_with("10 MB") if free < 10 else nullcontext():
            check_working_folder()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"t\.csv: "),
        ("", r"t\.csv: "),
        ("K,B\n1,2,3\n", r"t\.csv: "),
        ("B\n1\n", r"t\.csv: .*'K'.* B"),
        ("K\n1\nERROR\n", r"t\.csv: .*'K'"),
    ],
)
def test_a_bad_table_is_refused_by_file_and_column_in_one_line(tmp_path, content, message):
    if content is not None:
        (tmp_path / "t.csv").write_text(content)
    with refused_with(message):
        read_table(tmp_path / "t.csv", required=["K"])


@pytest.mark.parametrize("known", [None, "left"])
def test_a_side_is_written_where_one_is_known_and_read_in_any_case(tmp_path, known):
    placed = {"trial": ["a", "b"], "joint": None, "side": [known, None]}
    places = pl.DataFrame(placed, schema_overrides={"side": pl.String})
    write_table(places, path := tmp_path / "t.csv")
    assert ("side" in path.read_text().splitlines()[0]) == (known is not None)
    assert read_table(path)["side"].to_list() == [known, None]
