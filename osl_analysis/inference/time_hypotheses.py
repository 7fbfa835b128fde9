"""Time: what changes during the recording."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.inference.constants import DELAYS, MOMENTS
from osl_analysis.inference.hypothesis import (
    REFINEMENTS,
    Candidate,
    Hypothesis,
    Linear,
    OneParameter,
    Search,
)
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array

SMALL_LAGS = (1e-3, 4e-3)  # s; steps of a lag that are tried first
LONGEST_LAG_STEP = 0.15  # s; 60 lost rows of 500 Hz are 0.12 s
# nats that a change of the whole motion must gain beside a small lag before large ones are tried,
# which take time (a choice, not varied)
WORTH_A_STEP = 8.0
# share of that gain which the grid of moments must show: between two of them it is hardly twice
WORTH_REFINING_MOMENT = 0.25
LAGS_IN_A_PERIOD = 10  # steps of a lag that are tried in a period of the motion
NEWTON_STEPS = 8  # it doubles the digits of a lag in each
# which of `Whitened.step_signals` change with the whole motion, and with a stiffness
MOTION_AFTER = np.eye(5)[:3]
ANGLE_AND_ONE_AFTER = np.eye(5)[[0, 4]]


class GrowingLag(Hypothesis):
    """A torque late by a lag times a shape of time.

    The delayed motion is its Taylor series about no lag, of third order: at 6 Hz it misses 1e-5 of
    the torque for 3 ms, and 1e-3 for 10 ms.
    """

    family = "time"

    @abstractmethod
    def shape(self) -> Array:
        """Lag (w,) of each working row for a parameter of 1; nowhere above 1."""

    @cached_property
    def terms(self) -> Array:
        """Columns (4 k, m) of the series: the k columns of the motion, and their derivatives."""
        shape = self.shape()
        terms = [self.data.motion]
        for order, factor in enumerate((1.0, 2.0, 6.0), start=1):
            added = self.data.motion_at_working_rate(order) * (-shape) ** order / factor
            terms.append(self.data.windowed(added))
        return np.concatenate(terms)

    def candidates(self, search: Search) -> list[Candidate]:
        of_all_terms = self.terms
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

    def shape(self) -> Array:
        return np.clip(self.data.spectra.relative_time_at_working_rate, 0.0, 1.0)


class LagStep(Hypothesis):
    """A lag that steps once, as after lost rows: a tenth of a second and more."""

    family = "time"
    name = "lag that steps"
    term = "lag that changes at once"
    parameters = (("step of the lag", "s"),)

    def candidates(self, search: Search) -> list[Candidate]:
        # after a small lag the torque differs by its slope
        slope = np.array([[0.0, *search.coefficients, 0.0]])
        moment, left = MomentSearch(search, slope).refined()
        small = LagStepAt(self.data, moment, may_be_large=False).candidates(search)
        # after a large one it is another; where no hypothesis explains the torque, what is left
        # counts as noise
        noise = max(search.left / self.data.spectra.freedom, 1.0)
        worth = 2 * WORTH_A_STEP * noise
        of_motion = MomentSearch(search, MOTION_AFTER)
        if left - of_motion.on_grid.min() <= WORTH_REFINING_MOMENT * worth:
            return small
        moment, left_by_motion = of_motion.refined()
        if left - left_by_motion <= worth:
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
        self._is_after = data.spectra.relative_time_at_working_rate > moment
        self._early = data.motion_at_working_rate()
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

    def columns(self, values: Array) -> Array:
        late = np.array([self.data.motion_at_working_rate(delay=lag) for lag in values.tolist()])
        return self.data.windowed(np.where(self._is_after, late, self._early))


def left_by_first(candidates: Sequence[Candidate], search: Search) -> float:
    """What the first of some candidates leaves of the torque; infinite without one."""
    return search.fit(candidates[0].columns)[0] if candidates else np.inf


class MomentSearch:
    """Search for the moment after which torques best explain the rest.

    Parameters
    ----------
    search : Search
        The joint beside which they change.
    factors : Array (k, 5)
        The torques as sums of `Whitened.step_signals`.

    Attributes
    ----------
    on_grid : Array (g,)
        Sums of squares that they leave at each of the `MOMENTS`.
    """

    def __init__(self, search: Search, factors: Array) -> None:
        self._data = search.data
        self._changing = factors @ self._data.step_signals
        self._share = self._data.spectra.relative_time_at_working_rate
        # the motion's columns are the same at every moment: they are shared, too
        self._beside = search.beside_motion
        self._rest = search.rest_of_motion
        self.on_grid = self._beside.fit_products(search.steps.of_sums(factors))[0]

    def left(self, moment: float) -> float:
        """Sum of squares that they leave after a moment [share of the recording]."""
        columns = self._data.windowed(self._changing * (self._share > moment))
        return self._beside.fit_rest(columns, self._rest)[0]

    def refined(self) -> tuple[float, float]:
        """The best moment [share of the recording], and the sum of squares that it leaves."""
        best = int(np.argmin(self.on_grid))
        on_grid = MOMENTS[best]
        step = MOMENTS[1] - MOMENTS[0]
        refined = scipy.optimize.minimize_scalar(
            self.left,
            bounds=(on_grid - step, on_grid + step),
            method="bounded",
            options={"maxiter": REFINEMENTS},
        )
        if refined.fun < self.on_grid[best]:
            return float(refined.x), float(refined.fun)
        return on_grid, float(self.on_grid[best])


class StiffnessDrift(Linear):
    """A stiffness that changes evenly, as of a warming spring."""

    family = "time"
    name = "K drifts"
    term = "stiffness that changes"
    parameters = (("change of K", "N*m/rad"),)

    def added(self) -> list[Array]:
        spectra = self.data.spectra
        return [spectra.theta * (spectra.relative_time - 0.5)]

    def matrices(self) -> tuple[Array, ...]:
        return self.matrices_with_shares([[1.0], [0.0], [0.0]], (0.0, -0.5, 0.5))


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
        moment, _ = MomentSearch(search, ANGLE_AND_ONE_AFTER).refined()
        after = spectra.relative_time > moment
        matrices = self.matrices_with_shares([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]], (0.0, 1.0))
        return [self.plain(*(changing * after), matrices=matrices)]
