"""The page itself: one HTML file that needs no other file and no network, with packed signals, figures and captions."""

import hashlib
import json
import math
import re
import zlib
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import bokeh
import numpy as np
import polars as pl
from bokeh.resources import Resources
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from osl_analysis.report import TEMPLATES


def written_page(
    content: Mapping[str, Any],
    trials: Mapping[str, tuple[Mapping[str, Any], Mapping[str, pl.DataFrame]]],
    largest_mb: float,
) -> str:
    """The HTML of the report, of the names that the template `report.html.j2` uses, and of what it says of each trial
    with the tables that it draws, thinned out where the page would be larger than `largest_mb` [MB]."""
    around = template("report.html.j2")
    bokeh_js = "\n".join(Resources(mode="inline", log_level="warn", components=["bokeh", "bokeh-api"]).js_raw)
    report_js, style = ((TEMPLATES / f"report.{kind}").read_text(encoding="utf-8") for kind in ("js", "css"))
    hashes = (hashlib.sha256(script.encode()).digest() for script in (bokeh_js, report_js))
    scripts = " ".join(f"'sha256-{b64encode(digest).decode()}'" for digest in hashes)

    def packed(every: int) -> dict[str, Markup]:
        found = {}
        for name, (told, tables) in trials.items():
            text = json.dumps(told, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
            drawn = {table: packed_table(every_kth(rows, every)) for table, rows in tables.items()}
            both = json.dumps({"content": deflated(text.encode()), "tables": drawn}, allow_nan=False)
            found[name] = Markup(both.replace("<", "\\u003c"))  # it cannot end the script element that holds it
        return found

    whole = packed(1)
    size, room = sum(map(len, whole.values())), max(1e6 * largest_mb - len(bokeh_js) - len(str(content)), 1.0)
    every = math.ceil(1.3 * size / room) if size > room else 1  # noise deflates worse once it is thinned
    return around.render(
        **content,
        every=every,
        bokeh_version=bokeh.__version__,
        # content security policy: nothing is loaded, and no script runs but these two, by their hashes
        policy=f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:; "
        "font-src data:; base-uri 'none'; form-action 'none'",
        bokeh_js=Markup(bokeh_js),
        report_js=Markup(report_js),
        style=Markup(style),
        packed=whole if every == 1 else packed(every),
    )


def template(name: str) -> Template:
    known = FileSystemLoader(TEMPLATES)
    return Environment(loader=known, autoescape=True, undefined=StrictUndefined, trim_blocks=True).get_template(name)


def comparison_page(content: Mapping[str, Any]) -> str:
    """The HTML of a comparison, of the names that its template uses: the style of the report, without its scripts."""
    style = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    return template("comparison.html.j2").render(**content, style=Markup(style))


def every_kth(table: pl.DataFrame, k: int) -> pl.DataFrame:
    """Every k-th row of a table, 200 or more; of the ends of a range, `_low` and `_high`, the outermost."""
    if (k := min(k, len(table) // 200)) <= 1:
        return table
    low, high = (pl.col(f"^.*{end}$") for end in ("_low", "_high"))
    groups = (pl.int_range(pl.len()) // k).alias("k_th")
    others = pl.exclude("^.*_low$", "^.*_high$").first()
    return table.group_by(groups, maintain_order=True).agg(others, low.min(), high.max()).select(table.columns)


def packed_table(table: pl.DataFrame) -> dict[str, Any]:
    """A table of numbers for the page: `rows`, `plain` columns as lists, `even` ones as start and step, and `counts`
    with the value of count 0 and that of one count, per column. `data` holds, one column after the other, the
    differences of its counts modulo 2^16: all low bytes, then all high bytes, which deflates better than pairs.
    The largest count is 8191: more bits show nothing. What is not finite has the count -32768, in a list null."""
    if len(table) < 200:  # a short one is written as numbers
        numbers = table.with_columns(pl.selectors.numeric().cast(pl.Float64).replace([np.inf, -np.inf, np.nan], None))
        plain = numbers.with_columns(pl.selectors.float().round_sig_figs(7))
        return {"rows": len(table), "plain": plain.to_dict(as_series=False)}
    even: dict[str, list[float]] = {}
    counts: dict[str, list[float]] = {}
    data = []
    for name in table.columns:
        values = table[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
        steps = np.diff(values)
        step = float((values[-1] - values[0]) / len(steps))
        if step > 0 and np.abs(steps - step).max() <= 1e-6 * len(steps) * step:
            even[name] = [float(values[0]), step]
            continue
        known, most = np.isfinite(values), 8191
        low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
        centre, unit = (low + high) / 2, (high - low) / (2 * most) or 1.0
        numbered = np.full(len(values), -32768, dtype=np.int16)
        numbered[known] = np.round((values[known] - centre) / unit).clip(-most, most).astype(np.int16)
        differences = np.diff(numbered, prepend=np.int16(0)).astype("<i2").tobytes()
        data += [differences[0::2], differences[1::2]]
        counts[name] = [centre, unit]
    return {"rows": len(table), "even": even, "counts": counts, "data": deflated(b"".join(data))}


def deflated(content: bytes) -> str:
    """Bytes as the page's `DecompressionStream("deflate")` reads them, in base64."""
    return b64encode(zlib.compress(content, 9)).decode("ascii")


def inline_svg(text: str, name: str, label: str) -> Markup:
    """The SVG of a figure for the page: identifiers begin with `name`, links lead to trials, `label` says what it is.
    Links are not stops of the keyboard: the table of trials has the same, and a figure hundreds."""
    SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
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
                element.set(key, re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", value))
        if element.tag == f"{SVG}a":  # behind the name of the report in the figures' files; here the pointer says which
            trial = element.get(f"{XLINK}href", "").rpartition("#trial=")[2]
            element.set(f"{XLINK}href", f"#trial={trial}")
            element.attrib.pop("target", None)
            element.set("tabindex", "-1")
            title = ElementTree.Element(f"{SVG}title")
            title.text = unquote(trial)
            element.insert(0, title)
    width, height = (float(root.attrib.pop(key, "0").removesuffix("pt")) for key in ("width", "height"))
    box, size = f"0 0 {width:g} {height:g}", f"width: min(100vw - 4rem, {1.9 * width:.0f}px)"
    root.attrib.update({"viewBox": root.get("viewBox", box), "style": size, "role": "img", "aria-label": label})
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def captions_by_title(text: str) -> dict[str, Markup]:
    """The captions of `captions.md` by the title of their figure."""
    sections = (section.partition("\n") for section in f"\n{text}".split("\n## ")[1:])
    return {title.strip(): caption_html(body.strip()) for title, _, body in sections}


def caption_html(text: str) -> Markup:
    """A caption as HTML: signs that Markdown escapes are themselves, mathematics has its indices, all else is text."""
    parts = re.finditer(r"\\(?P<sign>[^A-Za-z0-9\s])|\$(?P<symbol>[^$]+)\$|(?P<text>[^\\$]+|[\\$])", text)
    letters, found = {"theta": "θ", "tau": "τ", "pm": "±"}, []
    for part in parts:
        if not part["symbol"]:
            found.append(escape(part["sign"] or part["text"]))
            continue
        # a symbol of the paper, such as `\\hat{K}` or `K_d`
        accented = re.sub(r"\\hat\{?(\w)\}?", "\\1\u0302", part["symbol"])
        shown = escape(re.sub(r"\\(\w+)", lambda word: letters.get(word[1], word[1]), accented))
        for sign, element in (("_", "sub"), (r"\^", "sup")):
            shown = re.sub(rf"{sign}(?:\{{([^}}]*)\}}|(\w))", rf"<{element}>\1\2</{element}>", shown)
        found.append(f"<i>{shown.replace('{', '').replace('}', '')}</i>")
    return Markup("".join(found))
