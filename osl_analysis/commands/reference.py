"""The page of tables: the meaning of every column of every result table, of every check and headline number."""

from collections.abc import Iterable

from osl_analysis.dictionary import HERE, described_tables
from osl_analysis.ingest.examine import UNITS
from osl_analysis.judge.limits import CHECKS
from osl_analysis.judge.words import WORDS
from osl_analysis.report.headlines import all_labels


def tables_page(command: str) -> str:
    """The page as Markdown; `command` is what the reader calls to make it again."""
    tables = []
    for table in described_tables():
        named = (path.replace("*/*", "EXPERIMENT/*").replace("*", "TRIAL") for path in (table.place, table.also))
        place, also = (f"{path}.csv" for path in named)
        columns = [(f"`{column.name}`", column.unit, column.meaning) for column in table.columns.values()]
        described = markdown("column", "unit", "meaning", rows=columns)
        gathered = f" `{also}` holds the rows of one trial." if table.also else ""
        tables.append(f"## `{place}`\n\nRows: {table.rows}.{gathered}\n\n{described}")
    checks = [
        (f"`{c.name}`", UNITS[c.name], f"{WORDS['checks'][c.name]}. Fails {c.fails} its threshold")
        for c in CHECKS.values()
    ]
    entries = [(f"`{one.name}`", one.unit, one.meaning) for one in all_labels()]
    page = (HERE / "page.md").read_text(encoding="utf-8").rstrip()
    return page.format(
        command=command,
        tables="\n".join(tables),
        checks=markdown("check", "unit", "meaning of its value", rows=checks),
        entries=markdown("entry", "unit", "meaning", rows=entries),
    )


def markdown(*head: str, rows: Iterable[Iterable[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)
