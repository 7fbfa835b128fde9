"""Text of an SVG: words that can be searched and edited, and that look alike on every machine.

With `svg.fonttype` `none` matplotlib writes text as text, but only names its fonts, and writes a
label with mathematics letter by letter. Here letters become words again, and the letters that a
figure uses are embedded.
"""

import unicodedata
from base64 import b64encode
from collections import defaultdict
from functools import cache
from io import BytesIO
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.font_manager import FontProperties, findfont

SVG = "{http://www.w3.org/2000/svg}"
KEEPS_SPACES = "{http://www.w3.org/XML/1998/namespace}space"
PREFIXES = {
    "": "http://www.w3.org/2000/svg",
    "xlink": "http://www.w3.org/1999/xlink",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "cc": "http://creativecommons.org/ns#",
    "dc": "http://purl.org/dc/elements/1.1/",
}

# for programs that ignore embedded fonts: their letters are as wide as those of STIX
LIKE_STIX = "'Times New Roman', 'Liberation Serif', serif"

UNBREAKABLE_SPACE = "\u00a0"  # by which matplotlib keeps spaces

# tables of a font that place letters, as matplotlib has done, and those of its editor
NOT_NEEDED = {"FFTM", "GDEF", "GPOS", "GSUB", "kern"}

Font = tuple[str, str]  # family, and `normal` or `italic`


def with_readable_text(svg: str) -> str:
    """Join the letters of an SVG to words, and embed its fonts.

    Parameters
    ----------
    svg : str
        As matplotlib writes it with `svg.fonttype` `none`.

    Returns
    -------
    str
        The same drawing; equal for equal input.
    """
    for prefix, space in PREFIXES.items():
        ElementTree.register_namespace(prefix, space)
    root = ElementTree.fromstring(svg)
    for text in root.iter(f"{SVG}text"):
        join_letters(text)

    letters_of_font = letters_by_font(root)
    embed(root, [font_face(font, letters_of_font[font]) for font in sorted(letters_of_font)])
    for element in root.iter():
        style = element.get("style", "")
        if "'STIXGeneral'" in style:
            element.set("style", style.replace("'STIXGeneral'", f"'STIXGeneral', {LIKE_STIX}"))
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def join_letters(text: Element) -> None:
    """Put letters that follow one another in one style and height into one `tspan`.

    Each keeps its place: the `tspan` lists the abscissas of its letters. Accents stay alone, behind
    all others, because a browser would put them where its own font has them.
    """
    letters = sorted(text, key=lambda letter: (is_accent(letter), float(letter.get("x", 0))))
    for letter in letters:
        text.remove(letter)
        letter.tail = None
        letter.text = (letter.text or "").replace(UNBREAKABLE_SPACE, " ")

    last: Element | None = None
    for letter in letters:
        if last is not None and goes_on(last, letter):
            last.set("x", f"{last.get('x')} {letter.get('x')}")
            last.text = f"{last.text}{letter.text}"
        else:
            text.append(letter)
            last = letter
    if len(text):
        text.text = None
        text.set(KEEPS_SPACES, "preserve")


def is_accent(letter: Element) -> bool:
    """Whether a letter stands above another."""
    return any(unicodedata.combining(sign) for sign in letter.text or "")


def goes_on(letter: Element, following: Element) -> bool:
    """Whether two letters have one style and height, and neither is an accent."""
    is_alike = all(letter.get(name) == following.get(name) for name in ("y", "style"))
    return is_alike and not is_accent(letter) and not is_accent(following)


def letters_by_font(root: Element) -> dict[Font, set[str]]:
    """The letters of an SVG, by the first font of their text that has them."""
    letters_of: defaultdict[Font, set[str]] = defaultdict(set)
    for element in root.iter():
        style = element.get("style", "")
        if "font-family" not in style:
            continue
        slant = "italic" if "font-style: italic" in style else "normal"
        families = style.partition("font-family:")[2].partition(";")[0].split(",")
        for letter in element.text or "":
            for family in (name.strip(" '") for name in families):
                if ord(letter) in letters_in(font_file(family, slant)):
                    letters_of[family, slant].add(letter)
                    break
    return letters_of


def font_file(family: str, slant: str) -> str:
    """The file of a font that matplotlib draws with."""
    style: Literal["normal", "italic"] = "italic" if slant == "italic" else "normal"
    return findfont(FontProperties(family=[family], style=style))


@cache
def letters_in(file: str) -> frozenset[int]:
    """The letters, by code, that a font has."""
    with TTFont(file, lazy=True) as font:
        return frozenset(font.getBestCmap())


def font_face(font: Font, letters: set[str]) -> str:
    """The rule of CSS that holds these letters of a font, about 0.2 kB for each."""
    family, slant = font
    codes = sorted(map(ord, letters))
    options = subset.Options(hinting=False, layout_features=[])
    # the page of a run holds all figures: a letter comes from the subset of one that has it
    ranges = ",".join(f"U+{code:X}" for code in codes)

    data = BytesIO()
    with TTFont(font_file(family, slant), recalcTimestamp=False) as file:
        for table in NOT_NEEDED & set(file.keys()):
            del file[table]
        shrinking = subset.Subsetter(options)
        shrinking.populate(unicodes=codes)
        shrinking.subset(file)
        file.flavor = "woff"
        file.save(data)
    return (
        f"@font-face{{font-family:'{family}';font-style:{slant};unicode-range:{ranges};"
        f"src:url(data:font/woff;base64,{b64encode(data.getvalue()).decode()})}}"
    )


def embed(root: Element, faces: list[str]) -> None:
    """Put rules of CSS behind those that an SVG of matplotlib begins with."""
    style = root.find(f"{SVG}defs/{SVG}style")
    if style is not None:
        style.text = f"{style.text}{''.join(faces)}"
