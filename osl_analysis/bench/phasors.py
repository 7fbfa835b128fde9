"""Phasors of angle and torque in each segment of a stepped sine (Fig. 7), and what harmonics of the
torque say by their phase: friction, a gap, a spring.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.segments import Segment
from osl_analysis.bench.stepped_sine import Columns, SteppedSineTrial, rounding_beside
from osl_analysis.errors import InputError
from osl_analysis.stats.covariance import RepeatedError
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.sinusoid import (
    ComplexEstimate,
    Phasor,
    Sinusoid,
    complex_from_row,
    complex_mean,
    complex_quotient,
    complex_row,
    polar_row,
    sinusoid,
    with_known_error,
)
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
"""theta/torque [rad/(N*m)] of a model, for complex s [rad/s]."""
RESPONSE_KEYS = ("trial", "joint", "side", "controller", "K_d", "B_d", "frequency_hz")
"""Columns of the phasor table whose rows differ in the amplitude only."""


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment."""

    amplitude_deg: float  # commanded amplitude [deg]
    frequency_hz: float  # frequency [Hz]
    theta: Phasor  # of the joint angle [rad]
    torque: Phasor  # of the resisting torque [N*m]
    compliance_error: float = 0.0
    """Standard error [rad/(N*m)] of the bench's compliance, whose yielding was taken off the angle."""

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)]. An error of the bench's compliance c changes the angle by
        -c torque, and Y by -c."""
        return with_known_error(complex_quotient(self.theta, self.torque), self.compliance_error)


def phasors_beside(trial: SteppedSineTrial, model: Columns) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment of a trial. The last cycle is not used. If the angle lags the
    command by more at one frequency than at another, this cycle contains the beginning of the next frequency. A fit of
    the `model` will need the same errors of rounding."""
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
    `repeated` are the errors of a signal that every cycle repeats, in the rows of the segment."""
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


Phasors = NDArray[np.complex128]


@dataclass(frozen=True)
class Nonlinearity:
    """Harmonics of the torque under a sine of the angle, and what of them has the phase of which cause."""

    even: float  # amplitude of harmonics 2 and 4 that all segments share, as a share of the fundamental: asymmetry
    odd: float
    """Amplitude of harmonics 3 and 5, as a share of the fundamental: friction, backlash, a spring that stiffens."""
    coulomb: float  # coulomb friction [N*m], from harmonics in phase with the sign of the velocity
    cubic: float  # cubic stiffness [N*m/rad^3], from the third harmonic in phase with the angle
    gap: float
    """Torque [N*m] that a gap takes off, from harmonics in phase with the sign of the torque: K times half the gap."""


def nonlinearity(phasors: Sequence[SegmentPhasors], linear: Callable[[Phasors], Phasors]) -> Nonlinearity:
    """From the phasors of segments; `linear` is the impedance of the fitted linear joint at complex s [rad/s].

    The angle's own harmonics make some of the torque's: these are taken off first. With psi the phase of the angle, the
    rest is that of T_C sign(omega), which has the harmonics 4j T_C/(k pi) at k psi, k odd; of k_3 theta^3, which has
    k_3 theta^3/4 at 3 psi; and of a gap, -gap sign(torque). Its third harmonic is 4 gap/(3 pi) at three times the phase
    of the torque, its fifth -4 gap/(5 pi). A segment weighs by one over its frequency, because resonances of the
    drivetrain turn the harmonics of fast segments.

    Even harmonics count as far as all segments have the same. A symmetric joint that chatters has some, at any phase.
    """
    own = np.array([harmonics_of_torque(s, linear) for s in phasors])
    size = np.array([abs(s.torque.value) for s in phasors])
    even, odd = (own / size[:, None])[:, [1, 3]].mean(axis=0), np.sqrt(np.sum(abs(own[:, [2, 4]]) ** 2, axis=0))
    coulomb, cubic, gap = odd_causes(phasors, own)
    return Nonlinearity(
        float(np.linalg.norm(even)), float(np.linalg.norm(odd) / np.linalg.norm(size)), coulomb, cubic, gap
    )


def harmonics_of_torque(segment: SegmentPhasors, linear: Callable[[Phasors], Phasors]) -> Phasors:
    """Harmonics (5,) of a segment's torque [N*m] beyond those of the linear joint, at the angle's phase."""
    k = np.arange(1, segment.torque.harmonics.size + 1)
    at = np.asarray(2j * np.pi * segment.frequency_hz * k, dtype=np.complex128)
    left = segment.torque.harmonics - linear(at) * segment.theta.harmonics
    return np.asarray(left * np.exp(-1j * k * segment.theta.phase))


def odd_causes(phasors: Sequence[SegmentPhasors], own: Phasors) -> tuple[float, float, float]:
    """Coulomb friction [N*m], cubic stiffness [N*m/rad^3] and gap [N*m] that harmonics 3 and 5 of `own` (n, 5) show."""
    theta = np.array([abs(s.theta.value) for s in phasors])
    weight = 1 / np.array([s.frequency_hz for s in phasors])
    turned = np.array([s.torque.phase - s.theta.phase for s in phasors])
    size = 4 / np.pi
    third = [1j * size / 3 * np.ones_like(theta), theta**3 / 4, size / 3 * np.exp(3j * turned)]
    fifth = [1j * size / 5 * np.ones_like(theta), 0 * theta, -size / 5 * np.exp(5j * turned)]
    X = np.column_stack([np.concatenate([a * weight, b * weight]) for a, b in zip(third, fifth, strict=True)])
    y = np.concatenate([own[:, 2] * weight, own[:, 4] * weight])
    scale = np.array([np.linalg.norm(column) for column in X.T])
    estimates = np.linalg.lstsq(np.vstack([X.real, X.imag]) / scale, stacked(y), rcond=None)[0] / scale
    coulomb, cubic, gap = (float(estimate) for estimate in estimates)
    return coulomb, cubic, gap


def damping_of_friction(phasors: Sequence[SegmentPhasors], coulomb: float) -> float:
    """Damping [N*m*s/rad] that Coulomb friction [N*m] adds to a fit. At one frequency its fundamental is a damping of 4
    T_C/(pi w |theta|). A fit to all frequencies weights these by duration times velocity squared, with equally many
    cycles at each."""
    w = 2 * np.pi * np.array([s.frequency_hz for s in phasors])
    theta = np.array([abs(s.theta.value) for s in phasors])
    return 4 * coulomb / np.pi * float(np.sum(theta) / np.sum(w * theta**2))


def stiffness_of_gap(phasors: Sequence[SegmentPhasors], gap: float) -> float:
    """Stiffness [N*m/rad] that a gap of this torque [N*m] takes from a fit: 4 gap/(pi |theta|) at one amplitude."""
    theta = np.array([abs(s.theta.value) for s in phasors])
    weight = 1 / np.array([s.frequency_hz for s in phasors])  # of the duration, with equally many cycles
    return 4 * gap / np.pi * float(np.sum(weight * theta) / np.sum(weight * theta**2))


def nonlinearity_row(phasors: Sequence[SegmentPhasors], measured: Nonlinearity) -> Row:
    """Shares of the torque's harmonics, and the Coulomb friction that they indicate."""
    return {
        "even_harmonics": measured.even,
        "odd_harmonics": measured.odd,
        "coulomb_torque": measured.coulomb,
        "coulomb_damping": damping_of_friction(phasors, measured.coulomb),
    }


def rendered_nonlinearity_row(phasors: Sequence[SegmentPhasors], fit: LinearFit) -> Row:
    """`nonlinearity_row` of a joint with a stiffness, with the causes as shares of the estimates.

    `coulomb_share` is the share of B that friction makes. `stiffening` is the share of K by which a cubic spring
    stiffens up to the largest amplitude. `backlash_deg` is the width of the gap, `backlash_share` the share of K that
    it takes off; a gap takes nothing where its estimate is negative.
    """
    measured = nonlinearity(phasors, linear_impedance(fit))
    row = nonlinearity_row(phasors, measured)
    largest = max(abs(s.theta.value) for s in phasors)
    return row | {
        "coulomb_share": damping_of_friction(phasors, measured.coulomb) / fit["B"],
        "stiffening": measured.cubic * largest**2 / fit["K"],
        "backlash_deg": float(np.rad2deg(2 * measured.gap / fit["K"])),
        "backlash_share": max(stiffness_of_gap(phasors, measured.gap) / fit["K"], 0.0),
    }


def linear_impedance(fit: LinearFit) -> Callable[[Phasors], Phasors]:
    """The impedance [N*m/rad] at complex s [rad/s] of a fit of Eq. 15, or of one without stiffness (B_j, J_j)."""
    K, B, I = (fit[name] if name in fit.names else 0.0 for name in ("K", "B", "I"))
    if "B_j" in fit.names:
        B, I = fit["B_j"], fit["J_j"]
    return lambda s: np.asarray(K + B * s + I * s**2, dtype=np.complex128)


def stacked(z: Phasors) -> Array:
    """Real and imaginary parts (2 n,) of complex numbers (n,)."""
    return np.concatenate([z.real, z.imag])
