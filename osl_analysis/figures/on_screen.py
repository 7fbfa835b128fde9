"""A figure in a notebook: it shows itself, and is saved in the style of the paper."""

from io import BytesIO
from typing import Any

from matplotlib.figure import Figure

from osl_analysis.figures.style import paper_style

SHARPNESS = 150
"""Resolution on the screen [dots per inch]."""


class NotebookFigure(Figure):
    """A matplotlib `Figure` of a result.

    matplotlib shows figures of its window manager, `pyplot`, only. This one is shown without it.
    """

    def _repr_png_(self) -> bytes:
        """The picture that a notebook shows."""
        page = BytesIO()
        self.savefig(page, format="png", dpi=SHARPNESS)
        return page.getvalue()

    def savefig(self, fname: Any, **kwargs: Any) -> None:
        """Save the figure as matplotlib does, in the style of the paper, whatever the user's settings are."""
        with paper_style():
            super().savefig(fname, **kwargs)


def on_screen(figure: Figure) -> NotebookFigure:
    """The same figure, which shows itself."""
    figure.__class__ = NotebookFigure
    if not isinstance(figure, NotebookFigure):
        raise TypeError(type(figure).__name__)
    return figure
