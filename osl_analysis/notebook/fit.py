"""The result of a fit, for notebooks."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

import polars as pl

from osl_analysis.commands.fit import FittedTrial, said_not_checked
from osl_analysis.commands.fit_text import UNITS, estimated, estimates_text
from osl_analysis.errors import nearest, printable, printable_lines


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial. Nothing of it can be changed: its data frames are copies.

    Every column of its table is an attribute, with the value of the fit to all data: `fit.K`, `fit.K_se`, `fit.VAF`;
    `fit.K_interval` is (low, high), the 95 % interval. docs/tables.md has meaning and unit of each.
    """

    experiment: str
    """Experiment, which names the table that the fit has rows of in a campaign."""
    _fitted: FittedTrial

    @property
    def table(self) -> pl.DataFrame:
        """The rows of the result table: one per amplitude, if there are several, and last the fit to all data."""
        return self._fitted.estimates.clone()

    @property
    def series(self) -> pl.DataFrame:
        """`time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit explains."""
        return self._fitted.series.clone()

    @property
    def curves(self) -> pl.DataFrame | None:
        """Torque over angle: rows of `belt_curves` or `torque_angle_curves`; None for another experiment."""
        return None if self._fitted.curves is None else self._fitted.curves.clone()

    @property
    def row(self) -> Mapping[str, Any]:
        """The row of the fit to all data."""
        return self._fitted.estimates.row(-1, named=True)

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do. Empty: nothing."""
        return self.row.get("doubtful") or ""

    @property
    def not_checked(self) -> str:
        """What could not be checked, and why; empty if everything was."""
        return said_not_checked(self._fitted)

    def __getattr__(self, name: str) -> Any:
        """A column of the table by name, of the fit to all data, or `NAME_interval`."""
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        row, of = self.row, name.removesuffix("_interval")
        if of != name and f"{of}_low" in row:
            return row[f"{of}_low"], row[f"{of}_high"]
        if name not in row:
            known = ", ".join(estimated(row))
            raise AttributeError(f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has {known}")
        return row[name]

    def __dir__(self) -> list[str]:
        """Attributes for completion."""
        return sorted({*super().__dir__(), *self.row, *(f"{name}_interval" for name in estimated(self.row))})

    def __repr__(self) -> str:
        lines = [
            f"{self.experiment}, {estimates_text(self._fitted.estimates.tail(1))}",
            self.not_checked,
        ]
        return printable_lines("\n".join(filter(None, lines)))

    def _repr_html_(self) -> str:
        """The fit to all data as an HTML table, for a notebook. Text of the recording is escaped."""
        row = self.row
        rows = [
            f"<tr><td>{name}</td><td>{number(row[name])}</td>"
            f"<td>{number(row[f'{name}_low'])} to {number(row[f'{name}_high'])}</td><td>{UNITS[name]}</td></tr>"
            for name in estimated(self.row)
        ]
        said = [f"Doubtful: {self.doubtful}"] * bool(self.doubtful) + self.not_checked.splitlines()
        title = f"{self.experiment}, {row['trial']}: VAF {row['VAF']:.2f} %"
        head = "<tr><th></th><th>estimate</th><th>95 % interval</th><th>unit</th></tr>"
        return (
            f"<table><caption>{escape(printable(title))}</caption>{head}{''.join(rows)}</table>"
            f"{''.join(f'<p>{escape(printable(line))}</p>' for line in said)}"
        )


def number(value: float | None) -> str:
    """A number with five digits; a dash where there is none."""
    return "–" if value is None else f"{value:.5g}"
