"""Large CSV files whose lines are all alike are read a column at a time, and as the ordinary reader reads them."""

from pathlib import Path

import pytest

from osl_analysis.formats import csv_plain
from osl_analysis.formats.csv_plain import PlainBody
from osl_analysis.formats.csv_table import CsvLayout, read_csv_table, read_lines, table_of

HEAD = "# bench 4\ntime [s],torque [N*m],angle [deg]\n"
ROWS = [
    f"{k * 1e-3:.6f},{'nan' if k % 7 == 3 else f'{k % 13 - 6.25e-3:.7g}'},{'' if k % 11 == 5 else k}"
    for k in range(700)
]
"""A missing reading in two ways."""


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_plain, "LARGE", 1000)
    monkeypatch.setattr(csv_plain, "BLOCK", 997)


def both(tmp_path: Path, text: str):
    """The table as it is read, and by the ordinary reader."""
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    return read_csv_table(path, CsvLayout()), table_of(path, read_lines(path), CsvLayout())


@pytest.mark.parametrize("end", ["\n", ""])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_plain_file_has_the_same_names_units_cells_and_lines(tmp_path: Path, newline: str, end: str) -> None:
    text = (HEAD + "\n".join(ROWS) + end).replace("\n", newline)
    plain, ordinary = both(tmp_path, text)
    assert isinstance(plain.rows, PlainBody)
    assert (plain.names, plain.units, plain.comments) == (ordinary.names, ordinary.units, ordinary.comments)
    assert (plain.notes, plain.columns_from) == (ordinary.notes, ordinary.columns_from)
    assert len(plain.rows) == len(ordinary.rows) == len(ROWS)
    for column in range(3):
        assert list(plain.cells(column)) == ordinary.cells(column)
    for row in (0, 100, 197, 198, 199, 450, 699, -1):
        assert plain.rows[row] == ordinary.rows[row]


OTHER_LINES = (
    "0.5,1",
    "0.5,1,2,3",
    '0.5,"1",2',
    "0.5, 1,2",
    "",
    "# paused",
    "0.5,1,2 # late",
    ",,",
    "0.5,1,\u00b0",
    "1\t1\t2",
)


@pytest.mark.parametrize("line", OTHER_LINES)
def test_a_file_with_any_other_line_is_read_by_the_ordinary_reader(tmp_path: Path, line: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + "\n".join([*ROWS[:500], line, *ROWS[500:]]) + "\n", encoding="utf-8")
    assert csv_plain.plain_lines(path, path.read_bytes().index(b"0.4"), ",", 3, "#") is None
    table = read_csv_table(path, CsvLayout(ragged="skip"))
    assert not isinstance(table.rows, PlainBody)


def test_a_small_file_is_read_by_the_ordinary_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_plain, "LARGE", 1 << 24)
    assert not isinstance(both(tmp_path, HEAD + "\n".join(ROWS))[0].rows, PlainBody)
