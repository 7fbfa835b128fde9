"""Equations of the site in MathML, which browsers draw without a script."""

import re

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.util import logging

ACCENTED = re.compile(r"\\(?:dot|ddot|hat|bar)\s*(?:\\[A-Za-z]+|\{[^{}]*\}|[A-Za-z])")
"""A letter with its accent. Of this alone docutils puts an index below; in a group with something
empty, beside."""
LOGGER = logging.getLogger(__name__)


def in_mathml(equation, as_block):
    """The MathML of an equation in LaTeX."""
    return latex2mathml.tex2mathml(ACCENTED.sub(r"{{}\g<0>}", equation), as_block=as_block)


def mathml(node, as_block):
    """The MathML of one equation; one that cannot be written is a warning, and so ends the
    build."""
    try:
        return in_mathml(node.astext(), as_block)
    except MathError as error:
        LOGGER.warning("equation %r: %s", node.astext(), error, location=node)
        return ""


def in_line(translator, node):
    """An equation within a sentence."""
    translator.body.append(mathml(node, as_block=False))
    raise nodes.SkipNode


def displayed(translator, node):
    """An equation of its own, which scrolls where the screen is narrow."""
    translator.body.append(f'<div class="equation">{mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def add_mathml(app):
    """Let the site's HTML have MathML."""
    app.add_html_math_renderer("mathml", (in_line, None), (displayed, None))
