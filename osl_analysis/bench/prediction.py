"""The torque of an impedance trial as the leg's components predict it, beside the recorded one:
nothing is fitted.

Each component was measured alone (`measured_components`). With the law that the controller ran
(`controller_law`) they give the torque for the recorded angle (Eqs. 1-7). The components'
uncertainty carries over to the prediction. What the equations lack shows in the other trials of the
campaign. A misfit that all trials share names a component that differs from its measurement, or a
late controller (`prediction_causes`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.analysis import LITTLE
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.measured_components import (
    COMPONENTS,
    PARTS,
    Components,
    components_in,
    drivetrain_of,
)
from osl_analysis.bench.prediction_causes import DELAYS, TERMS, causes_table
from osl_analysis.bench.record import Record
from osl_analysis.errors import InputError
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.trial import Array

QUANTITIES = ("K", "B", "I", "torque")  # of Eq. 15, and the RMS [N*m] of the torque
NUMBERS = (
    "K_d",
    "B_d",
    "VAF",
    "rms",
    "VAF_fitted",
    *(f"{quantity}{end}" for quantity in QUANTITIES for end in ("", "_measured")),
)
"""Columns of `prediction.csv` that exist without a prediction, too."""
# [%] of Eq. 15; below, K, B and I hardly describe a trial, and others do not learn from it
LOWEST_VAF = 80.0
MISSES = {
    "trial": pl.String,
    **dict.fromkeys(("frequency_hz", "torque", "miss", "share"), pl.Float64),
}
# with as many trials of the same controller, only these show what the equations lack
FEWEST_OTHERS = 4
DELAY_STEP_S = 2.5e-4  # s; change of the delays for the derivatives
COMPONENT_STEP = 0.02  # relative change of a component for the derivatives, at least
LEAST_POWER = 1e-3  # of the torque's power, below which a third octave is not shown


def predicted_torques(
    record: Record, legs: Sequence[tuple[Controller, DrivetrainParameters]]
) -> Iterator[Array]:
    """Predict the filtered resisting torque (n,) [N*m] of each leg for the recorded angle.

    Raises
    ------
    InputError
        It has no bounds.
    """
    of_belts = belt_responses(record.theta, record.rate_hz, legs)
    for of_belt, (law, p) in zip(of_belts, legs, strict=True):
        if not np.isfinite(of_belt).all():
            raise InputError(
                f"trial {record.name}: the drivetrain model grows without bounds for K_1 ="
                f" {law.gains.K_1:g}, B_1 = {law.gains.B_1:g}; check the parameter file and the"
                " component trials against the device"
            )
        filtered = record.low_pass(of_belt, record.rate_hz)
        yield filtered + p.B_j * record.motion.omega + p.J_j * record.motion.alpha


def miss_over_frequency(record: Record, predicted: Array) -> pl.DataFrame:
    """How much a prediction misses at each frequency.

    A frequency is one of a stepped sine, with its harmonics; of another motion a third octave that
    has 0.1 % or more of the torque's power. The mean of a stretch of rows is no miss.

    Parameters
    ----------
    record
        The trial.
    predicted : Array (n,)
        Its predicted torque [N*m].

    Returns
    -------
    polars.DataFrame
        RMS [N*m] of the recorded `torque` and of its `miss`, recorded less predicted, and their
        ratio `share` [%].
    """
    signals = np.array([record.filtered_torque, record.filtered_torque - predicted])
    of_sines = any(np.isfinite(stratum.frequency_hz) for stratum in record.groups.strata)
    rows: list[tuple[float, int, float, float]] = []
    for part in record.pieces:
        samples = part.stop - part.start
        if of_sines:
            rows.append((sine_of(record, part), samples, *signals[:, part].var(axis=1)))
            continue
        frequency, density = scipy.signal.periodogram(signals[:, part], record.rate_hz, "hann")
        third_octave = np.exp2(np.rint(3 * np.log2(frequency[1:])) / 3)
        for centre in np.unique(third_octave):
            power = density[:, 1:] @ (third_octave == centre) * frequency[1]
            rows.append((centre, samples, *power))

    table = pl.DataFrame(rows, schema=("frequency_hz", "n", "torque", "miss"), orient="row")
    means = [(pl.col(x) * pl.col("n")).sum() / pl.col("n").sum() for x in ("torque", "miss")]
    power_at = table.group_by("frequency_hz").agg(*means).sort("frequency_hz")
    shown = power_at.filter(pl.col("torque") >= LEAST_POWER * pl.col("torque").sum())
    rms = shown.with_columns(pl.col("torque", "miss").sqrt(), trial=pl.lit(record.name))
    return rms.with_columns(share=100 * pl.col("miss") / pl.col("torque")).select(*MISSES)


def sine_of(record: Record, part: slice) -> float:
    """Frequency [Hz] of the stretch in which rows begin."""
    return next(
        stratum.frequency_hz
        for stratum in record.groups.strata
        if stratum.rows.start <= part.start < stratum.rows.stop
    )


def prediction_terms(
    record: Record, law: Controller, components: Components
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Predict a trial's torque, and how it depends on each component.

    Parameters
    ----------
    record
        The trial.
    law
        What its controller ran.
    components
        As they were measured.

    Returns
    -------
    terms : polars.DataFrame
        A row `predicted`, and one for each of `TERMS`, with K, B and I of its torque, its part of
        the RMS `torque` to first order, and `ALONG`, without offset and drift. The prediction has
        its `VAF` [%] and the `rms` [N*m] of its residual.
    misses : polars.DataFrame
        As `miss_over_frequency`.

    Raises
    ------
    InputError
        As `predicted_torques`.
    """
    predicted, torques = torques_of_terms(record, law, components)
    recorded = record.part(record.filtered_torque)
    n = record.samples
    time = record.part(record.time)
    motion = record.motion
    moved = [record.part(x) for x in (motion.theta, motion.omega, motion.alpha)]
    X = np.array([np.ones(n), time - time.mean(), *moved])
    scale = np.linalg.norm(X, axis=1)[:, None]
    X /= scale
    Y = np.array([record.part(torque) for torque in (predicted, *torques.values())])

    # each column of X without what the ones before explain
    lower = np.linalg.cholesky(X @ X.T)
    along = np.linalg.solve(lower, X @ Y.T)
    K, B, I = (np.linalg.solve(lower.T, along) / scale)[2:]

    Y -= Y.mean(axis=1)[:, None]
    size = float(Y[0].std())
    torque = Y @ Y[0] / (n * size)
    torque[1] = recorded.std() - size
    along_theta, along_omega, along_alpha = along[2:] / np.sqrt(n) / size
    of_others = [None] * len(TERMS)
    terms = pl.DataFrame(
        {
            "trial": record.name,
            "term": ["predicted", *TERMS],
            "VAF": [variance_accounted_for(recorded, Y[1]), *of_others],
            "rms": [float(Y[1].std()), *of_others],
            "K": K,
            "B": B,
            "I": I,
            "torque": torque,
            "along_theta": along_theta,
            "along_omega": along_omega,
            "along_alpha": along_alpha,
        }
    )
    return terms, miss_over_frequency(record, predicted)


def torques_of_terms(
    record: Record, law: Controller, components: Components
) -> tuple[Array, dict[str, Array]]:
    """The predicted torque (n,) [N*m], and those of `TERMS`: its residual, and its derivatives by
    each component, by the gain of the torque and by the delays."""
    # the torque is linear in the losses of the joint
    torques = {"B_j": record.motion.omega, "J_j": record.motion.alpha}
    steps: dict[str, float] = {}
    legs = [(law, components.p)]
    for name in DELAYS:
        steps[name] = DELAY_STEP_S
        legs.append((replace(law, **{name: DELAY_STEP_S}), components.p))  # type: ignore[arg-type]
    for name, value in components.values.items():
        if name not in torques:
            steps[name] = max(COMPONENT_STEP * abs(value), 0.5 * components.se(name))
            changed = {**components.values, name: max(value, 0.0) + steps[name]}
            legs.append((law, drivetrain_of(changed, law.p)))

    predicted, *changed_torques = predicted_torques(record, legs)
    torques["left"] = record.filtered_torque - predicted
    torques["torque_gain"] = predicted
    for (name, step), changed_torque in zip(steps.items(), changed_torques, strict=True):
        torques[name] = (changed_torque - predicted) / step
    return predicted, {name: torques[name] for name in TERMS}


def prediction_table(
    terms: Mapping[str, pl.DataFrame], fits: pl.DataFrame, components: Components
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Compare predictions of one joint and side with the fits of its trials.

    The interval of a prediction is for the trial's measured value. It contains the uncertainty of
    the components and of the trial, and what the equations lack, learnt from the *other* trials
    with the same controller.

    Parameters
    ----------
    terms
        `prediction_terms` by trial.
    fits
        Rows of `impedance.csv` over all amplitudes of these trials.
    components
        As they were measured.

    Returns
    -------
    predictions, causes
        `prediction.csv` and `prediction_causes.csv`.
    """
    trials = [fits.row(by_predicate=pl.col("trial") == trial, named=True) for trial in terms]
    each = [{row["term"]: row for row in table.to_dicts()} for table in terms.values()]
    teachers = [teachers_of(k, trials) for k in range(len(trials))]
    rows: list[dict[str, Any]] = []
    for fit, of_term, teaches in zip(trials, each, teachers, strict=True):
        learnt_from = [other for other, is_one in zip(trials, teaches, strict=True) if is_one]
        rows.append(
            {
                **{name: fit[name] for name in ("trial", *PLACE, "controller", "K_d", "B_d")},
                "VAF": of_term["predicted"]["VAF"],
                "rms": of_term["predicted"]["rms"],
                "VAF_fitted": fit["VAF"],
                "doubtful": fit["doubtful"],
                "outside": outside_of(fit, learnt_from),
            }
        )

    for quantity in QUANTITIES:
        misses = Misses.of(quantity, trials, each, components)
        for k, row in enumerate(rows):
            predicted = misses.interval(k, teachers[k], components)
            row[quantity] = predicted.value
            row[f"{quantity}_component_se"] = predicted.component_se
            row[f"{quantity}_low"] = predicted.low
            row[f"{quantity}_high"] = predicted.high
            row[f"{quantity}_measured"] = predicted.value + misses.off[k]
    causes = causes_table(each, components, {name: rows[0][name] for name in PLACE})
    return pl.DataFrame(rows, infer_schema_length=None), causes


def teachers_of(k: int, trials: Sequence[Mapping[str, Any]]) -> NDArray[np.bool_]:
    """The trials (n,) that show what the equations lack in trial k: others that Eq. 15 fits, of its
    controller if there are enough."""
    is_fitted = np.array([fit["VAF"] >= LOWEST_VAF for fit in trials])
    others = is_fitted & (np.arange(len(trials)) != k)
    is_alike = np.array([fit["controller"] == trials[k]["controller"] for fit in trials])
    alike = others & is_alike
    return np.asarray(alike if np.count_nonzero(alike) >= FEWEST_OTHERS else others)


def outside_of(trial: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> str | None:
    """Which of a trial's K_d and B_d lie outside the range of the others, from which its interval
    is learnt."""
    beyond = []
    for name in ("K_d", "B_d"):
        of_others = [fit[name] for fit in others]
        if of_others and not min(of_others) <= trial[name] <= max(of_others):
            beyond.append(name)
    return " and ".join(beyond) or None


@dataclass(frozen=True)
class PredictedQuantity:
    """A predicted quantity with its 95 % interval; without it where no other trials teach it."""

    value: float
    component_se: float  # standard error due to the components alone
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Misses:
    """How much predictions of one quantity miss in n trials.

    Attributes
    ----------
    predicted : Array (n,)
        Predicted values [SI].
    off : Array (n,)
        Measured less predicted ones.
    size : Array (n,)
        Size by which they are compared: relative for K and B.
    of_parts : Array (n, parts)
        Variances due to the components, by the experiment that measured them.
    of_trial : Array (n,)
        Variances of the measured values.
    """

    predicted: Array
    off: Array
    size: Array
    of_parts: Array
    of_trial: Array

    @classmethod
    def of(
        cls,
        quantity: str,
        trials: Sequence[Mapping[str, Any]],
        each: Sequence[Mapping[str, Any]],
        components: Components,
    ) -> "Misses":
        """Those of a quantity, from the fits of the trials and the terms of each."""
        predicted = np.array([of_term["predicted"][quantity] for of_term in each])
        off = np.array([of_term["left"][quantity] for of_term in each])
        slopes = np.array([[of_term[name][quantity] for name in COMPONENTS] for of_term in each])
        is_of_part = np.array([[of == part for of in COMPONENTS.values()] for part in PARTS])
        of_parts = np.array(
            [
                [s @ components.covariance @ s for s in np.where(is_of_part, of_trial, 0.0)]
                for of_trial in slopes
            ]
        )
        se = [
            fit.get(f"{quantity}_repeat_se") or fit.get(f"{quantity}_se") or 0.0 for fit in trials
        ]
        is_relative = quantity in ("K", "B")
        size = np.hypot(predicted, LITTLE[quantity]) if is_relative else np.ones(len(off))
        return cls(predicted, off, np.asarray(size), of_parts, np.array(se) ** 2)

    def interval(
        self, k: int, teaches: NDArray[np.bool_], components: Components
    ) -> PredictedQuantity:
        """The prediction of trial k, with what the trials (n,) that teach show of the equations."""
        value = float(self.predicted[k])
        component_se = float(np.sqrt(self.of_parts[k].sum()))
        number = int(np.count_nonzero(teaches))
        if number < 2:
            return PredictedQuantity(value, component_se)
        known = self.of_parts.sum(axis=1) + self.of_trial
        relative = self.off / self.size
        of_equations = model_variance(relative[teaches], (known / self.size**2)[teaches])
        variances = np.array(
            [*self.of_parts[k], self.of_trial[k], of_equations * self.size[k] ** 2]
        )
        of_components = [
            min(components.freedom[name] for name in components_in(part)) for part in PARTS
        ]
        freedom = welch_satterthwaite(variances, [*of_components, np.inf, number - 1])
        half_width = float(scipy.special.stdtrit(freedom, 0.975) * np.sqrt(variances.sum()))
        return PredictedQuantity(value, component_se, value - half_width, value + half_width)


def model_variance(off: Array, known: Array) -> float:
    """Estimate the variance of what the equations lack.

    Parameters
    ----------
    off : Array (n,)
        Differences between measurement and prediction.
    known : Array (n,)
        Their known variances.

    Returns
    -------
    float
        The variance that makes their standardised mean square 1, with a known mean of 0 (Paule and
        Mandel, J. Res. Natl. Bur. Stand. 87, 1982); 0 if the known ones suffice.
    """
    most = float(np.max(off**2))

    def excess(variance: float) -> float:
        total = np.maximum(known + variance, 1e-12 * most + 1e-300)
        return float(np.mean(off**2 / total)) - 1

    if most == 0 or excess(0.0) <= 0:
        return 0.0
    return float(scipy.optimize.brentq(excess, 0.0, most))
