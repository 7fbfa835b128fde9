"""How a text is set: units, symbols, powers and minus signs on the page, and signs of LaTeX; rows
of texts as a table in Markdown, in LaTeX or in aligned columns, of which the first is the head."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from osl_analysis.files import own_yaml

SIGNS: dict[str, str] = own_yaml(Path(__file__).with_suffix(".yaml"))
ANY_SIGN = re.compile("|".join(SIGNS))  # few of a page's numbers have one


@cache
def printed(text: str) -> str:
    """A text with units, symbols, powers and minus signs as the page sets them; empty for the unit
    1."""
    if ANY_SIGN.search(text) is None:
        return "" if text == "1" else text
    for pattern, sign in SIGNS.items():
        text = re.sub(pattern, sign, text)
    return text


LATEX_SIGNS = str.maketrans(
    {
        **{sign: rf"\{sign}" for sign in "&%$#_{}"},
        "~": r"\~{}",
        "^": r"\^{}",
        "\\": r"\textbackslash{}",
    }
)


def in_latex(text: str) -> str:
    """A text with the signs escaped that LaTeX reads as commands."""
    return text.translate(LATEX_SIGNS)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines) + "\n"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown."""
    rule = ["---"] * len(rows[0])
    lines = [f"| {' | '.join(row)} |\n" for row in (rows[0], rule, *rows[1:])]
    return "".join(lines)


def latex_table(rows: Sequence[Sequence[str]], heads: Mapping[str, str]) -> str:
    """Rows as a `tabular` with rules of booktabs. `heads` has those heads, of columns and of rows,
    that are LaTeX."""
    lines = [[heads.get(cell, in_latex(cell)) for cell in row] for row in rows]
    head, *body = [" & ".join(line) + r" \\" for line in lines]
    begin = rf"\begin{{tabular}}{{{'l' * len(rows[0])}}}"
    parts = [begin, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"]
    return "\n".join(parts) + "\n"
