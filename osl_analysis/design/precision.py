"""Standard errors and 95 % intervals that a plan will give for K, B and I (Eq. 15), by Fisher's information.

**Sensors.** A sine of the torque that is fitted for a time T beside white noise of the one-sided density S [(N*m)^2/Hz]
has an amplitude with the variance S/T in phase with the angle, and S/T a quarter of a turn off. An error e of the angle
acts as an error -Z e of the torque.

**A joint that is not linear.** Coulomb friction T sign(w) answers a sine of amplitude a by the fundamental 4 T/pi in
phase with the velocity (its describing function), and a Gaussian velocity of RMS v by the damping T (2/pi)^(1/2)/v
(Bussgang, 1952). What is left of the torque then has the autocorrelation T^2 (2/pi) (arcsin r - r), where r is that of
the velocity (Van Vleck and Middleton, Proc. IEEE 54, 1966). In a periodic motion it repeats with every period: longer
records do not average it out, other phases do. An odd multisine has it at odd lines only, since r changes its sign
after half a period.

Variances of the amplitudes of n sines have the shape (2, n): in phase with the angle, and in phase with the velocity.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit, zeta

from osl_analysis.design.plan import Continuous, PeriodicMultisine, Plan, Sines, SteppedSine
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion
from osl_analysis.spectral.response import DETECTION, ENOUGH_REALISATIONS, REALISATIONS
from osl_analysis.stats.covariance import CYCLES, FEWEST_CYCLES, welch_satterthwaite
from osl_analysis.stats.regression import CONDITION_LIMIT
from osl_analysis.trial import Array

KBI = ("K", "B", "I")
ZETA_3 = float(zeta(3))  # Sum of 1/k^3
Impedances = NDArray[np.complex128]


@dataclass(frozen=True)
class Joint:
    """The impedance that is expected: K [N*m/rad], B [N*m*s/rad], I [kg*m^2]."""

    K: float
    B: float
    I: float

    def impedance(self, w: Array) -> Impedances:
        """Z [N*m/rad] at angular frequencies (n,) [rad/s] (Eq. 15)."""
        return np.asarray(self.K - self.I * w**2 + 1j * w * self.B, dtype=np.complex128)

    @property
    def values(self) -> Array:
        """K, B, I, shape (3,)."""
        return np.array([self.K, self.B, self.I])


@dataclass(frozen=True)
class PlannedFit:
    """Least squares on filtered signals: what each sine tells on K, B and I.

    Over whole cycles a sine is two rows: its amplitudes in phase with the angle and with the velocity. Their products,
    each times its duration and 1/S, are Fisher's information for white noise of the one-sided density S. The filter
    weighs the sines, and errors are not the same at all of them: the covariance is that of weighted least squares.
    """

    sines: Sines
    weight: Array  # Squared gain of the zero-phase filter at each sine, (n,)

    @cached_property
    def columns(self) -> Array:
        """The columns of Eq. 15 in these rows, as the fits have them, shape (2, n, 3). The offset is orthogonal."""
        a, w, still = self.sines.size, self.sines.w, np.zeros(len(self.sines.w))
        motion = Motion(*(np.array(pair) for pair in ((a, still), (still, a * w), (-a * w**2, still))))
        of = impedance_columns(motion)
        return np.stack([of[name] for name in KBI], axis=-1)

    @cached_property
    def normal(self) -> Array:
        """The normal matrix (3, 3): products of the columns over time."""
        each = self.weight * self.sines.duration_s / 2
        return np.asarray(np.einsum("pni,n,pnj->ij", self.columns, each, self.columns))

    @cached_property
    def change(self) -> Array:
        """By how much an amplitude of 1 N*m of the torque changes K, B and I, shape (3, 2, n)."""
        each = self.columns * (self.weight * self.sines.duration_s / 2)[:, None]
        return np.asarray(np.einsum("ij,pnj->ipn", np.linalg.inv(self.normal), each))

    def covariance(self, error: Array) -> Array:
        """Covariance (3, 3) of the estimates by errors of the torque's amplitudes, of variance (2, n) [(N*m)^2]."""
        return np.asarray(np.einsum("ipn,pn,jpn->ij", self.change, error, self.change))

    def share(self, error: Array) -> Array:
        """Part of the variances of K, B, I that the error of each sine makes, shape (n, 3)."""
        return np.asarray(np.einsum("ipn,pn->ni", self.change**2, error))

    def fitted(self, impedance: Impedances) -> Array:
        """K, B and I (3,) that are fitted to an impedance [N*m/rad] at the sines, shape (n,)."""
        torque = self.sines.size * impedance
        return np.asarray(np.einsum("ipn,pn->i", self.change, np.array([torque.real, torque.imag])))

    @property
    def correlation(self) -> float:
        return float(-self.normal[0, 2] / np.sqrt(self.normal[0, 0] * self.normal[2, 2]))

    @property
    def condition_number(self) -> float:
        """Condition number of the columns, each scaled to unit length; infinite for a single frequency."""
        scale = np.sqrt(np.diag(self.normal))
        values = np.linalg.eigvalsh(self.normal / np.outer(scale, scale))
        return float(np.sqrt(values[-1] / values[0])) if values[0] > 1e-15 * values[-1] else np.inf


def planned_fit(plan: Plan, low_pass: LowPass) -> PlannedFit:
    """The fit of a plan. Raises IdentifiabilityError where its motion cannot tell K from I."""
    fit = PlannedFit(plan.sines, low_pass.gain(plan.sines.frequency_hz) ** 2)
    if fit.condition_number > CONDITION_LIMIT:
        low, high = float(fit.sines.frequency_hz.min()), float(fit.sines.frequency_hz.max())
        where = f"{low:.4g} Hz alone" if np.isclose(low, high) else f"{low:.4g} to {high:.4g} Hz"
        raise IdentifiabilityError(
            f"K and I cannot be told apart by {where}, where K - I w^2 is one number; excite down to {low / 2:.3g} Hz "
            f"or up to {2 * high:.3g} Hz too"
        )
    return fit


@dataclass(frozen=True)
class Sensors:
    """Errors of load cell and encoder."""

    rate_hz: float  # Sampling rate [Hz]
    torque_noise: float  # Standard deviation of the torque's noise [N*m]
    noise_band_hz: float | None = None
    """Bandwidth [Hz] of this noise; None: half the rate, as noise that is independent from sample to sample has it."""
    torque_step: float = 0.0  # Step of the load cell's converter [N*m]
    encoder_step: float = 0.0  # Step of the encoder [rad]
    angle_noise: float = 0.0
    """Standard deviation of the angle's noise before it is rounded [rad], independent from sample to sample."""
    drift: float = 0.0  # Standard deviation of the load cell's drift [N*m/s]

    def variances(self, sines: Sines, Z: Impedances, record_s: float) -> dict[str, Array]:
        """Variances (2, n) [(N*m)^2] of the torque's amplitudes by cause. `Z` (n,) is the joint's impedance [N*m/rad]
        at the sines, `record_s` the record [s]."""
        both = np.ones((2, 1))
        angle = both * self.angle_noise**2 * 2 / self.rate_hz / sines.duration_s
        return {
            "torque noise": both * self.torque_density / sines.duration_s,
            "angle noise": through(Z, angle),
            "encoder rounding": through(Z, self.rounding(sines)),
            "load cell drift": both * 2 * self.drift_left(record_s) / sines.w**2,
        }

    @property
    def torque_density(self) -> float:
        """One-sided density [(N*m)^2/Hz] of the torque's noise, with the rounding of its converter: step^2/12."""
        band = self.rate_hz / 2 if self.noise_band_hz is None else self.noise_band_hz
        return self.torque_noise**2 / band + self.torque_step**2 / 12 / (self.rate_hz / 2)

    def drift_left(self, record_s: float) -> float:
        """Variance [(N*m/s)^2] of the drift after the analysis has taken off the slope that it finds in the record. The
        slope's own error by noise is 6 S/T^3; both are combined as two pieces of knowledge. A slope s changes the
        amplitude of a sine over whole cycles by 2 s/w (the integral of t sin wt)."""
        if not self.drift or not self.torque_density:
            return 0.0
        return 1 / (1 / self.drift**2 + record_s**3 / (6 * self.torque_density))

    def rounding(self, sines: Sines) -> Array:
        """Variance (2, n) [rad^2] of the angle's amplitudes by rounding to steps q, independent from sine to sine.

        Averaged over all zeros of the encoder. Of N samples that lie at different places of the motion each has an
        error of variance q^2/12, and the amplitude 2/N of it. Later cycles repeat these errors, if motion and samples
        have one clock, which is assumed: rounding does not average out. Where there are many samples per step, only one
        sample at each step is by chance on one side or the other, with the same variance: the steps of a sine are even
        in its angle, so that a third of it is in phase. The errors between steps are alike. That of a sine is then in
        `rounded_gain`. Of a random motion its density at low frequencies is zeta(3) q^3/(pi^2 (2 pi)^(1/2) v), v being
        the RMS velocity (Woodward's theorem on each harmonic of the rounding), and it repeats in every period.

        Noise s before the rounding leaves exp(-(2 pi s/q)^2) of it to repeat (Widrow and Kollar, Quantization Noise,
        2008, ch. 5); the rest averages out as noise of variance q^2/12 does.
        """
        q = self.encoder_step
        if not q:
            return np.zeros((2, len(sines.w)))
        white = q**2 / 6 / self.rate_hz
        # the mean of the velocity's size over its RMS is 0.90 of a sine, 0.80 of a random motion
        steps = 0.9 * sines.velocity / (q * self.rate_hz)
        sampled = self.repeating * white / pattern_s(sines.cycle_s, sines.duration_s, self.rate_hz)
        random = ZETA_3 * q**3 / (np.pi**2 * np.sqrt(2 * np.pi) * sines.velocity) / sines.cycle_s
        others = np.where(sines.alone, 0.0, self.repeating * random) + (1 - self.repeating) * white / sines.duration_s
        thirds = np.where(sines.alone, np.array([[2 / 3], [4 / 3]]), 1)
        return np.asarray(sampled * np.minimum(1, thirds * steps) + others)

    def rounded_gain(self, sines: Sines) -> Array:
        """Variance of the share by which rounding to steps q changes the amplitude of single sines, (n,); 0 for others.
        The error of rounding is a sum of sines of 2 pi k theta/q, and its fundamental 2 q/(pi k) J_1(2 pi k a/q) in
        phase with theta = a sin (Bennett, 1948), the same at every frequency. Its variance is zeta(3) q^3/(pi^4 a)."""
        share = ZETA_3 / np.pi**4 * (self.encoder_step / sines.size) ** 3
        return np.asarray(np.where(sines.alone, self.repeating * share, 0.0))

    @property
    def repeating(self) -> float:
        """Share of the variance of rounding that every cycle repeats."""
        if not self.encoder_step:
            return 0.0
        return float(np.exp(-((2 * np.pi * self.angle_noise / self.encoder_step) ** 2)))


def through(Z: Impedances, angle: Array) -> Array:
    """Variance (2, n) of the torque's amplitudes that errors of the angle [rad^2] are worth, for impedances (n,)."""
    return np.asarray(Z.real**2 * angle + Z.imag**2 * angle[::-1])


def pattern_s(cycle_s: Array, duration_s: Array, rate_hz: float) -> Array:
    """Time [s] after which samples at `rate_hz` lie at the same places of the motion again, where its clock is that of
    the samples; at most the duration. Shape (n,) each. A denominator above 10 000 is no pattern."""
    samples = [Fraction(float(c) * rate_hz).limit_denominator(10_000).numerator for c in cycle_s]
    return np.asarray(np.minimum(np.array(samples) / rate_hz, duration_s))


@dataclass(frozen=True)
class Density:
    """Density of a distortion of the torque, from an earlier trial. Beyond the ends it is that of the end."""

    frequency_hz: Array  # Frequencies [Hz], increasing, shape (n,)
    density: Array  # Mean square per Hz [(N*m)^2/Hz], shape (n,)


@dataclass(frozen=True)
class Spread:
    """How far the estimates of one realisation of an earlier multisine were from those of another."""

    variance: Array  # Variances of K, B and I of one realisation, shape (3,)
    band_hz: tuple[float, float]  # Band of the motion [Hz]
    rms: float  # Root mean square of the angle [rad]

    def at(self, plan: Plan) -> Array:
        """Covariance (3, 3) of K, B and I in a plan; a torque that stays when the motion grows counts for less. Bands
        whose ends differ by up to a fifth count as one."""
        ends = [plan.sines.frequency_hz.min(), plan.sines.frequency_hz.max()]
        if not isinstance(plan, PeriodicMultisine) or not np.allclose(ends, self.band_hz, rtol=0.2):
            low, high = self.band_hz
            raise InputError(
                f"the spread of realisations of an earlier trial says nothing on another motion than a multisine from "
                f"{low:.3g} to {high:.3g} Hz; give its response.csv, or --friction"
            )
        return np.asarray(np.diag(self.variance) * (self.rms / plan.rms) ** 2 / plan.realisations)


@dataclass(frozen=True)
class Distortion:
    """How far the joint is from linear, as far as it is stated. What is stated twice counts twice."""

    coulomb: float = 0.0  # Coulomb friction [N*m]
    level: float = 0.0  # Odd distortion at the excited lines as a share of the torque there
    earlier: Density | None = None
    """Density of the distortion in an earlier trial. That of friction hardly depends on the size of the motion."""
    spread: Spread | None = None  # Spread of the realisations of an earlier trial, the noise in it too

    @property
    def stated(self) -> bool:
        return bool(self.coulomb or self.level or self.earlier or self.spread)

    def covariance(self, plan: Plan, fit: PlannedFit, Z: Impedances) -> Array:
        """Covariance (3, 3) of K, B and I by the distortion; `Z` (n,) is the impedance [N*m/rad] at the sines.

        A level is taken for independent from line to line, as the analysis takes that at detection lines. Estimates
        scatter by less, as of friction by 0.65 (K) and 0.4 (B, I): at given amplitudes the velocity has a given RMS, so
        that errors at its lines depend on one another. The interval of four realisations or more, from their spread,
        has it. Of friction this scatter is drawn.
        """
        if self.spread:
            return self.spread.at(plan) + replace(self, spread=None).covariance(plan, fit, Z)
        few = isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS
        if few or not (random_motion(plan) and self.coulomb):
            return fit.covariance(self.variance(plan, fit, Z))
        columns = (tuple(c.tolist()) for c in (fit.sines.frequency_hz, fit.sines.size, fit.weight))
        scatter = scatter_of_friction(*columns, spacing(plan), isinstance(plan, PeriodicMultisine))
        levels = fit.covariance(replace(self, coulomb=0.0).variance(plan, fit, Z))
        return np.asarray(self.coulomb**2 * scatter / independent(plan) + levels)

    def variance(self, plan: Plan, fit: PlannedFit, Z: Impedances) -> Array:
        """Variance (2, n) [(N*m)^2] of the amplitudes of the torque's sines by what the fit of Eq. 15 cannot follow.
        `Z` (n,) is the joint's impedance [N*m/rad] at the sines. In single sines it is no scatter: it is the same in
        every repetition of the protocol, and differs from frequency to frequency. It then says how far the estimates
        depend on the choice of frequencies and amplitudes."""
        sines = plan.sines
        if isinstance(plan, Continuous) and plan.chirp and (self.level or self.earlier):
            raise InputError(
                "a level of distortion says nothing on a chirp, whose distortion is no scatter; state --friction"
            )
        if isinstance(plan, SteppedSine) and self.earlier:
            raise InputError(
                "the distortion level of an earlier multisine says nothing on single sines; state --friction or "
                "--distortion"
            )
        power = 0.5 * (self.level * np.abs(Z) * sines.size) ** 2
        if not random_motion(plan):
            left = 4 / np.pi * self.coulomb * np.ones(len(sines.w))
            left -= fit.fitted(np.asarray(1j * left / sines.size, dtype=np.complex128))[1] * sines.size * sines.w
            return np.array([power, power + left**2])
        power += self.coulomb**2 * arcsine_power(sines, spacing(plan))
        if self.earlier:  # of an odd multisine a sine has the distortion of two lines
            width = (2 if isinstance(plan, PeriodicMultisine) else 1) * spacing(plan)
            power += np.interp(sines.frequency_hz, self.earlier.frequency_hz, self.earlier.density) * width
        return np.array([power, power]) / independent(plan)

    def added_damping(self, plan: Plan) -> dict[str, float]:
        """B [N*m*s/rad] that friction adds: at each amplitude of a stepped sine, over the whole of another motion; of
        single sines as `bench.nonlinearity.damping_of_friction`."""
        if not self.coulomb:
            return {}
        sines = plan.sines
        if random_motion(plan):
            return {"in all": self.coulomb * float(np.sqrt(2 / np.pi) / sines.velocity[0])}
        parts = {"in all": np.ones(len(sines.size), dtype=np.bool_)}
        if isinstance(plan, SteppedSine):
            parts = {f"{np.rad2deg(a):.4g} deg": np.isclose(sines.size, a) for a in plan.amplitudes}
        speed, T = sines.size * sines.w, sines.duration_s
        each = {name: np.sum((T * speed)[c]) / np.sum((T * speed**2)[c]) for name, c in parts.items()}
        return {name: 4 * self.coulomb / np.pi * float(ratio) for name, ratio in each.items()}


def random_motion(plan: Plan) -> bool:
    """Whether many sines with random phases move the joint at a time."""
    return isinstance(plan, PeriodicMultisine) or (isinstance(plan, Continuous) and not plan.chirp)


def spacing(plan: Plan) -> float:
    """Distance [Hz] of the multiples on which the sines of a random motion lie."""
    if isinstance(plan, PeriodicMultisine):
        return 1 / plan.period_s
    frequency = plan.sines.frequency_hz
    return float(frequency[1] - frequency[0])


def independent(plan: Plan) -> float:
    """Number of independent values of the distortion at one sine: realisations, or lengths of 1/spacing."""
    return plan.realisations if isinstance(plan, PeriodicMultisine) else plan.record_s * spacing(plan)


def lines_of_motion(frequency_hz: Array, spacing_hz: float) -> tuple[NDArray[np.intp], int]:
    """The multiples of `spacing_hz` to which sines are rounded, and the samples in which arcsin r, which has cusps, is
    computed: 64 or more per period of the highest line."""
    line = np.rint(frequency_hz / spacing_hz).astype(np.intp)
    return line, 1 << int(np.ceil(np.log2(64 * line[-1])))


@lru_cache(maxsize=8)
def scatter_of_friction(
    frequency_hz: tuple[float, ...],
    size: tuple[float, ...],
    weight: tuple[float, ...],
    spacing_hz: float,
    periodic: bool,
) -> Array:
    """Covariance (3, 3) of K, B and I by Coulomb friction of 1 N*m, from one set of random phases to another. Eq. 15 is
    fitted to 400 of them (whose scatter has a standard error of 3.5 %), with a seed, for sines of these frequencies
    [Hz], amplitudes [rad] and squared filter gains, multiples of `spacing_hz`. Where they are not `periodic` but noise,
    amplitudes are random too."""
    number, rng = 400, np.random.default_rng(1)
    (line, n), w = lines_of_motion(np.asarray(frequency_hz), spacing_hz), 2 * np.pi * np.asarray(frequency_hz)
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
    return np.asarray(np.cov(estimates.T))


def arcsine_power(sines: Sines, spacing_hz: float) -> Array:
    """Mean square at each sine (n,) of what sign(w) leaves beside its equivalent damping."""
    line, n = lines_of_motion(sines.frequency_hz, spacing_hz)
    power = np.zeros(n // 2 + 1)
    power[line] = (sines.size * sines.w) ** 2
    r = np.clip(np.fft.irfft(power / power.sum() * n / 2, n), -1, 1)
    left = 2 / np.pi * (np.arcsin(r) - r)
    return np.asarray(2 / n * np.fft.rfft(left).real[line])


@dataclass(frozen=True)
class Precision:
    """What a plan will give, for K, B and I: shape (3,) each."""

    fit: PlannedFit
    causes: Mapping[str, Array]  # Variances of the estimates by cause; their sum is the squared standard error
    noise_half_width: Array  # Half of the 95 % interval without distortion
    half_width: Array  # Half of the 95 % interval
    degrees_of_freedom: Array  # Degrees of freedom of the standard errors
    method: str  # Source of the interval that the analysis will give

    @property
    def se(self) -> Array:
        return np.asarray(np.sqrt(np.sum(list(self.causes.values()), axis=0)))

    def rows(self, joint: Joint) -> dict[str, dict[str, Any]]:
        """What is expected of K, B and I, by name, in SI units; `variance` by its cause."""
        columns = {
            "expected": joint.values,
            "half_width": self.half_width,
            "half_width_of_noise": self.noise_half_width,
            "se": self.se,
            "degrees_of_freedom": self.degrees_of_freedom,
        }
        return {
            name: {column: float(values[k]) for column, values in columns.items()}
            | {"variance": {cause: float(values[k]) for cause, values in self.causes.items()}}
            for k, name in enumerate(KBI)
        }

    def reaches(self, joint: Joint, within: Mapping[str, float]) -> bool:
        """Whether the half widths are within these shares of K, B, I, as far as there are any."""
        rows = self.rows(joint)
        return all(rows[name]["half_width"] <= share * abs(rows[name]["expected"]) for name, share in within.items())


def precision(
    plan: Plan, joint: Joint, sensors: Sensors, low_pass: LowPass, distortion: Distortion | None = None
) -> Precision:
    """The intervals that a plan will give. Raises as `planned_fit`; InputError as `Distortion.variance`."""
    fit = planned_fit(plan, low_pass)
    Z, stated = joint.impedance(fit.sines.w), distortion or Distortion()
    errors = sensors.variances(fit.sines, Z, plan.record_s)
    causes = {name: np.diag(fit.covariance(error)) for name, error in errors.items()}
    causes["encoder rounding"] = causes["encoder rounding"] + gain_variance(fit, Z, sensors)
    noise = np.sum(list(causes.values()), axis=0)
    errors["distortion"] = stated.variance(plan, fit, Z)
    causes["distortion"] = np.diag(stated.covariance(plan, fit, Z))
    total, seen = noise + causes["distortion"], causes["torque noise"] + causes["angle noise"]
    method, freedom = interval_of(plan, fit, errors, low_pass)
    freedom_of_all, of_noise = (student(method, freedom, seen, variance - seen) for variance in (total, noise))
    half_widths = (stdtrit(of_noise, 0.975) * np.sqrt(noise), stdtrit(freedom_of_all, 0.975) * np.sqrt(total))
    return Precision(fit, causes, *half_widths, freedom_of_all, method)


def interval_of(plan: Plan, fit: PlannedFit, errors: Mapping[str, Array], low_pass: LowPass) -> tuple[str, Array]:
    """Where the interval is taken from, and the degrees of freedom (3,) of its standard errors. The
    spread of cycles has cycles - 1 of them at each amplitude and frequency, combined by Welch and Satterthwaite; the
    spread of realisations one less than there are; a level at detection lines two at each, which serve the excited
    lines around it; HAC those of `stats.covariance.moving_sums`, with the four columns of Eq. 15 with an offset."""
    if isinstance(plan, PeriodicMultisine):
        if plan.realisations >= ENOUGH_REALISATIONS:
            return REALISATIONS, np.full(3, plan.realisations - 1.0)
        share = np.sum([fit.share(error) for error in errors.values()], axis=0)
        near = np.argmin(np.abs(plan.first.lines[:, None] - plan.first.detection[None, :]), axis=1)
        together = [np.bincount(near, own) for own in share.T]
        return DETECTION, np.array([2 * plan.realisations * u.sum() ** 2 / np.sum(u**2) for u in together])
    cycles = fit.sines.cycles
    if isinstance(plan, Continuous) or cycles.min() < FEWEST_CYCLES:
        windows = plan.record_s * 2 * low_pass.cutoff_hz / 8  # of eight half periods: weights lose 1 % of the noise
        return "HAC", np.full(3, max(1.5 * windows - 4, 1.0))
    seen = fit.share(errors["torque noise"]) + fit.share(errors["angle noise"])
    return CYCLES, welch_satterthwaite(list(seen), cycles - 1)


def student(method: str, freedom: Array, seen: Array, unseen: Array) -> Array:
    """Degrees of freedom (3,) of a variance of which the spread of cycles shows a part; other methods see all of it.
    From 1e5 on the variance counts as known."""
    if method != CYCLES:
        return freedom
    each = zip(seen, unseen, freedom, strict=True)
    found = np.array([float(welch_satterthwaite([s, max(u, 0.0)], [f, np.inf])) for s, u, f in each])
    return np.where(found < 1e5, found, np.inf)


def gain_variance(fit: PlannedFit, Z: Impedances, sensors: Sensors) -> Array:
    """Variance (3,) of K, B and I by amplitudes that rounding changes by the same share at every frequency."""
    share, size = sensors.rounded_gain(fit.sines), fit.sines.size
    alike = [np.isclose(size, a) for a in np.unique(np.round(size[share > 0], 9))]
    each = [share[c].mean() * fit.fitted(np.where(c, Z, 0)) ** 2 for c in alike]
    return np.asarray(np.sum([np.zeros(3), *each], axis=0))
