# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budget of one estimate, its 95 % interval, and the verdict on it.

Independent contributions add as variances, u^2 = sum of u_i^2 (JCGM 100:2008, 5.1.2). The
half-width is t u, where Student's quantile t has the degrees of freedom of the sum
(Welch-Satterthwaite, G.4). Every printed interval of a fit is made here.

Example: `Budget(200.0, (scatter(0.5, 30),)).columns("K")` has K, K_low and K_high.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from statistics import NormalDist
from typing import Any, Final, Literal

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
"""repeatability: scatter of this recording; sensor: encoder and rounding; bench: statements and
assumptions about the bench, friction, and where a belt's loading begins; motion: change by another
amplitude or frequency; fault: change by a fault of the recording. Motion and fault are in no
interval."""
IN_INTERVAL: tuple[Part, ...] = ("repeatability", "sensor", "bench")
Basis = Literal["measured", "stated", "assumed", "bound", "weighed"]
PART_AND_BASIS: Mapping[Source, tuple[Part, Basis]] = {
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
"""Part and basis of known errors. Any other known error is one of the bench, and stated."""
SOURCES_OF_ONE_TRIAL = (
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
# verdicts on an estimate that is not doubtful
CLEAR: Final = "clear"
WIDE: Final = "wide"  # its interval is wider than is needed
# sizes that are added in quadrature to K, B, I before a share is taken: 0 has no relative change
# [N*m/rad, N*m*s/rad, kg*m^2]
FLOOR = {"K": 2.0, "B": 0.1, "I": 1e-3}


@dataclass(frozen=True)
class Contribution:
    """The effect of one source on one estimate, in its unit; a row of `budget.csv`."""

    source: Source
    # standard uncertainty; of a fault the change of the estimate, of motion half of the range;
    # None: not known
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


def floored_size(name: str, value: float) -> float:
    """The size of K, B or I that shares refer to, in its unit; at least `FLOOR`."""
    return math.hypot(value, FLOOR[name])


def scatter(standard: float, freedom: float) -> Contribution:
    """The contribution of a recording's scatter."""
    return Contribution(Source.REPEATABILITY, standard, freedom, "measured", "repeatability")


def unknown(source: Source, unit: str = "", **changes: float) -> dict[str, Contribution]:
    """Contributions that nobody has measured, by estimate, with the change per unit; 0: the change
    is not known either."""
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
    """The verdict of a budget on its estimate."""

    name: Source | Literal["clear", "wide"]  # the source of the doubt, else `CLEAR` or `WIDE`
    limit: float  # beyond which a change matters, in the unit of the estimate
    rows: tuple[Contribution, ...] = ()  # of the source, the most probable first

    @property
    def size(self) -> float:
        """The largest plausible change by the source."""
        return max((row.size for row in self.rows), default=0.0)

    @property
    def doubt(self) -> Source | None:
        """The source of the doubt; None without one."""
        return self.name if isinstance(self.name, Source) else None


@dataclass(frozen=True)
class Budget:
    """An estimate with all contributions to its uncertainty, in its SI unit."""

    value: float
    contributions: tuple[Contribution, ...] = ()

    def in_parts(self, *parts: Part) -> list[Contribution]:
        """The contributions of known size to some parts."""
        return [
            contribution
            for contribution in self.contributions
            if contribution.part in parts and contribution.standard
        ]

    def spread(self, *parts: Part) -> tuple[float, float]:
        """Standard uncertainty and its degrees of freedom, of the whole interval or of some parts
        alone; NaN where nothing repeats."""
        chosen = self.in_parts(*(parts or IN_INTERVAL))
        variances = [contribution.size**2 for contribution in chosen]
        if any(map(math.isnan, variances)):
            return math.nan, math.nan
        freedoms = [
            math.inf if contribution.freedom is None else contribution.freedom
            for contribution in chosen
        ]
        return math.sqrt(sum(variances)), float(welch_satterthwaite(variances, freedoms))

    def half_width(self, *parts: Part) -> float:
        """Half of the 95 % interval, of all its parts or of some alone."""
        standard, freedom = self.spread(*parts)
        return float(scipy.special.stdtrit(freedom, 0.975) * standard)

    @property
    def se_bench(self) -> float:
        """Standard uncertainty by the errors that all trials on a bench share."""
        shared = [row.size for row in self.in_parts(*IN_INTERVAL) if row.shared]
        return math.hypot(*shared)

    def from_source(self, source: Source) -> list[Contribution]:
        """The contributions of known size from one source."""
        return [
            contribution
            for contribution in self.contributions
            if contribution.source == source and contribution.standard is not None
        ]

    @property
    def half_range(self) -> float:
        """Change by another motion: the largest, as the others are shares of it."""
        return max((row.size for row in self.in_parts("motion")), default=0.0)

    @property
    def unknown(self) -> list[Contribution]:
        """The contributions whose size this recording does not show."""
        return [row for row in self.contributions if row.standard is None]

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

        A fault makes it doubtful where the change exceeds `needed`, the half-width and the
        half-range: another motion would change the estimate anyway. A likely fault need not exceed
        the half-range, which may be its own effect: a delay makes B fall with the frequency.

        A likely fault also makes it doubtful where the scatter alone exceeds `needed`: the lack of
        fit in the scatter is then the fault's.
        """
        half = self.half_width()
        limit = max(needed, half)
        faults = self.in_parts("fault")
        # weighed faults exclude each other, so that their probabilities add; nothing tells how
        # likely a bound is, so that its probability is 1
        weighed = [fault for fault in faults if fault.basis == "weighed"]
        if sum(fault.probability for fault in weighed if fault.size > limit) <= LIKELY:
            limit = max(needed, math.hypot(half, self.half_range))
        harmful = [fault for fault in faults if fault.size > limit]
        if sum(fault.probability for fault in harmful) <= DOUBT:
            harmful = weighed
            probability = sum(fault.probability for fault in weighed)
            repeatability = replace(
                self, contributions=tuple(self.from_source(Source.REPEATABILITY))
            )
            if probability <= LIKELY or repeatability.half_width() <= needed:
                return Verdict(WIDE if half > needed else CLEAR, limit)
        # a bound weighs as a cause of the probability `DOUBT`: a likelier one is named first
        weight_of: dict[Source, float] = {}
        for fault in harmful:
            weight = fault.probability if fault.basis != "bound" else DOUBT
            weight_of[fault.source] = weight_of.get(fault.source, 0.0) + weight
        cause = max(weight_of, key=weight_of.__getitem__)
        rows = [fault for fault in harmful if fault.source == cause]
        rows.sort(key=lambda fault: -fault.probability)
        return Verdict(cause, limit, tuple(rows))


def budget_rows(place: Mapping[str, Any], estimates: Mapping[str, Budget]) -> list[dict[str, Any]]:
    """The rows of `budget.csv` of some estimates.

    `place` has the trial and the amplitude. A bound of 0 is kept: it says that candidate models
    were weighed. A contribution that nobody has measured has no probability.
    """
    place_columns = {name: place.get(name) for name in ("trial", "amplitude_deg")}
    rows = []
    for name, budget in estimates.items():
        for contribution in budget.contributions:
            if contribution.standard == 0.0 and contribution.basis != "bound":
                continue
            row = {**place_columns, "estimate": name, **vars(contribution)}
            if not contribution.size and contribution.basis == "assumed":
                row["probability"] = None
            rows.append(row)
    return rows


def budgets_in(rows: Sequence[Mapping[str, Any]], values: Mapping[str, Any]) -> dict[str, Budget]:
    """The budgets of the estimates of one fit from its rows of `budget.csv`; `values` has the
    estimates by name."""
    budgets: dict[str, Budget] = {}
    for row in rows:
        name = row["estimate"]
        if values.get(name) is not None:
            cells = {field: row[field] for field in FIELDS}
            contribution = Contribution(**{**cells, "source": Source(row["source"])})
            budgets[name] = budgets.get(name, Budget(values[name])).plus(contribution)
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
