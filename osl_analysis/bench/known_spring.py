"""A known spring or inertia on the bench, which gives its lag and gain."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import polars as pl

from osl_analysis.bench import effects
from osl_analysis.bench.analysis import QUANTITIES, Analysis, widened
from osl_analysis.bench.bench_frame import Frame
from osl_analysis.bench.bench_settings import Fixture
from osl_analysis.bench.effects import IMPEDANCE
from osl_analysis.bench.fixture import error_to_state, fixture_row
from osl_analysis.bench.joint_inference import suspected_fault_of_losses
from osl_analysis.bench.late_torque import LateFit, late_fit
from osl_analysis.bench.plausibility import check_resists
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import GroupFit
from osl_analysis.dictionary import table_of
from osl_analysis.errors import InputError
from osl_analysis.stats.table_rows import Row, estimates_row
from osl_analysis.trial import Array

SPRING_LOSS = 1e-3
"""Half-width of the loss factor of a spring, tan(phase), about 0: steel and clamps have 1e-4 to
1e-3."""
LEAST_INERTIA_SHARE = 0.01
"""Torque of the inertia over that of the spring, at the fastest motion, from which damping is told
from a delay. They differ by the inertia's torque alone, and 0.001 of the torque are usually
wrong."""


@dataclass(frozen=True)
class Known:
    """A spring, an inertia, or both, that calibrate a bench."""

    stiffness: float | None  # [N*m/rad]
    inertia: float | None  # [kg*m^2]
    share: float = 0.0  # their relative standard uncertainty
    is_fixture_alone: bool = False  # nothing else turns: its own inertia and weight are measured


@dataclass(frozen=True)
class LateFits:
    """Eq. 15 with friction and a late torque.

    Attributes
    ----------
    counted : GroupFit
        The fit that counts: of a spring without damping, unless this is certain.
    damped : GroupFit or None
        The fit that allows damping; None for a spring with too little inertia to tell it.
    """

    counted: GroupFit
    damped: GroupFit | None


def late_fits(record: Record, is_spring: bool) -> LateFits:
    """Fit Eq. 15 with friction and a late torque."""
    few = record.coarse
    model = {**IMPEDANCE, "T_C": "T_C"}
    columns, centre = effects.effect_columns(record)
    fit_late = partial(late_fit, few, columns, centre=centre)
    if not is_spring:
        fit = fit_late(model=model).fit
        return LateFits(fit, fit)

    undamped_model = {name: column for name, column in model.items() if name != "B"}
    undamped = fit_late(model=undamped_model).fit
    fastest = 2 * np.pi * record.band_hz[1]
    if abs(undamped["I"]) * fastest**2 < LEAST_INERTIA_SHARE * undamped["K"]:
        return LateFits(undamped, None)

    def is_unlikely(late: LateFit) -> bool:
        """Whether the search has not ended, or ended in the false minimum of a delay, beside a
        negative damping."""
        return not late.has_ended or late.fit.interval("B")[1] < 0

    tried = [fit_late(model=model, lag_s=lag_s) for lag_s in (0.0, undamped["lag_s"])]
    damped = min(tried, key=is_unlikely).fit
    is_damped = damped["B"] > 0 and damped.certain("B", effects.FALSE_ALARM)
    return LateFits(damped if is_damped else undamped, damped)


def calibration_table(
    analysis: Analysis, known: Known, frame: Frame | None = None, stated: Fixture | None = None
) -> pl.DataFrame:
    """The trial's row of `calibration.csv`: Eq. 15 of a known spring or inertia, with friction and
    a late torque, and what else than a delay may make the torque late.

    A spring has no damping beyond `SPRING_LOSS`, unless the fit that allows one, whose `B` is
    given, is certain of it: torque in phase with the velocity, beside friction, is a delay. For an
    inertia, higher derivatives tell a delay from the damping of its bearing. `gain` is the measured
    K or I over the known one; the rest is the fixture's. `frame` is what yields between two angles,
    and `stated` the fixture that one alone is compared with.

    Raises
    ------
    InputError
        Nothing is known, and it is no fixture alone.
    IdentifiabilityError
        As `fit_groups`.
    """
    record = analysis.record
    if known.is_fixture_alone:
        of_fixture = {"trial": record.name, **fixture_row(analysis, stated)}
        return table_of([of_fixture], "calibration", complete=True)
    of = known.stiffness or known.inertia
    if not of or of < 0:
        raise InputError(
            f"trial {record.name}: a calibration needs what is known; fill in known_K [N*m/rad] of"
            " its spring, known_I [kg*m^2] of its inertia, or `alone` under fixture, in the sample"
            " sheet"
        )
    fits = late_fits(record, known.stiffness is not None)
    fit = bench_estimates(record, fits, known, of)
    lag_s, gain = fit["lag_s"], fit["gain"]
    certain_lag = beyond_interval(fit, "lag_s", lag_s)
    explanations = None
    if certain_lag:
        fault = suspected_fault_of_losses(record)
        explanations = fault.explanations if fault else None

    row: Row = {
        "trial": record.name,
        **(frame.row() if frame else {}),
        "known_K": known.stiffness,
        "known_I": known.inertia,
        "known_share": known.share,
        **estimates_row(fit, *fit.names),
        **(estimates_row(fits.damped, "B") if fits.damped else {}),
        **estimates_row(fits.counted, "T_C"),
        **analysis.diagnostics(),
        "certain_lag_s": certain_lag,
        "certain_gain_error": beyond_interval(fit, "gain", gain - 1),
        "to_state": to_state(fit, frame),
        **analysis.time_base_row(None, QUANTITIES),
        "explanations": explanations,
    }
    return table_of([row], "calibration", complete=True)


def to_state(fit: GroupFit, frame: Frame | None) -> str:
    """What the configuration should state of gain, delay and frame, once gain and delay are
    corrected."""
    gain, lag_s = error_to_state(fit, "gain"), error_to_state(fit, "lag_s")
    text = f"calibration: {{torque_gain: {gain:.2g}, delay: {lag_s:.2g}}}"
    stiffness = frame.stiffness if frame else None
    if stiffness is None:
        return text
    value, error = stiffness.value, stiffness.standard_error
    return f"{{{text}, bench_stiffness: {{value: {value}, standard_error: {error}}}}}"


def bench_estimates(record: Record, fits: LateFits, known: Known, of: float) -> GroupFit:
    """Lag, gain, and the fixture's inertia or weight, from a fit of what is known to be `of`."""
    fit = fits.counted
    if known.stiffness:
        main, beside, name, taken = "K", "I", "inertia", known.inertia or 0.0
    else:
        main, beside, name, taken = "I", "K", "weight", 0.0
    gain = fit[main] / of
    check_resists(record.name, main, gain)
    other = fit[beside] / gain

    # derivatives of lag, gain and the other one by the estimates
    change = np.zeros((3, len(fit.names)))
    at_main, at_beside = fit.names.index(main), fit.names.index(beside)
    change[0, fit.names.index("lag_s")] = 1.0
    change[1, at_main] = 1 / of
    change[2, at_main] = -other / fit[main]
    change[2, at_beside] = 1 / gain
    found = replace(
        fit,
        names=("lag_s", "gain", name),
        estimates=np.array([fit["lag_s"], gain, other - taken]),
        covariance=change @ fit.covariance @ change.T,
        degrees_of_freedom=np.array([fit.freedom(each) for each in ("lag_s", main, beside)]),
    )
    found = widened(found, known.share * np.array([0.0, gain, other - taken]))
    if fit is not fits.damped:
        found = widened(found, lag_of_loss(record.band_hz))
    return found


def lag_of_loss(band_hz: tuple[float, float]) -> Array:
    """Standard deviation (3,) of the lag [s] that a spring's own loss makes, in the middle of a
    band; of gain and fixture it is 0. A phase of d at f is a lag of d/(2 pi f)."""
    lowest_hz, highest_hz = band_hz
    middle_hz = np.sqrt(lowest_hz * highest_hz)
    largest_lag_s = SPRING_LOSS / (2 * np.pi * middle_hz)
    # of a rectangular distribution
    return np.array([largest_lag_s / np.sqrt(3), 0.0, 0.0])


def beyond_interval(fit: GroupFit, name: str, difference: float) -> float:
    """A difference of an estimate from what it should be, less the half-width of its interval."""
    half_width = fit.interval(name)[1] - fit[name]
    return float(np.sign(difference)) * max(abs(difference) - half_width, 0.0)
