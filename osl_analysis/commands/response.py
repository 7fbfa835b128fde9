"""The frequency response over amplitudes (Fig. 7), beside the desired one and linear theory."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.figures.fig7 import LINEAR_MODEL, RESPONSE, points, response_curve
from osl_analysis.fits.sinusoid import Response, mean_response
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import desired_admittance, joint_admittance
from osl_analysis.parameters import read_parameters
from osl_analysis.table_file import read_table, write_table


def frequency_response(phasors: Path, output: Path) -> None:
    """Complex mean of Y over the amplitudes, per trial and frequency, with standard errors and their scatter."""
    keys = ["trial", "controller", "K_d", "B_d", "frequency_hz"]
    table = read_table(phasors)
    groups = table.group_by(keys, maintain_order=True)
    write_table(pl.DataFrame([{**dict(zip(keys, k, strict=True)), **response_row(g)} for k, g in groups]), output)


def response_row(group: pl.DataFrame) -> dict[str, float]:
    """Mean response of the amplitudes in a group: magnitude [rad/(N*m)] and phase [deg]."""
    responses = [
        Response(complex(re, im), np.array([[var_re, cov], [cov, var_im]]))
        for re, im, var_re, cov, var_im in group.select("Y_re", "Y_im", "Y_var_re", "Y_cov", "Y_var_im").rows()
    ]
    mean = mean_response(responses)
    return {
        "magnitude": mean.magnitude,
        "magnitude_se": mean.magnitude_se,
        "phase_deg": float(np.rad2deg(mean.phase)),
        "phase_se_deg": float(np.rad2deg(mean.phase_se)),
        "Y_re": mean.value.real,
        "Y_im": mean.value.imag,
        "magnitude_min": min(r.magnitude for r in responses),
        "magnitude_max": max(r.magnitude for r in responses),
        "n_amplitudes": len(responses),
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
