# SPDX-License-Identifier: Apache-2.0
"""The uncertainty of one estimate: what contributes to it, and the half-width of all of it.

Every printed 95 % interval of a fit is made here, by JCGM 100:2008: independent contributions add
as variances (5.1.2), and Student's quantile has the degrees of freedom of their sum (G.4).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array
from osl_analysis.stats.rounding import significant
from osl_analysis.stats.sources import Source

Row = dict[str, float | str | None]
"""One row of a result table, by column. None becomes an empty field."""
MOST_FREEDOM = 1 / np.finfo(float).eps  # degrees of freedom; rounding of the sum decides on more
# standard errors of a 95 % interval where their size is known
NORMAL_HALF_WIDTH = NormalDist().inv_cdf(0.975)

Part = Literal["repeatability", "sensor", "bench", "motion", "fault"]
"""repeatability: the scatter of this recording; sensor: encoder and rounding; bench: what is stated
or assumed of it, of friction, and of where a belt's loading begins;
motion: what another amplitude or frequency would change; fault: what a fault of the recording would
change. The last two are in no interval."""
IN_INTERVAL: tuple[Part, ...] = ("repeatability", "sensor", "bench")
Basis = Literal["measured", "stated", "assumed", "bound", "weighed"]
OF_SOURCE: Mapping[Source, tuple[Part, Basis]] = {
    Source.ENCODER: ("sensor", "measured"),
    Source.HELD_DELAY: ("sensor", "measured"),
    Source.FRICTION: ("bench", "measured"),
    Source.FRICTION_SIGN: ("bench", "assumed"),
    Source.FRICTION_SHAPE: ("bench", "weighed"),
    Source.LOADING_BEGINS: ("bench", "assumed"),
    Source.SPRING_LOSS: ("bench", "assumed"),
    Source.BELT_ERROR: ("bench", "assumed"),
    Source.THETA_M_DELAY: ("bench", "assumed"),
}
"""Part and basis of known errors; others are stated of the bench."""
OF_ONE_TRIAL = (
    Source.HELD_DELAY,
    Source.FRICTION,
    Source.FRICTION_SIGN,
    Source.FRICTION_SHAPE,
    Source.LOADING_BEGINS,
    Source.LOAD_CELL_DRIFT,
    Source.KNOWN_PART,
)
"""Known errors that the trials on a bench do not share."""

DOUBT = 0.2  # probability of a change beyond the limit, from which an estimate is doubtful
LIKELY = 0.5  # probability above which a fault is named; more likely than not
CLEAR, WIDE = "clear", "wide"  # verdicts; any other is the cause of a doubt
# sizes that are added in quadrature to K, B, I before a share is taken: 0 has no relative change
# [N*m/rad, N*m*s/rad, kg*m^2]
FLOOR = {"K": 2.0, "B": 0.1, "I": 1e-3}


@dataclass(frozen=True)
class Contribution:
    """What one source does to one estimate, in its unit; a row of `budget.csv`."""

    source: Source
    # standard uncertainty; of a fault by how much the estimate would be another, of motion half of
    # the range; None: not known
    standard: float | None
    freedom: float | None = None  # degrees of freedom of its variance; None: infinitely many
    basis: Basis = "stated"
    part: Part = "bench"
    shared: bool = False  # whether all trials on a bench have it
    probability: float = 1.0  # of a fault
    detail: str | None = None
    per: str | None = None  # of one that is not known: what it does, as `0.09 N*m*s/rad per ms`

    @property
    def size(self) -> float:
        """Its standard uncertainty; 0 where it is not known."""
        return self.standard or 0.0


FIELDS = [field.name for field in fields(Contribution)]
QUANTITIES = ("K", "B", "I")  # of Eq. 15
WITHOUT_FRICTION = {"K": "K_without_friction", "B": "B_viscous", "I": "I_without_friction"}
"""Columns of K, B and I without friction."""
UNITS = {
    "K": "N*m/rad",
    "B": "N*m*s/rad",
    "I": "kg*m^2",
    "B_j": "N*m*s/rad",
    "J_j": "kg*m^2",
    "K_d_rendered": "N*m/rad",
    "B_d_rendered": "N*m*s/rad",
    "loop_delay_s": "s",
}


def own_size(name: str, value: float) -> float:
    """What shares of K, B or I are of, in its unit; a change beyond it has no size of its own."""
    return math.hypot(value, FLOOR[name])


def scatter(standard: float, freedom: float) -> Contribution:
    """What the scatter of a recording shows."""
    return Contribution(Source.REPEATABILITY, standard, freedom, "measured", "repeatability")


def unknown(source: Source, unit: str = "", **changes: float) -> dict[str, Contribution]:
    """What nobody has measured, by the estimates that it would change by so much per unit; 0: by
    nobody knows how much."""
    return {
        name: Contribution(
            source=source,
            standard=None,
            basis="assumed",
            part="fault",
            per=f"{significant(abs(change))} {UNITS[name]} per {unit}" if change else None,
        )
        for name, change in changes.items()
    }


@dataclass(frozen=True)
class Verdict:
    """What a budget says of its estimate."""

    name: str  # `CLEAR`, `WIDE`, or the source of the doubt
    limit: float  # beyond which a change matters, in the unit of the estimate
    rows: tuple[Contribution, ...] = ()  # of the source, the most probable first

    @property
    def size(self) -> float:
        """The largest plausible change by the source."""
        return max((row.size for row in self.rows), default=0.0)


@dataclass(frozen=True)
class Budget:
    """An estimate with all that contributes to its uncertainty, in its SI unit."""

    value: float
    contributions: tuple[Contribution, ...] = ()

    def of_parts(self, *parts: Part) -> list[Contribution]:
        """The contributions of some parts whose size is known."""
        return [each for each in self.contributions if each.part in parts and each.standard]

    def spread(self, *parts: Part) -> tuple[float, float]:
        """Standard uncertainty and its degrees of freedom, of all that is in the interval, or by
        some parts alone; NaN where nothing repeats."""
        chosen = self.of_parts(*(parts or IN_INTERVAL))
        variances = [each.size**2 for each in chosen]
        if any(map(math.isnan, variances)):
            return math.nan, math.nan
        freedoms = [math.inf if each.freedom is None else each.freedom for each in chosen]
        return math.sqrt(sum(variances)), float(welch_satterthwaite(variances, freedoms))

    def half_width(self, *parts: Part) -> float:
        """Half of the 95 % interval: of all that is in it, or by some parts alone."""
        standard, freedom = self.spread(*parts)
        return float(scipy.special.stdtrit(freedom, 0.975) * standard)

    @property
    def se_bench(self) -> float:
        """Standard uncertainty by what all trials on a bench share."""
        return math.hypot(*(each.size for each in self.of_parts(*IN_INTERVAL) if each.shared))

    def of_source(self, source: Source) -> list[Contribution]:
        """The contributions of a source, of known size."""
        return [
            each
            for each in self.contributions
            if each.source == source and each.standard is not None
        ]

    @property
    def half_range(self) -> float:
        """What another motion would change: the largest, as the others are shares of it."""
        return max((each.size for each in self.of_parts("motion")), default=0.0)

    @property
    def unknown(self) -> list[Contribution]:
        """The contributions of which this recording does not tell the size."""
        return [each for each in self.contributions if each.standard is None]

    @property
    def low(self) -> float:
        return self.value - self.half_width()

    @property
    def high(self) -> float:
        return self.value + self.half_width()

    def plus(self, *contributions: Contribution) -> "Budget":
        """The estimate with further contributions."""
        return replace(self, contributions=(*self.contributions, *contributions))

    def columns(self, name: str) -> dict[str, Any]:
        """`name`, and the ends of its interval."""
        half = self.half_width()
        low, high = self.value - half, self.value + half
        return {name: self.value, f"{name}_low": low, f"{name}_high": high}

    def verdict(self, needed: float) -> Verdict:
        """Judge the estimate.

        It is doubtful where a fault would change it by more than `needed` and its half-width, and
        by more than its half-range, too: of another motion the estimate would be another anyway.
        Where such a fault is likely, it does not hide behind the range, which is then its own: a
        delay makes B fall with the frequency. Or a fault is likely, and the scatter alone exceeds
        what is needed: the lack of fit in it is then the fault's.
        """
        half = self.half_width()
        limit = max(needed, half)
        faults = self.of_parts("fault")
        weighed = [each for each in faults if each.basis == "weighed"]
        # that one of the weighed ones is there, which exclude each other; a bound, of which nothing
        # tells how likely it is, counts 1
        if sum(each.probability for each in weighed if each.size > limit) <= LIKELY:
            limit = max(needed, math.hypot(half, self.half_range))
        harmful = [each for each in faults if each.size > limit]
        if sum(each.probability for each in harmful) <= DOUBT:
            harmful = weighed
            of_scatter = replace(self, contributions=tuple(self.of_source(Source.REPEATABILITY)))
            likely = sum(each.probability for each in weighed)
            if likely <= LIKELY or of_scatter.half_width() <= needed:
                return Verdict(WIDE if half > needed else CLEAR, limit)
        # a bound weighs as a cause of the probability `DOUBT`: a likelier one is named first
        by_source: dict[Source, float] = {}
        for each in harmful:
            weight = each.probability if each.basis != "bound" else DOUBT
            by_source[each.source] = by_source.get(each.source, 0.0) + weight
        source = max(by_source, key=by_source.__getitem__)
        of_source = [each for each in harmful if each.source == source]
        of_source.sort(key=lambda each: -each.probability)
        return Verdict(source, limit, tuple(of_source))


def budget_rows(place: Mapping[str, Any], estimates: Mapping[str, Budget]) -> list[dict[str, Any]]:
    """The rows of `budget.csv` of some estimates; `place` has the trial and the amplitude. A bound
    of 0 says that candidate models were weighed. What nobody has measured has no probability."""
    of_place = {name: place.get(name) for name in ("trial", "amplitude_deg")}
    return [
        {
            **of_place,
            "estimate": name,
            **vars(each),
            "probability": each.probability if each.size or each.basis != "assumed" else None,
        }
        for name, budget in estimates.items()
        for each in budget.contributions
        if each.standard != 0.0 or each.basis == "bound"
    ]


def budgets_in(rows: Sequence[Mapping[str, Any]], values: Mapping[str, Any]) -> dict[str, Budget]:
    """The budgets of the estimates of one fit from its rows of `budget.csv`; `values` has the
    estimates by name."""
    budgets: dict[str, Budget] = {}
    for row in rows:
        name = row["estimate"]
        if values.get(name) is not None:
            cells = {field: row[field] for field in FIELDS}
            found = Contribution(**{**cells, "source": Source(row["source"])})
            budgets[name] = budgets.get(name, Budget(values[name])).plus(found)
    return budgets


def welch_satterthwaite(
    variances: Sequence[ArrayLike] | Array, degrees_of_freedom: ArrayLike
) -> Array:
    """Find the degrees of freedom of a sum of k independent variances (Satterthwaite, Biometrics
    Bulletin 2, 1946; Welch, Biometrika 34, 1947).

    Parameters
    ----------
    variances : (k, ...)
        The summands.
    degrees_of_freedom : (k,) or (k, ...)
        Of each.

    Returns
    -------
    Array (...)
        Infinite where all variances are zero, or the uncertain ones vanish beside the others: the
        rounding of a sum would decide on more than `MOST_FREEDOM`.

    Raises
    ------
    InputError
        A variance is not finite.
    """
    summands = np.asarray(variances, dtype=float)
    if not np.isfinite(summands).all():
        raise InputError(
            "the uncertainty of an estimate is not finite",
            "is the `unit` of `time` right? Else record a longer or livelier motion",
        )
    certainty = 1 / np.asarray(degrees_of_freedom, dtype=float)
    if certainty.ndim < summands.ndim:
        certainty = certainty.reshape(-1, *[1] * (summands.ndim - 1))
    uncertainty = np.sum(certainty * summands**2, axis=0)
    square_of_sum = np.sum(summands, axis=0) ** 2
    is_finite = uncertainty > square_of_sum / MOST_FREEDOM
    infinite = np.full_like(square_of_sum, np.inf)
    return np.divide(square_of_sum, uncertainty, out=infinite, where=is_finite)
