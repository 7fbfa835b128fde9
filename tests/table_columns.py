"""Keep the columns of all result tables, whose version is `osl_analysis.schema.SCHEMA`: python
tests/table_columns.py

`table_columns.txt` has the schema, the release that has it first, and below each table a line per
column with its unit (`text` and `true or false` are types, all other units are of numbers).
"""

import re
import sys
from pathlib import Path

from osl_analysis.dictionary import described_tables
from osl_analysis.schema import SCHEMA

KEPT = Path(__file__).with_suffix(".txt")
CHANGELOG = Path(__file__).parents[1] / "CHANGELOG.md"
FIRST_LINE = "schema {schema} since {release}"


def columns_text() -> str:
    """The columns of the tables below `results/tables`, as the dictionary describes them."""
    lines = []
    for table in described_tables():
        if table.place.startswith("tables/"):
            lines.append(table.place)
            lines += [f"  {column.name}: {column.unit}" for column in table.columns.values()]
    return "\n".join(lines) + "\n"


def release_at_work() -> str:
    """The release that the top of the changelog is about."""
    found = re.search(r"(?m)^## (\d\S*)", CHANGELOG.read_text(encoding="utf-8"))
    assert found is not None
    return found[1]


def kept() -> tuple[int, str, str]:
    """The kept schema, the release that has it first, and the columns."""
    first, _, columns = KEPT.read_text(encoding="utf-8").partition("\n")
    _, schema, _, release = first.split()
    return int(schema), release, columns


def updated(schema_here: int, release_here: str) -> str:
    """The file of the columns as they are now.

    Raises
    ------
    SystemExit
        A release has the kept columns, and `SCHEMA` is still theirs.
    """
    schema, release, columns = kept()
    if release != release_here and columns != columns_text():
        if schema_here != schema + 1:
            raise SystemExit(
                f"release {release} has schema {schema} with other columns: set SCHEMA ="
                f" {schema + 1} in osl_analysis/schema.py first"
            )
        release = release_here
    return f"{FIRST_LINE.format(schema=schema_here, release=release)}\n{columns_text()}"


if __name__ == "__main__":
    KEPT.write_text(updated(SCHEMA, release_at_work()), encoding="utf-8")
    sys.stdout.write(f"wrote {KEPT}\n")
