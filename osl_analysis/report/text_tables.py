"""Rows of texts as a table in Markdown or in aligned columns."""

from collections.abc import Sequence

from tabulate import tabulate


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown; the first row is the head."""
    return tabulate(rows[1:], rows[0], tablefmt="github", disable_numparse=True) + "\n"


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows as lines with aligned columns."""
    return tabulate(rows, tablefmt="plain", disable_numparse=True) + "\n"
