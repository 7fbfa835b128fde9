"""Rows of texts as a table in Markdown, in LaTeX or in aligned columns; the first row is the
head."""

from collections.abc import Mapping, Sequence

from osl_analysis.report.typography import in_latex


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
    """Rows as a `tabular` with rules of booktabs. `heads` has those of the heads that are LaTeX."""
    lines = [[heads.get(head, in_latex(head)) for head in rows[0]]]
    lines += [[in_latex(cell) for cell in row] for row in rows[1:]]
    head, *body = [" & ".join(line) + r" \\" for line in lines]
    begin = rf"\begin{{tabular}}{{{'l' * len(rows[0])}}}"
    parts = [begin, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"]
    return "\n".join(parts) + "\n"
