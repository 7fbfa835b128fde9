# SPDX-License-Identifier: Apache-2.0
"""Set texts for the page, LaTeX and Markdown, and load the templates of longer texts.

Units, symbols, powers and minus signs are set by the patterns of `typography.yaml`. A table is rows
of texts, of which the first is its head.

Example: `printed("N*m*s/rad")` is `N·m·s/rad`.
"""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from osl_analysis.base.files import package_yaml
from osl_analysis.stats.rounding import significant

TYPESET_SIGNS = package_yaml(Path(__file__).with_suffix(".yaml"))
ANY_SIGN = re.compile("|".join(TYPESET_SIGNS))  # few of a page's numbers have one


@cache
def printed(text: str) -> str:
    """A text with units, symbols, powers and minus signs as the page has them; empty for the unit
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
        "−": "$-$",
        "±": r"$\pm$",
        "×": r"$\times$",
        "≤": r"$\leq$",
        "≥": r"$\geq$",
    }
)


def in_latex(text: str) -> str:
    """A text with the signs escaped that LaTeX reads as commands."""
    return text.translate(LATEX_SIGNS)


# of a combining mark of Unicode, and of letters that are no letter with a mark
LATEX_ACCENTS = {
    "\N{COMBINING GRAVE ACCENT}": r"\`",
    "\N{COMBINING ACUTE ACCENT}": r"\'",
    "\N{COMBINING CIRCUMFLEX ACCENT}": r"\^",
    "\N{COMBINING TILDE}": r"\~",
    "\N{COMBINING DIAERESIS}": r"\"",
    "\N{COMBINING RING ABOVE}": r"\r ",
    "\N{COMBINING CEDILLA}": r"\c ",
    "\N{COMBINING CARON}": r"\v ",
}
LATEX_LETTERS = {
    "Ø": r"{\O}",
    "ø": r"{\o}",
    "Æ": r"{\AE}",
    "æ": r"{\ae}",
    "ß": r"{\ss}",
    "ł": r"{\l}",
}


def in_ascii_latex(text: str) -> str:
    """A text of BibTeX with commands in place of letters beyond ASCII, which BibTeX sorts and
    abbreviates wrongly: `Mölder` is `M{\\"o}lder`.

    Raises
    ------
    ValueError
        No command is known for a letter.
    """
    letters = [ascii_latex_letter(letter) for letter in text]
    return "".join(letters)


def ascii_latex_letter(letter: str) -> str:
    if letter.isascii():
        return letter
    if letter in LATEX_LETTERS:
        return LATEX_LETTERS[letter]
    base, *marks = list(unicodedata.normalize("NFD", letter))
    if not base.isascii() or len(marks) != 1 or marks[0] not in LATEX_ACCENTS:
        raise ValueError(f"no command of LaTeX is known for '{letter}'")
    return f"{{{LATEX_ACCENTS[marks[0]]}{base}}}"


MARKED_PARTS = re.compile(r"((?<!\\)\$.+?(?<!\\)\$|`[^`]+`|\[@\w+\])")


def prose_in_latex(marked: str) -> str:
    """A sentence in Markdown as LaTeX.

    Symbols between `$` stay. A text in backticks becomes code, and `[@fuller1987]` a citation.
    Other signs are escaped.
    """
    words = []
    for part in MARKED_PARTS.split(marked):
        if part.startswith("$"):
            words.append(part)
        elif part.startswith("`"):
            words.append(rf"\texttt{{{in_latex(part.strip('`'))}}}")
        elif part.startswith("[@"):
            words.append(rf"\cite{{{part[2:-1]}}}")
        else:
            words.append(in_latex(part.replace(r"\$", "$")))
    return re.sub(r" ?\\cite", r"~\\cite", "".join(words))


def in_markdown(text: str) -> str:
    """A text without what Markdown reads as HTML, a link or the end of a cell."""
    return text.replace("<", "&lt;").replace("](", r"]\(").replace("|", r"\|")


def template(name: str, filters: Mapping[str, Any] = {}, **choices: Any) -> Template:
    """A template of this package with `filters`; an unknown name in it is an error.

    `choices` are options of `jinja2.Environment`.
    """
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
