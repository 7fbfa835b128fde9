# SPDX-License-Identifier: Apache-2.0
"""Print paper/paper.md from paper/paper.md.j2: `make paper`.

Its numbers are cells of the documentation's tables, which a command has printed between
`<!-- NAME -->` and `<!-- end -->`. `--check` only tells whether the paper is as printed.
"""

import re
import sys
from datetime import date
from pathlib import Path

import jinja2

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"
MOST_WORDS = 1000  # of the journal


def table(page: str, name: str) -> tuple[list[str], list[str]]:
    """The cells of the head of a table of a page, and its rows as text, cells parted by ` | `."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    printed = text.split(f"<!-- {name} -->\n")[1].split("<!-- end -->")[0]
    head, _, *rows = [line.strip("| ") for line in printed.strip().splitlines()]
    return head.split(" | "), rows


def column(page: str, name: str, begins: str) -> int:
    head, _ = table(page, name)
    (found,) = [i for i, cell in enumerate(head) if re.match(rf"{begins}\b", cell)]
    return found


def cell(page: str, name: str, row_begins: str, column_begins: str) -> str:
    """The cell of a printed table in the row and the column that begin with these words."""
    _, rows = table(page, name)
    (row,) = [row for row in rows if re.match(rf"{re.escape(row_begins)}\b", row)]
    return row.split(" | ")[column(page, name, column_begins)].strip()


def of(page: str, name: str, column_begins: str) -> str:
    """The number in the head of a column, as 27 in `silent, of 27`."""
    head, _ = table(page, name)
    return re.findall(r"\d+", head[column(page, name, column_begins)])[-1]


def day_of_release() -> str:
    """As the journal writes it, of the release that CITATION.cff names."""
    citation = (HERE.parent / "CITATION.cff").read_text(encoding="utf-8")
    day = date.fromisoformat(re.findall(r"^date-released: (\S+)", citation, re.MULTILINE)[0])
    return f"{day.day} {day:%B %Y}"


def faults(template: str, paper: str) -> list[str]:
    """What is wrong with the paper: a number that no table has, a key without a reference, too many
    words."""
    found = []
    body = template.split("---\n", 2)[2]
    typed = re.sub(r"\{\{.*?\}\}|@\w+", "", body, flags=re.DOTALL)
    if numbers := re.findall(r".{0,20}(?<![A-Za-z])\d.{0,20}", typed):
        found.append(f"paper.md.j2: numbers that no command has printed: {numbers}")
    references = (HERE / "paper.bib").read_text(encoding="utf-8")
    if unknown := set(re.findall(r"@(\w+)", body)) ^ set(re.findall(r"@\w+\{(\w+)", references)):
        found.append(f"paper.bib: cited and not there, or there and not cited: {sorted(unknown)}")
    words = len(paper.split("---\n", 2)[2].split())
    if words > MOST_WORDS:
        found.append(f"paper.md: {words} words; the journal prints {MOST_WORDS}")
    return found


def main() -> None:
    template = (HERE / "paper.md.j2").read_text(encoding="utf-8")
    strict = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    paper = strict.from_string(template).render(cell=cell, of=of, date=day_of_release())
    found = faults(template, paper)
    printed = HERE / "paper.md"
    if "--check" not in sys.argv:
        printed.write_text(paper, encoding="utf-8")
    elif printed.read_text(encoding="utf-8") != paper:
        found.append("paper.md: not as the tables of the documentation are now: make paper")
    if found:
        sys.exit("\n".join(found))


if __name__ == "__main__":
    main()
