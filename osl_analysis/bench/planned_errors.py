"""Errors of K, B and I that sensors and friction will cause in a planned fit.

A torque sine, fitted for a time T in white noise of one-sided density S [(N*m)^2/Hz], has an
amplitude with the variance S/T in phase with the angle, and S/T in quadrature: (2, n) for n sines.
An error e of the angle acts as an error -Z e of the torque. docs/design_of_experiments.md has the
formulas and their sources."""

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.effects import IMPEDANCE
from osl_analysis.bench.planned_motion import (
    ENOUGH_REALISATIONS,
    PeriodicMultisine,
    Plan,
    PlannedSines,
    SteppedSine,
)
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import CONDITION_LIMIT
from osl_analysis.trial import Array

KBI = ("K", "B", "I")
Impedances = NDArray[np.complex128]
SAMPLES_PER_PERIOD = 64  # of the highest line, for a function with cusps such as arcsin or sign
LARGEST_DENOMINATOR = 10_000  # of samples per cycle as a fraction: a larger one is no pattern
SETS_OF_PHASES = 400  # that are drawn: the standard error of their scatter is 3.5 %
MEAN_SPEED = 0.9  # of a sine, over its RMS velocity: 2 sqrt(2)/pi; 0.80 of a random motion


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
        in_phase, in_quadrature = error
        of_in_phase = self.change.real**2 * in_phase
        return np.asarray(of_in_phase + self.change.imag**2 * in_quadrature)

    def fitted(self, impedance: Impedances) -> Array:
        """K, B and I (3,) fitted to an impedance (n,) [N*m/rad] at the sines."""
        return np.asarray((self.change.conj() @ (self.sines.size * impedance)).real)


def planned_fit(plan: Plan, low_pass: LowPass) -> PlannedFit:
    """Predict the fit of a plan behind a filter.

    Raises
    ------
    IdentifiabilityError
        Its motion cannot tell K from I.

    Notes
    -----
    The normal equations of columns X (3, n) are Re(X* W X'), with the weight of each sine: the
    filter's squared gain times half of its duration.
    """
    sines = plan.sines
    filter_weight = low_pass.gain(sines.frequency_hz) ** 2
    columns = sines.size * eq15(sines.w)
    weight = filter_weight * sines.duration_s / 2
    normal = ((columns.conj() * weight) @ columns.T).real
    scale = np.sqrt(np.diag(normal))
    eigenvalues = np.linalg.eigvalsh(normal / np.outer(scale, scale))
    condition = np.inf
    if eigenvalues[0] > 1e-15 * eigenvalues[-1]:  # else it is the rounding of zero
        condition = float(np.sqrt(eigenvalues[-1] / eigenvalues[0]))
    if condition > CONDITION_LIMIT:
        refuse_narrow(sines)
    return PlannedFit(
        sines,
        filter_weight,
        columns,
        change=np.linalg.inv(normal) @ (columns * weight),
        correlation=float(-normal[0, 2] / np.sqrt(normal[0, 0] * normal[2, 2])),
        condition_number=condition,
    )


def refuse_narrow(sines: PlannedSines) -> None:
    """Raise an error that says which band cannot tell K from I, and which can."""
    low_hz, high_hz = float(sines.frequency_hz.min()), float(sines.frequency_hz.max())
    band = f"{low_hz:.4g} to {high_hz:.4g} Hz"
    if np.isclose(low_hz, high_hz):
        band = f"{low_hz:.4g} Hz alone"
    raise IdentifiabilityError(
        f"K and I cannot be told apart by {band}, where K - I w^2 is one number; excite down"
        f" to {low_hz / 2:.3g} Hz or up to {2 * high_hz:.3g} Hz too"
    )


@dataclass(frozen=True)
class Rounding:
    """Rounding of an encoder, as errors of the angle's amplitudes."""

    variance: Array  # independent between sines, (2, n) [rad^2]
    common: Array  # (n,): of the relative error that all amplitudes of one size share


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
        """Variances of the torque's amplitudes by cause.

        Parameters
        ----------
        sines : PlannedSines
            The n sines of a motion.
        Z : Impedances
            Impedance (n,) [N*m/rad] of the joint at these.
        record_s : float
            Length of the recording [s].

        Returns
        -------
        dict[str, Array]
            (2, n) [(N*m)^2] each: in phase with the angle, and in quadrature.
        """
        nyquist_hz = self.rate_hz / 2
        band_hz = self.noise_band_hz or nyquist_hz
        noise_density = self.torque_noise**2 / band_hz
        rounding_density = self.torque_step**2 / 12 / nyquist_hz
        density = noise_density * (sines.frequency_hz <= band_hz) + rounding_density
        angle_density = self.angle_noise**2 / nyquist_hz
        slope_variance = self.slope_variance(noise_density + rounding_density, record_s)
        both_phases = np.ones((2, 1))
        of_angle = both_phases * angle_density / sines.duration_s
        return {
            "torque noise": both_phases * density / sines.duration_s,
            "angle noise": as_torque(of_angle, Z),
            "encoder rounding": as_torque(self.rounding(sines).variance, Z),
            "load cell drift": both_phases * 2 * slope_variance / sines.w**2,
        }

    def slope_variance(self, density: float, record_s: float) -> float:
        """Variance of the load cell's drift [(N*m/s)^2] that is left once the analysis has
        subtracted a fitted slope, whose variance is 6 S/T^3 in noise of density S."""
        if not self.drift or not density:
            return 0.0
        return 1 / (1 / self.drift**2 + record_s**3 / (6 * density))

    def rounding(self, sines: PlannedSines) -> Rounding:
        """Errors of the angle's amplitudes by rounding to steps q, over all zeros of the encoder.

        Notes
        -----
        Later cycles repeat the errors if motion and samples share a clock, as assumed here; noise s
        before rounding leaves exp(-(2 pi s/q)^2) of them (Widrow and Kollar, Quantization Noise,
        2008, ch. 5). With many samples per step, the sample at each step falls on either side at
        random, and a third of this error is in phase. Between steps the errors are correlated: for
        a sine they are in phase with it (Bennett, 1948); for a random motion with the RMS velocity
        v their density at low frequencies is zeta(3) q^3/(pi^2 (2 pi)^(1/2) v) (Woodward's
        theorem).
        """
        step, velocity = self.encoder_step, sines.velocity
        count = len(velocity)
        if not step:
            return Rounding(np.zeros((2, count)), np.zeros(count))
        one_at_a_time = sines.spacing_hz is None
        repeating = np.exp(-((2 * np.pi * self.angle_noise / step) ** 2))
        white_density = step**2 / 6 / self.rate_hz
        pattern_s = np.minimum(self.samples_of_pattern(sines) / self.rate_hz, sines.duration_s)
        steps_per_sample = MEAN_SPEED * velocity / (step * self.rate_hz)
        share_of_phases = np.ones((2, 1))
        if one_at_a_time:
            share_of_phases = np.array([[2 / 3], [4 / 3]])
        of_samples = (
            repeating
            * white_density
            / pattern_s
            * np.minimum(1, steps_per_sample * share_of_phases)
        )
        of_samples = of_samples + (1 - repeating) * white_density / sines.duration_s
        zeta_3 = scipy.special.zeta(3)
        if one_at_a_time:
            common = repeating * zeta_3 / np.pi**4 * (step / sines.size) ** 3
            return Rounding(of_samples, common)
        low_density = zeta_3 * step**3 / (np.pi**2 * np.sqrt(2 * np.pi) * velocity)
        return Rounding(of_samples + repeating * low_density / sines.cycle_s, np.zeros(count))

    def samples_of_pattern(self, sines: PlannedSines) -> Array:
        """Number of samples (n,) until they meet the same places of the motion again."""
        return np.array([
            Fraction(float(cycle_s) * self.rate_hz).limit_denominator(LARGEST_DENOMINATOR).numerator
            for cycle_s in sines.cycle_s
        ])  # fmt: skip


def as_torque(of_angle: Array, Z: Impedances) -> Array:
    """Errors of the angle's amplitudes as equivalent errors of the torque's, as variances (2, n):
    the imaginary part of Z (n,) exchanges the phases."""
    return np.asarray(Z.real**2 * of_angle + Z.imag**2 * of_angle[::-1])


@dataclass(frozen=True)
class Distortion:
    """Stated deviations of the joint from a linear one."""

    coulomb: float = 0.0  # Coulomb friction [N*m]
    pilot: tuple[float, ...] | None = None
    """Variances of K, B and I in an earlier trial of this kind: the joint's own contribution, such
    as that of a drivetrain with friction behind a belt, does not fall with the length of a
    record."""

    def variances(self, plan: Plan, fit: PlannedFit) -> Array:
        """Variances (3,) of K, B and I by the distortion.

        In a random motion friction scatters the estimates less than the lines (0.65 of it for K,
        0.4 for B and I), since given amplitudes fix the RMS velocity. From four realisations on the
        analysis sees this scatter, which is simulated.
        """
        sines = fit.sines
        is_periodic = isinstance(plan, PeriodicMultisine)
        few_realisations = is_periodic and sines.independent < ENOUGH_REALISATIONS
        simulated = np.zeros(3)
        at_sines = self.at_sines(fit)
        if self.coulomb and sines.spacing_hz and not few_realisations:
            scatter = scatter_of_friction(
                tuple(sines.frequency_hz.tolist()),
                tuple(sines.size.tolist()),
                tuple(fit.weight.tolist()),
                sines.spacing_hz,
                is_periodic,
            )
            simulated = self.coulomb**2 * scatter / sines.independent
            at_sines = replace(self, coulomb=0.0).at_sines(fit)
        variances = simulated + fit.share(at_sines).sum(axis=1)
        return np.asarray(np.maximum(variances, self.pilot or 0.0))

    def at_sines(self, fit: PlannedFit) -> Array:
        """Variance (2, n) [(N*m)^2] of the torque's amplitudes that Eq. 15 cannot fit.

        Notes
        -----
        Friction T sign(w) responds to a sine of amplitude a with 4 T/pi in phase with the velocity:
        no scatter, since it depends on frequency only and every repetition has it. In a random
        motion, friction less its damping (`added_damping`) has the autocorrelation
        T^2 (2/pi) (arcsin r - r), where r is that of the velocity (Van Vleck and Middleton, 1966).
        """
        sines = fit.sines
        if sines.spacing_hz is None:
            of_friction = 4 / np.pi * self.coulomb * np.ones(len(sines.w))
            as_impedance = np.asarray(1j * of_friction / sines.size, dtype=np.complex128)
            damping = fit.fitted(as_impedance)[1]
            unfitted = of_friction - damping * sines.size * sines.w
            return np.array([np.zeros_like(unfitted), unfitted**2])
        line = lines_of_sines(sines.frequency_hz, sines.spacing_hz)
        samples = samples_of_period(line)
        power_of_velocity = np.zeros(samples // 2 + 1)
        power_of_velocity[line] = (sines.size * sines.w) ** 2
        relative = power_of_velocity / power_of_velocity.sum()
        r = np.clip(np.fft.irfft(relative * samples / 2, samples), -1, 1)
        autocorrelation = 2 / np.pi * (np.arcsin(r) - r)
        power = self.coulomb**2 * 2 / samples * np.fft.rfft(autocorrelation).real[line]
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
            parts = {
                f"{np.rad2deg(amplitude):.4g} deg": np.isclose(sines.size, amplitude)
                for amplitude in plan.amplitudes
            }
        speed = sines.size * sines.w
        distance, power = sines.duration_s * speed, sines.duration_s * speed**2
        return {
            name: 4 * self.coulomb / np.pi * float(distance[part].sum() / power[part].sum())
            for name, part in parts.items()
        }


def lines_of_sines(frequency_hz: Array, spacing_hz: float) -> NDArray[np.intp]:
    """The number (n,) of each sine's line among multiples of a spacing."""
    return np.rint(frequency_hz / spacing_hz).astype(np.intp)


def samples_of_period(line: NDArray[np.intp]) -> int:
    """A power of two with `SAMPLES_PER_PERIOD` or more samples in each period of the last line."""
    return 1 << int(np.ceil(np.log2(SAMPLES_PER_PERIOD * line[-1])))


@lru_cache(maxsize=8)  # a search for the length asks for the same sines again and again
def scatter_of_friction(
    frequency_hz: tuple[float, ...],
    size: tuple[float, ...],
    filter_weight: tuple[float, ...],
    spacing_hz: float,
    periodic: bool,
) -> Array:
    """Variances (3,) of K, B and I by Coulomb friction of 1 N*m over sets of random phases.

    Parameters
    ----------
    frequency_hz, size, filter_weight : tuple[float, ...]
        Of the n sines: frequency [Hz], amplitude [rad] and squared gain of the filter.
    spacing_hz : float
        Of which the frequencies are multiples.
    periodic : bool
        Whether amplitudes are given; else the motion is noise, whose amplitudes are random, too.
    """
    w = 2 * np.pi * np.asarray(frequency_hz)
    line = lines_of_sines(np.asarray(frequency_hz), spacing_hz)
    samples = samples_of_period(line)
    draws = np.random.default_rng(1).standard_normal((2, SETS_OF_PHASES, len(line)))
    theta = draws[0] + 1j * draws[1]
    theta *= np.asarray(size) / (np.abs(theta) if periodic else np.sqrt(2))
    spectrum = np.zeros((SETS_OF_PHASES, samples // 2 + 1), dtype=np.complex128)
    spectrum[:, line] = 1j * w * theta * samples / 2
    velocity = np.fft.irfft(spectrum, samples, axis=1)
    torque = 2 / samples * np.fft.rfft(np.sign(velocity), axis=1)[:, line]
    root = np.sqrt(filter_weight)
    columns = np.stack([real_parts(root * (1j * w) ** k * theta) for k in range(3)], axis=2)
    products = np.einsum("dni,dnj->dij", columns, columns)
    with_torque = np.einsum("dni,dn->di", columns, real_parts(root * torque))
    estimates = np.linalg.solve(products, with_torque[..., None])[..., 0]
    return np.asarray(np.var(estimates, axis=0, ddof=1))


def real_parts(numbers: Impedances) -> Array:
    """Real and imaginary parts (draws, 2 n) of complex numbers (draws, n), as real equations."""
    return np.concatenate([numbers.real, numbers.imag], axis=1)
