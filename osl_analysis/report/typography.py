# SPDX-License-Identifier: Apache-2.0
"""How a text is set: units, symbols, powers and minus signs on the page, and signs of LaTeX; rows
of texts as a table in Markdown, in LaTeX or in aligned columns, of which the first is the head; and
the templates of longer texts."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from osl_analysis.base.files import own_yaml
from osl_analysis.stats.rounding import significant

TYPESET_SIGNS = own_yaml(Path(__file__).with_suffix(".yaml"))
ANY_SIGN = re.compile("|".join(TYPESET_SIGNS))  # few of a page's numbers have one


@cache
def printed(text: str) -> str:
    """A text with units, symbols, powers and minus signs as the page sets them; empty for the unit
    1."""
    if ANY_SIGN.search(text) is None:
        return "" if text == "1" else text
    for pattern, sign in TYPESET_SIGNS.items():
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


def template(name: str, filters: Mapping[str, Any] = {}, **choices: Any) -> Template:
    """A template of this package, which refuses names that it does not know, with filters of its
    own; `choices` are of `jinja2.Environment`."""
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    environment = Environment(loader=loader, undefined=StrictUndefined, **choices)
    # models of Bokeh are read in the order in which they refer to each other
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}
    environment.filters.update(digits=value_text, latex=in_latex, **filters)
    return environment.get_template(name)


def value_text(value: object) -> str:
    """A value in a sentence; a number with three digits."""
    return significant(value, 3) if isinstance(value, float) else str(value)


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
