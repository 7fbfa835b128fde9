"""The frequency response over amplitudes (Fig. 7), beside the desired one and linear theory."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.figures.fig7 import LINEAR_MODEL, RESPONSE, points, response_curve
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import desired_admittance, joint_admittance
from osl_analysis.parameters import read_parameters
from osl_analysis.stats.rows import Row
from osl_analysis.stats.sinusoid import complex_row, from_row, mean_response, polar_row
from osl_analysis.table import read_table, write_table


def frequency_response(phasors: Path, output: Path) -> None:
    """Complex mean of Y over the amplitudes, per trial and frequency, with 95 % intervals and the amplitudes' range."""
    keys = ["trial", "controller", "K_d", "B_d", "frequency_hz"]
    table = read_table(phasors, ["amplitude_deg", "doubtful"])
    groups = table.group_by(keys, maintain_order=True)
    write_table(pl.DataFrame([{**dict(zip(keys, k, strict=True)), **response_row(g)} for k, g in groups]), output)


def response_row(group: pl.DataFrame) -> Row:
    """Mean response of the amplitudes in a group: magnitude [rad/(N*m)] and phase [deg].

    The intervals are of the phasors' noise; `_min` and `_max` are the lowest and highest amplitude's. Phases are taken
    from the mean's, so that they do not jump at 180 degrees. `doubtful` are the phasors' reasons, by amplitude.
    """
    responses = [from_row("Y", row) for row in group.iter_rows(named=True)]
    mean = mean_response(responses)
    phases = [np.rad2deg(mean.phase + np.angle(r.value / mean.value)) for r in responses]
    reasons = group.select("amplitude_deg", "doubtful").drop_nulls().filter(pl.col("doubtful") != "").rows()
    return {
        **polar_row(mean),
        **complex_row("Y", mean),
        "interval_method": " and ".join(group["interval_method"].unique().sort()),
        "magnitude_min": min(r.magnitude for r in responses),
        "magnitude_max": max(r.magnitude for r in responses),
        "phase_min_deg": float(min(phases)),
        "phase_max_deg": float(max(phases)),
        "n_amplitudes": len(responses),
        "doubtful": "; ".join(f"at {amplitude:g} deg: {reason}" for amplitude, reason in reasons),
    }


def plot_numbers(
    table: Path,
    K_d: float,
    B_d: float,
    parameters: Path,
    weight: Weight,
    frequencies_hz: Sequence[float],
    output: Path,
) -> None:
    """The numbers of Fig. 7: measured responses of one K_d, B_d, the desired one (Eq. 11), the linear model (Eq. 9)."""
    measured, p = of_impedance(read_table(table, required=RESPONSE), K_d, B_d, table), read_parameters(parameters)
    f = np.linspace(min(frequencies_hz), max(frequencies_hz), 101)
    curves = {"desired": desired_admittance(K_d, B_d)}
    for controller in measured["controller"].unique(maintain_order=True):
        gains = select_gains(controller, K_d, B_d, p, weight)
        curves[controller + LINEAR_MODEL] = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
    frames = [response_curve(name, f, Y(2j * np.pi * f)) for name, Y in curves.items()]
    write_table(points(measured, pl.concat(frames)), output)


def of_impedance(responses: pl.DataFrame, K_d: float, B_d: float, path: Path) -> pl.DataFrame:
    """The responses of the trials that were asked for K_d [N*m/rad] and B_d [N*m*s/rad]."""
    found = responses.filter((pl.col("K_d") == K_d) & (pl.col("B_d") == B_d))
    if found.is_empty():
        raise InputError(
            f"{path}: no trial with K_d = {K_d:g}, B_d = {B_d:g}; choose another one, or null, for "
            "figures.frequency_response in the configuration"
        )
    return found
