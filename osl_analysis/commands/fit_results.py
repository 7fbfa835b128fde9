"""What the fit of one trial gives, with its estimates as attributes."""

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import polars as pl

from osl_analysis.commands.estimates import estimated, estimates_text
from osl_analysis.errors import nearest, printable_lines
from osl_analysis.figures import drawn
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.words import finding_text

DOTS_PER_INCH = 100  # of the picture in a notebook


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial of any experiment.

    Every column of its table is an attribute, with the value of the fit to all data: `fit.K_se`,
    `fit.VAF`. An absent value is None, as in the table. `fit.K_interval` is (low, high), the 95 %
    interval. An absent one is (NaN, NaN), so that there are always two numbers to compute and to
    plot with. Meaning and unit of each are told by `osl-analysis results --columns`. `trial`,
    `doubtful` and `remarks` are texts: the trial's name, and sentences of its findings. A notebook
    shows text and picture.

    Attributes
    ----------
    experiment : str
        It names the table that the fit has rows of in a campaign.
    table : polars.DataFrame
        Those rows: one per amplitude, if there are several, and last the fit to all data.
    series : polars.DataFrame
        `time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit
        explains.
    curves : polars.DataFrame or None
        Torque over angle, rows of `belt_curves` or `torque_angle_curves`; None for another
        experiment.
    findings : Sequence of Sequence of Finding
        What was judged of each row: doubts, what could not be checked, notes.

    Examples
    --------
    >>> fit = osl.fit(trial)
    >>> isinstance(fit, osl.Fit), fit.experiment, fit.table.height
    (True, 'impedance', 1)
    """

    experiment: str
    table: pl.DataFrame
    series: pl.DataFrame
    curves: pl.DataFrame | None
    findings: Sequence[Sequence[Finding]] = ()

    @property
    def row(self) -> Mapping[str, Any]:
        """The fit to all data, by the columns of the table."""
        return self.table.row(-1, named=True)

    @property
    def trial(self) -> str:
        """Name of the trial."""
        return str(self.row["trial"])

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do.
        Empty: nothing."""
        return "\n".join(self.sentences(Grade.DOUBTS))

    @property
    def remarks(self) -> str:
        """What could not be checked, and why, a line each, and what is to be known, such as
        friction; empty if there is nothing."""
        lines = [f"not checked: {text}" for text in self.sentences(Grade.UNCHECKED)]
        lines += [f"remark: {text}" for text in self.sentences(Grade.NOTES)]
        return "\n".join(lines)

    def sentences(self, *grades: Grade) -> list[str]:
        """The findings of some grades about the fit to all data, in words."""
        of_whole = self.findings[-1] if self.findings else ()
        return [finding_text(finding, self.row) for finding in of_whole if finding.grade in grades]

    def value_of(self, name: str) -> Any:
        """A column of the table, of the fit to all data, or its `NAME_interval`. Raises
        AttributeError for another name."""
        row = self.row
        quantity = name.removesuffix("_interval")
        is_interval = quantity != name
        if is_interval and f"{quantity}_low" in row:
            ends = (row[f"{quantity}_low"], row[f"{quantity}_high"])
            return tuple(math.nan if end is None else end for end in ends)
        if name not in row:
            estimates = ", ".join(estimated(row))
            raise AttributeError(
                f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has"
                f" {estimates}"
            )
        return row[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        return self.value_of(name)

    def __dir__(self) -> list[str]:
        intervals = [f"{name}_interval" for name in estimated(self.row)]
        return sorted({*super().__dir__(), *self.row, *intervals})

    def __repr__(self) -> str:
        text = f"{self.experiment}, {estimates_text(self.table.tail(1), self.findings[-1:])}"
        if self.remarks:
            text += f"\n{self.remarks}"
        return printable_lines(text)

    def _repr_html_(self) -> str:
        html = f"<pre>{escape(repr(self))}</pre>"
        if not self.series.is_empty():
            picture = b64encode(drawn("torque", self.series)._repr_png_(DOTS_PER_INCH)).decode()
            html += (
                '<img alt="Torque over time" style="max-width: 100%"'
                f' src="data:image/png;base64,{picture}">'
            )
        return html
