"""Settings of the documentation site. `make docs` builds it into build/docs: warnings are errors,
links are checked.

Nothing of the built site comes from a network: equations are MathML, fonts are those of the
reader's machine.
"""

import re
import sys
from importlib import metadata
from itertools import pairwise
from pathlib import Path

import matplotlib

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

from equations import add_mathml  # noqa: E402
from pages import fill_page  # noqa: E402

project = "osl-analysis"
author = copyright = "the osl-analysis developers"
release = metadata.version("osl-analysis")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "index"
highlight_language = "none"
smartquotes = False
"""They would make one dash of the two before an option."""

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
default_role = "code"
"""What docstrings have in single backticks is code."""

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_google_docstring = False

html_theme = "furo"
html_title = "osl-analysis"
html_static_path = [
    str(HERE / "static"),
    str(Path(matplotlib.get_data_path(), "fonts/ttf/DejaVuSerif.ttf")),
]
"""The font is the one of matplotlib that has what equations need."""
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_show_search_summary = False
"""A summary would be fetched, which browsers refuse to a page that is a file."""
html_theme_options = {"top_of_page_buttons": []}
html_math_renderer = "mathml"


DESCRIBED = re.compile(r"^(\w+): (.*)")
ARRAY = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+?)_?\]\]")


def shorter(app, what, name, thing, options, signature, returned):
    """A signature with `Array` for an array of numbers: docstrings have the shapes."""

    def short(text):
        return text and ARRAY.sub(
            lambda match: "Array" if match[1] == "float64" else f"Array[{match[1]}]", text
        )

    return short(signature), short(returned)


def described(app, what, name, thing, options, lines):
    """Write `name: what it is` of a docstring as numpydoc has it, where the colon would begin a
    type."""
    made, of_names = [], False
    for before, line in pairwise(["", *lines]):
        if line and not line.strip("-"):
            of_names = before in ("Parameters", "Attributes")
        made += DESCRIBED.sub(r"\1\n    \2", line).split("\n") if of_names else [line]
    lines[:] = made


def setup(app):
    """Have the pages filled whose text comes from elsewhere, and equations written as MathML."""
    app.connect("autodoc-process-docstring", described, priority=400)
    app.connect("autodoc-process-signature", shorter)
    app.connect("source-read", fill_page)
    add_mathml(app)
