"""What may explain a torque: Eq. 15 alone, or with one mechanism more.

Each hypothesis is a class: its family, its term in the field, its own parameters with their units,
and how its columns are made. The first three columns multiply K, B and I:

    torque = K x_1 + B x_2 + I x_3 + further columns + offset and drift
             (+ dry friction) (+ reflex) + noise

A path, for example, delays or filters what the load cell sees of the joint's torque: its x_k are
the delayed angle, velocity and acceleration.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import scipy

from osl_analysis.inference.constants import (
    COMPLIANCES,
    DELAYS,
    FEWEST_STEPS,
    LAGS,
    MOMENTS,
    PLAYS,
    RESONANCE_DAMPING,
)
from osl_analysis.inference.least_squares import BesideShared, Products, solve_scaled
from osl_analysis.inference.spectra import Spectrum
from osl_analysis.inference.whitening import JointKind, Whitened
from osl_analysis.trial import Array

Family = Literal["", "path", "time", "speed", "size", "direction", "clipping"]
EQUATION_15 = np.eye(3)  # the first three coefficients are K, B, I
# nats that a grid must gain: below it a weight stays near its small prior, unless B or I of Eq. 15
# alone is negative, which a path may explain although it gains nothing
WORTH_REFINING = 2.0
PROFILE = np.linspace(-3.0, 3.0, 9)  # standard deviations at which a likelihood is tabulated
REFINEMENTS = 12  # evaluations of Brent's method about a minimum of the grid
OUTERMOST = (0.002, 0.998)  # quantiles of a torque that are its ends, beside noise
UNCLIPPED = 0.5  # share of the rows, about the median torque, in which nothing is cut
STOPS = np.linspace(0.05, 0.95, 10)  # quantiles of the angle at which a stop may be
SMALL_LAGS = (1e-3, 4e-3)  # s; steps of a lag that are tried first
LONGEST_LAG_STEP = 0.15  # s; 60 lost rows of 500 Hz are 0.12 s
# nats that a change of the whole motion must gain beside a small lag before large ones are tried,
# which take time (a choice, not varied)
WORTH_A_STEP = 8.0
LAGS_IN_A_PERIOD = 10  # steps of a lag that are tried in a period of the motion
CLIPPING_STEPS = 16  # the end and what is beyond it are found in turn
LAST_STEP = 1e-9  # relative change of K, B and I below which a step is the last one
NEWTON_STEPS = 8  # it doubles the digits of a lag in each
MOMENTS_AT_ONCE = 2  # two rows fill a processor's vector; more take memory only


@dataclass(frozen=True)
class ProfilePoint:
    """The best fit at one value of a hypothesis's own parameter."""

    parameter: float
    left: float  # residual sum of squares
    impedance: Array  # K, B, I (3,)


@dataclass(frozen=True)
class Candidate:
    """A hypothesis at a value of its own parameter, ready to be fitted and to predict.

    Attributes
    ----------
    hypothesis : Hypothesis
        What it is of.
    columns : Array (k, m)
        Whitened columns; the first three multiply K, B and I.
    torque : Array (m,)
        Whitened torque that they explain.
    slope : Array (m,) or None
        Derivative of the modelled torque by its own parameter.
    parameter : float
        Value of its own parameter; NaN if it has none.
    estimates : Array (k,) or None
        Coefficients of the columns at this value; None if there is no own parameter.
    profile : tuple of ProfilePoint
        Its likelihood about this value; empty if one Gaussian is enough.
    readings : tuple of Array (3, k)
        What K, B, I may mean: at the beginning or at the end, on this or on the other side.
    """

    hypothesis: "Hypothesis"
    columns: Array
    torque: Array
    slope: Array | None = None
    parameter: float = np.nan
    estimates: Array | None = None
    profile: tuple[ProfilePoint, ...] = ()
    readings: tuple[Array, ...] = ()

    def readings_of(self, width: int) -> tuple[Array, ...]:
        """The readings as matrices (3, width)."""
        if self.readings:
            return self.readings
        of_motion = self.hypothesis.data.reading
        others = np.zeros((3, width - of_motion.shape[1]))
        return (np.hstack([of_motion, others]),)


class Search:
    """Fits of columns to the torque of a joint of some kind, beside offset and drift.

    Attributes
    ----------
    data : Whitened
        The recording.
    kind : JointKind
        Whether the joint has friction, and a reflex.
    left : float
        What Eq. 15 alone leaves of the torque.
    coefficients : Array (3,) or (4,)
        Those of its motion's columns.
    impedance : Array (3,)
        Its K, B, I.
    """

    def __init__(self, data: Whitened, kind: JointKind) -> None:
        self.data, self.kind = data, kind
        self._beside = BesideShared(data.shared(kind))
        self._rest = self._beside.rest(data.torque)
        self.left, self.coefficients = self.fit(data.motion)
        self.impedance = data.reading @ self.coefficients

    def fit(self, columns: Array, torque: Array | None = None) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns (k, m)."""
        if torque is None:
            return self._beside.fit_rest(columns, self._rest)
        return self._beside.fit(columns, torque)

    @cached_property
    def may_be_path(self) -> bool:
        """Whether jerk and snap beside the motion gain anything, as they do for any path: to first
        order in its delay or compliance a path adds multiples of them to Eq. 15."""
        left, _ = self.fit(self.data.higher_motion)
        return not self.is_body or self.left - left >= 2 * WORTH_REFINING

    @property
    def is_body(self) -> bool:
        """Whether B and I of Eq. 15 alone are positive."""
        return float(self.impedance[1:].min()) > 0.0

    def products(self, columns: Array) -> Products:
        """Products of columns (k, m), whose sums `fit_products` fits."""
        return self._beside.products(columns, self._rest)

    def fit_products(self, products: Products) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns with these products."""
        return self._beside.fit_products(products)

    def minima(self, left: Callable[[float], float], grid: Array) -> list[float]:
        """Up to two minima of what is left over a parameter, the lower one first.

        A delay has a false minimum beside the true one.
        """
        values = np.array([left(x) for x in grid.tolist()])
        if self.is_body and self.left - values.min() < 2 * WORTH_REFINING:
            return []
        found = []
        for k in np.argsort(values).tolist():
            before, after = max(k - 1, 0), min(k + 1, len(grid) - 1)
            if values[k] > min(values[before], values[after]):
                continue
            ends = float(grid[before]), float(grid[after])
            refined = scipy.optimize.minimize_scalar(
                left,
                bounds=ends,
                method="bounded",
                options={"maxiter": REFINEMENTS, "xatol": 1e-4 * (ends[1] - ends[0])},
            )
            found.append((float(refined.fun), float(refined.x)))
        return [parameter for _, parameter in sorted(found)[:2]]


class Hypothesis(ABC):
    """One explanation of a recording's torque; an instance serves one recording."""

    family: ClassVar[Family]
    name: ClassVar[str]
    term: ClassVar[str]
    parameters: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Name and unit of its own parameter, if any, and of the coefficients of its own columns."""

    def __init__(self, data: Whitened) -> None:
        self.data = data

    @abstractmethod
    def candidates(self, search: Search) -> list[Candidate]:
        """Find values of its own parameter that may be; none if it gains nothing."""

    def readings(
        self, of_added: Sequence[Sequence[float]], shares: Sequence[float]
    ) -> tuple[Array, ...]:
        """What K, B, I may mean: those of Eq. 15, and shares of what added columns give them."""
        of_motion = self.data.reading
        return tuple(np.hstack([of_motion, share * np.array(of_added)]) for share in shares)

    def plain(self, *added: Array, readings: tuple[Array, ...] = ()) -> Candidate:
        """Eq. 15 with columns (p,) of the product rate."""
        columns = self.data.motion
        if added:
            columns = np.concatenate([columns, self.data.of_product(np.array(added))])
        return Candidate(self, columns, self.data.torque, readings=readings)


class Nothing(Hypothesis):
    """Eq. 15 alone."""

    family = ""
    name = "nothing"
    term = "second-order joint"

    def candidates(self, search: Search) -> list[Candidate]:
        return [self.plain()]


class Drivetrain(Hypothesis):
    """A joint rendered by a drivetrain whose actuator is not recorded: Eq. 9 in powers of s.

    Its K, B and I are those of Eq. 15 fitted to the torque of the linear drivetrain in this motion:
    what jerk and snap add, projected on angle, velocity and acceleration before any whitening.
    """

    family = ""
    name = "drivetrain"
    term = "drivetrain of higher order"
    parameters = (("jerk", "N*m*s^3/rad"), ("snap", "N*m*s^4/rad"))

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        columns = self.data.higher_motion
        in_time = scipy.fft.irfft(spectra.derivatives * spectra.roll_off, spectra.working)
        rows = in_time[:, spectra.rows]
        rows = rows - rows.mean(axis=1, keepdims=True)
        projection = np.linalg.lstsq(rows[:3].T, rows[3:].T)[0]
        reading = np.hstack([EQUATION_15, projection])
        return [Candidate(self, columns, self.data.torque, readings=(reading,))]


# ---- path: what lies between the joint's torque and its number


class OneParameter(Hypothesis):
    """A hypothesis with one parameter of its own, sought on a grid and then refined."""

    def __init__(self, data: Whitened) -> None:
        super().__init__(data)
        self._grid = frozenset(self.grid().tolist())
        self._known: dict[float, Array] = {}

    @abstractmethod
    def grid(self) -> Array:
        """Values (g,) of the parameter, ascending."""

    def columns_at(self, value: float) -> Array:
        """Whitened columns (k, m) at a value of the parameter. What depends on it is kept for the
        values of the grid, which serve every kind of joint."""
        if value in self._known:
            return self.with_others(self._known[value])
        columns = self.columns(value)
        if value in self._grid:
            self._known[value] = columns
        return self.with_others(columns)

    def columns(self, value: float) -> Array:
        """Those whitened columns that depend on the parameter."""
        raise NotImplementedError

    def with_others(self, columns: Array) -> Array:
        """All columns (k, m): those that depend on the parameter stand in place of the first ones
        of the motion."""
        others = self.data.motion[len(columns) :]
        return np.vstack([columns, others]) if len(others) else columns

    def model(self, value: float, search: Search) -> tuple[Array, Array]:
        """Columns (k, m) at a value, and the torque (m,) that they explain."""
        return self.columns_at(value), search.data.torque

    def candidates(self, search: Search) -> list[Candidate]:
        grid = self.grid()

        def left(value: float) -> float:
            return search.fit(*self.model(value, search))[0]

        return [self._candidate(value, grid, search) for value in search.minima(left, grid)]

    def _candidate(self, value: float, grid: Array, search: Search) -> Candidate:
        columns, torque = self.model(value, search)
        estimates = search.fit(columns, torque)[1]

        # derivative of the modelled torque, from a small step of the parameter
        step = 1e-3 * abs(value) + 1e-9
        columns_then, torque_then = self.model(value + step, search)
        slope = (estimates @ (columns_then - columns) - (torque_then - torque)) / step

        # the likelihood over the parameter: a Gaussian fails where it is flat
        left, _ = search.fit(columns, slope)
        sd = 1 / float(np.sqrt(max(left, np.finfo(float).tiny)))
        tried = np.unique(np.clip(value + sd * PROFILE, grid[0], grid[-1]))
        profile = []
        for near in tried.tolist():
            left, then = search.fit(*self.model(near, search))
            impedance = self.data.reading @ then[: self.data.reading.shape[1]]
            profile.append(ProfilePoint(near, left, impedance))
        return Candidate(self, columns, torque, slope, value, estimates, profile=tuple(profile))


class Path(OneParameter):
    """What lies between the joint's torque and its record."""

    family = "path"

    def candidates(self, search: Search) -> list[Candidate]:
        return super().candidates(search) if search.may_be_path else []


class Filter(Path):
    """A linear filter of the torque."""

    def grid(self) -> Array:
        return np.geomspace(*LAGS, 11)

    @abstractmethod
    def response(self, value: float) -> Spectrum:
        """Response of the path (f,)."""

    def columns(self, value: float) -> Array:
        return self.data.column(self.data.spectra.derivatives[:3] * self.response(value))


class Delay(Filter):
    """A torque that is late by a constant time, or early if it is negative."""

    name = "delay"
    term = "late torque"
    parameters = (("delay", "s"),)

    def grid(self) -> Array:
        return np.linspace(*DELAYS, 26)

    def response(self, value: float) -> Spectrum:
        return np.asarray(np.exp(-value * self.data.spectra.s))


class LowPass(Filter):
    """A torque behind a low-pass of first order."""

    name = "low-pass"
    term = "low-pass of the torque"
    parameters = (("time constant", "s"),)

    def response(self, value: float) -> Spectrum:
        return 1 / (1 + value * self.data.spectra.s)


class SecondOrderLowPass(Filter):
    """A torque behind a Butterworth low-pass of second order."""

    name = "low-pass of second order"
    term = "low-pass of the torque"
    parameters = (("time constant", "s"),)

    def response(self, value: float) -> Spectrum:
        of_corner = value * self.data.spectra.s
        return np.asarray(1 / (1 + np.sqrt(2.0) * of_corner + of_corner**2))


class MovingMean(Filter):
    """A torque that is the mean over the time before, or is held for that time."""

    name = "moving mean"
    term = "averaged or held torque"
    parameters = (("duration", "s"),)

    def response(self, value: float) -> Spectrum:
        spectra = self.data.spectra
        held = np.exp(-value / 2 * spectra.s) * np.sinc(value * spectra.frequency)
        return np.asarray(held)


class Resonance(Filter):
    """A torque behind a frame that resonates."""

    name = "resonance"
    term = "resonance of the path"
    parameters = (("period over 2 pi", "s"),)

    def grid(self) -> Array:
        return super().grid()[4:]

    def response(self, value: float) -> Spectrum:
        of_corner = value * self.data.spectra.s
        return 1 / (1 + RESONANCE_DAMPING * of_corner + of_corner**2)


class SeriesSpring(Path):
    """A spring between the angle's encoder and the joint.

    With Z = K + B s + I s^2 and the compliance c the torque is Z/(1 + c Z) theta, which is not
    linear in K, B and I: Gauss-Newton steps linearise it.
    """

    name = "spring in series"
    term = "yielding bench"
    parameters = (("compliance", "rad/(N*m)"),)

    def grid(self) -> Array:
        return np.geomspace(*COMPLIANCES, 9)

    def model(self, value: float, search: Search) -> tuple[Array, Array]:
        spectra = self.data.spectra
        powers = spectra.s ** np.arange(3)[:, None]
        impedance = search.impedance
        columns, torque = self.data.motion, self.data.torque
        for _ in range(4):
            of_joint = impedance @ powers
            gain = 1 / (1 + value * of_joint)
            columns = self.data.column(spectra.derivatives[:3] * gain**2)
            modelled = self.data.column(spectra.derivatives[0] * of_joint * gain)
            torque = self.data.torque - (modelled - impedance @ columns)
            impedance = search.fit(columns, torque)[1]
        return columns, torque


# ---- time: what changes during the recording


class GrowingLag(Hypothesis):
    """A torque late by a lag times a shape of time.

    The delayed motion is its Taylor series about no lag, of third order: at 6 Hz it misses 1e-5 of
    the torque for 3 ms, and 1e-3 for 10 ms.
    """

    family = "time"

    @abstractmethod
    def shape(self, search: Search) -> Array:
        """Lag (w,) of each working row for a parameter of 1; nowhere above 1."""

    def candidates(self, search: Search) -> list[Candidate]:
        shape = self.shape(search)
        terms = [self.data.motion]
        for order, factor in enumerate((1.0, 2.0, 6.0), start=1):
            added = self.data.motion_at_working_rate(order) * (-shape) ** order / factor
            terms.append(self.data.windowed(added))
        of_all_terms = np.concatenate(terms)

        # columns and slope are sums of the terms' columns, whose products are enough to fit them
        products = search.products(of_all_terms)
        lag = 0.0
        for _ in range(NEWTON_STEPS):
            columns = self.sums_of_terms([1.0, lag, lag**2, lag**3])
            slopes = self.sums_of_terms([0.0, 1.0, 2 * lag, 3 * lag**2])
            estimates = search.fit_products(products.of_sums(columns))[1]
            slope = estimates @ slopes
            with_slope = products.of_sums(np.vstack([columns, slope]))
            more = search.fit_products(with_slope)[1][-1]
            moved = float(np.clip(lag + more, *DELAYS))
            if abs(moved - lag) < 1e-8:
                break
            lag = moved
        return [
            Candidate(
                self,
                columns=columns @ of_all_terms,
                torque=self.data.torque,
                slope=slope @ of_all_terms,
                parameter=lag,
                estimates=estimates,
            )
        ]

    def sums_of_terms(self, weights: Sequence[float]) -> Array:
        """Factors (k, 4 k) that sum the terms of each of the k columns of the motion with these
        weights."""
        each_column = np.eye(len(self.data.motion))
        return np.hstack([weight * each_column for weight in weights])


class DriftingClocks(GrowingLag):
    """Clocks of two devices that drift apart, from no lag at the first row."""

    name = "clocks"
    term = "clocks that drift apart"
    parameters = (("lag at the end", "s"),)

    def shape(self, search: Search) -> Array:
        return np.clip(self.data.spectra.share_at_working_rate, 0.0, 1.0)


class LagStep(Hypothesis):
    """A lag that steps once, as after lost rows: a tenth of a second and more."""

    family = "time"
    name = "lag that steps"
    term = "lag that changes at once"
    parameters = (("step of the lag", "s"),)

    def candidates(self, search: Search) -> list[Candidate]:
        # after a small lag the torque differs by its slope
        slope = search.coefficients @ self.data.motion_at_working_rate(1)
        moment, left = best_moment(search, slope[None])
        small = LagStepAt(self.data, moment, may_be_large=False).candidates(search)
        # after a large one it is another; where no hypothesis explains the torque, what is left
        # counts as noise
        noise = max(search.left / self.data.spectra.freedom, 1.0)
        moment, left_by_motion = best_moment(search, self.data.motion_at_working_rate())
        if left - left_by_motion <= 2 * WORTH_A_STEP * noise:
            return small
        large = LagStepAt(self.data, moment, may_be_large=True).candidates(search)
        return min(small, large, key=lambda tried: left_by_first(tried, search))


class LagStepAt(OneParameter):
    """A lag that steps at a moment.

    Parameters
    ----------
    data : Whitened
        The recording.
    moment : float
        When it steps [share of the recording].
    may_be_large : bool
        Whether steps beyond 8 ms are tried, up to `LONGEST_LAG_STEP`.
    """

    family = LagStep.family
    name = LagStep.name
    term = LagStep.term
    parameters = LagStep.parameters

    def __init__(self, data: Whitened, moment: float, may_be_large: bool) -> None:
        self._may_be_large = may_be_large
        self._is_after = data.spectra.share_at_working_rate > moment
        super().__init__(data)

    def grid(self) -> Array:
        larger = np.array([2 * SMALL_LAGS[-1]])
        if self._may_be_large:
            spectra = self.data.spectra
            alpha, omega = spectra.alpha[spectra.inside], spectra.omega[spectra.inside]
            period = 2 * np.pi * float(np.sqrt(np.mean(omega**2) / np.mean(alpha**2)))
            step = period / LAGS_IN_A_PERIOD
            larger = np.arange(max(step, larger[0]), LONGEST_LAG_STEP + step, step)
        later = np.concatenate([SMALL_LAGS, larger])
        return np.concatenate([-later[::-1], [0.0], later])

    def columns_at(self, value: float) -> Array:
        return self.columns(value)  # those of another moment serve nobody

    def columns(self, value: float) -> Array:
        early = self.data.motion_at_working_rate()
        late = self.data.motion_at_working_rate(delay=value)
        return self.data.windowed(np.where(self._is_after, late, early))


def left_by_first(candidates: Sequence[Candidate], search: Search) -> float:
    """What the first of some candidates leaves of the torque; infinite without one."""
    return search.fit(candidates[0].columns)[0] if candidates else np.inf


def best_moment(search: Search, changing: Array) -> tuple[float, float]:
    """The moment [share of the recording] after which torques (k, w) best explain the rest, and the
    sum of squares that they leave."""
    data = search.data
    share = data.spectra.share_at_working_rate
    # the motion's columns are the same at every moment: they are shared, too
    beside = BesideShared(np.concatenate([data.shared(search.kind), data.motion]))
    rest = beside.rest(data.torque)

    def left(moment: float) -> float:
        return beside.fit_rest(data.windowed(changing * (share > moment)), rest)[0]

    # a few moments at once: transforms of many rows cost less than one by one, and more memory
    on_grid_left = []
    for first in range(0, len(MOMENTS), MOMENTS_AT_ONCE):
        moments = np.array(MOMENTS[first : first + MOMENTS_AT_ONCE])
        after = share > moments[:, None, None]
        on_grid_left += [
            beside.fit_rest(columns, rest)[0] for columns in data.windowed(changing * after)
        ]
    best = int(np.argmin(on_grid_left))
    on_grid = MOMENTS[best]
    step = MOMENTS[1] - MOMENTS[0]
    refined = scipy.optimize.minimize_scalar(
        left,
        bounds=(on_grid - step, on_grid + step),
        method="bounded",
        options={"maxiter": REFINEMENTS},
    )
    if refined.fun < on_grid_left[best]:
        return float(refined.x), float(refined.fun)
    return on_grid, on_grid_left[best]


class StiffnessDrift(Hypothesis):
    """A stiffness that changes evenly, as of a warming spring."""

    family = "time"
    name = "K drifts"
    term = "stiffness that changes"
    parameters = (("change of K", "N*m/rad"),)

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        readings = self.readings([[1.0], [0.0], [0.0]], (0.0, -0.5, 0.5))
        added = spectra.theta * (spectra.share - 0.5)
        return [self.plain(added, readings=readings)]


class StiffnessStep(Hypothesis):
    """A stiffness that steps once."""

    family = "time"
    name = "K steps"
    term = "stiffness that changes"
    parameters = (("step of K", "N*m/rad"), ("step of the torque", "N*m"))

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        # about the spring's own zero, which nobody knows, so that the torque steps, too
        changing = np.array([spectra.theta, np.ones_like(spectra.theta)])
        at_working_rate = self.data.motion_at_working_rate()[0]
        both = np.array([at_working_rate, np.ones_like(at_working_rate)])
        moment, _ = best_moment(search, both)
        after = spectra.share > moment
        readings = self.readings([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]], (0.0, 1.0))
        return [self.plain(*(changing * after), readings=readings)]


# ---- speed


class QuadraticDamping(Hypothesis):
    """A damping that grows with the speed."""

    family = "speed"
    name = "damping by speed"
    term = "damping that depends on speed"
    parameters = (("quadratic damping", "N*m*s^2/rad^2"),)

    def candidates(self, search: Search) -> list[Candidate]:
        omega = self.data.spectra.omega
        return [self.plain(omega * np.abs(omega))]


class Play(OneParameter):
    """Play before the spring: the spring follows the angle when a gap is taken up."""

    family = "speed"
    name = "play"
    term = "backlash"
    parameters = (("play", "rad"),)

    def grid(self) -> Array:
        return gaps(self.data)

    def columns(self, value: float) -> Array:
        return self.data.behind_gap(value, is_kept=value in self._grid)[:1]


class PlayBeforeDamper(Play):
    """Play before spring and damper."""

    name = "play before spring and damper"

    def columns(self, value: float) -> Array:
        return self.data.behind_gap(value, is_kept=value in self._grid)


def gaps(data: Whitened) -> Array:
    """Widths (8,) of a gap [rad], from what rounding cannot be."""
    least = max(PLAYS[0], FEWEST_STEPS * data.spectra.signals.encoder_step)
    return np.geomspace(least, max(PLAYS[1], 2 * least), 8)


# ---- size


class Hardening(Hypothesis):
    """A spring whose stiffness changes with the angle, about any centre."""

    family = "size"
    name = "hardening"
    term = "spring that is not linear"
    parameters = (("quadratic stiffness", "N*m/rad^2"), ("cubic stiffness", "N*m/rad^3"))

    def candidates(self, search: Search) -> list[Candidate]:
        angle = self.data.spectra.angle
        return [self.plain(angle**2, angle**3)]


class StiffnessBySide(Hypothesis):
    """A spring with another stiffness on either side of the middle."""

    family = "size"
    name = "K by side"
    term = "asymmetric torque"
    parameters = (("half the difference of K", "N*m/rad"),)

    def candidates(self, search: Search) -> list[Candidate]:
        readings = self.readings([[1.0], [0.0], [0.0]], (0.0, 1.0, -1.0))
        return [self.plain(np.abs(self.data.spectra.angle), readings=readings)]


class EndStop(OneParameter):
    """A spring that is stiffer or softer beyond an angle, as behind a stop of one side."""

    family = "size"
    name = "end stop"
    term = "spring that is not linear"
    parameters = (("angle of the stop from the mean", "rad"), ("change of K", "N*m/rad"))

    def grid(self) -> Array:
        spectra = self.data.spectra
        return np.asarray(np.quantile(spectra.angle[spectra.inside], STOPS))

    def columns(self, value: float) -> Array:
        beyond = np.maximum(self.data.spectra.angle - value, 0.0)
        return self.data.of_product(beyond[None])

    def with_others(self, columns: Array) -> Array:
        return np.vstack([self.data.motion, columns])


class DeadZone(OneParameter):
    """A gap about the middle in which the spring does not act."""

    family = "size"
    name = "dead zone"
    term = "backlash"
    parameters = (("dead zone", "rad"),)

    def grid(self) -> Array:
        return gaps(self.data)

    def columns(self, value: float) -> Array:
        spectra = self.data.spectra
        beyond = spectra.theta - np.clip(spectra.angle, -value / 2, value / 2)
        return self.data.of_product(beyond[None])


# ---- direction


class DampingByDirection(Hypothesis):
    """Another damping in each direction of motion."""

    family = "direction"
    name = "B by direction"
    term = "asymmetric torque"
    parameters = (("half the difference of B", "N*m*s/rad"),)

    def candidates(self, search: Search) -> list[Candidate]:
        readings = self.readings([[0.0], [1.0], [0.0]], (0.0, 1.0, -1.0))
        return [self.plain(np.abs(self.data.spectra.omega), readings=readings)]


class StiffnessByDirection(Hypothesis):
    """Another stiffness in each direction of motion."""

    family = "direction"
    name = "K by direction"
    term = "asymmetric torque"
    parameters = (("half the difference of K", "N*m/rad"),)

    def candidates(self, search: Search) -> list[Candidate]:
        return [self.plain(self.data.spectra.angle * self.data.sign)]


# ---- clipping


class Clipping(Hypothesis):
    """A torque of which one or both ends are cut; K, B and I predict what is missing.

    An end is the median of what is recorded where more is predicted: noise is added after an
    amplifier has cut, so that the largest samples are beyond it.
    """

    family = "clipping"
    name = "clipping"
    term = "clipped signal"

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        recorded = spectra.recorded_torque
        low, high = np.quantile(recorded[spectra.inside], OUTERMOST)
        motion = self.data.motion_at_product_rate().copy()
        motion[0] = spectra.angle
        # Eq. 15 of a cut torque hardly passes its ends: begin with the rows that are surely not cut
        ends = np.quantile(recorded[spectra.inside], [(1 - UNCLIPPED) / 2, (1 + UNCLIPPED) / 2])
        small = spectra.inside & (recorded > ends[0]) & (recorded < ends[1])
        beside = np.vstack([motion, np.ones_like(recorded), spectra.share])
        coefficients = solve_scaled(beside[:, small], recorded[small])[: len(motion)]
        torque = self.data.torque
        for _ in range(CLIPPING_STEPS):
            ends_before = (low, high)
            coefficients_before = coefficients
            modelled = coefficients @ motion
            size = np.abs(modelled - np.median(modelled[spectra.inside]))
            small = spectra.inside & (size <= np.quantile(size[spectra.inside], UNCLIPPED))
            modelled = modelled + np.median((recorded - modelled)[small])
            above = spectra.inside & (modelled > high)
            below = spectra.inside & (modelled < low)
            if above.any():
                high = float(np.median(recorded[above]))
            if below.any():
                low = float(np.median(recorded[below]))
            missing = modelled - np.clip(modelled, low, high)
            torque = self.data.torque + self.data.of_product(missing)
            coefficients = search.fit(self.data.motion, torque)[1]
            change = np.abs(coefficients - coefficients_before)
            has_moved = bool((change > LAST_STEP * np.abs(coefficients)).any())
            if (low, high) == ends_before and not has_moved:
                break
        return [Candidate(self, self.data.motion, torque)]


SOUND: tuple[type[Hypothesis], ...] = (Nothing,)
PATHS: tuple[type[Hypothesis], ...] = (
    Delay,
    LowPass,
    SecondOrderLowPass,
    MovingMean,
    Resonance,
    SeriesSpring,
)
OTHER_FAULTS: tuple[type[Hypothesis], ...] = (
    DriftingClocks,
    LagStep,
    StiffnessDrift,
    StiffnessStep,
    QuadraticDamping,
    Play,
    PlayBeforeDamper,
    Hardening,
    StiffnessBySide,
    EndStop,
    DeadZone,
    DampingByDirection,
    StiffnessByDirection,
    Clipping,
)


def hypotheses_for(data: Whitened) -> list[Hypothesis]:
    """All hypotheses that compete for a recording.

    Of a drivetrain none is a fault: it delays and filters the torque by itself, and its friction
    changes more than most faults do.
    """
    kinds = (*SOUND, *PATHS, *OTHER_FAULTS)
    if data.spectra.actuator_spectrum is not None:
        kinds = SOUND
    elif data.spectra.signals.has_drivetrain:
        kinds = (*SOUND, Drivetrain)
    return [kind(data) for kind in kinds]
