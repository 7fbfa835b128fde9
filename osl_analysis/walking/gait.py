"""Unperturbed gait on a common grid of stance phase, and the phase of a perturbed crossing on it (docs/walking.md).

A perturbation may change the duration of stance. What the person did before the onset tells the one to be expected.
Size and drift of a motion differ from step to step and look like pace, but cannot imitate the ankle's sharp turn after
heel strike. So both are fitted too; the drift has the order with which unperturbed scales scatter least. Torque and
load misread a slower crossing: low-pass and heel's impact act in time and not in phase."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, rounding_of
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.settings import StanceSource

PHASES = np.linspace(0.0, 1.0, 401)  # Phases of stance at which crossings are sampled, finer than the frames


@dataclass(frozen=True)
class UnperturbedGait:
    """Unperturbed crossings at `PHASES`: 0 at heel strike, 1 at toe-off."""

    names: tuple[str, ...]
    theta: Array  # angle of the ankle (crossings, phases) [rad]
    torque: Array  # (crossings, phases) [N*m]
    stance: Array  # duration of stance (crossings,) [s]
    plate_errors: Array  # (m, crossings, phases) [N*m], as in `Crossing`
    lab_errors: Array  # (6, crossings, phases) [N*m], as in `Crossing`


def unperturbed_gait(
    crossings: Sequence[Crossing], fewest: int, lost: Mapping[str, str] | None = None
) -> UnperturbedGait:
    """Crossings on the common grid of stance phase. `lost` has the reasons of those that are not used, by trial."""
    if len(crossings) < fewest:
        used = ", ".join(c.name for c in crossings)
        if not lost:
            raise InputError(
                f"{len(crossings)} unperturbed crossings ({used or 'none'}), expected {fewest} or more; record more, "
                "or exclude fewer in the sheet"
            )
        # The most frequent, in one trial's words. Reasons that differ in numbers and the trial's name are one.
        said = {trial: why.removeprefix(f"trial {trial}: ") for trial, why in lost.items()}
        kinds = {trial: re.sub(r"[-+]?\d+(\.\d+)?", "#", why) for trial, why in said.items()}
        kind, count = Counter(kinds.values()).most_common(1)[0]
        alike = [trial for trial, of in kinds.items() if of == kind]
        named = f" ({', '.join(alike)})" if 1 < count <= 8 else ""
        others = f" beside {len(lost) - count} for other reasons, which walking_crossings.csv lists"
        raise InputError(
            f"{len(crossings)} of {len(crossings) + len(lost)} unperturbed crossings can be used"
            f"{f' ({used})' if used else ''}, expected {fewest} or more; {count} times"
            f"{named}{others if count < len(lost) else ''}, as in {alike[0]}: {said[alike[0]]}"
        )
    theta, torque, *errors = (
        np.stack([signal_at(c, getattr(c, signal), stance_times(c)) for c in crossings], axis=-2)
        for signal in ("theta", "torque", "plate_errors", "lab_errors")
    )
    stance = np.array([c.stance.duration for c in crossings])
    return UnperturbedGait(tuple(c.name for c in crossings), theta, torque, stance, *errors)


def stance_times(crossing: Crossing, phases: Array = PHASES) -> Array:
    """Times [s] of the phases (k,) of a crossing's stance."""
    return crossing.stance.heel_strike + phases * crossing.stance.duration


def signal_at(crossing: Crossing, signal: Array, time: Array) -> Array:
    """Signals (..., n) of a crossing at other times (k,) [s], by a cubic spline; constant beyond the recording."""
    spline = scipy.interpolate.make_interp_spline(crossing.time, signal, k=3, axis=-1)
    return np.asarray(spline(np.clip(time, crossing.time[0], crossing.time[-1])))


def at_phases(curves: Array, phase: Array) -> Array:
    """Curves (..., `PHASES`) at other phases (k,): (..., k), by a cubic spline."""
    return np.asarray(scipy.interpolate.make_interp_spline(PHASES, curves, k=3, axis=-1)(phase))


SMALLEST, LARGEST = 0.75, 1.33  # Bounds of a scale


def matched_scales(phase: Array, curves: Array, mean: Array) -> Array:
    """The scales r (8, m) at which curves (m, k) at phases p (k,) are most like a multiple of the mean curve (n,) at r
    p, plus a polynomial of order 1 to 8; NaN if the search by Gauss and Newton from 1 on does not end within bounds."""
    spline = scipy.interpolate.make_interp_spline(np.linspace(0.0, 1.0, len(mean)), mean, k=3)
    slope = spline.derivative()
    orders = np.arange(1, 9)
    drift = np.linalg.qr(np.vander(phase / phase[-1], orders[-1] + 1, increasing=True))[0]  # orthonormal polynomials
    used = (np.arange(drift.shape[1]) <= orders[:, None])[:, None].astype(float)

    def beside(curves: Array) -> Array:
        """What the drift of each order leaves of curves (orders, m, k)."""
        return np.asarray(curves - ((curves @ drift) * used) @ drift.T)

    nothing = len(phase) * rounding_of(mean)
    scales = np.ones((len(orders), len(curves)))
    step = np.full_like(scales, np.inf)
    last = 1e-6  # step that ends the search
    for _ in range(15):
        there = np.clip(scales[..., None] * phase, 0.0, 1.0)
        expected = spline(there)
        size, change, left = (beside(v) for v in (expected, phase * slope(there), curves - expected))
        # the coefficient of `change` in the regression of `left` on `size` and `change`, where both have one
        ff, fs, ss = (np.sum(a * b, axis=-1) for a, b in ((size, size), (size, change), (change, change)))
        alone = ss * ff - fs**2
        some = (ff > nothing) & (ss > nothing) & (alone > nothing * ff)
        found = ff * np.sum(change * left, axis=-1) - fs * np.sum(size * left, axis=-1)
        step = np.clip(np.where(some, found, np.nan) / np.where(some, alone, 1.0), -0.05, 0.05)
        scales = np.clip(scales + step, SMALLEST, LARGEST)
        if np.all(np.abs(step) < last):
            break
    settled = (np.abs(step) < last) & (scales > SMALLEST) & (scales < LARGEST)
    return np.where(settled, scales, np.nan)


BEFORE_ONSET_S = 0.03  # Time [s] before the onset at which the matching ends: the filter spreads the response into it


@dataclass(frozen=True)
class AlignedGait:
    """How a perturbed crossing and the unperturbed ones lie on the mean gait."""

    stance: float  # duration of stance [s] of the perturbed crossing that converts time to phase
    scales: Array  # phase of the mean gait over own phase (crossings,), of each unperturbed crossing
    expected: float  # stance [s] that the gait before the onset leads to expect; NaN: it is like the mean at no pace

    def curves(self, unperturbed: Array, phase: Array) -> Array:
        """The unperturbed curves (crossings, `PHASES`) at phases (k,) of the mean gait: (crossings, k)."""
        own = np.clip(phase / self.scales[:, None], 0.0, 1.0)
        return np.array([at_phases(curve, there) for curve, there in zip(unperturbed, own, strict=True)])


def aligned_gait(crossing: Crossing, gait: UnperturbedGait, source: StanceSource) -> AlignedGait:
    """The alignment of a perturbed crossing, whose duration of stance comes from `source`."""
    own, usual = crossing.stance.duration, float(np.mean(gait.stance))
    onset, scale, others = crossing.onset, np.nan, np.full(len(gait.names), np.nan)
    last = crossing.stance.toe_off if onset is None else onset
    phase = PHASES[(last - BEFORE_ONSET_S - crossing.stance.heel_strike) / own >= PHASES]
    if len(phase) >= 20:  # from heel strike to before the onset: 5 % of stance, from which a pace can be read
        theta = signal_at(crossing, crossing.theta, stance_times(crossing, phase))
        both = np.vstack([theta, gait.theta[:, : len(phase)]])[:, ::4]  # a low-pass of 20 Hz leaves no more
        found = matched_scales(phase[::4], both, gait.theta.mean(axis=0))
        # The drift has the order at which the unperturbed scales scatter least, where every curve has a scale
        scatters = np.where(np.isfinite(found).all(axis=1), np.std(found[:, 1:], axis=1), np.inf)
        best = int(np.argmin(scatters))
        if np.isfinite(scatters[best]):
            scale, others = float(found[best, 0]), found[best, 1:]
    expected = own / scale * float(others.mean())
    if source != "matched":
        return AlignedGait(own if source == "own" else usual, np.ones(len(gait.names)), expected)
    if not np.isfinite(scale):
        raise InputError(
            f"trial {crossing.name}: its ankle angle before the onset is like that of the mean unperturbed gait at no "
            f"pace between {SMALLEST:g} and {LARGEST:g} of its own; exclude the trial, give it another group, or state "
            "perturbed_stance: own"
        )
    return AlignedGait(own / scale, others, expected)
