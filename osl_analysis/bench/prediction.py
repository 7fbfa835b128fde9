"""The torque that the leg's components predict for an impedance trial, beside the recorded one: nothing is fitted.

Each component was measured alone (components.py). With the law of the controller they give the torque for the recorded
angle (Eqs. 1-7). What is uncertain of the components is uncertain of the prediction too; what the equations lack shows
in the other trials of the campaign, and a misfit that is alike in all trials names the component that is not as
measured, or a controller that acts late.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.components import ACTUATOR_PARAMETERS, LOSSES, PLACE
from osl_analysis.bench.record import Record
from osl_analysis.errors import InputError
from osl_analysis.measured import rms
from osl_analysis.model.compensator import Controller, belt_response
from osl_analysis.model.parameters import PARAMETER_UNITS, DrivetrainParameters
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.stats.repeats import counted
from osl_analysis.table import finite_or_null
from osl_analysis.trial import Array

COMPONENTS = dict.fromkeys(ACTUATOR_PARAMETERS, "actuator") | {"K_s": "belt"} | dict.fromkeys(LOSSES, "transmission")
"""The experiment that each component is measured by."""
PARTS = tuple(dict.fromkeys(COMPONENTS.values()))
DELAYS = ("angle_delay", "velocity_delay")  # ages [s] of what the controller uses, which no component trial shows
TERMS = ("left", *COMPONENTS, "torque_gain", *DELAYS)
"""Torques of a trial: what the prediction leaves, and what one unit more of each component, of the gain of its load
cell, or of a delay adds to it."""
QUANTITIES = ("K", "B", "I", "torque")  # of Eq. 15, and the RMS [N*m] of the torque
ALONG = ("along_theta", "along_omega", "along_alpha")
"""RMS of the parts of a torque that are proportional to the motion, over the RMS of the predicted torque: what K, B and
I are made of, in numbers that are alike in size and independent."""
NUMBERS = ("K_d", "B_d", "VAF", "rms", "VAF_fitted", *(f"{x}{end}" for x in QUANTITIES for end in ("", "_measured")))
"""Columns of `prediction.csv` that it has without any prediction too."""
ENDS = {"low": -1.0, "high": 1.0}
LOWEST_VAF = 80.0  # [percent] of Eq. 15; below it K, B and I hardly describe a trial: it teaches nothing
LITTLE = {"K": 0.0, "B": 2.0}  # sizes [N*m/rad, N*m*s/rad] below which what the equations lack is no share of K or B
FEWEST_OTHERS = 4  # trials with the same controller from which on they alone teach what the equations lack
DELAY_STEP = 2.5e-4  # [s] by which the delays are changed
LEAST_SHARE, CERTAIN = 0.5, 4.0  # share of the misfit that a named cause explains; standard errors of its change
AS_GOOD = 1.5  # times what the best explanation leaves that another may leave to be named beside it
LEAST_MISFIT = 5e-3  # of the torque, that the delays leave; sound legs leave up to 0.0035
LEAST_CHANGE = dict.fromkeys(COMPONENTS, 0.05) | {"torque_gain": 0.02, "angle_delay": 1.5e-3, "velocity_delay": 5e-3}
"""Change, relative to a component, or of a delay [s], from which on it is named. A sampled loop acts half a sample late
and later (1 ms at 500 Hz), a velocity that is a filtered difference is older still."""


@dataclass(frozen=True)
class Components:
    """The drivetrain as its components were measured."""

    p: DrivetrainParameters  # ratios n_T and n_m are those of the parameter file
    values: Mapping[str, float]  # means over the trials of each component, in the order of `COMPONENTS`
    covariance: Array  # of these means, (8, 8)
    freedom: Mapping[str, float]  # degrees of freedom of the variance of each
    trials: Mapping[str, tuple[str, ...]]  # names of the trials, by experiment

    def se(self, name: str) -> float:
        k = list(COMPONENTS).index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def rows(self) -> list[dict[str, Any]]:
        """For JSON, in SI units: each component with its 95 % interval and the trials that it is from."""
        found = []
        for name, value in self.values.items():
            freedom, part, se = self.freedom[name], COMPONENTS[name], self.se(name)
            half = float(scipy.special.stdtrit(freedom, 0.975)) * se
            row = {"name": name, "value": value, "unit": PARAMETER_UNITS["k_tau" if name == "k_tau_n_m" else name]}
            row |= {"standard_error": se, "low": value - half, "high": value + half, "degrees_of_freedom": freedom}
            found.append(finite_or_null(row) | {"experiment": part, "trials": self.trials[part]})
        return found


def components_of(
    tables: Mapping[str, pl.DataFrame], place: Sequence[str | None], file: DrivetrainParameters
) -> Components:
    """The components of one joint and side from the campaign's tables `actuator`, `belt` and `transmission`, means of
    the trials that count. The variance of a mean is that of the scatter of its trials, or of their fits where this is
    larger; correlations are those of the fits. `file` has the ratios. Raises InputError: a table has no such trial; a
    component is negative beyond its uncertainty."""
    rows = component_rows(tables, place)
    values, freedom, covariance = dict[str, float](), dict[str, float](), np.zeros((len(COMPONENTS),) * 2)
    for part, own in rows.items():
        names = [name for name, of in COMPONENTS.items() if of == part]
        k, n = [list(COMPONENTS).index(name) for name in names], len(own)
        within = np.array([[mean_covariance(own, a, b) for b in names] for a in names]) / n
        of_fits = np.sqrt(np.diag(within))
        shared = np.array([rms(own[f"{name}_se_bench"].to_numpy()) for name in names])  # by all trials on the bench
        alone = np.sqrt(np.maximum(of_fits**2 - shared**2 / n, 0.0))
        scatter = own.select(names).to_numpy().std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.zeros(len(names))
        se = np.hypot(np.maximum(alone, scatter), shared)
        covariance[np.ix_(k, k)] = within / np.outer(of_fits, of_fits) * np.outer(se, se)
        freedom |= dict.fromkeys(names, float(n - 1) if n > 1 else np.inf)
        values |= {name: float(np.mean(own[name].to_numpy())) for name in names}
    found = Components(file, values, covariance, freedom, {part: tuple(own["trial"]) for part, own in rows.items()})
    for name, value in values.items():
        if value < 0 and value + 3 * found.se(name) < 0:
            part = COMPONENTS[name]
            raise InputError(f"{part}.csv: {name} = {value:.4g} is negative; look for the cause in the {part} trials")
    return replace(found, p=drivetrain_of(values, file))


def component_rows(tables: Mapping[str, pl.DataFrame], place: Sequence[str | None]) -> dict[str, pl.DataFrame]:
    """The rows of each part that count, of one joint and side; raises as `components_of`."""
    at, rows = [pl.col(k).eq_missing(pl.lit(v, pl.String)) for k, v in zip(PLACE, place, strict=True)], {}
    for part in PARTS:
        own = tables.get(part, pl.DataFrame())
        whole = [pl.col("amplitude_deg").is_null()] if "amplitude_deg" in own.columns else []  # the fit to all of each
        names = [name for name, of in COMPONENTS.items() if of == part]  # which an actuator that stands has not all
        rows[part] = counted(own.filter(*at, *whole).drop_nulls(names)) if len(own) else own
    if missing := [part for part, own in rows.items() if own.is_empty()]:
        stands = ", with a shaft that turns" if missing[0] == "actuator" and len(tables.get("actuator", ())) else ""
        said = " and no ".join(missing)
        raise InputError(f"the campaign has no {said} trials of this joint and side{stands}; record them")
    return rows


def mean_covariance(rows: pl.DataFrame, a: str, b: str) -> float:
    """Mean over the trials of the covariance of two estimates."""
    if a == b:
        return float((rows[f"{a}_se"].to_numpy() ** 2).mean())
    return float(np.mean(rows[f"cov_{a}_{b}" if f"cov_{a}_{b}" in rows.columns else f"cov_{b}_{a}"].to_numpy()))


def drivetrain_of(values: Mapping[str, float], file: DrivetrainParameters) -> DrivetrainParameters:
    """The drivetrain with these components; a loss that is negative by chance is none."""
    named = {name: max(value, 0.0) for name, value in values.items() if name != "k_tau_n_m"}
    return replace(file, k_tau=values["k_tau_n_m"] / file.n_m, K_s2=0.0, **named)


def predicted_torque(record: Record, law: Controller, p: DrivetrainParameters, friction: float = 1.0) -> Array:
    """Filtered resisting torque (n,) [N*m] of a drivetrain under a controller, for the recorded angle, with `friction`
    times that of the parameters. Raises InputError: it grows without bounds."""
    belt = belt_response(record.theta, record.rate_hz, law, p, friction)
    if not np.isfinite(belt).all():
        raise InputError(
            f"trial {record.name}: the drivetrain model grows without bounds for K_1 = {law.gains.K_1:g}, B_1 = "
            f"{law.gains.B_1:g}; check the parameter file and the component trials against the device"
        )
    return record.low_pass(belt, record.rate_hz) + p.B_j * record.motion.omega + p.J_j * record.motion.alpha


def prediction_terms(record: Record, law: Controller, components: Components) -> pl.DataFrame:
    """A row `predicted`, and one for each of `TERMS`. They have the K, B and I of the torque, and its part of the RMS
    `torque`, to first order; the prediction its `VAF` [percent] and the `rms` [N*m] of what it leaves; the terms their
    products with each of the terms, without offset and drift. Raises as `predicted_torque`."""
    predicted, file = predicted_torque(record, law, components.p), law.p
    columns = {"left": record.filtered_torque - predicted}
    exact = {"B_j": record.motion.omega, "J_j": record.motion.alpha}  # the torque is linear in them
    for name, value in components.values.items():
        if name in exact:
            columns[name] = exact[name]
            continue
        step = max(0.02 * abs(value), 0.5 * components.se(name))
        changed = drivetrain_of({**components.values, name: max(value, 0.0) + step}, file)
        columns[name] = (predicted_torque(record, law, changed) - predicted) / step
    columns["torque_gain"] = predicted
    for name in DELAYS:
        late: Any = {name: DELAY_STEP}
        columns[name] = (predicted_torque(record, replace(law, **late), components.p) - predicted) / DELAY_STEP
    motion, recorded, n = record.motion, record.part(record.filtered_torque), record.samples
    time = record.part(record.time)
    X = np.array(
        [np.ones(n), time - time.mean(), *(record.part(x) for x in (motion.theta, motion.omega, motion.alpha))]
    )
    scale = np.linalg.norm(X, axis=1)[:, None]
    X /= scale
    Y = np.array([record.part(x) for x in (predicted, *columns.values())])
    lower = np.linalg.cholesky(X @ X.T)
    along = np.linalg.solve(lower, X @ Y.T)  # each column of X without what the ones before explain
    K, B, I = (np.linalg.solve(lower.T, along) / scale)[2:]
    Y -= Y.mean(axis=1)[:, None]
    size = float(Y[0].std())
    torque = Y @ Y[0] / (n * size)
    torque[1] = recorded.std() - size
    vaf, nothing = variance_accounted_for(recorded, Y[1]), [None] * len(TERMS)
    found: dict[str, Any] = {"trial": record.name, "term": ["predicted", *TERMS], "VAF": [vaf, *nothing]}
    found["rms"] = [float(Y[1].std()), *nothing]
    sizes = along[2:] / np.sqrt(n) / size
    return pl.DataFrame(found | dict(zip((*QUANTITIES, *ALONG), (K, B, I, torque, *sizes), strict=True)))


def prediction_table(
    terms: Mapping[str, pl.DataFrame], fits: pl.DataFrame, components: Components
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """`prediction.csv` and `prediction_causes.csv` of one joint and side. `terms` are those of `prediction_terms` by
    trial, `fits` the rows of `impedance.csv` over all amplitudes of these trials.

    The interval of a prediction is that of what the trial should measure: the components' uncertainty, the trial's own,
    and what the equations lack, learnt from the *other* trials with the same controller.
    """
    trials = [fits.row(by_predicate=pl.col("trial") == trial, named=True) for trial in terms]
    each = [{row["term"]: row for row in own.to_dicts()} for own in terms.values()]
    rows = [
        {name: fit[name] for name in ("trial", *PLACE, "controller", "K_d", "B_d")}
        | {name: of["predicted"][name] for name in ("VAF", "rms")}
        | {"VAF_fitted": fit["VAF"], "doubtful": fit["doubtful"]}
        for fit, of in zip(trials, each, strict=True)
    ]
    of_part = np.array([[of == part for of in COMPONENTS.values()] for part in PARTS])
    teachers = [teachers_of(k, trials) for k in range(len(trials))]
    for row, others in zip(rows, teachers, strict=True):
        row["outside"] = outside_of(row, [fit for fit, teaches in zip(trials, others, strict=True) if teaches])
    freedom = [min(components.freedom[n] for n, of in COMPONENTS.items() if of == part) for part in PARTS]
    for quantity in QUANTITIES:
        x = np.array([[of[term][quantity] for term in ("predicted", "left", *COMPONENTS)] for of in each])
        predicted, off = x[:, 0], x[:, 1]
        size = np.hypot(predicted, LITTLE[quantity]) if quantity in LITTLE else np.ones(len(off))  # it errs by shares
        own_se = np.array([fit.get(f"{quantity}_repeat_se") or fit.get(f"{quantity}_se") or 0.0 for fit in trials])
        by_part = np.array([[s @ components.covariance @ s for s in np.where(of_part, own, 0.0)] for own in x[:, 2:]])
        known = by_part.sum(axis=1) + own_se**2
        for k, (row, others) in enumerate(zip(rows, teachers, strict=True)):
            learnt, value = int(np.count_nonzero(others)), float(predicted[k])
            row |= {quantity: value, f"{quantity}_component_se": float(np.sqrt(by_part[k].sum()))}
            row |= dict.fromkeys(f"{quantity}_{end}" for end in ENDS) | {f"{quantity}_measured": value + off[k]}
            if learnt < 2:
                continue
            lacking = model_variance((off / size)[others], (known / size**2)[others]) * size[k] ** 2
            variances = np.array([*by_part[k], own_se[k] ** 2, lacking])
            total = welch_satterthwaite(variances, [*freedom, np.inf, learnt - 1])
            half = float(scipy.special.stdtrit(total, 0.975) * np.sqrt(variances.sum()))
            row |= {f"{quantity}_{end}": value + way * half for end, way in ENDS.items()}
    causes = causes_table(each, components, {name: rows[0][name] for name in PLACE})
    return pl.DataFrame(rows, infer_schema_length=None), causes


def teachers_of(k: int, trials: Sequence[Mapping[str, Any]]) -> NDArray[np.bool_]:
    """From which trials what the equations lack in trial k is learnt: others that a fit explains, those with the same
    controller if there are enough."""
    others = np.array([fit["VAF"] >= LOWEST_VAF for fit in trials]) & (np.arange(len(trials)) != k)
    like = others & [fit["controller"] == trials[k]["controller"] for fit in trials]
    return np.asarray(like if np.count_nonzero(like) >= FEWEST_OTHERS else others)


def outside_of(trial: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> str | None:
    """Which of K_d and B_d of a trial is smaller, or larger, than in all others, from which its interval is learnt."""
    asked = {name: [fit[name] for fit in others] for name in ("K_d", "B_d")}
    beyond = [name for name, of in asked.items() if of and not min(of) <= trial[name] <= max(of)]
    return " and ".join(beyond) or None


def model_variance(off: Array, known: Array) -> float:
    """Variance of what the equations lack, from differences (n,) between measurement and prediction whose `known`
    variances are (n,): with it their mean square in standard deviations is one (Paule and Mandel, J. Res. Natl. Bur.
    Stand. 87, 1982, with known mean 0); 0 where the known ones suffice."""

    def excess(v: float) -> float:
        return float(np.mean(off**2 / np.maximum(known + v, 1e-12 * most + 1e-300))) - 1

    most = float(np.max(off**2))
    return float(scipy.optimize.brentq(excess, 0.0, most)) if excess(0.0) > 0 and most > 0 else 0.0


def causes_table(each: Sequence[Mapping[str, Any]], components: Components, place: Mapping[str, Any]) -> pl.DataFrame:
    """A row per component, for the gain of the torque, and per delay: the `change` that explains most of what all
    predictions leave, in the unit of the component, with its standard error, by leaving out a trial at a time and by
    the component's own; what is `left` with it and `left_without` it [percent of the torque]; and whether the
    recordings name it.

    No trial measures the delays of the controller, so that they explain first, and a component what they leave. The one
    that explains most is named, with those that explain as much, where it explains `LEAST_SHARE` and its change is
    certain and not small. Trials that ring do not outweigh the others: the regression is robust.
    """
    A = np.array([[[of[term][x] for x in ALONG] for term in TERMS] for of in each])
    n, values = len(A), {**components.values, "torque_gain": 1.0}

    def row_of(name: str, names: tuple[str, ...], left: float, without: float) -> dict[str, Any]:
        change, se, value = beside_delays(A, *names)[0].get(name, 0.0), None, values.get(name)
        if n > 2:
            again = [beside_delays(np.delete(A, trial, axis=0), *names)[0].get(name, 0.0) for trial in range(n)]
            se = float(np.hypot(np.sqrt((n - 1) * np.var(again)), components.se(name) if name in COMPONENTS else 0.0))
        if name == "K_s" and value and change < value:
            change = value * change / (value - change)  # the torque is linear in the compliance of the belt
        size = change if value is None else abs(change / value)
        certain = se is not None and size > LEAST_CHANGE[name] and abs(change) > CERTAIN * se
        row = {**place, "component": name, "value": value, "change": change, "change_se": se}
        return row | {"left": 100 * left, "left_without": 100 * without, "trials": n, "named": bool(certain)}

    late, left = beside_delays(A)[1], {name: beside_delays(A, name)[1] for name in values}
    least = min(left.values())
    rows = [row_of(name, (name,), of, late) for name, of in left.items()]
    best = next(row for row in rows if row["left"] == 100 * least)
    clear = best["named"] and late > LEAST_MISFIT and least < (1 - LEAST_SHARE) * late
    for row in rows:
        row["named"] &= clear and row["left"] <= AS_GOOD * 100 * least
    named = (best["component"],) if clear else ()
    with_it, without = beside_delays(A, *named)[1], robust_fit(A, named)[1]
    delays = [row_of(name, named, with_it, without) for name in DELAYS]
    for row in delays:
        row["named"] &= with_it < (1 - LEAST_SHARE) * without
    return pl.DataFrame([*rows, *delays], infer_schema_length=None)


def beside_delays(A: Array, *names: str) -> tuple[dict[str, float], float]:
    """As `robust_fit`, of terms beside the delays, of which none is negative: no controller knows the future."""
    delays = list(DELAYS)
    while True:
        x, left = robust_fit(A, (*names, *delays))
        found = dict(zip((*names, *delays), x.tolist(), strict=True))
        early = min(delays, key=lambda name: found[name], default=None)
        if early is None or found[early] >= 0:
            return found, left
        delays.remove(early)


def robust_fit(A: Array, names: Sequence[str]) -> tuple[Array, float]:
    """Coefficients of some terms in what the predictions leave, and the mean absolute value of what then is left; A is
    (trials, terms, 3), as shares of the torque. By Huber's M-estimator, with a scale by the median."""
    y = A[:, 0].ravel()
    if not names:
        return np.empty(0), float(np.mean(np.abs(y)))
    X = A[:, [TERMS.index(name) for name in names]].transpose(0, 2, 1).reshape(-1, len(names))
    scale = np.maximum(np.abs(X).max(axis=0), np.finfo(float).tiny)
    x = np.linalg.lstsq(X / scale, y, rcond=None)[0]
    for _ in range(49):  # iteratively reweighted least squares
        left = np.abs(y - X / scale @ x)
        if not (spread := np.median(left) / scipy.special.ndtri(0.75)):
            break  # half of the numbers are explained exactly
        weight = np.sqrt(np.minimum(1, 1.5 * spread / np.maximum(left, np.finfo(float).tiny)))
        before, x = x, np.linalg.lstsq(weight[:, None] * X / scale, weight * y, rcond=None)[0]
        if (np.abs(x - before) <= 1e-13 * np.abs(before)).all():
            break
    x = x / scale
    return x, float(np.mean(np.abs(y - X @ x)))
