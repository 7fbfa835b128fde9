"""Eq. 15 of a motion that repeats itself: estimates and intervals from the lines of its periods."""

from dataclasses import replace

import numpy as np

from osl_analysis.bench.moving_fit import middle
from osl_analysis.errors import OslAnalysisError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import fit_periodic
from osl_analysis.spectral.realisations import PeriodicMotion
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array


def by_lines(fit: LinearFit, motion: PeriodicMotion | None, time: Array, low_pass: LowPass) -> LinearFit:
    """The fit of a record at times (n,) [s] with estimates and intervals from the lines of its motion; diagnostics
    stay. The fit itself where there are none.

    Whatever repeats in every period, as the rounding of an encoder and friction, is in these intervals. Noise alone is
    in those of `fit`.
    """
    if motion is None:
        return fit
    try:
        lines = fit_periodic(motion.realisations, low_pass)
    except OslAnalysisError:
        return fit
    covariance, offset = lines.covariance.copy(), lines.names.index("offset")
    covariance[offset, offset] += (beside_middle(time, motion) * fit.se("drift")) ** 2
    return replace(
        fit,
        names=lines.names,
        estimates=lines.estimates,
        covariance=covariance,
        degrees_of_freedom=lines.degrees_of_freedom,
        interval_method=lines.interval_method,
    )


def beside_middle(time: Array, motion: PeriodicMotion) -> float:
    """Time [s] from the middle of a record, about which its drift is subtracted, to the middle of its periods."""
    middles = [one.start + one.periods * one.period / 2 for one in motion.realisations]
    weighted = float(np.average(middles, weights=[one.periods for one in motion.realisations]))
    return weighted - (middle(time) - float(time[0]))
