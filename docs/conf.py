# SPDX-License-Identifier: Apache-2.0
"""Sphinx builds the documentation: `make docs`, into build/docs, without a network.

Warnings are errors. MyST warns of each link that leads to no file or heading, Sphinx of each page
that no table of contents names.
"""

from importlib import metadata

from docutils import nodes
from docutils.utils.math import latex2mathml

from osl_analysis.dictionary.described import described_tables
from osl_analysis.judge.checks import CHECKS
from osl_analysis.report.typography import markdown_table

project = "osl-impedance"
author = copyright = "The osl-impedance developers"
release = metadata.version(project)
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click"]
default_role = "code"  # what docstrings have in single backticks
highlight_language = "none"
smartquotes = False  # they would make one dash of the two before an option

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings have types, shapes and units
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_google_docstring = False

html_theme = "furo"
html_title = project
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_search_summary = False  # it would be fetched, which browsers refuse to a local file
html_math_renderer = "mathml"  # browsers draw it without a script


def columns_of_tables(app, page, source):
    """Append unit and meaning of every column and check to the page of tables."""
    if page != "tables":
        return
    parts = source
    for table in described_tables():
        for file, rows, columns in table.sections:
            parts.append(f"## `{file}`\n\nRows: {rows}.")
            lines = [(f"`{each.name}`", each.unit, each.meaning) for each in columns]
            parts.append(markdown_table([("column", "unit", "meaning"), *lines]))
    checks = [
        (f"`{name}`", check.unit, f"{check.meaning}. Fails {check.fails} its threshold")
        for name, check in CHECKS.items()
    ]
    parts.append("## Checks of quality control")
    parts.append(markdown_table([("check", "unit", "meaning of its value"), *checks]))
    source[:] = ["\n\n".join(parts)]


def inline_equation(translator, node):
    translator.body.append(latex2mathml.tex2mathml(node.astext()))
    raise nodes.SkipNode


def displayed_equation(translator, node):
    mathml = latex2mathml.tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="equation">{mathml}</div>')
    raise nodes.SkipNode


def setup(app):
    app.connect("source-read", columns_of_tables)
    app.add_html_math_renderer("mathml", (inline_equation, None), (displayed_equation, None))
