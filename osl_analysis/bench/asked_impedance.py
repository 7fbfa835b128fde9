"""The fits of a trial against the controller, judged by what the leg was asked to render where that is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench.frequency_response import SegmentPhasors
from osl_analysis.bench.impedance import DesiredImpedance, prediction_columns
from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.bench.plausibility import Saturated, not_checked, plausible_impedance
from osl_analysis.bench.rendered import RenderedTrial, rendered_table
from osl_analysis.model.compensator import Gains, predicted_impedance
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.gain_selection import Weight
from osl_analysis.parameters import DrivetrainParameters

OF_GAINS, OF_LAG = (
    "whether K is what the gains should give, whether the bench's frame yields",
    "whether the torque is late",
)
LOOKS_ALIKE = "a lag that would change I by a tenth or more looks like noise here, or like what Eqs. 15 and 9 miss"
BAND_POINTS = 12
"""Frequencies of a band at which the rendered impedance is predicted."""
OF_BELT = "K against the belt's K_s"
OF_DRIFT = "whether K changes while it is recorded: noise, or what Eq. 15 misses, may hide it"
OF_CLOCKS = "whether the clocks of angle and torque drift apart: what the fit leaves does not show it"


@dataclass(frozen=True)
class AskedImpedance:
    """What the leg was asked to render, and all that linear theory needs to say what it should have rendered."""

    desired: DesiredImpedance
    """Controller and desired impedance."""
    weight: Weight
    """W of Eq. 14 with which the gains were selected."""
    frequencies_hz: Sequence[float]
    """Frequencies [Hz] of the protocol."""

    def frequencies_of(self, rendered: RenderedTrial) -> Sequence[float]:
        """Frequencies [Hz] at which the rendered impedance is predicted: of the protocol, or over the motion's band."""
        if isinstance(rendered, MovingRecord):
            return [float(f) for f in np.linspace(*rendered.band_hz, BAND_POINTS)]
        return self.frequencies_hz

    def gains(self, p: DrivetrainParameters | None) -> Gains | None:
        """The gains that the leg had; None where they are not known. Raises as `DesiredImpedance.gains`."""
        return self.desired.gains(p, self.weight)

    def not_checked(self, p: DrivetrainParameters | None, lag_known: bool) -> str:
        """What a trial is not checked for, and why; empty if it is checked for all."""
        of_gains = OF_GAINS if lag_known else f"{OF_GAINS}, {OF_LAG}"
        if p is None:
            return f"{OF_BELT}, {of_gains}: the configuration names no parameter file"
        why = self.desired.unknown_gains()
        if why:
            return f"{of_gains}: {why}"
        return "" if lag_known else f"{OF_LAG}: {LOOKS_ALIKE}"

    def left_unchecked(self, p: DrivetrainParameters | None) -> pl.Expr:
        """The column `not_checked` of a table with lags: whether the torque is late, only in rows without a share."""
        known, unknown = (pl.lit(self.not_checked(p, lag_known) or None, pl.String) for lag_known in (True, False))
        return pl.when(pl.col("lag_inertia_share").is_null()).then(unknown).otherwise(known).alias("not_checked")


def judged_impedance(
    rendered: RenderedTrial,
    rails: Saturated,
    p: DrivetrainParameters | None,
    asked: AskedImpedance | None,
    phasors: Sequence[SegmentPhasors] | None = None,
) -> pl.DataFrame:
    """The rows of Eq. 15 with all that judges them; what the gains should give only where these are known.

    `phasors` as in `rendered_table`.

    Without parameter file (`p`), controller of the draft, K_d and B_d they are not. The column `not_checked` says so,
    and where the motion does not show a change of K over time, or a drift between the clocks of two devices.

    Raises
    ------
    InputError, UnreachableImpedanceError
        As `plausible_impedance`, and as `DesiredImpedance.gains`.
    """
    table = judged_by_gains(rendered, rails, p, asked, phasors)
    two_clocks = rendered.uniform is not None and not rendered.uniform.one_device("theta", "torque")
    unseen = {"K_drift": OF_DRIFT} | ({"clock_drift_ppm": OF_CLOCKS} if two_clocks else {})
    for column, words in unseen.items():
        both = pl.concat_str("not_checked", pl.lit(words), separator="; ", ignore_nulls=True)
        table = table.with_columns(
            pl.when(pl.col(column).is_null()).then(both).otherwise("not_checked").alias("not_checked")
        )
    return table


def judged_by_gains(
    rendered: RenderedTrial,
    rails: Saturated,
    p: DrivetrainParameters | None,
    asked: AskedImpedance | None,
    phasors: Sequence[SegmentPhasors] | None,
) -> pl.DataFrame:
    """As `judged_impedance`, without what the motion alone leaves unchecked."""
    gains = None if asked is None else asked.gains(p)
    if asked is None or p is None or gains is None:
        table = plausible_impedance(rendered_table(rendered, None, phasors), rails, p)
        if asked is None:
            return table.with_columns(not_checked("" if p else f"{OF_BELT}: no parameter file is named"))
        known = table.with_columns(**asked.desired.columns(), **prediction_columns(None))
        return known.with_columns(asked.left_unchecked(p))
    table = rendered_table(rendered, joint_admittance(gains.K_1, gains.B_1, p, p.J_j), phasors)
    predicted = predicted_impedance(gains, p, asked.frequencies_of(rendered))
    plausible = plausible_impedance(table, rails, p, predicted[0])
    judged = plausible.with_columns(**asked.desired.columns(), **prediction_columns(predicted))
    return judged.with_columns(asked.left_unchecked(p))
