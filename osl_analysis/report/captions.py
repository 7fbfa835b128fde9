"""Captions of the figures as HTML, from `captions.md`."""

import re
from html import escape

from markupsafe import Markup

PARTS = re.compile(r"\\(?P<sign>[^A-Za-z0-9\s])|\$(?P<mathematics>[^$]+)\$|(?P<text>[^\\$]+|[\\$])")
INDEX = re.compile(r"_(?:\{([^}]*)\}|(\w))")
POWER = re.compile(r"\^(?:\{([^}]*)\}|(\w))")
ACCENT = re.compile(r"\\hat\{?(\w)\}?")
LETTERS = {"theta": "θ", "tau": "τ", "omega": "ω", "alpha": "α", "pm": "±", "cdot": "·", "dot": "", "mathrm": ""}
"""Commands of LaTeX, and what stands for them."""


def captions_by_title(text: str) -> dict[str, Markup]:
    """The captions of `captions.md` by the title of their figure."""
    sections = (section.partition("\n") for section in f"\n{text}".split("\n## ")[1:])
    return {title.strip(): caption_html(body.strip()) for title, _, body in sections}


def caption_html(text: str) -> Markup:
    """A caption as HTML: signs that Markdown escapes are themselves, mathematics has its indices, all else is text."""
    return Markup("".join(part_html(part) for part in PARTS.finditer(text)))


def part_html(part: re.Match[str]) -> str:
    """One part of a caption."""
    if part["mathematics"]:
        return mathematics_html(part["mathematics"])
    return escape(part["sign"] or part["text"])


def mathematics_html(text: str) -> str:
    """A symbol of the paper, such as `\\hat{K}` or `K_d`."""
    plain = re.sub(r"\\(\w+)", lambda word: LETTERS.get(word[1], word[1]), ACCENT.sub("\\1\u0302", text))
    with_index = INDEX.sub(lambda found: f"<sub>{found[1] or found[2]}</sub>", escape(plain))
    raised = POWER.sub(lambda found: f"<sup>{found[1] or found[2]}</sup>", with_index)
    return f"<i>{raised.replace('{', '').replace('}', '')}</i>"
