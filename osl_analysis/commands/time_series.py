"""A piece of one stepped-sine trial with its best second-order fit (Fig. 4)."""

from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.stepped_sine import read_stepped_sine
from osl_analysis.config import DynamometerAnalysis, TimeSeriesFigure
from osl_analysis.doubtful import Doubt, marked
from osl_analysis.errors import InputError
from osl_analysis.second_order import fit_impedance
from osl_analysis.table import read_table, write_table


def plot_numbers(
    trial: Path, fit: Path, settings: DynamometerAnalysis, choice: TimeSeriesFigure, limits: Doubt, output: Path
) -> None:
    """The numbers of Fig. 4: the last seconds of one amplitude, measured and by the best second-order fit.

    `fit` is the trial's own table of fits, which by `limits` says whether that of the amplitude is doubtful.
    """
    record = read_stepped_sine(trial, settings)
    chosen = [b for b in record.blocks if np.isclose(np.rad2deg(b.amplitude), choice.amplitude_deg)]
    if not chosen:
        raise InputError(
            f"figures.time_series.amplitude_deg = {choice.amplitude_deg:g} is not in the protocol "
            f"({', '.join(f'{a:g}' for a in settings.amplitudes_deg)} deg); choose one of these"
        )
    block = chosen[0].rows
    motion, torque = record.motion[block], record.filtered_torque[block]
    modelled = fit_impedance(motion, torque).torque(motion)
    fits = marked(read_table(fit), limits, "impedance").drop_nulls("amplitude_deg")
    doubtful = fits.filter((pl.col("amplitude_deg") - choice.amplitude_deg).abs() < 1e-6)["doubtful"][0]
    shown = slice(-min(round(choice.duration_s * record.rate_hz), len(torque)), None)
    time = record.time[block][shown]
    write_table(
        pl.DataFrame(
            {
                "time": time - time[0],
                "theta_deg": np.rad2deg(motion.theta[shown]),
                "torque": torque[shown],
                "torque_model": modelled[shown],
                "doubtful": [doubtful] * len(time),
            }
        ),
        output,
    )
