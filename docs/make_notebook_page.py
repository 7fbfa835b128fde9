"""Run the Python blocks of docs/notebook.md and write what they give below each: python
docs/make_notebook_page.py

What a block prints, and its last expression, become a block of text; a figure becomes a picture
beside the page.
"""

import ast
import re
import tempfile
from collections.abc import Callable
from contextlib import chdir, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.errors import OslAnalysisError

PAGE = Path(__file__).with_name("notebook.md")
BLOCK = re.compile(
    r"^```python\n(.*?)^```\n(?:\n```text\n.*?^```\n)?(?:\n!\[.*?\]\(notebook_\d+\.png\)\n)?",
    re.M | re.S,
)
"""A block of code, with what an earlier run wrote below it."""


def made_page(text: str, keep: Callable[[str, Any], None]) -> str:
    """The page with the output of each block; `keep` is called with name and figure of each
    picture."""
    names: dict[str, Any] = {}
    pictures: list[str] = []

    def made(block: re.Match[str]) -> str:
        said, figure = output_of(block[1], names)
        parts = [f"```python\n{block[1]}```\n"]
        if said:
            parts.append(f"```text\n{said}\n```\n")
        if figure is not None:
            pictures.append(f"notebook_{len(pictures) + 1}.png")
            keep(pictures[-1], figure)
            parts.append(f"![{block[1].splitlines()[-1]}]({pictures[-1]})\n")
        return "\n".join(parts)

    frames = pl.Config(
        tbl_width_chars=110,
        tbl_cols=12,
        tbl_rows=12,
        fmt_str_lengths=40,
        tbl_hide_dataframe_shape=True,
    )
    with tempfile.TemporaryDirectory() as place, chdir(place), frames:
        return BLOCK.sub(made, text)


def output_of(code: str, names: dict[str, Any]) -> tuple[str, Any]:
    """What a block prints and shows, and its figure if it ends with one. `names` are those of the
    blocks before it."""
    body = ast.parse(code).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    printed, value = StringIO(), None
    with redirect_stdout(printed):
        exec(compile(ast.Module(body, []), "page", "exec"), names)
        if isinstance(last, ast.Expr):
            try:
                value = eval(compile(ast.Expression(last.value), "page", "eval"), names)
            except OslAnalysisError as error:  # shown as the last line of what a notebook says
                print(f"{type(error).__name__}: {error}")
    if hasattr(value, "_repr_png_"):
        return printed.getvalue().strip(), value
    shown = [printed.getvalue().strip(), "" if value is None else repr(value)]
    return "\n".join(line.rstrip() for line in "\n".join(filter(None, shown)).splitlines()), None


def write_page() -> None:
    """Write the page and its pictures."""
    text = made_page(
        PAGE.read_text(encoding="utf-8"),
        lambda name, figure: figure.savefig(PAGE.with_name(name), dpi=130),
    )
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        write_page()
