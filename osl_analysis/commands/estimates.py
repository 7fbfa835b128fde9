"""Estimates of a fit as text and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from itertools import zip_longest
from typing import Any

import polars as pl
from pydantic_core import to_json

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.words import finding_text, words_of
from osl_analysis.measured import decimal_places, with_places, written

# estimates in the order in which they are printed
PRINTED = (
    "K", "B", "B_viscous", "I", "K_s", "B_j", "B_j_viscous", "J_j", "T_C", "k_tau_n_m", "f_C",
    "f_G", "B_m", "J_m", "lag_s", "gain", "inertia", "weight",
    "K_unloading", "energy_stored", "energy_returned", "energy_lost",
)  # fmt: skip


@cache
def printed_units() -> Mapping[str, str]:
    """Unit of each estimate that is printed: of `PRINTED`, and what an experiment calls K, B and I.
    Those with an interval are estimates."""
    units: dict[str, str] = dict.fromkeys(PRINTED, "")
    for experiment in EXPERIMENTS.values():
        units.update(dict.fromkeys(filter(None, experiment.impedance), ""))
    for table in described_tables_by_name().values():
        columns = {**table.columns, **table.of_fits}
        for name in units.keys() & columns.keys():
            if f"{name}_low" in columns:
                unit = columns[name].unit
                units[name] = "" if unit == "1" else unit.replace("*", "·").replace("^2", "²")
    return units


def rows_json(table: pl.DataFrame, findings: Sequence[Sequence[Finding]] = ()) -> str:
    """A table as JSON in SI units: an object per row, null for what is not finite, with its
    `findings`."""
    rows = table.to_dicts()
    for row, of_row in zip(rows, findings, strict=False):
        row["findings"] = [finding_json(finding, row) for finding in of_row]
    return to_json(rows, indent=2, inf_nan_mode="null").decode()


def finding_json(finding: Finding, row: Mapping[str, Any]) -> dict[str, Any]:
    """A finding about a row as an object of JSON."""
    return {
        "grade": finding.grade.value,
        "name": finding.name,
        "cause": finding.cause,
        **words_of(finding, row)._asdict(),
        "evidence": [asdict(number) for number in finding.evidence],
    }


def estimates_text(estimates: pl.DataFrame, findings: Sequence[Sequence[Finding]] = ()) -> str:
    """The estimates as text: a line per fit and quantity, with 95 % interval and VAF, and the
    doubts about each row."""
    lines: list[str] = []
    for row, of_row in zip_longest(estimates.to_dicts(), findings, fillvalue=()):
        assert isinstance(row, dict)
        quality = f"VAF {written(row['VAF'], unit='%')} %" if "VAF" in row else "no VAF"
        if "condition_number" in row:
            quality += f", condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {fitted_motion(row)}: {quality}")
        lines += [estimate_line(row, name) for name in estimated(row)]
        for finding in of_row:
            if finding.grade is Grade.DOUBTS:
                lines.append(f"  doubtful: {finding_text(finding, row)}")
    lines.append("in brackets: the 95 % interval, by the method that interval_method names")
    return "\n".join(lines)


def fitted_motion(row: Mapping[str, Any]) -> str:
    """What of a trial is fitted: cycles, an amplitude, or a motion with its band."""
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
        f" {row['band_high_hz']:.3g} Hz, {row['theta_rms_deg']:.2g} deg RMS"
    )


def estimate_line(row: Mapping[str, Any], name: str) -> str:
    """One estimate with its interval and its range over single amplitudes."""
    value, low, high = row[name], row.get(f"{name}_low"), row.get(f"{name}_high")
    line = f"  {name:<15} {written(value, low, high):<30} {printed_units().get(name, '')}"
    lowest = row.get(f"{name}_amplitudes_low")
    if lowest is not None:
        places = decimal_places(value, low, high)
        ends = " to ".join(with_places(places, lowest, row[f"{name}_amplitudes_high"]))
        line += f", single amplitudes {ends}"
    return line


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities that a fit estimates (a belt at a constant velocity has no B_j), or all its
    numbers."""
    quantities = [
        name for name in printed_units() if f"{name}_low" in row and row[name] is not None
    ]
    return quantities or [name for name, value in row.items() if isinstance(value, float)]
