"""Tables read back as they were written, appear whole or not at all, and say what is wrong with them."""

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.table import read_table, write_table


@given(st.lists(st.one_of(st.none(), st.floats(allow_infinity=False)), min_size=1, max_size=8))
def test_every_number_null_and_nan_reads_back_to_the_last_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("tables") / "t.csv"
    table = pl.DataFrame(
        {"n": list(range(len(numbers))), "value": numbers}, schema={"n": pl.Int64, "value": pl.Float64}
    )
    write_table(table, path)
    assert_frame_equal(read_table(path), table, check_exact=True)


def test_names_of_digits_are_text_decimals_may_come_late_and_an_empty_column_holds_numbers(tmp_path):
    table = pl.DataFrame({"trial": ["01"] * 5000, "amplitude_deg": [None] * 5000, "K": ["1"] * 4999 + ["1.5"]})
    write_table(table, tmp_path / "a" / "b" / "t.csv")
    read = read_table(tmp_path / "a" / "b" / "t.csv")
    assert read.row(-1) == ("01", None, 1.5)
    assert read["amplitude_deg"].dtype == pl.Float64
    assert [p.name for p in (tmp_path / "a" / "b").iterdir()] == ["t.csv"]


def test_a_failure_while_writing_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:  # noqa: PT012
        temporary.write_text("half of the new")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"t\.csv: no such table"),
        ("", r"t\.csv: not a CSV table"),
        ("K,B\n1,2,3\n", r"t\.csv: not a CSV table"),
        ("B\n1\n", r"t\.csv: no column 'K'; it has B"),
        ("K\n1\nERROR\n", r"t\.csv: column 'K' holds 'ERROR', expected numbers"),
    ],
)
def test_a_bad_table_is_refused_by_file_and_column_in_one_line(tmp_path, content, message):
    if content is not None:
        (tmp_path / "t.csv").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        read_table(tmp_path / "t.csv", required=["K"])
    assert "\n" not in str(caught.value)
