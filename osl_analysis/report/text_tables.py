"""Rows of texts as a table in Markdown, in LaTeX or in aligned columns; the first row is the
head."""

from collections.abc import Mapping, Sequence

from tabulate import tabulate

from osl_analysis.report.typography import in_latex

Rows = Sequence[Sequence[str]]


def markdown_table(rows: Rows) -> str:
    """Rows as a table in Markdown."""
    return tabulate(rows[1:], rows[0], tablefmt="github", disable_numparse=True) + "\n"


def aligned(rows: Rows) -> str:
    """Rows as lines with aligned columns."""
    return tabulate(rows, tablefmt="plain", disable_numparse=True) + "\n"


def latex_table(rows: Rows, heads: Mapping[str, str]) -> str:
    """Rows as a `tabular` with rules of booktabs. `heads` has those of the heads that are LaTeX."""
    lines = [[heads.get(head, in_latex(head)) for head in rows[0]]]
    lines += [[in_latex(cell) for cell in row] for row in rows[1:]]
    head, *body = [" & ".join(line) + r" \\" for line in lines]
    begin = rf"\begin{{tabular}}{{{'l' * len(rows[0])}}}"
    parts = [begin, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"]
    return "\n".join(parts) + "\n"
