"""Planned protocols, and the 95 % intervals that they will give for K, B and I, by the Fisher
information of the fits' columns. docs/design_of_experiments.md has the formulas and their sources.

A plan has the `sines` of its motion, its length `record_s` [s] without rests, its `peak` (largest
angle [rad], velocity [rad/s], acceleration [rad/s^2]) and a description `words`. K, B and I of the
joint are an array (3,).

A torque sine, fitted for a time T in white noise of one-sided density S [(N*m)^2/Hz], has an
amplitude with the variance S/T in phase with the angle, and S/T in quadrature: (2, n) for n sines.
An error e of the angle acts as an error -Z e of the torque."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.effects import IMPEDANCE
from osl_analysis.bench.gram import BY_REPEATS, BY_UNITS, FEWEST_UNITS
from osl_analysis.bench.record import STRETCH_S
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.model.multisine import Multisine, odd_multisine
from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import CONDITION_LIMIT, FEWEST_CYCLES, welch_satterthwaite
from osl_analysis.trial import Array

KBI = ("K", "B", "I")
Impedances = NDArray[np.complex128]
# last cycles of a segment, not fitted: the filter smears the next frequency into them
LAST_CYCLES = 1
TRANSIENTS = 1  # periods before those of a realisation, for the joint to settle
ENOUGH_REALISATIONS = 4  # number of realisations whose spread gives an interval
MOST_DRAWN = 20  # largest number of realisations in the search for the peak


@dataclass(frozen=True)
class PlannedSines:
    """The sines of a motion, shape (n,) each."""

    frequency_hz: Array
    size: Array  # amplitude [rad]
    duration_s: Array  # fitted time [s] of this sine
    cycle_s: Array  # period [s] of the whole motion; `duration_s` if it is not periodic
    spacing_hz: float | None = None  # of simultaneous multiples; None: one sine at a time
    independent: float = 1.0  # number of independent values of the distortion at a line

    @property
    def w(self) -> Array:
        return np.asarray(2 * np.pi * self.frequency_hz)

    @property
    def velocity(self) -> Array:
        """RMS velocity [rad/s] of the whole motion during each sine."""
        each = self.size * self.w / np.sqrt(2)
        return each if self.spacing_hz is None else np.full(len(each), np.sqrt(np.sum(each**2)))


@dataclass(frozen=True)
class SteppedSine:
    """A stepped sine: each amplitude at every frequency."""

    amplitudes: tuple[float, ...]  # [rad]
    frequencies_hz: tuple[float, ...]
    cycles: tuple[float, ...]  # number at each frequency
    settle_cycles: int  # first cycles of each, not fitted

    @property
    def sines(self) -> PlannedSines:
        """The fitted cycles are those that `spectral.stepped_sine.settled_cycles` leaves."""
        fitted = np.maximum(np.floor(self.cycles) - self.settle_cycles - LAST_CYCLES, 1)
        a, f = (x.ravel() for x in np.meshgrid(self.amplitudes, self.frequencies_hz, indexing="ij"))
        return PlannedSines(f, a, np.tile(fitted, len(self.amplitudes)) / f, 1 / f)

    @property
    def record_s(self) -> float:
        return len(self.amplitudes) * float(np.sum(np.asarray(self.cycles) / self.frequencies_hz))

    @property
    def peak(self) -> tuple[float, float, float]:
        a, w = max(self.amplitudes), 2 * np.pi * max(self.frequencies_hz)
        return a, a * w, a * w**2

    @property
    def words(self) -> str:
        sines = self.sines
        numbers = (
            np.rad2deg(self.amplitudes),
            self.frequencies_hz,
            self.cycles,
            sines.duration_s / sines.cycle_s,
        )
        degrees, hertz = (", ".join(f"{one:.4g}" for one in each) for each in numbers[:2])
        cycles, fitted = (
            ", ".join(dict.fromkeys(f"{one:.4g}" for one in each)) for each in numbers[2:]
        )
        return (
            f"stepped sine: {degrees} deg at {hertz} Hz, {cycles} cycles at each ({fitted} fitted)"
        )


@dataclass(frozen=True)
class PeriodicMultisine:
    """Realisations of an odd random-phase multisine, whole periods of each after a transient."""

    period_s: float
    band_hz: tuple[float, float]
    rms: float  # root mean square of the angle [rad]
    periods: int  # fitted periods of each realisation
    realisations: int  # with different phases
    seed: int = 1

    def motion(self, realisation: int) -> Multisine:
        """One realisation; raises as `odd_multisine`."""
        return odd_multisine(self.period_s, self.band_hz, self.rms, self.seed, realisation)

    @property
    def sines(self) -> PlannedSines:
        motion = self.motion(0)
        period = np.full(len(motion.lines), self.period_s)
        duration = self.realisations * self.periods * period
        return PlannedSines(
            motion.frequency_hz, motion.size, duration, period, 1 / self.period_s, self.realisations
        )

    @property
    def record_s(self) -> float:
        return self.realisations * (self.periods + TRANSIENTS) * self.period_s

    @property
    def peak(self) -> tuple[float, float, float]:
        motions = [self.motion(r) for r in range(min(self.realisations, MOST_DRAWN))]
        n = 16 * int(motions[0].lines[-1])
        time = self.period_s * np.arange(n) / n
        orders = [
            [np.abs(m.angle(time, derivative)).max() for m in motions] for derivative in range(3)
        ]
        angle, velocity, acceleration = (float(max(one)) for one in orders)
        return angle, velocity, acceleration

    @property
    def words(self) -> str:
        motion = self.motion(0)
        low, high = motion.frequency_hz[[0, -1]]
        return (
            f"odd random-phase multisine: {len(motion.lines)} lines from {low:.4g} to {high:.4g} Hz"
            f" and {len(motion.detection)} detection lines, {np.rad2deg(self.rms):.4g} deg rms,"
            f" crest factor {self.peak[0] / self.rms:.3g}, period {self.period_s:.4g} s,"
            f" {self.periods} periods after {TRANSIENTS} of transient, {self.realisations}"
            f" realisation{'s' if self.realisations > 1 else ''}"
        )


@dataclass(frozen=True)
class Continuous:
    """A motion without repeats whose spectrum is flat over a band: a linear chirp, or band-limited
    noise."""

    band_hz: tuple[float, float]
    rms: float  # root mean square of the angle [rad]
    record_s: float
    chirp: bool  # whether it is a chirp, with one frequency at a time; else noise

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not (0 < low < high < np.inf and self.rms > 0 and self.record_s > 0):
            raise InputError(
                f"no motion has a band of {low:g} to {high:g} Hz, {self.rms:g} rad rms and "
                f"{self.record_s:g} s; give positive numbers, the lower frequency first"
            )

    @property
    def sines(self) -> PlannedSines:
        """200 sines that share its power: in a chirp successive, in noise simultaneous."""
        n, (low, high), T = 200, self.band_hz, self.record_s
        f, one, spacing = (
            low + (high - low) * (np.arange(n) + 0.5) / n,
            np.ones(n),
            (high - low) / n,
        )
        if self.chirp:
            return PlannedSines(f, np.sqrt(2) * self.rms * one, T / n * one, T / n * one)
        return PlannedSines(
            f, self.rms * np.sqrt(2 / n) * one, T * one, T * one, spacing, T * spacing
        )

    @property
    def peak(self) -> tuple[float, float, float]:
        """For noise four times the RMS, which one sample in 16 000 exceeds."""
        w = 2 * np.pi * self.sines.frequency_hz
        if self.chirp:
            largest = np.sqrt(2) * self.rms * w[-1] ** np.arange(3)
        else:
            largest = 4 * self.rms * np.array([np.sqrt(np.mean(w ** (2 * k))) for k in range(3)])
        return float(largest[0]), float(largest[1]), float(largest[2])

    @property
    def words(self) -> str:
        name, (low, high) = "linear chirp" if self.chirp else "band-limited noise", self.band_hz
        return (
            f"{name}: {low:.4g} to {high:.4g} Hz, {np.rad2deg(self.rms):.4g} deg rms,"
            f" {self.record_s:.4g} s"
        )


Plan = SteppedSine | PeriodicMultisine | Continuous


def long_enough(plan: Plan, enough: Callable[[Plan], bool]) -> tuple[Plan | None, Plan]:
    """The shortest plan of the same kind such that it and all longer ones are `enough` (None if
    none is), and the longest that is tried. For a multisine, periods and realisations are chosen
    together."""
    found: list[Plan] = []
    tried, shortest, longest = [plan], 10, 7200  # s
    if isinstance(plan, SteppedSine):
        shortest, longest = plan.settle_cycles + LAST_CYCLES + FEWEST_CYCLES, 2000
    elif isinstance(plan, PeriodicMultisine):  # fewer realisations do not show the distortion
        tried = [replace(plan, periods=n) for n in (2, 3, 4, 6, 8, 12)]
        shortest, longest = ENOUGH_REALISATIONS, 200
    for one in tried:
        low, high = shortest - 1, longest
        if not enough(of_length(one, high)):
            continue
        while high - low > 1:
            middle = int(np.clip(round(np.sqrt(max(low, 1) * high)), low + 1, high - 1))
            low, high = (low, middle) if enough(of_length(one, middle)) else (middle, high)
        found.append(of_length(one, high))
    return min(found, key=lambda one: one.record_s, default=None), of_length(tried[-1], longest)


def of_length(plan: Plan, n: int) -> Plan:
    """The same plan with n cycles, realisations or seconds."""
    if isinstance(plan, SteppedSine):
        return replace(plan, cycles=(float(n),) * len(plan.frequencies_hz))
    return (
        replace(plan, realisations=n)
        if isinstance(plan, PeriodicMultisine)
        else replace(plan, record_s=float(n))
    )


def eq15(w: Array) -> Impedances:
    """The fits' columns (`IMPEDANCE`) for an angle of 1 rad at angular frequencies (n,) [rad/s],
    (3, n): real parts are in phase with the angle, imaginary ones with the velocity. A joint (K, B,
    I) @ these is its impedance [N*m/rad]."""
    of_angle = {"theta": np.ones(len(w)), "omega": 1j * w, "alpha": -(w**2)}
    return np.array([of_angle[IMPEDANCE[name]] for name in KBI])


@dataclass(frozen=True)
class PlannedFit:
    """Least squares on filtered signals: the filter weights the sines. Offset and drift are
    orthogonal to full cycles."""

    sines: PlannedSines
    weight: Array  # squared gain of the zero-phase filter at each sine, (n,)
    columns: Impedances  # columns at the sines, (3, n)
    change: Impedances  # change of K, B and I per N*m of a torque amplitude, (3, n)
    correlation: float  # of K and I
    condition_number: float  # of the columns, each scaled to unit length

    def share(self, error: Array) -> Array:
        """Parts (3, n) of the variances of K, B, I due to errors of the sines with variances (2, n)
        [(N*m)^2]."""
        return np.asarray(self.change.real**2 * error[0] + self.change.imag**2 * error[1])

    def fitted(self, impedance: Impedances) -> Array:
        """K, B and I (3,) fitted to an impedance (n,) [N*m/rad] at the sines."""
        return np.asarray((self.change.conj() @ (self.sines.size * impedance)).real)


def planned_fit(plan: Plan, low_pass: LowPass) -> PlannedFit:
    """The fit of a plan. Raises IdentifiabilityError: its motion cannot tell K from I."""
    sines = plan.sines
    weight, X = low_pass.gain(sines.frequency_hz) ** 2, sines.size * eq15(sines.w)
    each = weight * sines.duration_s / 2
    normal = ((X.conj() * each) @ X.T).real
    scale = np.sqrt(np.diag(normal))
    values = np.linalg.eigvalsh(normal / np.outer(scale, scale))
    condition = float(np.sqrt(values[-1] / values[0])) if values[0] > 1e-15 * values[-1] else np.inf
    if condition > CONDITION_LIMIT:
        low, high = float(sines.frequency_hz.min()), float(sines.frequency_hz.max())
        where = f"{low:.4g} Hz alone" if np.isclose(low, high) else f"{low:.4g} to {high:.4g} Hz"
        raise IdentifiabilityError(
            f"K and I cannot be told apart by {where}, where K - I w^2 is one number; excite down"
            f" to {low / 2:.3g} Hz or up to {2 * high:.3g} Hz too"
        )
    correlation = float(-normal[0, 2] / np.sqrt(normal[0, 0] * normal[2, 2]))
    return PlannedFit(sines, weight, X, np.linalg.inv(normal) @ (X * each), correlation, condition)


@dataclass(frozen=True)
class Sensors:
    """Errors of load cell and encoder: standard deviations, or steps where named so."""

    rate_hz: float  # sampling rate [Hz]
    torque_noise: float  # [N*m]
    # bandwidth [Hz] of this noise; None: half the rate (independent samples)
    noise_band_hz: float | None = None
    torque_step: float = 0.0  # step of the load cell's converter [N*m]
    encoder_step: float = 0.0  # step of the encoder [rad]
    angle_noise: float = 0.0  # [rad]
    drift: float = 0.0  # of the load cell [N*m/s]

    def variances(self, sines: PlannedSines, Z: Impedances, record_s: float) -> dict[str, Array]:
        """Variances (2, n) [(N*m)^2] of the torque's amplitudes by cause, for impedances Z (n,)
        [N*m/rad]."""

        def through(angle: Array) -> Array:
            """Errors of the angle's amplitudes as equivalent errors of the torque's, as variances
            (2, n)."""
            return np.asarray(Z.real**2 * angle + Z.imag**2 * angle[::-1])

        both, nyquist, drift = np.ones((2, 1)), self.rate_hz / 2, 0.0
        band = self.noise_band_hz or nyquist
        slow, rounded = self.torque_noise**2 / band, self.torque_step**2 / 12 / nyquist
        # the analysis subtracts a fitted slope, whose variance is 6 S/T^3
        if self.drift and slow + rounded:
            drift = 1 / (1 / self.drift**2 + record_s**3 / (6 * (slow + rounded)))
        density = slow * (sines.frequency_hz <= band) + rounded
        return {
            "torque noise": both * density / sines.duration_s,
            "angle noise": through(both * self.angle_noise**2 / nyquist / sines.duration_s),
            "encoder rounding": through(self.rounding(sines)[0]),
            "load cell drift": both * 2 * drift / sines.w**2,
        }

    def rounding(self, sines: PlannedSines) -> tuple[Array, Array]:
        """Variance (2, n) [rad^2] of the angle's amplitudes by rounding to steps q, independent
        between sines, over all zeros of the encoder; and the variance (n,) of the relative error
        common to all amplitudes of one size.

        Later cycles repeat the errors if motion and samples share a clock, as assumed here; noise s
        before rounding leaves exp(-(2 pi s/q)^2) of them (Widrow and Kollar, Quantization Noise,
        2008, ch. 5). With many samples per step, the sample at each step falls on either side at
        random, and a third of this error is in phase. Between steps the errors are correlated: for
        a sine they are in phase with it (Bennett, 1948); for a random motion with the RMS velocity
        v their density at low frequencies is zeta(3) q^3/(pi^2 (2 pi)^(1/2) v) (Woodward's
        theorem)."""
        q, v, alone = self.encoder_step, sines.velocity, sines.spacing_hz is None
        if not q:
            return np.zeros((2, len(v))), np.zeros(len(v))
        repeating = np.exp(-((2 * np.pi * self.angle_noise / q) ** 2))
        # samples until they meet the same places of the motion again; a denominator above 10 000 is
        # no pattern
        places = [
            Fraction(float(c) * self.rate_hz).limit_denominator(10_000).numerator
            for c in sines.cycle_s
        ]
        white, pattern_s = (
            q**2 / 6 / self.rate_hz,
            np.minimum(np.array(places) / self.rate_hz, sines.duration_s),
        )
        # mean speed over RMS velocity: 0.90 for a sine, 0.80 for a random motion
        steps = (
            0.9
            * v
            / (q * self.rate_hz)
            * (np.array([[2 / 3], [4 / 3]]) if alone else np.ones((2, 1)))
        )
        found = (
            repeating * white / pattern_s * np.minimum(1, steps)
            + (1 - repeating) * white / sines.duration_s
        )
        if alone:
            return found, repeating * scipy.special.zeta(3) / np.pi**4 * (q / sines.size) ** 3
        between_steps = (
            scipy.special.zeta(3) * q**3 / (np.pi**2 * np.sqrt(2 * np.pi) * v) / sines.cycle_s
        )
        return found + repeating * between_steps, np.zeros(len(v))


@dataclass(frozen=True)
class Distortion:
    """Stated deviations of the joint from a linear one."""

    coulomb: float = 0.0  # Coulomb friction [N*m]
    pilot: tuple[float, ...] | None = None
    """Variances of K, B and I in an earlier trial of this kind: the joint's own contribution, such
    as that of a drivetrain with friction behind a belt, does not fall with the length of a
    record."""

    def variances(self, plan: Plan, fit: PlannedFit) -> Array:
        """Variances (3,) of K, B and I by the distortion. In a random motion friction scatters the
        estimates less than the lines (0.65 of it for K, 0.4 for B and I), since given amplitudes
        fix the RMS velocity. From four realisations on the analysis sees this scatter, which is
        simulated."""
        found, sines, periodic = np.zeros(3), fit.sines, isinstance(plan, PeriodicMultisine)
        at_sines, few = self, periodic and sines.independent < ENOUGH_REALISATIONS
        if self.coulomb and sines.spacing_hz and not few:
            columns = (tuple(c.tolist()) for c in (sines.frequency_hz, sines.size, fit.weight))
            scatter = scatter_of_friction(*columns, sines.spacing_hz, periodic)
            found = self.coulomb**2 * scatter / sines.independent
            at_sines = replace(self, coulomb=0.0)
        found = found + fit.share(at_sines.at_sines(fit)).sum(axis=1)
        return np.asarray(np.maximum(found, self.pilot or 0.0))

    def at_sines(self, fit: PlannedFit) -> Array:
        """Variance (2, n) [(N*m)^2] of the torque's amplitudes that Eq. 15 cannot fit. Friction T
        sign(w) responds to a sine of amplitude a with 4 T/pi in phase with the velocity: no
        scatter, since it depends on frequency only and every repetition has it. In a random motion,
        friction less its damping (`added_damping`) has the autocorrelation T^2 (2/pi) (arcsin r -
        r), where r is that of the velocity (Van Vleck and Middleton, 1966)."""
        sines = fit.sines
        if sines.spacing_hz is None:
            left = 4 / np.pi * self.coulomb * np.ones(len(sines.w))
            left -= (
                fit.fitted(np.asarray(1j * left / sines.size, dtype=np.complex128))[1]
                * sines.size
                * sines.w
            )
            return np.array([np.zeros_like(left), left**2])
        # mean square of sign(w) less its equivalent damping; 64 or more samples per period of the
        # highest line, since arcsin r has cusps
        line = np.rint(sines.frequency_hz / sines.spacing_hz).astype(np.intp)
        n = 1 << int(np.ceil(np.log2(64 * line[-1])))
        lines = np.zeros(n // 2 + 1)
        lines[line] = (sines.size * sines.w) ** 2
        r = np.clip(np.fft.irfft(lines / lines.sum() * n / 2, n), -1, 1)
        power = self.coulomb**2 * 2 / n * np.fft.rfft(2 / np.pi * (np.arcsin(r) - r)).real[line]
        return np.array([power, power]) / sines.independent

    def added_damping(self, plan: Plan) -> dict[str, float]:
        """B [N*m*s/rad] that friction adds: at each amplitude of a stepped sine, over the whole of
        another motion; T (2/pi)^(1/2)/v for a random one with the RMS velocity v (Bussgang,
        1952)."""
        sines = plan.sines
        if not self.coulomb:
            return {}
        if sines.spacing_hz is not None:
            return {"in all": self.coulomb * float(np.sqrt(2 / np.pi) / sines.velocity[0])}
        parts = {"in all": np.ones(len(sines.size), dtype=np.bool_)}
        if isinstance(plan, SteppedSine):
            parts = {f"{np.rad2deg(a):.4g} deg": np.isclose(sines.size, a) for a in plan.amplitudes}
        speed, T = sines.size * sines.w, sines.duration_s
        each = {
            name: np.sum((T * speed)[c]) / np.sum((T * speed**2)[c]) for name, c in parts.items()
        }
        return {name: 4 * self.coulomb / np.pi * float(ratio) for name, ratio in each.items()}


@lru_cache(maxsize=8)  # a search for the length asks for the same sines again and again
def scatter_of_friction(
    frequency_hz: tuple[float, ...],
    size: tuple[float, ...],
    weight: tuple[float, ...],
    spacing_hz: float,
    periodic: bool,
) -> Array:
    """Variances (3,) of K, B and I by Coulomb friction of 1 N*m over 400 sets of random phases
    (standard error of their scatter: 3.5 %), for sines of these amplitudes [rad] and squared filter
    gains. If they are noise, not `periodic`, amplitudes are random, too."""
    number, rng, w = 400, np.random.default_rng(1), 2 * np.pi * np.asarray(frequency_hz)
    line = np.rint(np.asarray(frequency_hz) / spacing_hz).astype(np.intp)
    n = 1 << int(np.ceil(np.log2(64 * line[-1])))
    draws = rng.standard_normal((2, number, len(line)))
    theta = draws[0] + 1j * draws[1]
    theta *= np.asarray(size) / (np.abs(theta) if periodic else np.sqrt(2))
    spectrum = np.zeros((number, n // 2 + 1), dtype=np.complex128)
    spectrum[:, line] = 1j * w * theta * n / 2
    torque = 2 / n * np.fft.rfft(np.sign(np.fft.irfft(spectrum, n, axis=1)), axis=1)[:, line]
    root = np.sqrt(weight)
    y = np.concatenate([(root * torque).real, (root * torque).imag], axis=1)
    columns = [root * (1j * w) ** k * theta for k in range(3)]
    X = np.stack([np.concatenate([c.real, c.imag], axis=1) for c in columns], axis=2)
    products = np.einsum("dni,dnj->dij", X, X)
    estimates = np.linalg.solve(products, np.einsum("dni,dn->di", X, y)[..., None])[..., 0]
    return np.asarray(np.var(estimates, axis=0, ddof=1))


@dataclass(frozen=True)
class Precision:
    """The precision that a plan will give."""

    fit: PlannedFit
    columns: Mapping[str, Array]
    """For K, B and I (3,) in SI units: `expected`, `half_width` of the 95 % interval,
    `half_width_of_noise` without distortion, `se` and its `degrees_of_freedom`."""
    variance: Mapping[str, Array]  # of K, B and I (3,) by cause
    method: str  # `interval_method` of the analysis

    def reaches(self, within: Mapping[str, float]) -> bool:
        """Whether the half-widths are within these shares of K, B and I, as far as stated."""
        share = self.columns["half_width"] / np.maximum(
            np.abs(self.columns["expected"]), np.finfo(float).tiny
        )
        return all(share[KBI.index(name)] <= most for name, most in within.items())


def precision(
    plan: Plan,
    joint: Array,
    sensors: Sensors,
    low_pass: LowPass,
    distortion: Distortion | None = None,
) -> Precision:
    """The intervals that a plan will give for a joint (K, B, I), from the source that the fit will
    use (`interval_method`). Raises as `planned_fit`; InputError as `Distortion.variances`.

    Units are those of `bench.gram`: a frequency at an amplitude, or a stretch. The noise has the
    degrees of freedom of cycles, or of stretches; the distortion, as scatter of units, one fewer
    than units; rounding and drift count as known. For a multisine the interval is from the spread
    of realisations; with fewer than four, from the level at detection lines, each of which serves
    the excited lines around it."""
    fit, stated = planned_fit(plan, low_pass), distortion or Distortion()
    sines, Z = fit.sines, joint @ eq15(fit.sines.w)
    errors = sensors.variances(sines, Z, plan.record_s)
    causes = {name: fit.share(error).sum(axis=1) for name, error in errors.items()}
    alike = sensors.rounding(sines)[1]
    for a in np.unique(np.round(sines.size[alike > 0], 9)):
        here = np.isclose(sines.size, a)
        causes["encoder rounding"] += alike[here].mean() * fit.fitted(np.where(here, Z, 0)) ** 2
    known = causes["encoder rounding"] + causes["load cell drift"]
    seen, scatter = causes["torque noise"] + causes["angle noise"], stated.variances(plan, fit)
    noise, total = seen + known, seen + known + scatter
    if isinstance(plan, PeriodicMultisine):
        if plan.realisations >= ENOUGH_REALISATIONS:
            method, freedom = "realisations", np.full(3, plan.realisations - 1.0)
        else:
            share = fit.share(np.sum([*errors.values(), stated.at_sines(fit)], axis=0))
            motion = plan.motion(0)
            near = np.argmin(np.abs(motion.lines[:, None] - motion.detection[None, :]), axis=1)
            together = [np.bincount(near, own) for own in share]
            method = "detection lines"
            freedom = np.array(
                [2 * plan.realisations * u.sum() ** 2 / np.sum(u**2) for u in together]
            )
        of_noise = freedom
    else:
        cycles = np.rint(sines.duration_s / sines.cycle_s)
        groups = plan.record_s / STRETCH_S if isinstance(plan, Continuous) else float(cycles.sum())
        units = (
            float(len(cycles))
            if isinstance(plan, SteppedSine) and len(cycles) >= FEWEST_UNITS
            else groups
        )
        method = (
            BY_REPEATS if isinstance(plan, SteppedSine) and len(cycles) < FEWEST_UNITS else BY_UNITS
        )
        if cycles.min() > 1:
            each = fit.share(errors["torque noise"] + errors["angle noise"])
            of_seen = welch_satterthwaite(list(each.T), cycles - 1)
        else:  # nothing repeats: neighbours overlap, and each of five columns uses up half a group
            of_seen = np.full(3, max(groups / 1.5 - len(IMPEDANCE) / 2, 1.0))
        infinite = np.full(3, np.inf)
        of_noise = welch_satterthwaite([seen, known], [of_seen, infinite])
        freedom = welch_satterthwaite(
            [seen, known, scatter], [of_seen, infinite, np.full(3, max(units - 1, 1.0))]
        )
        of_noise, freedom = (np.where(each < 1e5, each, np.inf) for each in (of_noise, freedom))
    columns = {
        "expected": joint,
        "half_width": scipy.special.stdtrit(freedom, 0.975) * np.sqrt(total),
        "half_width_of_noise": scipy.special.stdtrit(of_noise, 0.975) * np.sqrt(noise),
        "se": np.sqrt(total),
        "degrees_of_freedom": freedom,
    }
    return Precision(fit, columns, causes | {"distortion": scatter}, method)
