"""What a joint that is not linear does to the fit of Eq. 15: an equivalent damping, and a scatter beside it.

Coulomb friction T sign(w) answers a sine of amplitude a by the fundamental 4 T/pi in phase with the velocity (its
describing function), and a Gaussian velocity of RMS v by the damping T (2/pi)^(1/2)/v (Bussgang, 1952). What is left of
the torque then has the autocorrelation T^2 (2/pi) (arcsin r - r), where r is that of the velocity (Van Vleck and
Middleton, Proc. IEEE 54, 1966). In a periodic motion it repeats with every period: longer records do not average it
out, other phases do. An odd multisine has it at odd lines only, since r changes its sign after half a period.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from osl_analysis.design.information import Weighted
from osl_analysis.design.plan import Continuous, PeriodicMultisine, Plan, Sines, SteppedSine
from osl_analysis.design.sensors import LineVariance, Phasors
from osl_analysis.errors import InputError
from osl_analysis.spectral.equation_error import ENOUGH_REALISATIONS
from osl_analysis.trial import Array

FINE = 64
"""Samples per period of the highest line with which the autocorrelation is computed: arcsin r has cusps."""

SAME_BAND = 0.2
"""Largest difference between the ends of two bands that count as one, as a share."""
DRAWS = 400
"""Random phases from whose scatter that of the estimates is taken: its standard error is 3.5 %."""


@dataclass(frozen=True)
class Density:
    """Density of a distortion of the torque, from an earlier trial."""

    frequency_hz: Array
    """Frequencies [Hz], increasing, shape (n,)."""
    density: Array
    """Mean square per Hz [(N*m)^2/Hz], shape (n,)."""

    def at(self, frequency_hz: Array) -> Array:
        """At other frequencies (m,) [Hz], interpolated; beyond the ends it is that of the end."""
        return np.asarray(np.interp(frequency_hz, self.frequency_hz, self.density))


@dataclass(frozen=True)
class Spread:
    """How far the estimates of one realisation of an earlier multisine were from those of another."""

    variance: Array
    """Variances of K, B and I of one realisation, shape (3,)."""
    band_hz: tuple[float, float]
    """Band of the motion [Hz]."""
    rms: float
    """Root mean square of the angle [rad]."""

    def at(self, plan: Plan) -> Array:
        """Covariance (3, 3) of K, B and I in a plan; a torque that stays when the motion grows counts for less.

        Raises
        ------
        InputError
            The plan is no multisine of this band.
        """
        frequency = plan.sines.frequency_hz
        if not isinstance(plan, PeriodicMultisine) or not np.allclose(
            [frequency.min(), frequency.max()], self.band_hz, rtol=SAME_BAND
        ):
            low, high = self.band_hz
            raise InputError(
                f"the spread of realisations of an earlier trial says nothing on another motion than a multisine from "
                f"{low:.3g} to {high:.3g} Hz; give its response.csv, or --friction"
            )
        return np.asarray(np.diag(self.variance) * (self.rms / plan.rms) ** 2 / plan.realisations)


@dataclass(frozen=True)
class Distortion:
    """How far the joint is from linear, as far as it is stated. What is stated twice counts twice."""

    coulomb: float = 0.0
    """Coulomb friction [N*m]."""
    level: float = 0.0
    """Odd distortion at the excited lines as a share of the torque there."""
    earlier: Density | None = None
    """Density of the distortion in an earlier trial. That of friction hardly depends on the size of the motion."""
    spread: Spread | None = None
    """Spread of the realisations of an earlier trial, the noise in it too."""

    @property
    def stated(self) -> bool:
        """Whether anything is."""
        return bool(self.coulomb or self.level or self.earlier or self.spread)

    def covariance(self, plan: Plan, fit: Weighted, Z: Phasors) -> Array:
        """Covariance (3, 3) of K, B and I by the distortion; `Z` (n,) is the impedance [N*m/rad] at the sines.

        A level is taken for independent from line to line, as the analysis takes that at detection lines. Estimates
        scatter by less, as of friction by 0.65 (K) and 0.4 (B, I): at given amplitudes the velocity has a given RMS, so
        that errors at its lines depend on one another. The interval of four realisations or more, from their spread,
        has it. Of friction this scatter is drawn.

        Raises
        ------
        InputError
            As `variance`.
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

    def variance(self, plan: Plan, fit: Weighted, Z: Phasors) -> LineVariance:
        """Variance [(N*m)^2] of the amplitudes of the torque's sines (n,) by what the fit of Eq. 15 cannot follow.

        `Z` (n,) is the joint's impedance [N*m/rad] at the sines. In single sines it is no scatter: it is the same in
        every repetition of the protocol, and differs from frequency to frequency. It then says how far the estimates
        depend on the choice of frequencies and amplitudes.

        Raises
        ------
        InputError
            A level or density is stated for single sines, which do not have it.
        """
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
        if not random_motion(plan):
            left = 4 / np.pi * self.coulomb * np.ones(len(sines.w))
            left -= fit.fitted(np.asarray(1j * left / sines.size, dtype=np.complex128))[1] * sines.size * sines.w
            each = 0.5 * (self.level * np.abs(Z) * sines.size) ** 2
            return LineVariance(each, each + left**2)
        power = 0.5 * (self.level * np.abs(Z) * sines.size) ** 2 + self.coulomb**2 * arcsine_power(sines, spacing(plan))
        if self.earlier:
            power += self.earlier.at(sines.frequency_hz) * lines_apart(plan)
        each = power / independent(plan)
        return LineVariance(each, each)

    def added_damping(self, plan: Plan) -> dict[str, float]:
        """B [N*m*s/rad] that friction adds: at each amplitude of a stepped sine, over the whole of another motion."""
        if not self.coulomb:
            return {}
        sines = plan.sines
        if random_motion(plan):
            return {"in all": self.coulomb * float(np.sqrt(2 / np.pi) / sines.velocity[0])}
        if not isinstance(plan, SteppedSine):
            return {"in all": self.sine_damping(sines.size, sines.w, sines.duration_s)}
        chosen = {f"{np.rad2deg(a):.4g} deg": np.isclose(sines.size, a) for a in plan.amplitudes}
        parts = {name: (sines.size[c], sines.w[c], sines.duration_s[c]) for name, c in chosen.items()}
        return {name: self.sine_damping(*part) for name, part in parts.items()}

    def sine_damping(self, size: Array, w: Array, duration_s: Array) -> float:
        """As `bench.nonlinearity.damping_of_friction`, for sines (n,) fitted for the times `duration_s`."""
        return 4 * self.coulomb / np.pi * float(np.sum(duration_s * size * w) / np.sum(duration_s * (size * w) ** 2))


def random_motion(plan: Plan) -> bool:
    """Whether many sines with random phases move the joint at a time."""
    return isinstance(plan, PeriodicMultisine) or (isinstance(plan, Continuous) and not plan.chirp)


def spacing(plan: Plan) -> float:
    """Distance [Hz] of the multiples on which the sines of a random motion lie."""
    if isinstance(plan, PeriodicMultisine):
        return 1 / plan.period_s
    frequency = plan.sines.frequency_hz
    return float(frequency[1] - frequency[0])


def lines_apart(plan: Plan) -> float:
    """Width [Hz] of the band whose distortion one sine has: of an odd multisine two lines."""
    return (2 if isinstance(plan, PeriodicMultisine) else 1) * spacing(plan)


def independent(plan: Plan) -> float:
    """Number of independent values of the distortion at one sine: realisations, or lengths of 1/spacing."""
    return plan.realisations if isinstance(plan, PeriodicMultisine) else plan.record_s * spacing(plan)


@lru_cache(maxsize=8)
def scatter_of_friction(
    frequency_hz: tuple[float, ...],
    size: tuple[float, ...],
    weight: tuple[float, ...],
    spacing_hz: float,
    periodic: bool,
) -> Array:
    """Covariance (3, 3) of K, B and I by Coulomb friction of 1 N*m, from one set of random phases to another.

    Eq. 15 is fitted to `DRAWS` of them, with a seed, for sines of these frequencies [Hz], amplitudes [rad] and squared
    filter gains, multiples of `spacing_hz`. Where they are not `periodic` but noise, amplitudes are random too.
    """
    line = np.rint(np.asarray(frequency_hz) / spacing_hz).astype(np.intp)
    w, rng = 2 * np.pi * np.asarray(frequency_hz), np.random.default_rng(1)
    n = 1 << int(np.ceil(np.log2(FINE * line[-1])))
    draws = rng.standard_normal((2, DRAWS, len(line)))
    theta = draws[0] + 1j * draws[1]
    theta *= np.asarray(size) / (np.abs(theta) if periodic else np.sqrt(2))
    spectrum = np.zeros((DRAWS, n // 2 + 1), dtype=np.complex128)
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
    """Mean square at each sine (n,) of what sign(w) leaves beside its equivalent damping; the sines are multiples of
    `spacing_hz`, to which they are rounded."""
    line = np.rint(sines.frequency_hz / spacing_hz).astype(np.intp)
    n = 1 << int(np.ceil(np.log2(FINE * line[-1])))
    power = np.zeros(n // 2 + 1)
    power[line] = (sines.size * sines.w) ** 2
    r = np.clip(np.fft.irfft(power / power.sum() * n / 2, n), -1, 1)
    left = 2 / np.pi * (np.arcsin(r) - r)
    return np.asarray(2 / n * np.fft.rfft(left).real[line])
