"""How a text is set on the page: units, symbols, powers, minus signs."""

import re
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
