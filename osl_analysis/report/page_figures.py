"""Figures and captions of a run as parts of the page."""

import re
from dataclasses import dataclass
from html import escape
from urllib.parse import unquote
from xml.etree import ElementTree

from markupsafe import Markup

SVG = "{http://www.w3.org/2000/svg}"
XLINK = "{http://www.w3.org/1999/xlink}"
HREF = f"{XLINK}href"
WIDE = 300  # pt; a narrower figure is shown whole on a phone
PIXELS_PER_POINT = 1.6
LETTERS = {"theta": "θ", "tau": "τ", "pm": "±"}  # of mathematics in captions


@dataclass(frozen=True)
class ShownFigure:
    """A figure on the page."""

    name: str
    title: str
    caption: Markup | str
    drawing: Markup  # SVG
    reading: str  # how to read it, good and bad


def inline_svg(text: str, name: str, label: str) -> Markup:
    """The SVG of a figure for the page, described by `label`. Identifiers begin with `name`, links
    lead to trials. The tab key skips the links: a figure has hundreds, and the table of trials has
    the same ones."""
    for prefix, space in (("", SVG), ("xlink", XLINK)):
        ElementTree.register_namespace(prefix, space.strip("{}"))
    root = ElementTree.fromstring(text)
    for metadata in root.findall(f"{SVG}metadata"):
        root.remove(metadata)
    for element in root.iter():
        begin_identifiers(element, name)
        if element.tag == f"{SVG}a":
            lead_to_trial(element)
    width = float(root.attrib.pop("width", "0").removesuffix("pt"))
    height = float(root.attrib.pop("height", "0").removesuffix("pt"))
    root.set("viewBox", root.get("viewBox", f"0 0 {width:g} {height:g}"))
    root.set("style", f"width: {PIXELS_PER_POINT * width:.0f}px")
    root.set("role", "img")
    root.set("aria-label", label)
    root.set("class", "wide" if width > WIDE else "narrow")
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def begin_identifiers(element: ElementTree.Element, name: str) -> None:
    """Let the identifiers of an element, and what refers to them, begin with `name`: they are
    unique in a file, and the page has several."""
    for key, value in list(element.attrib.items()):
        if key == "id":
            element.set(key, f"{name}-{value}")
        elif key == HREF and value.startswith("#"):
            element.set(key, f"#{name}-{value[1:]}")
        elif "url(#" in value:
            element.set(key, re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", value))


def lead_to_trial(link: ElementTree.Element) -> None:
    """Let a link of a figure's file, which names the report before the trial, lead to the trial
    within the page; the pointer shows its name."""
    trial = link.get(HREF, "").rpartition("#trial=")[2]
    link.set(HREF, f"#trial={trial}")
    link.attrib.pop("target", None)
    link.set("tabindex", "-1")
    title = ElementTree.Element(f"{SVG}title")
    title.text = unquote(trial)
    link.insert(0, title)


def captions_by_title(text: str) -> dict[str, Markup]:
    """The captions of `captions.md` as HTML, by the title of their sections."""
    captions = {}
    for section in f"\n{text}".split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        captions[title.strip()] = caption_html(body.strip())
    return captions


def caption_html(text: str) -> Markup:
    """A caption as HTML: escapes of Markdown are undone, mathematics gets its indices, all else is
    text."""
    parts = re.finditer(
        r"\\(?P<sign>[^A-Za-z0-9\s])|\$(?P<symbol>[^$]+)\$|(?P<text>[^\\$]+|[\\$])", text
    )
    html = []
    for part in parts:
        if part["symbol"]:
            html.append(symbol_html(part["symbol"]))
        else:
            html.append(escape(part["sign"] or part["text"]))
    return Markup("".join(html))


def symbol_html(symbol: str) -> str:
    r"""A symbol of the paper, such as `\hat{K}` or `K_d`, as HTML."""
    accented = re.sub(r"\\hat\{?(\w)\}?", "\\1\u0302", symbol)
    html = escape(re.sub(r"\\(\w+)", lambda word: LETTERS.get(word[1], word[1]), accented))
    for sign, element in (("_", "sub"), (r"\^", "sup")):
        html = re.sub(rf"{sign}(?:\{{([^}}]*)\}}|(\w))", rf"<{element}>\1\2</{element}>", html)
    return f"<i>{html.replace('{', '').replace('}', '')}</i>"
