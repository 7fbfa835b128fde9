"""A general witness: estimates must not depend on which part of a recording one looks at.

Terms that the model lacks are tested in families: higher derivatives (a path that delays or filters
the torque, or yields), and terms in time, speed, size and direction. A family is heard if its test
has a p-value below 1 in 3000. The test takes its covariance from the scatter between chunks of the
recording, so that it holds for noise of any colour. If a family is heard, rival explanations of the
misfit are fitted, each with its own K, B and I. All rivals that cannot be told apart are given.

Angle and torque are band-passed to the motion's own band, so that drift and slow disturbances are
no evidence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.effects import (
    LAG_FOUND,
    LONGEST_LAG,
    clocks_row,
    shapes_of_friction,
    spring_that_slips,
)
from osl_analysis.bench.gram import solved
from osl_analysis.bench.record import Record
from osl_analysis.measured import rms
from osl_analysis.signals import seven_point_motion
from osl_analysis.stats.regression import Row, less
from osl_analysis.trial import Array

CHUNKS = 24  # parts of a recording; the covariance comes from the scatter of their scores
# highest end of the witness's band: above it, rounding of the angle raises false alarms
HIGHEST_HZ = 8.0
# second band: it shows a late torque better if the motion is by hand or in steps
FAST_HZ = (2.0, 12.0)
# the band ends where the angle's power falls below this multiple of its noise: a snap would be
# noise
TELLS = 100.0
# a higher derivative counts if its own part exceeds these multiples of its noise and of its RMS
OWN = 3.0, 1e-4
# effective number of chunks that must hold this remainder: two steady sines give 1.4 to 3.4
TELLING = 4.0
RATE_HZ = 50.0  # sampling rate of the columns whose products are summed
HEARD = -3.5  # log10 of the p-value below which a family is heard
FRICTION = -4.0  # the same for Coulomb friction, which then joins the model
# standard errors, paired by chunks, within which the misfits of two rivals do not differ
ALIKE = 3.0
# one of many rivals may fit better by chance, by as much as this many parameters fitted to noise
CHANCE = 10.0
# a lag that changes at once is heard if it leaves less than this share of what a constant lag
# leaves
JUMPS = 0.4
UNEXPLAINED = 0.7  # an equally good rival may miss at most this share of what the best one explains
# share of the misfit: rivals that leave less are told even if certain friction leaves K, or B, open
EXPLAINS = 0.1
# friction may be the cause if it explains this share of what the best rival does; early torque: 0.3
RUBBING = 0.5
# paths are alike if their misfits differ by less than this share: their models are approximate
NEAR_PATH = 0.15
MOMENTS = np.arange(6, 19) / CHUNKS  # shares of the fitted rows after which K, or a lag, may change
# a muscle's low-pass; delays of reflexes, as an ankle's data need
MUSCLE_HZ, REFLEX_S = 6.0, (0.02, 0.04, 0.06, 0.1)
SLOW = 0.02  # share of the velocity's SD at which friction has changed its sign
# rivals are named only if the best leaves no more than this share of the torque's variance
MOST_LEFT = 0.05
HIDDEN = 0.1  # share of the inertia that an unheard delay may explain
HIDDEN_OF_B = 0.03  # the same for the damping
# kg*m^2 and N*m*s/rad, added in quadrature before these shares are taken
LEAST_INERTIA, LEAST_DAMPING = 1e-3, 0.1
USELESS = 3.0  # a range wider than this multiple of the estimate says nothing
HARM = {"K": (0.003, 2.0), "B": (0.01, 2.0), "I": (0.02, 5e-3)}
"""Relative change of an estimate that does harm, and the size [SI] added in quadrature to the
estimate beforehand."""
# families that no test hears, and that raise no doubt by themselves
UNHEARD = ("reflex", "friction")
FAMILIES = ("path", "time", "speed", "size", "direction", "friction")


@dataclass(frozen=True)
class Rival:
    """A possible cause of a misfit."""

    family: str
    name: str
    estimates: Array  # K, B and I of the fit with it
    half: Array  # half-widths of their 95 % intervals, from the scatter of chunks and rounding
    left: Array  # residual torque in each row
    parameters: int
    beside: tuple[Array, ...] = ()  # its columns (m,) beyond those of the model

    @property
    def possible(self) -> bool:
        """Whether neither damping nor inertia is negative; at the false minimum of a delay one of
        them is."""
        return bool(np.all(self.estimates[-2:] >= 0))


class View:
    """Angle and torque of a record, band-passed to its motion, and columns of them, in chunks."""

    def __init__(
        self, record: Record, first: int = 0, rubs: bool = False, fast: bool = False
    ) -> None:
        """`first`: lowest derivative of the angle in the model; `rubs`: friction is certain;
        `fast`: the band is `FAST_HZ`."""
        few, self.first = record.coarse, first
        self.n, self.rate_hz = len(few.time), few.rate_hz
        self.padded = int(scipy.fft.next_fast_len(self.n + int(2 * few.rate_hz), real=True))
        self.f = f = np.maximum(np.fft.rfftfreq(self.padded, 1 / few.rate_hz), 1e-9)
        fitted = np.zeros(self.n, dtype=np.bool_)
        fitted[few.rows()] = True
        # rows that depend on the filter's padding
        edge = int(2 * few.rate_hz / few.low_pass.cutoff_hz)
        fitted[:edge] = fitted[self.n - edge :] = False
        first_row, last = np.flatnonzero(fitted)[[0, -1]].tolist()
        self.inside = slice(first_row, last + 1)
        # for products: they contain its trend, too
        self.away = few.motion.theta - few.motion.theta[self.inside].mean()
        theta, torque = few.motion.theta, few.filtered_torque
        # an interpolated torque is not the joint's, and the band-pass spreads it over seconds
        if not few.usable.all():
            Z = np.column_stack([few.motion.columns, np.ones(self.n)])
            torque = np.where(few.usable, torque, Z @ np.linalg.lstsq(Z[fitted], torque[fitted])[0])
        theta, torque = (between_ends(x, few.rate_hz) for x in (theta, torque))
        self.motion, self.torques = [theta, few.motion.omega, few.motion.alpha], [torque]
        for signals, number in ((self.motion, 5), (self.torques, 3)):
            while len(signals) < number:
                higher = seven_point_motion(few.time, signals[-1], few.rate_hz)
                signals += [higher.omega, higher.alpha]
        power = np.cumsum(np.abs(self.spectrum(theta)) ** 2 * (f > 0.02))
        low, high = (float(f[np.searchsorted(power, share * power[-1])]) for share in (0.02, 0.999))
        low, high = float(np.clip(0.5 * low, 0.03, 0.4)), min(2.5 * high, HIGHEST_HZ)
        if fast:
            low, high = FAST_HZ
        hz, power = scipy.signal.welch(
            few.part(few.motion.theta), few.rate_hz, nperseg=min(1000, few.samples)
        )
        noisy = hz[
            (hz > max(low, 1.0)) & (power < TELLS * record.noise[0] * few.low_pass.gain(hz) ** 2)
        ]
        high = max(min([high, *noisy[:1].tolist()]), low + 1)
        self.band = 1 / (1 + (f / high) ** 12) / (1 + (low / f) ** 12)
        self.bandwidth = high - low
        self.time = (few.time - few.time.mean()) / float(np.ptp(few.time))
        self.seconds = float(np.ptp(few.time))
        self.few = round(self.padded * RATE_HZ / few.rate_hz)
        at = np.rint(np.arange(self.few) * self.padded / self.few).astype(np.intp)
        self.rows = np.flatnonzero((at < self.n) & fitted[np.minimum(at, self.n - 1)])
        self.moments = np.quantile(self.time[at[self.rows]], MOMENTS)
        self.edges = -(-np.arange(CHUNKS + 1) * len(self.rows) // CHUNKS)  # of chunks
        self.y, self.columns = self.column(torque), [self.column(x) for x in self.motion[:5]]
        self.base = self.columns[first:3]
        # the band-pass keeps the slopes of a drift at its ends
        self.slow = [self.column(self.time**k) for k in (2, 3)]
        # of the angle [rad**2/Hz]
        self.noise = record.noise[0] * (few.low_pass.gain(f) * self.band) ** 2
        self.step, rounded = record.steps[0] or 0.0, record.rounded
        self.rounded = [self.column(x - x.mean()) for x in ([] if rounded is None else rounded)]
        self.record, self.rubs, self.swift = record, rubs, record.swift_omega
        self.turns = max(SLOW * float(self.swift.std()), 1e-9)
        self.sign = np.asarray(np.tanh(self.swift / self.turns))

    def higher(self) -> list[Array]:
        """The third and fourth derivative, each if it exceeds its noise and what lower ones
        explain, in enough chunks. Two steady sines show a fourth one only at their ends, and the
        scatter of few chunks is no measure."""
        Z, found = np.array(self.columns[:3]), list[Array]()
        for k, x in enumerate(self.columns[3:], 3):
            own = x - solved(Z @ Z.T, Z @ x)[0] @ Z
            noise = float(np.trapezoid((2 * np.pi * self.f) ** (2 * k) * self.noise, self.f)) ** 0.5
            in_chunks = np.add.reduceat(own**2, self.edges[:-1])
            if in_chunks.sum() ** 2 > TELLING * in_chunks @ in_chunks:
                found += [x] * (rms(own) > float(np.hypot(OWN[0] * noise, OWN[1] * rms(x))))
        return found

    def spectrum(self, x: Array) -> NDArray[np.complex128]:
        """Spectrum of the fitted part of a signal (n,), less the line between its ends; linear
        relations of samples hold for it. Derivatives are taken in time: from a spectrum they would
        ring at ends where the joint moves."""
        within = np.zeros(self.padded)
        within[self.inside] = between_ends(x[self.inside], self.rate_hz)
        return np.asarray(np.fft.rfft(within))

    def passed(self, spectrum: NDArray[Any]) -> Array:
        """The column of the signal with this spectrum, which is of the whole signal: filters
        remember the past."""
        return self.column(np.fft.irfft(spectrum, self.padded)[: self.n])

    def column(self, x: Array) -> Array:
        """The fitted rows (m,) of a signal (n,), band-passed."""
        kept = (self.spectrum(x) * self.band)[: self.few // 2 + 1]
        return np.asarray(np.fft.irfft(kept, self.few)[self.rows]) * (self.few / self.padded)

    @cached_property
    def friction(self) -> list[Array]:
        """Columns of friction: sliding, and each shape of it about rest."""
        return [self.column(x) for x in shapes_of_friction(self.record).values()]

    @cached_property
    def curved(self) -> list[Array]:
        """Columns of a spring that stiffens with the angle: with both its centre may lie
        anywhere."""
        return [self.column(self.away**2), self.column(self.away**3)]

    def sign_errors(self) -> list[Array]:
        """Errors of the velocity's sign due to rounding of the angle."""
        slower = (np.gradient(error, 1 / self.rate_hz) for error in self.record.coarse_roundings(0))
        return [
            self.column(np.tanh((self.swift + more) / self.turns) - self.sign) for more in slower
        ]

    def sums(self, columns: Sequence[Array]) -> Array:
        """Products (CHUNKS, q + 1, q + 1) of columns (m,) and the torque, in each chunk."""
        Z = np.array([*columns, self.y])
        return np.array([Z[:, a:b] @ Z[:, a:b].T for a, b in pairwise(self.edges)])


def between_ends(x: Array, rate_hz: float) -> Array:
    """A signal less the straight line between its ends; a straight line becomes zero."""
    edge = max(int(0.2 * rate_hz), 4)
    first, last = float(x[:edge].mean()), float(x[-edge:].mean())
    return np.asarray(
        x - first - (last - first) / (len(x) - edge) * (np.arange(len(x)) - (edge - 1) / 2)
    )


def square(x: Array) -> float:
    return float(x @ x)


def scattered(sums: Array) -> tuple[Array, Array]:
    """Estimates (q,) of sums (chunks, q + 1, q + 1), and their covariance from the scatter of
    chunks."""
    A, b = sums[:, :-1, :-1], sums[:, :-1, -1]
    estimates, inverse = solved(A.sum(axis=0), b.sum(axis=0))
    scores = (b - A @ estimates) @ inverse
    return estimates, scores.T @ scores * len(sums) / (len(sums) - 1)


def wald(sums: Array, base: Sequence[int], added: Sequence[int], draws: int) -> tuple[float, Array]:
    """The p-value (log10) of added columns beside those of the base, and their estimates. Before
    the torque the sums hold `draws` torques that rounding may cause: the scatter of chunks misses
    errors that all chunks share."""
    at, q, chunks = [*base, *added], len(added), len(sums)
    estimates, covariance = scattered(sums[np.ix_(range(chunks), [*at, -1], [*at, -1])])
    z = estimates[-q:]

    def chance(covariance: Array) -> float:
        F = float(z @ np.linalg.pinv(covariance[-q:, -q:], rcond=1e-9, hermitian=True) @ z) / q
        return float(
            scipy.stats.f.logsf(F * (chunks - q) / (chunks - 1), q, chunks - q) / np.log(10)
        )

    by_scatter = chance(covariance)
    if not draws or by_scatter >= HEARD:
        return by_scatter, z
    each = [
        scattered(sums[np.ix_(range(chunks), [*at, k], [*at, k])]) for k in range(-1 - draws, -1)
    ]
    made, seen = (np.array(values) for values in zip(*each, strict=True))
    by_both = chance(covariance + less(made.T @ made / draws, np.diag(seen.mean(axis=0))))
    return by_scatter if by_both < HEARD else by_both, z


class Court:
    """The families that are heard in a view, if it `hears` any, and their rivals. Certain friction,
    weight and the columns `taken` (m,) are part of the model. A reflex competes only if the joint
    `answers`."""

    def __init__(
        self, view: View, hears: bool = True, answers: bool = True, taken: Sequence[Array] = ()
    ) -> None:
        self.view, self.rivals, self.chance = view, list[Rival](), dict[str, float]()
        # share of what the best rival explains that a reflex explains; no reflex: none
        self.by_reflex = -np.inf
        self.answers = answers and view.first == 0
        self.beside = [*view.slow, *[view.columns[0]] * (view.first == 1), *taken]
        omega, elastic = view.motion[1], view.first == 0
        columns, draws = [*view.base, *self.beside, view.column(view.sign)], view.rounded
        sign = len(columns) - 1
        models = [range(sign)]
        by_friction, (size,) = wald(view.sums([*columns, *draws]), models[0], [sign], len(draws))
        if view.rubs or (by_friction < FRICTION and size > 0):
            self.beside.append(columns[-1])
            models = [range(sign + 1)]
        if view.rubs:
            self.beside += view.friction
            columns, draws = (
                [*columns, *view.friction],
                [*draws, *(size * x for x in view.sign_errors())],
            )
            models.append(range(len(columns)))
        self.draws = draws
        if not hears:
            return
        lacking = {
            "path": view.higher(),
            "time": [view.column(x * view.time) for x in view.motion[view.first : 3]],
            "moment": [
                view.column(view.motion[view.first] * (view.time > at)) for at in view.moments
            ],
            "speed": [view.column(omega * np.abs(omega))],
            "size": [view.curved[-1], view.column(np.abs(view.away))] * elastic,
            "direction": [
                view.column(np.abs(omega)),
                *[view.column(view.away * view.sign)] * elastic,
            ],
        }
        places = dict[str, range]()
        for name, added in lacking.items():
            places[name] = range(len(columns), len(columns) + len(added))
            columns += added
        sums = view.sums([*columns, *draws])

        def chance(added: Sequence[int]) -> float:
            return max(wald(sums, model, added, len(draws))[0] for model in models)

        moments = places.pop("moment")
        self.chance = {name: chance(at) for name, at in places.items() if at}
        at_once = [chance([at]) for at in moments]
        # in shorter chunks a change at some moment arises by chance
        if len(view.rows) > CHUNKS * RATE_HZ:
            self.chance["time"] = min(
                self.chance["time"], *(chance + np.log10(len(at_once)) for chance in at_once)
            )
        if self.late_at_once[1] < JUMPS * self.left([*view.base, view.column(self.slope)]):
            # this misfit inflates the scatter of chunks
            self.chance["time"] = min(self.chance["time"], 2 * HEARD)
        if size < 0:  # negative friction: play, or damping that falls with speed
            self.chance["speed"] = min(self.chance["speed"], by_friction - FRICTION)

    def fitted(self, columns: Sequence[Array]) -> tuple[Array, Array]:
        """Estimates, and the residual torque in each row."""
        Z = np.array([*columns, *self.beside])
        estimates, _ = solved(Z @ Z.T, Z @ self.view.y)
        return estimates, self.view.y - estimates @ Z

    def left(self, columns: Sequence[Array]) -> float:
        return square(self.fitted(columns)[1])

    def add(
        self,
        family: str,
        name: str,
        columns: Sequence[Array],
        slopes: Sequence[Array] = (),
        parameters: int = 0,
    ) -> None:
        """Add a rival by its columns, those of the model first; `slopes` (m,) are derivatives by
        its own parameters."""
        estimates, left = self.fitted(columns)
        of_model, Z = slice(len(self.view.base)), np.array([*columns, *slopes, *self.beside])
        variance = np.diag(scattered(self.view.sums([*Z]))[1])
        if self.draws:  # rounding error that is alike in all chunks
            variance = variance + np.mean(
                (np.array(self.draws) @ Z.T @ np.linalg.pinv(Z @ Z.T)) ** 2, axis=0
            )
        half = scipy.stats.t.ppf(0.975, CHUNKS - 1) * np.sqrt(variance[of_model])
        known, beside = len(columns) + parameters, tuple(columns[of_model.stop :])
        self.rivals.append(Rival(family, name, estimates[of_model], half, left, known, beside))

    def add_by(
        self, family: str, name: str, made: Callable[[float], list[Array]], grid: Array
    ) -> None:
        """Add rivals whose columns depend on a parameter, at up to two minima: a delay has a false
        one."""
        for size in minima(lambda size: self.left(made(size)), grid):
            columns, step = made(size), 1e-3 * size
            further = [
                (beyond - at) / step for beyond, at in zip(made(size + step), columns, strict=True)
            ]
            slope = np.einsum("k,km->m", self.fitted(columns)[0][: len(columns)], further)
            self.add(family, name, columns, [slope], 1)

    def hear_path(self) -> None:
        """A path that filters the torque is fitted by filtering the columns. A spring in series is
        part of the joint: the K, B and I of its filter are fitted to the angle less the deflection
        by the torque."""
        view, f = self.view, self.view.f
        s, torques = 2j * np.pi * f, [view.column(x) for x in view.torques]
        spectra = np.fft.rfft(view.motion[view.first : 3], view.padded)

        def in_series(c: float) -> NDArray[np.complex128]:
            wound = [view.columns[k] - c * torque for k, torque in enumerate(torques)]
            K, B, I = self.fitted(wound)[0][:3]
            return np.asarray(1 / (1 + c * (K + B * s + I * s**2)))

        responses: dict[str, tuple[Array, Callable[[float], NDArray[Any]]]] = {
            "delay": (np.linspace(-0.02, 0.03, 26), lambda p: np.exp(-s * p)),
            "low-pass": (np.geomspace(3e-4, 0.04, 10), lambda p: 1 / (1 + s * p)),
            "low-pass of second order": (
                np.geomspace(3e-4, 0.03, 10),
                lambda p: 1 / (1 + 2**0.5 * s * p + (s * p) ** 2),
            ),
            "mean": (np.geomspace(1e-3, 0.06, 12), lambda p: np.exp(-s * p / 2) * np.sinc(f * p)),
            "resonance that rings": (
                np.geomspace(5e-3, 0.06, 10),
                lambda p: 1 / (1 + 0.02 * s * p + (s * p) ** 2),
            ),
            "resonance": (
                np.geomspace(5e-3, 0.06, 10),
                lambda p: 1 / (1 + 0.2 * s * p + (s * p) ** 2),
            ),
        }
        if view.first == 0:
            responses["spring in series"] = np.geomspace(2e-5, 3e-3, 10), in_series
        for name, (grid, response) in responses.items():

            def filtered(
                p: float, response: Callable[[float], NDArray[Any]] = response
            ) -> list[Array]:
                return [view.passed(spectrum) for spectrum in spectra * response(p)]

            self.add_by("path", name, filtered, grid)

    def late(self, *shapes: Array) -> tuple[list[Array], list[Array], Array, Array]:
        """A torque that is late by a weighted sum of shapes (n,): its columns, the derivatives of
        the fit by the weights, the weights [s], which Gauss-Newton steps find, and their standard
        errors."""
        view, sizes, first = self.view, np.zeros(len(shapes)), self.view.first
        at, number = np.arange(view.n) / view.rate_hz, len(shapes)
        signals = scipy.interpolate.make_interp_spline(at, np.array(view.motion[:4]).T)
        for _ in range(20):
            motion = signals(np.clip(at - sizes @ np.array(shapes), 0, at[-1])).T
            columns = [view.column(x) for x in motion[first:3]]
            slope = -(self.fitted(columns)[0][: 3 - first] @ motion[first + 1 :])
            slopes = [view.column(shape * slope) for shape in shapes]
            more, covariance = scattered(view.sums([*slopes, *columns, *self.beside]))
            longest = float(np.abs(more[:number] @ np.array(shapes)).max())
            if longest < LAG_FOUND:
                break
            sizes = sizes + min(0.5 * LONGEST_LAG / longest, 1.0) * more[:number]
        return columns, slopes, sizes, np.sqrt(np.diag(covariance))[:number]

    @cached_property
    def slope(self) -> Array:
        """Rate of the model's torque (n,) [N*m/s]."""
        view = self.view
        return np.asarray(
            self.fitted(view.base)[0][: len(view.base)] @ np.array(view.motion[view.first + 1 : 4])
        )

    @cached_property
    def late_at_once(self) -> tuple[Array, float]:
        """The shape (n,) of the best lag that changes at once, and its residual sum of squares."""
        return self.at_once(self.slope)

    def at_once(self, torque: Array) -> tuple[Array, float]:
        """The step (n,) from whose moment on more of a torque (n,) explains most, and its residual
        sum of squares."""
        moments = [np.where(self.view.time > at, 1.0, 0.0) for at in self.view.moments]
        left = [self.left([*self.view.base, self.view.column(then * torque)]) for then in moments]
        return moments[int(np.argmin(left))], min(left)

    def hides_delay(self) -> bool:
        """Whether no test can hear a path, or an unheard delay may change I by `HIDDEN`, or B by
        `HIDDEN_OF_B`."""
        if "path" not in self.chance:
            return True
        _, _, (size,), (error,) = self.late(np.ones(self.view.n))
        *stiffness, damping, inertia = np.abs(
            self.fitted(self.view.base)[0][: len(self.view.base)]
        ).tolist()
        most = abs(float(size)) + 2.0 * float(error)
        of_damping = sum(stiffness) * most
        moves_inertia = (damping + of_damping) * most > HIDDEN * float(
            np.hypot(inertia, LEAST_INERTIA)
        )
        return bool(
            moves_inertia or of_damping > HIDDEN_OF_B * float(np.hypot(damping, LEAST_DAMPING))
        )

    def hear_time(self) -> None:
        """Clocks that drift apart, a lag that changes at once, and K that drifts or changes at
        once."""
        view, changing = self.view, self.view.motion[self.view.first]
        shapes = {
            "clocks": view.time - view.time[0],
            "lag that changes at once": self.late_at_once[0],
        }
        for name, shape in shapes.items():
            self.add("time", name, *self.late(shape)[:2], 1)
        what = "K" if view.first == 0 else "B_j"
        for name, shape in (("drifts", view.time), ("changes at once", self.at_once(changing)[0])):
            # the estimate is that before, or after the change
            for end in (shape.min(), shape.max()):
                self.add(
                    "time",
                    f"{what} that {name}",
                    [*view.base, view.column(changing * (shape - end))],
                    parameters=1,
                )

    def hear_speed(self) -> None:
        """Damping that depends on speed, and play before the spring."""
        view, theta, omega = self.view, self.view.away, self.view.motion[1]
        self.add(
            "speed",
            "damping that changes with the speed",
            [*view.base, view.column(omega * np.abs(omega))],
        )

        def followed(width: float) -> list[Array]:
            return [
                view.column(theta - width / 2 * spring_that_slips(theta, width / 2)),
                *view.base[1:],
            ]

        if view.first == 0:
            self.add_by(
                "speed",
                "play",
                followed,
                max(3 * view.step, np.deg2rad(0.03)) * np.geomspace(1, 20, 6),
            )

    def hear_size(self) -> None:
        """Stiffness that curves with the angle, or differs on the two sides of the middle of the
        motion."""
        view = self.view
        self.add("size", "stiffness that changes with the angle", [*view.base, *view.curved])
        for side in (1.0, -1.0):
            self.add(
                "size",
                "stiffness by side",
                [*view.base, view.column(np.maximum(side * view.away, 0.0))],
            )

    def hear_direction(self) -> None:
        """B, or K, that differs between the two directions of motion."""
        view = self.view
        for side in (1.0, -1.0):
            column = view.column(np.maximum(side * view.motion[1], 0.0))
            self.add("direction", "damping by direction", [*view.base, column])
            if view.first == 0:
                column = view.column(view.away * (side * view.sign + 1) / 2)  # about any angle
                switch = [column, view.column(view.sign)]
                self.add("direction", "stiffness by direction of motion", [*view.base, *switch])

    def hear_reflex(self) -> None:
        """A torque that follows the speed, delayed and low-passed by a muscle. No family hears it,
        but it may be why another one is heard."""
        view, s = self.view, 2j * np.pi * self.view.f
        answered = (
            np.fft.rfft(np.abs(view.motion[1]), view.padded)
            / (1 + s / (2 * np.pi * MUSCLE_HZ)) ** 2
        )
        for delay in REFLEX_S:
            self.add(
                "reflex",
                "reflex",
                [*view.base, view.passed(answered * np.exp(-s * delay))],
                parameters=1,
            )

    def hear_friction(self) -> tuple[Rival, Rival]:
        """A rival with friction of several shapes, none of which drives the joint; and, outside of
        the contest, all shapes of either sign. No test hears friction, but steps between two levels
        turn it into other families."""
        base, (sliding, *resting) = self.view.base, self.view.friction
        shapes = np.array([sliding, *(sliding + x for x in resting)])
        own = np.array([self.unexplained(x) for x in shapes])
        sizes, _ = scipy.optimize.nnls(own.T, self.unexplained(self.view.y))
        self.add("friction", "friction", [*base, *shapes])
        of_either_sign = self.rivals.pop()
        self.add(
            "friction", "friction", [*base, sizes @ shapes], parameters=int((sizes > 0).sum()) - 1
        )
        return self.rivals[-1], of_either_sign

    def unexplained(self, torque: Array) -> Array:
        """Residual (m,) of the model fitted to a torque (m,)."""
        Z = np.array([*self.view.base, *self.beside])
        return np.asarray(torque - solved(Z @ Z.T, Z @ torque)[0] @ Z)

    @property
    def heard(self) -> list[str]:
        """The families that are heard."""
        return [name for name, chance in self.chance.items() if chance < HEARD]

    def verdict(self) -> tuple[Rival, list[Rival]]:
        """The model alone, and the rivals that explain what is heard and cannot be told apart."""
        self.add("", "none", self.view.base)
        none = self.rivals.pop()
        if not self.heard:
            return none, []
        # a path may be what makes another family speak
        asked = ("path", *self.heard, *["reflex"] * self.answers)
        for name in dict.fromkeys(asked):
            getattr(self, f"hear_{name}")()
        rubs, shapes = self.hear_friction()
        least = min(square(rival.left) for rival in self.rivals)
        per_parameter = least / (self.view.seconds * self.view.bandwidth)
        # without rounding (0, m)
        made = np.reshape([self.unexplained(x) for x in self.draws], (-1, len(self.view.y)))
        spread = ALIKE * 2 / max(len(made), 1) ** 0.5

        def score(rival: Rival) -> float:
            parameters = rival.parameters + CHANCE * (rival.family == "reflex")
            return square(rival.left) + float(per_parameter * parameters)

        def as_good(best: Rival) -> list[Rival]:
            """Rivals that cannot be told from the best one, better ones first. A path precedes them
            if it is worse only within rounding or chance, or if its family has the lowest p-value:
            a late torque is the commonest fault, and looks like a change with time, too."""
            explained, left = square(none.left) - square(best.left), square(best.left)
            found = list[tuple[bool, float, Rival]]()
            for rival in self.rivals:
                by_chunk = np.add.reduceat(rival.left**2 - best.left**2, self.view.edges[:-1])
                margin = ALIKE * float(by_chunk.std(ddof=1)) * CHUNKS**0.5
                rounding = spread * float(np.linalg.norm(made @ (rival.left - best.left)))
                most, apart = UNEXPLAINED * explained, score(rival) - score(best)
                if rival.family == best.family == "path" and rival.possible:
                    margin = most = min(max(margin, most, NEAR_PATH * left), explained)
                if (
                    apart <= max(min(max(margin, rounding), most), CHANCE * per_parameter)
                    and rival.family not in UNHEARD
                ):
                    first = apart > margin or self.chance.get("path") == min(self.chance.values())
                    found.append((rival.family != "path" or not first, apart, rival))
            return [rival for _, _, rival in sorted(found, key=lambda one: one[:2])]

        best = min(self.rivals, key=score)
        alike = as_good(best)
        alike = as_good(min(alike, key=score)) if alike else []
        alike = [rival for rival in alike if rival.possible] or alike
        reflexes = [rival for rival in self.rivals if rival.family == "reflex"]
        least, by_reflex, by_shapes, by_friction = (
            min((square(rival.left) for rival in some), default=np.inf)
            for some in (alike or [best], reflexes, [shapes], [rubs])
        )
        misfit = square(none.left)
        explained = max(misfit - min(least, by_reflex), np.finfo(float).tiny)
        self.by_reflex = (misfit - by_reflex) / explained
        may_be = misfit - by_friction > RUBBING * (misfit - least)
        if self.view.rubs and least > EXPLAINS * misfit:  # certain friction may leave K, or B, open
            may_be |= bool(harm_of(none.half, none.estimates)[:-1].max() > 1)
        if may_be and rubs.possible and min(by_friction, least) < by_reflex:
            return none, [rubs, shapes, *alike]
        return none, [*alike, *[shapes] * bool(alike and by_shapes < (1 - NEAR_PATH) * least)]


def harm_of(moved: Array, estimates: Array) -> Array:
    """Changes (..., p) of the estimates (p,) of K, B and I, or of B and I, in multiples of
    `HARM`."""
    shares, least = np.array(list(HARM.values())[-len(estimates) :]).T
    least = least * (len(estimates) == len(HARM))  # of losses any share counts
    return np.asarray(np.abs(moved) / (shares * np.hypot(estimates, least)))


def beside_harmless(court: Court, none: Rival, alike: list[Rival]) -> list[Rival]:
    """Rivals of the other families that are heard, if the best rivals do no harm. The best one then
    joins the model, lest it hide another: beside a delay, rounding in steps between two levels
    looks like a stiffness by direction."""
    others = [name for name in court.heard if alike and name != alike[0].family]
    moved = [one.estimates - none.estimates for one in alike]
    if not others or not alike[0].beside or harm_of(np.array(moved), none.estimates).max() > 1:
        return alike
    again = Court(court.view, answers=court.answers, taken=alike[0].beside)
    again.chance = {name: chance for name, chance in again.chance.items() if name in others}
    return again.verdict()[1] or alike


def minima(left: Callable[[float], float], grid: Array) -> list[float]:
    """Up to two local minima of a function on a grid, refined, the lowest first: a delay has a
    false one."""
    over = np.array([left(x) for x in grid.tolist()])
    found = list[float]()
    for k in np.argsort(over).tolist():
        low, high = max(k - 1, 0), min(k + 1, len(grid) - 1)
        if over[k] <= min(over[low], over[high]):
            ends = float(grid[low]), float(grid[high])
            refined = scipy.optimize.minimize_scalar(
                left, bounds=ends, method="bounded", options={"maxiter": 10}
            )
            found.append(float(refined.x))
    return found[:2]


def no_witness(names: Sequence[str] = tuple(HARM)) -> Row:
    """The row of a model that no witness examined."""
    shifts: Row = {
        f"{name}_shift": None for name in FAMILIES if name != "size" or len(names) == len(HARM)
    }
    return shifts | {
        **dict.fromkeys(("heard", "rivals", "reflex_explains")),
        **{f"{name}_without{end}": None for name in names for end in ("", "_low", "_high")},
    }


def witness_row(
    record: Record,
    names: Sequence[str] = tuple(HARM),
    is_leg: bool = False,
    answers: bool = True,
    rubs: bool = False,
) -> Row:
    """The witness's evidence. `<family>_shift` is the largest change of an estimate by a rival in
    multiples of `HARM`; 0: the family is not heard, or does not explain most. `rivals` cannot be
    told apart; `<name>_without` are the estimates beside them; `VAF_in_band` is in percent. The row
    of two clocks has their drift, if repeats give none. A leg is not of second order and has its
    own friction: with `is_leg` the shifts are no evidence, and null.

    Raises InputError: the clocks drift apart by more than the settings allow; the message names the
    trial."""
    view = View(record, 3 - len(names), rubs)
    court = Court(view, not is_leg, answers)
    none, alike = court.verdict()
    row = no_witness(names)
    vaf = 100 * (1 - square(none.left) / max(float(view.y @ view.y), np.finfo(float).tiny))
    if not (is_leg or court.heard) and record.band_hz[1] > 2 * FAST_HZ[0]:
        fast = Court(View(record, view.first, rubs, fast=True), answers=answers)
        fast.chance = {name: chance for name, chance in fast.chance.items() if name == "path"}
        court = fast if fast.heard else court
        none, alike = court.verdict()
    alike = beside_harmless(court, none, alike)
    if not is_leg:
        row |= {name: 0.0 for name in row if name.endswith("_shift")}
        row |= {
            "path_shift": None if court.hides_delay() else 0.0,
            "heard": ", ".join(court.heard) or None,
        }
    row |= {
        "VAF_in_band": vaf,
        "reflex_explains": court.by_reflex if np.isfinite(court.by_reflex) else None,
    }
    # other misfits look like a drift
    told = not court.heard or any(one.name in ("clocks", "delay") for one in alike)
    if record.two_clocks and not is_leg and not record.groups.repeat and told:
        lag, error = (
            float(x[1]) / view.seconds for x in court.late(np.ones(view.n), view.time)[2:]
        )
        row |= clocks_row(record, 1e6 * lag / (1 - lag), 1e6 * error, CHUNKS - 5.0)
    if not alike:
        return row
    every, half = (
        np.array([getattr(one, name) for one in alike]) for name in ("estimates", "half")
    )
    # a path without effect has an unbounded interval
    half = np.minimum(half, np.maximum(np.abs(every), half[0]))
    low, high = (every - half).min(axis=0), (every + half).max(axis=0)
    row |= {"path_shift": None} if alike[0].family == "friction" else {}
    harm, first, chance = (
        harm_of(every - none.estimates, none.estimates),
        alike[0].family,
        court.chance,
    )
    # a family that is heard more clearly than the path that explains it is told, too
    clearer = [one.family for one in alike if chance.get(one.family, 0.0) < chance.get(first, 0.0)]
    row |= {
        f"{family}_shift": float(harm.max())
        for family in {first, *(clearer if first == "path" else ())}
    }
    if square(alike[0].left) > MOST_LEFT * square(court.view.y):
        return row
    row |= {"rivals": ", ".join(dict.fromkeys(one.name for one in alike))}
    apart = harm_of(np.ptp(every, axis=0), every[0])
    useless = USELESS * np.hypot(
        none.estimates, [HARM[name][1] for name in list(HARM)[-len(names) :]]
    )
    for k, name in enumerate(names):
        # friction: the fit's interval
        is_told = high[k] - low[k] < useless[k] or alike[0].family == "friction"
        ends, is_one = (
            (float(low[k]), float(high[k])) if is_told else (None, None),
            alike[-1].family != "friction",
        )
        row |= {
            f"{name}_without": float(every[0, k]) if is_told and is_one and apart[k] <= 1 else None
        }
        row |= dict(zip((f"{name}_without_low", f"{name}_without_high"), ends, strict=True))
    return row
