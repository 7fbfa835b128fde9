"""Harmonics of the torque under a sine of the angle, and what they say by their phase: friction, a gap, a spring."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.frequency_response import SegmentPhasors
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

Phasors = NDArray[np.complex128]


@dataclass(frozen=True)
class Nonlinearity:
    """Harmonics of the torque under a sine of the angle, and what of them has the phase of which cause."""

    even: float
    """Amplitude of harmonics 2 and 4 that all segments share, as a share of the fundamental: asymmetry."""
    odd: float
    """Amplitude of harmonics 3 and 5, as a share of the fundamental: friction, backlash, a spring that stiffens."""
    coulomb: float
    """Coulomb friction [N*m], from harmonics in phase with the sign of the velocity."""
    cubic: float
    """Cubic stiffness [N*m/rad^3], from the third harmonic in phase with the angle."""
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
    """Damping [N*m*s/rad] that Coulomb friction [N*m] adds to a fit.

    At one frequency its fundamental is a damping of 4 T_C/(pi w |theta|). A fit to all frequencies weights these by
    duration times velocity squared, with equally many cycles at each.
    """
    w = 2 * np.pi * np.array([s.frequency_hz for s in phasors])
    theta = np.array([abs(s.theta.value) for s in phasors])
    return 4 * coulomb / np.pi * float(np.sum(theta) / np.sum(w * theta**2))


def stiffness_of_gap(phasors: Sequence[SegmentPhasors], gap: float) -> float:
    """Stiffness [N*m/rad] that a gap of this torque [N*m] takes from a fit: 4 gap/(pi |theta|) at one amplitude."""
    theta = np.array([abs(s.theta.value) for s in phasors])
    weight = 1 / np.array([s.frequency_hz for s in phasors])  # of the duration, with equally many cycles
    return 4 * gap / np.pi * float(np.sum(weight * theta) / np.sum(weight * theta**2))


def nonlinearity_row(phasors: Sequence[SegmentPhasors], fit: LinearFit) -> Row:
    """Shares of the torque's harmonics, and the Coulomb friction that they indicate; `fit` is that of the joint."""
    return harmonics_row(phasors, nonlinearity(phasors, linear_impedance(fit)))


def harmonics_row(phasors: Sequence[SegmentPhasors], measured: Nonlinearity) -> Row:
    """The columns that every stepped sine has."""
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
    row = harmonics_row(phasors, measured)
    largest = max(abs(s.theta.value) for s in phasors)
    return {
        **row,
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
