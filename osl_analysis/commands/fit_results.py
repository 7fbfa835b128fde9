# SPDX-License-Identifier: Apache-2.0
"""The result of the fit of one trial: its tables, and its estimates as attributes, text and JSON.

Example: `fit_trial("impedance", trial, parameters, config).K_interval`.
"""

import math
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from html import escape
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
from pydantic_core import to_json

from osl_analysis.base.errors import nearest, printable_lines
from osl_analysis.base.trial import Array
from osl_analysis.bench.impedance import Analysis
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.figures.drawing import completed, drawn
from osl_analysis.judge.campaign import QUALITY, failed_checks
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.joining import findings_of_rows
from osl_analysis.judge.judging import budgets_of_rows
from osl_analysis.judge.rules import Grade
from osl_analysis.judge.wording import finding_text, verdict_texts
from osl_analysis.stats.budget import CLEAR, IN_INTERVAL, WIDE, Budget
from osl_analysis.stats.promises import RANGE_PROMISE, promise_texts
from osl_analysis.stats.rounding import estimate_text, printed_range, significant, written

if TYPE_CHECKING:
    from osl_analysis.figures.style import PaperFigure

MOST_SHOWN = 20_000  # rows of a series; two minutes of a stepped sine have 30 per fastest period


@dataclass(frozen=True)
class FitTables:
    """The tables of one fit by name.

    Attributes
    ----------
    estimates : Mapping of DataFrame
        Estimates and curves.
    samples : DataFrame
        All samples, as of `samples_of`.
    streams : Sequence of Mapping
        How the signals came on their time base, by the columns of `timebase.csv`.
    compute_others : callable
        Computes the other tables. They take time, which a user of the estimates alone need not
        spend.
    """

    estimates: Mapping[str, pl.DataFrame]
    samples: pl.DataFrame
    streams: Sequence[Mapping[str, Any]] = ()
    compute_others: Callable[[], Mapping[str, pl.DataFrame]] = dict

    @property
    def row(self) -> Mapping[str, Any]:
        """The last row of its first table: the fit to the whole trial."""
        return next(iter(self.estimates.values())).row(-1, named=True)

    def everything(self) -> dict[str, pl.DataFrame]:
        """All tables: `estimates`, the others, the thinned `series`, and `timebase`.

        `timebase` has a row per stream, and none where no grid was needed.
        """
        trial = self.row["trial"]
        return {
            **self.estimates,
            **self.compute_others(),
            "series": thinned(self.samples),
            "timebase": table_of(
                [{"trial": trial, **stream} for stream in self.streams], "timebase"
            ),
        }


def samples_of(analysis: Analysis, **motion: Array) -> pl.DataFrame:
    """Samples of a whole trial, filtered as for the fit.

    Columns are `time` [s], `motion` (by default the angle `theta_deg`), `torque` [N*m],
    `torque_model` [N*m] of the fit to the whole trial, and `is_fitted`.
    """
    record = analysis.record
    return pl.DataFrame(
        {
            "time": record.time,
            **(motion or {"theta_deg": np.rad2deg(record.motion.theta)}),
            "torque": record.filtered_torque,
            "torque_model": analysis.modelled(analysis.label),
            "is_fitted": record.is_fitted(analysis.label),
        }
    )


def thinned(samples: pl.DataFrame) -> pl.DataFrame:
    """Every k-th sample, at most `MOST_SHOWN` rows.

    `torque_model` is null where the fit does not use the sample. `residual_low` and `residual_high`
    [N*m] are the range over the next k samples that it uses, so that no outlier is lost.
    """
    k = max(-(-len(samples) // MOST_SHOWN), 1)
    used = samples.with_columns(
        pl.col("time") - pl.col("time").first(),
        torque_model=pl.when("is_fitted").then("torque_model"),
    ).fill_nan(None)
    residual = pl.col("torque") - pl.col("torque_model")
    parts = used.group_by(part=pl.int_range(pl.len()) // k, maintain_order=True).agg(
        pl.exclude("is_fitted").first(), residual_low=residual.min(), residual_high=residual.max()
    )
    return parts.select(pl.exclude("part").round_sig_figs(7))


@cache
def printed_units() -> Mapping[str, str]:
    """Unit of each column of result tables, as it is printed."""
    units = {}
    for table in described_tables_by_name().values():
        for name, column in {**table.columns, **table.of_fits}.items():
            unit = "" if column.unit == "1" else column.unit
            units[name] = unit.replace("*", "·").replace("^2", "²")
    return units


def rows_json(table: pl.DataFrame, findings: Sequence[Sequence[Finding]] = ()) -> str:
    """A table as JSON in SI units: an object per row with its `findings`; null for what is not
    finite."""
    rows = table.to_dicts()
    for row, row_findings in zip(rows, findings, strict=False):
        row["findings"] = [finding_json(finding) for finding in row_findings]
    return to_json(rows, indent=2, inf_nan_mode="null").decode()


def finding_json(finding: Finding) -> dict[str, Any]:
    """A finding as an object of JSON."""
    return {
        "grade": finding.grade.value,
        "source": finding.source,
        "cause": finding.cause,
        "says": finding.says,
        "size": finding.size,
        "remedy": finding.remedy,
        "evidence": [
            {name: cell for name, cell in vars(number).items() if name != "rule"}
            for number in finding.evidence
        ],
    }


def estimates_text(
    estimates: pl.DataFrame, findings: Sequence[Sequence[Finding]], budget: pl.DataFrame | None
) -> str:
    """The estimates as text.

    A fit and each of its quantities has a line, with 95 % interval, verdict and parts of the
    interval. Doubts and the promises of intervals follow.
    """
    lines = []
    rows = estimates.to_dicts()
    fit_findings = [finding for finding in chain(*findings) if finding.table != QUALITY]
    verdicts_of_rows = map(verdict_texts, findings_of_rows(estimates, fit_findings))
    facts_by_row = zip(
        rows,
        budgets_of_rows(rows, budget),
        findings or [()] * len(rows),
        verdicts_of_rows,
        strict=True,
    )
    for row, budgets, row_findings, verdicts in facts_by_row:
        quality = f"VAF {written(row['VAF'], unit='%')} %" if "VAF" in row else "no VAF"
        lines.append(f"{row['trial']}, {fitted_motion(row)}: {quality}")
        for name in estimated(row):
            verdict = verdicts[name] if f"{name}_verdict" in row else ""
            lines.append(estimate_line(row, name, verdict))
            parts = parts_text(budgets[name]) if name in budgets else ""
            if parts:
                lines.append(f"{'':<21}of which {parts}")
        for finding in row_findings:
            if finding.grade in (Grade.EXCLUDES, Grade.DOUBTS):
                lines.append(f"  doubtful: {finding_text(finding)}")
    lines.append("in brackets: the 95 % interval; of which: the half-width of each part alone")
    promises = promise_texts(row.get("interval_method") for row in rows)
    lines += [f"interval by {promise}" for promise in promises]
    if any(row.get("K_range_low") is not None for row in rows):
        lines.append(f"range: {RANGE_PROMISE}")
    return "\n".join(lines)


def parts_text(budget: Budget) -> str:
    """The half-widths of the parts of an interval; empty for a single part."""
    widths = {part: budget.half_width(part) for part in IN_INTERVAL}
    texts = [f"{part} {significant(width)}" for part, width in widths.items() if width]
    return ", ".join(texts) if len(texts) > 1 else ""


def fitted_motion(row: Mapping[str, Any]) -> str:
    """The fitted part of a trial: cycles, an amplitude, or a motion with its band."""
    if "cycles" in row:
        return f"mean of cycles: {row['cycles']}"
    if row.get("amplitude_deg") is not None:
        return f"{row['amplitude_deg']:g} deg"
    if "amplitude_deg" not in row:
        return "whole trial"
    if row.get("excitation") in (None, "stepped sine"):
        return "all amplitudes"
    kind = "periodic" if row["excitation"] == "periodic" else "any"
    return (
        f"{row['fitted_s']:.1f} s of {kind} motion, {row['band_low_hz']:.3g} to"
        f" {row['band_high_hz']:.3g} Hz"
    )


def estimate_line(row: Mapping[str, Any], name: str, verdict: str = "") -> str:
    """One estimate: its verdict, its interval, and its range over amplitudes and parts of the
    band."""
    judged = ""
    if verdict:
        judged = f"{verdict}: " if verdict in (CLEAR, WIDE) else f"doubtful, {verdict}: "
    unit = printed_units().get(name, "")
    line = f"  {name:<18} {judged}{estimate_text(row, name)} {unit}".rstrip()
    lowest = row.get(f"{name}_range_low")
    if lowest is not None:
        line += f", range {printed_range(lowest, row[f'{name}_range_high'], row[name])}"
    return line


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities of a fit that have an interval, or else all its numbers.

    A joint without friction has no B_viscous.
    """
    quantities = [name for name in row if f"{name}_low" in row and row[name] is not None]
    return quantities or [name for name, value in row.items() if isinstance(value, float)]


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial of any experiment.

    Every column of its table is an attribute, with the value of the fit to all data: `fit.K_low`,
    `fit.VAF`. An absent value is None, as in the table. `fit.K_interval` is (low, high), the 95 %
    interval. An absent one is (NaN, NaN), so that there are always two numbers to compute and to
    plot with. `osl-analysis results --columns` lists unit and meaning of each. `trial`,
    `doubtful` and `remarks` are texts: the trial's name, and sentences of its findings. A notebook
    shows text and picture.

    Attributes
    ----------
    experiment : str
        The experiment, which has a table of this name in a campaign.
    table : polars.DataFrame
        The fit's rows of that table: one per amplitude, if there are several, and last the fit to
        all data.
    series : polars.DataFrame
        `time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit
        explains.
    curves : polars.DataFrame or None
        Torque over angle, rows of `belt_curves` or `torque_angle_curves`; None for another
        experiment.
    estimate_findings : Sequence of Sequence of Finding
        The findings on the estimates of each row: doubts, checks that were not possible, remarks.
    budget : polars.DataFrame or None
        The contributions to the uncertainty of each estimate, as in `budget.csv`.
    recording_checks : callable
        Computes the checks of the recording, as in `quality.csv`, once `findings` are read.

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
    estimate_findings: Sequence[Sequence[Finding]]
    budget: pl.DataFrame | None
    recording_checks: Callable[[], pl.DataFrame]

    @cached_property
    def findings(self) -> list[Sequence[Finding]]:
        """The findings on each row; the fit to all data also has failed checks of the recording."""
        *on_amplitudes, on_trial = self.estimate_findings
        return [*on_amplitudes, [*on_trial, *failed_checks(self.recording_checks())]]

    @property
    def row(self) -> Mapping[str, Any]:
        """The fit to all data, by the columns of the table."""
        return self.table.row(-1, named=True)

    @property
    def doubtful(self) -> str:
        """The doubts about the fit to all data, with their limits and what to do; empty for none.

        A check that would exclude the trial from a campaign stands first.
        """
        return "\n".join(self.sentences(Grade.EXCLUDES) + self.sentences(Grade.DOUBTS))

    @property
    def remarks(self) -> str:
        """The checks that were not possible, and remarks such as friction, a line each; empty for
        none."""
        lines = [f"not checked: {text}" for text in self.sentences(Grade.UNCHECKED)]
        lines += [f"remark: {text}" for text in self.sentences(Grade.NOTES)]
        return "\n".join(lines)

    @property
    def drawing(self) -> "PaperFigure":
        """Its series as Fig. 4 shows those of a campaign's trial."""
        trial_series = self.series.with_columns(trial=pl.lit(self.trial))
        return drawn("fig4", completed("fig4", trial_series))

    def sentences(self, grade: Grade) -> list[str]:
        """The findings of a grade about the fit to all data, in words."""
        return [finding_text(finding) for finding in self.findings[-1] if finding.grade is grade]

    def __getattr__(self, name: str) -> Any:
        """A column of the table, of the fit to all data, or its `NAME_interval`."""
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
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

    def __dir__(self) -> list[str]:
        intervals = [f"{name}_interval" for name in estimated(self.row)]
        return sorted({*super().__dir__(), *self.row, *intervals})

    def __repr__(self) -> str:
        estimates = estimates_text(self.table.tail(1), self.findings[-1:], self.budget)
        text = f"{self.experiment}, {estimates}"
        if self.remarks:
            text += f"\n{self.remarks}"
        return printable_lines(text)

    def _repr_html_(self) -> str:
        html = f"<pre>{escape(repr(self))}</pre>"
        if not self.series.is_empty():
            picture = b64encode(self.drawing._repr_png_()).decode()
            html += (
                '<img alt="Torque over time" style="max-width: 100%"'
                f' src="data:image/png;base64,{picture}">'
            )
        return html
