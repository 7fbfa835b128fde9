"""Figures inside the page: SVG as it was drawn, with identifiers of its own, and points that open their trial."""

import re
from base64 import b64encode
from urllib.parse import unquote
from xml.etree import ElementTree

from markupsafe import Markup

SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
TRIAL = "#trial="
"""Link to a trial, in the figures' files behind the name of the report."""
REFERENCE = re.compile(r"url\(#([^)]+)\)")


def inline_svg(text: str, name: str, label: str) -> Markup:
    """The SVG of a figure for the page: identifiers begin with `name`, links lead to trials, `label` says what it is.

    Links are not stops of the keyboard: the table of trials has the same, and a figure hundreds.
    """
    for prefix, space in (("", SVG), ("xlink", XLINK)):
        ElementTree.register_namespace(prefix, space.strip("{}"))
    root = ElementTree.fromstring(text)
    for metadata in root.findall(f"{SVG}metadata"):
        root.remove(metadata)
    for element in root.iter():
        for key, value in list(element.attrib.items()):
            if key == "id":
                element.set(key, f"{name}-{value}")
            elif key == f"{XLINK}href" and value.startswith("#"):
                element.set(key, f"#{name}-{value[1:]}")
            elif "url(#" in value:
                element.set(key, REFERENCE.sub(rf"url(#{name}-\1)", value))
        if element.tag == f"{SVG}a":
            link(element)
    width, height = (float(root.get(key, "0").removesuffix("pt")) for key in ("width", "height"))
    root.set("viewBox", root.get("viewBox") or f"0 0 {width:g} {height:g}")
    root.set("style", f"width: min(100vw - 4rem, {1.9 * width:.0f}px)")
    for key in ("width", "height"):
        root.attrib.pop(key, None)
    root.set("role", "img")
    root.set("aria-label", label)
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def inline_png(content: bytes, label: str) -> Markup:
    """The PNG of a figure for the page; `label` says what it is."""
    picture = Markup('<img src="data:image/png;base64,{}" alt="{}" style="max-width: 100%">')
    return picture.format(b64encode(content).decode("ascii"), label)


def link(element: ElementTree.Element) -> None:
    """Let a link lead to its trial on this page, and say which one under the pointer."""
    trial = element.get(f"{XLINK}href", "").rpartition(TRIAL)[2]
    element.set(f"{XLINK}href", f"{TRIAL}{trial}")
    element.attrib.pop("target", None)
    element.set("tabindex", "-1")
    title = ElementTree.Element(f"{SVG}title")
    title.text = unquote(trial)
    element.insert(0, title)
