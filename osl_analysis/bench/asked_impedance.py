"""The fits of a trial against the controller, judged by what the leg was asked to render where that is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import polars as pl

from osl_analysis.bench.frequency_response import trial_phasors
from osl_analysis.bench.impedance import DesiredImpedance, impedance_table, prediction_columns
from osl_analysis.bench.plausibility import plausible_impedance
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.rendering import predicted_impedance
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Trial


@dataclass(frozen=True)
class AskedImpedance:
    """What the leg was asked to render, and all that linear theory needs to say what it should have rendered."""

    desired: DesiredImpedance
    """Controller and desired impedance."""
    weight: Weight
    """W of Eq. 14 with which the gains were selected."""
    frequencies_hz: Sequence[float]
    """Frequencies [Hz] of the protocol."""


def judged_impedance(
    stepped: SteppedSineTrial, trial: Trial, p: DrivetrainParameters, asked: AskedImpedance | None
) -> pl.DataFrame:
    """The rows of Eq. 15 with all that judges them; what the gains should give only where it is known what was asked.

    Raises
    ------
    InputError, UnreachableImpedanceError
        As `plausible_impedance`, and as `DesiredImpedance.gains`.
    """
    phasors = trial_phasors(stepped)
    if asked is None:
        return plausible_impedance(impedance_table(stepped, phasors), trial, p)
    gains = asked.desired.gains(p, asked.weight)
    table = impedance_table(stepped, phasors, joint_admittance(gains.K_1, gains.B_1, p, p.J_j))
    predicted = predicted_impedance(gains, p, asked.frequencies_hz)
    plausible = plausible_impedance(table, trial, p, predicted[0])
    return plausible.with_columns(**asked.desired.columns(), **prediction_columns(predicted))
