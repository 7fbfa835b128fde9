"""Frequency response of the joint (Fig. 7): phasors of angle and torque, and the admittance Y = theta/torque."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.segments import Segment
from osl_analysis.bench.stepped_sine import Columns, SteppedSineTrial, rounding_beside
from osl_analysis.errors import InputError
from osl_analysis.stats.complex_estimate import (
    ComplexEstimate,
    complex_from_row,
    complex_mean,
    complex_quotient,
    complex_row,
    polar_row,
    with_known_error,
)
from osl_analysis.stats.covariance import RepeatedError
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.sinusoid import Phasor, Sinusoid, sinusoid
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
"""theta/torque [rad/(N*m)] of a model, for complex s [rad/s]."""
RESPONSE_KEYS = ("trial", "joint", "side", "controller", "K_d", "B_d", "frequency_hz")
"""Columns of the phasor table whose rows differ in the amplitude only."""


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment."""

    amplitude_deg: float
    """Commanded amplitude [deg]."""
    frequency_hz: float
    """Frequency [Hz]."""
    theta: Phasor
    """Of the joint angle [rad]."""
    torque: Phasor
    """Of the resisting torque [N*m]."""
    compliance_error: float = 0.0
    """Standard error [rad/(N*m)] of the bench's compliance, whose yielding was taken off the angle."""

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)].

        An error of the bench's compliance c changes the angle by -c torque, and Y by -c.
        """
        return with_known_error(complex_quotient(self.theta, self.torque), self.compliance_error)


def phasors_beside(trial: SteppedSineTrial, model: Columns) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment of a trial.

    The last cycle is not used. If the angle lags the command by more at one frequency than at another, this cycle
    contains the beginning of the next frequency. A fit of the `model` will need the same errors of rounding.

    Raises
    ------
    InputError
        As `segment_phasors`, naming the trial.
    """
    try:
        return [phasors_of(trial, segment, model) for segment in trial.segments(None)]
    except InputError as error:
        raise InputError(f"trial {trial.name}, {error}") from error


def phasors_of(trial: SteppedSineTrial, segment: Segment, model: Columns) -> SegmentPhasors:
    """Phasors of one segment of a trial, with the errors that the spread of its cycles does not show."""
    sine = sinusoid(segment.part(trial.time), segment.frequency_hz, segment.repeated)
    signals = {"theta": trial.theta, "torque": trial.torque}
    found = segment_phasors(segment, sine, signals, rounding_beside(trial, segment, model, sine.columns.X))
    return found if trial.bench is None else replace(found, compliance_error=trial.bench.compliance_error)


def segment_phasors(
    segment: Segment, sine: Sinusoid, signals: Mapping[str, Array], repeated: Mapping[str, RepeatedError]
) -> SegmentPhasors:
    """Phasors of one segment of the raw signals `theta` and `torque` (n,) [rad, N*m], with the segment's sine.

    `repeated` are the errors of a signal that every cycle repeats, in the rows of the segment.

    Raises
    ------
    InputError
        As `fit_sinusoid`.
    """
    parts = {name: segment.part(signal) for name, signal in signals.items()}
    phasors = sine.phasors(parts, {name: [error] for name, error in repeated.items()})
    return SegmentPhasors(segment.amplitude_deg, segment.frequency_hz, phasors["theta"], phasors["torque"])


def at_amplitude(phasors: Sequence[SegmentPhasors], amplitude: float | None) -> list[SegmentPhasors]:
    """The segments of one amplitude [deg], or all (None)."""
    return [s for s in phasors if amplitude is None or isclose(s.amplitude_deg, amplitude, rel_tol=1e-5)]


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """A row per amplitude and frequency: phasors of angle [rad] and torque [N*m], Y [rad/(N*m)], distortions."""
    return pl.DataFrame([{"trial": trial, **phasor_row(segment)} for segment in phasors])


def phasor_row(segment: SegmentPhasors) -> Row:
    """Phasors and Y with covariances and degrees of freedom, the distortions, magnitude and phase of Y."""
    admittance = segment.admittance
    return {
        "amplitude_deg": segment.amplitude_deg,
        "frequency_hz": segment.frequency_hz,
        **complex_row("theta", segment.theta),
        **complex_row("torque", segment.torque),
        "theta_distortion": segment.theta.distortion,
        "torque_distortion": segment.torque.distortion,
        **complex_row("Y", admittance),
        **{f"Y_{name}": value for name, value in polar_row(admittance).items()},
        "Y_se_bench": segment.compliance_error,
        "interval_method": max(segment.theta.interval_method, segment.torque.interval_method, key=len),
    }


def no_phasors() -> pl.DataFrame:
    """The columns of `phasor_table` without a row, for a trial that no sine moved."""
    return example_phasors().clear()


def example_phasors() -> pl.DataFrame:
    """One row of `phasor_table`, of a sine that stands for no trial; only its columns count."""
    time = np.arange(200) / 200
    sine = np.sin(2 * np.pi * 10 * time)
    signals, segment = {"theta": sine, "torque": sine}, Segment(1.0, 10.0, 0.0, 200.0, 10)
    return phasor_table("", [segment_phasors(segment, sinusoid(time, 10.0, segment.repeated), signals, {})])


def no_responses() -> pl.DataFrame:
    """The columns of `frequency_response_table` without a row."""
    numbers = ("K_d", "B_d", "frequency_hz")
    keys = {name: pl.lit(None, pl.Float64 if name in numbers else pl.String) for name in RESPONSE_KEYS}
    row = pl.DataFrame([mean_response_row(example_phasors().with_columns(doubtful=pl.lit("")))])
    return row.select(**keys).hstack(row).clear()


def frequency_response_table(phasors: pl.DataFrame) -> pl.DataFrame:
    """Complex mean of Y over the amplitudes, a row per trial and frequency, from the gathered phasor tables."""
    keys = [key for key in RESPONSE_KEYS if key in phasors.columns]
    groups = phasors.group_by(keys, maintain_order=True)
    rows = [{**dict(zip(keys, values, strict=True)), **mean_response_row(group)} for values, group in groups]
    if not rows:
        return no_responses()
    return pl.DataFrame(rows, schema_overrides={key: phasors.schema[key] for key in keys}, infer_schema_length=None)


def mean_response_row(amplitudes: pl.DataFrame) -> Row:
    """Mean of Y over amplitudes at one frequency: magnitude [rad/(N*m)] and phase [deg] with 95 % intervals.

    The intervals contain the noise of the phasors only. `_min` and `_max` are the values of the single amplitudes.
    Their phases are computed relative to that of the mean, so that they do not jump at 180 degrees. `doubtful` lists
    the reasons of doubtful phasors with their amplitudes.
    """
    rows = list(amplitudes.iter_rows(named=True))
    shared = max(float(row["Y_se_bench"]) for row in rows)
    responses = [complex_from_row("Y", row | {"Y_var_re": row["Y_var_re"] - shared**2}) for row in rows]
    mean = with_known_error(complex_mean(responses), shared)  # all amplitudes share the error of the bench
    phases = [np.rad2deg(mean.phase + np.angle(r.value / mean.value)) for r in responses]
    reasons = amplitudes.select("amplitude_deg", "doubtful").drop_nulls().filter(pl.col("doubtful") != "").rows()
    return {
        **polar_row(mean),
        **complex_row("Y", mean),
        "interval_method": " and ".join(amplitudes["interval_method"].unique().sort()),
        "magnitude_min": min(r.magnitude for r in responses),
        "magnitude_max": max(r.magnitude for r in responses),
        "phase_min_deg": float(min(phases)),
        "phase_max_deg": float(max(phases)),
        "n_amplitudes": len(responses),
        "doubtful": "; ".join(f"at {amplitude:g} deg: {reason}" for amplitude, reason in reasons),
    }
