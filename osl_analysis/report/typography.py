# SPDX-License-Identifier: Apache-2.0
"""How a text is set: units, symbols, powers and minus signs on the page, and signs of LaTeX; rows
of texts as a table in Markdown, in LaTeX or in aligned columns, of which the first is the head."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from osl_analysis.files import own_yaml
from osl_analysis.stats.rounding import WithInterval, plus_minus

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


def in_markdown(text: str) -> str:
    """A text without what Markdown reads as HTML, a link or the end of a cell."""
    return text.replace("<", "&lt;").replace("](", r"]\(").replace("|", r"\|")


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join(lines) + "\n"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown."""
    rule = ["---"] * len(rows[0])
    lines = [f"| {' | '.join(map(in_markdown, row))} |\n" for row in (rows[0], rule, *rows[1:])]
    return "".join(lines)


MOST_IN_COLUMN = 4  # columns of a table that a column of two holds, with intervals below the values
INTERVAL_BELOW = r"\begin{tabular}[t]{@{}l@{}}%s\\{}[%s, %s]\end{tabular}"
UNIT_BELOW = r"\\begin{tabular}[t]{@{}l@{}}\1\\\\(\2\\end{tabular}"


def latex_table(rows: Sequence[Sequence[str]], heads: Mapping[str, str]) -> str:
    """Rows as a `tabular` with rules of booktabs, which fits a column, turned if need be, or else
    the width of two. `heads` has those heads, of columns and of rows, that are LaTeX."""
    if len(rows) <= MOST_IN_COLUMN < len(rows[0]):
        rows = [*zip(*rows, strict=True)]
    is_wide = len(rows[0]) > MOST_IN_COLUMN
    on_top = dict(heads)
    if is_wide:
        on_top = {name: re.sub(r"(.+) \((.+)", UNIT_BELOW, head) for name, head in heads.items()}

    def in_cell(text: str) -> str:
        if not isinstance(text, WithInterval):
            return in_latex(text)
        if is_wide:
            return plus_minus(*text.parts).replace("±", r"$\pm$")
        return INTERVAL_BELOW % text.parts

    lines = [" & ".join(on_top.get(cell, in_cell(cell)) for cell in rows[0])]
    lines += [" & ".join(heads.get(cell, in_cell(cell)) for cell in row) for row in rows[1:]]
    head, *body = [re.sub(r"(?<!\w)-(?=\d)", "$-$", line) + r" \\" for line in lines]
    begin = rf"\begin{{tabular}}{{@{{}}{'l' * len(rows[0])}@{{}}}}\toprule"
    parts = [
        r"{\footnotesize\tabcolsep=2pt\sisetup{per-mode=symbol}",
        begin,
        head,
        r"\midrule",
        *body,
        r"\bottomrule",
    ]
    return "\n".join([*parts, r"\end{tabular}}", ""])
