"""The torque of an impedance trial as the leg's components predict it, beside the recorded one:
nothing is fitted.

Each component was measured alone (belt.py, transmission.py, actuator_alone.py). With the
controller's law they give the torque for the recorded angle (Eqs. 1-7). The components' uncertainty
carries over to the prediction. What
the equations lack shows in the other trials of the campaign. A misfit that all trials share names a
component that differs from its measurement, or a late controller.

The law that a controller ran comes from the logged current and the motor's angle, without any
component of the drivetrain or torque of the bench.

The controller of Eq. 5 asks for k_tau n_m I_q - s f_G |I_q| - s f_C = -K_1 theta_m - B_1 omega_m,
in the numbers of its program; s is the smoothed sign of the velocity. A loop that acts d seconds
late takes K_1 d off B_1. A velocity that is t seconds old adds B_1 t to the coefficient of the
acceleration. Its sign is as old; it is read from a velocity with `QUICK` times the cut-off, since a
motor that sticks and slides turns faster than the joint. Its age is the one that explains most of
the current.

The next link is the motor: the belt's torque per current. A current that reads too high scales the
whole law up and the motor's constant down, by one factor."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS
from osl_analysis.bench.analysis import LITTLE
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.gram import solved
from osl_analysis.bench.record import Record
from osl_analysis.bench.transmission import LOSSES
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import rms
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import PARAMETER_UNITS, DrivetrainParameters
from osl_analysis.stats.regression import (
    Covariance,
    LinearFit,
    estimates_row,
    linear_fit,
    thinned_rows,
    variance_accounted_for,
    welch_satterthwaite,
    with_shared_error,
    without,
)
from osl_analysis.stats.repeats import counted
from osl_analysis.table import finite_or_null
from osl_analysis.trial import Array

ONE = np.ones((1, 1))
CHUNKS = 24  # parts of a recording; the covariance comes from the scatter of their scores
LAW_GAINS = ("K_1", "B_1", "f_C", "f_G")
CONSTANT = "k_tau_n_m"
GAIN_COLUMNS = tuple(
    f"{x}{end}"
    for x in (*LAW_GAINS, CONSTANT)
    for end in ("", "_se", "_low", "_high", "_programmed")
)
OTHER_LAW = {"K_1_error": 0.02, "B_1_gap_s": 3e-3, "feedforward_error": 0.2}
"""Errors of the gains, each with the size from which on another law ran than was programmed: a
share of K_1, the lateness [s] that would explain B_1, a share of the cancelled friction."""
OTHER_LINK = ("loop_late_s", "current_error")
"""What passes for another law: a late loop [s], and the relative error of the current."""
LAW_COLUMNS = {"trial": pl.String} | dict.fromkeys(
    (*GAIN_COLUMNS, "VAF", *OTHER_LAW, *OTHER_LINK), pl.Float64
)
LEAST_SE = {"K_1": 1e-3, "B_1": 2e-3, "f_C": 5e-3, "f_G": 2e-2, CONSTANT: 1e-2}
"""Relative standard errors due to sampling and hold of the loop, and to a slipping belt, which all
chunks share."""


def law_table(
    record: Record, p: DrivetrainParameters, programmed: Gains, sign_width: float
) -> pl.DataFrame:
    """The row of a trial: its gains [N*m/rad, N*m*s/rad, N*m, 1] with 95 % intervals beside the
    `programmed` ones, the motor's torque per current [N*m/A], and by how much each is certainly
    off. `p` holds the numbers of the controller's program, `sign_width` [rad/s] that of its
    velocity's sign. No row if the trial has no current or motor angle on a time base with its
    torque, or if the motion cannot tell the gains apart."""
    nothing = pl.DataFrame(schema=LAW_COLUMNS)
    if "current" not in record.actuator:
        return nothing
    rate, low_pass = record.rate_hz, record.low_pass
    current, motion = record.actuator["current"], [record.actuator["theta_m"]]
    for _ in range(3):
        motion.append(np.gradient(motion[-1], 1 / rate))
    moved = {
        "K_1": -motion[0],
        "B_1": -motion[1],
        "lag": motion[2],
        "third": motion[3],
        "one": np.ones(len(motion[0])),
    }
    belt = record.filtered_torque - p.B_j * record.motion.omega - p.J_j * record.motion.alpha
    rows = record.rows()[thinned_rows(record.samples, rate, low_pass)]

    def fitted(y: Array, columns: Mapping[str, Array]) -> LinearFit:
        return linear_fit(y[rows], {name: x[rows] for name, x in columns.items()}, by_chunks)

    try:
        omega = np.gradient(record.actuator["quick"], 1 / rate)

        def friction(age: float) -> dict[str, Array]:
            sign = np.tanh(np.interp(record.time - age, record.time, omega) / sign_width)
            return {"f_C": low_pass(sign, rate), "f_G": low_pass(sign * np.abs(current), rate)}

        commanded, of_now = p.k_tau * p.n_m * current, friction(0.0)
        at_once = fit = fitted(commanded, moved | of_now)
        if abs(at_once["f_C"]) > 4 * at_once.se("f_C"):
            beside = without(np.column_stack([x[rows] for x in moved.values()]))
            y = beside(commanded[rows])

            # a filtered column of a later sign is the filtered column, later
            def missed(age: float) -> float:
                signs = [
                    np.interp(record.time[rows] - age, record.time, x) for x in of_now.values()
                ]
                late = beside(np.column_stack(signs))
                return float(np.sum((y - late @ np.linalg.lstsq(late, y)[0]) ** 2))

            ages = 0.0, 0.02  # bounds of the sign's age [s]
            best = scipy.optimize.minimize_scalar(
                missed, bounds=ages, method="bounded", options={"xatol": 2e-4}
            )
            fit = fitted(commanded, moved | friction(float(best.x)))
        against = {f"motor's {name}": -column for name, column in of_now.items()}
        losses = {"B_m": -motion[1], "J_m": -motion[2], "one": moved["one"]}
        motor = fitted(-belt / p.n_T, {CONSTANT: current} | against | losses)
    except (InputError, IdentifiabilityError):
        return nothing
    known = {
        "K_1": programmed.K_1,
        "B_1": programmed.B_1,
        "f_C": p.f_C,
        "f_G": p.f_G,
        CONSTANT: p.k_tau * p.n_m,
    }
    least = np.array([LEAST_SE.get(name, 0.0) * known.get(name, 0.0) for name in fit.names])
    # the age has an error (SD) of a tenth of its effect
    fit = with_shared_error(fit, 0.1 * (fit.estimates - at_once.estimates))
    fit = replace(fit, covariance=fit.covariance + np.diag(least**2))
    motor = with_shared_error(
        motor, np.array([LEAST_SE[CONSTANT] * known[CONSTANT], *np.zeros(len(motor.names) - 1)])
    )
    asked = known | {name: programmed.cancels_friction * known[name] for name in ("f_C", "f_G")}
    row = {
        "trial": record.name,
        **estimates_row(fit, *LAW_GAINS),
        **estimates_row(motor, CONSTANT),
        "VAF": fit.vaf,
    }
    row |= {f"{name}_programmed": value for name, value in asked.items()}
    typical = float(np.sqrt(np.mean(record.part(current) ** 2)))
    return pl.DataFrame(
        [row | certain_errors(fit, known[CONSTANT] / motor[CONSTANT], asked, p, typical)],
        LAW_COLUMNS,
    )


def by_chunks(X: Array, inverse: Array, residual: Array) -> Covariance:
    """The covariance from the scatter of scores of chunks: what a model lacks differs between
    them."""
    edges = np.arange(CHUNKS) * len(residual) // CHUNKS
    scores = np.add.reduceat(X * residual[:, None], edges) @ inverse
    freedom = np.full(X.shape[1], CHUNKS - 1.0)
    return scores.T @ scores * CHUNKS / (CHUNKS - 1), freedom, "chunks", len(residual) // CHUNKS


def certain_errors(
    fit: LinearFit,
    reads: float,
    asked: Mapping[str, float],
    p: DrivetrainParameters,
    current: float,
) -> dict[str, float | None]:
    """The certain errors, by the names of `OTHER_LAW` and `OTHER_LINK`. `reads` is the ratio of the
    logged current to the motor's, by its torque; `current` [A] is a typical one.

    If that ratio explains K_1, the current is wrong, and the law is what remains. A late loop has
    the right K_1, too small a B_1, and a coefficient of the acceleration of B_1 times its
    lateness."""

    def off(value: float, known: float, se: float) -> float:
        return max(abs(value - known) - 2 * se, 0.0)

    K_1, B_1 = asked["K_1"], asked["B_1"]
    is_off = off(fit["K_1"], K_1, fit.se("K_1")) > OTHER_LAW["K_1_error"] * K_1
    is_current = is_off and abs(fit["K_1"] / reads - K_1) < 0.5 * abs(fit["K_1"] - K_1)
    by = reads if is_current else 1.0
    row: dict[str, float | None] = dict.fromkeys((*OTHER_LAW, *OTHER_LINK))
    row["current_error"] = by - 1
    if K_1:
        apart = K_1 * LEAST_SE[CONSTANT] * is_current
        share = off(fit["K_1"] / by, K_1, fit.se("K_1") + apart) / K_1
        late = off(fit["B_1"] / by, B_1, fit.se("B_1")) / K_1
        borne = (fit["lag"] + 2 * fit.se("lag")) / by + K_1 * late**2 / 2
        is_late = (
            share <= OTHER_LAW["K_1_error"] and fit["B_1"] / by < B_1 and borne > 0.5 * B_1 * late
        )
        row |= {
            "K_1_error": share,
            "B_1_gap_s": late * (not is_late),
            "loop_late_s": late * is_late,
        }
    if stated := p.f_C + p.f_G * current:
        with_load = fit["f_C"] + fit["f_G"] * current
        variance = (
            fit.se("f_C") ** 2
            + 2 * current * fit.cov("f_C", "f_G")
            + (current * fit.se("f_G")) ** 2
        )
        known = asked["f_C"] + asked["f_G"] * current
        row["feedforward_error"] = (
            off(with_load / by, known, float(np.sqrt(max(variance, 0.0)))) / stated
        )
    return row


def law_that_ran(
    table: pl.DataFrame, programmed: Gains, p: DrivetrainParameters
) -> tuple[Gains, DrivetrainParameters]:
    """The gains, and parameters with the friction that the controller cancels: as programmed, or as
    in `law_table` if another law certainly ran. A late loop and a current that reads wrong do not
    change the law."""
    if table.is_empty():
        return programmed, p
    row = table.row(0, named=True)
    reads = 1 + row["current_error"]
    other = [name for name, most in OTHER_LAW.items() if (row[name] or 0.0) > most]
    if "feedforward_error" in other:
        f_C, f_G = (
            float(max(row["f_C"], 0.0) / reads),
            float(np.clip(row["f_G"], 0.0, 0.5 * row[CONSTANT])),
        )
        p = replace(p, f_C=f_C, f_G=f_G)
        cancels = p.f_C + p.f_G > 0.1 * (row["f_C_programmed"] + row["f_G_programmed"])
        programmed = replace(programmed, cancels_friction=cancels)
    if {"K_1_error", "B_1_gap_s"} & {*other}:
        programmed = replace(programmed, K_1=row["K_1"] / reads, B_1=row["B_1"] / reads)
    return programmed, p


COMPONENTS = (
    dict.fromkeys(ACTUATOR_PARAMETERS, "actuator")
    | {"K_s": "belt"}
    | dict.fromkeys(LOSSES, "transmission")
)
"""The experiment that measures each component."""
PARTS = tuple(dict.fromkeys(COMPONENTS.values()))
# ages [s] of the controller's inputs, which no component trial shows
DELAYS = ("angle_delay", "velocity_delay")
TERMS = ("left", *COMPONENTS, "torque_gain", *DELAYS)
"""Torques of a trial: the prediction's residual, and the effect of one unit of each component, gain
or delay."""
QUANTITIES = ("K", "B", "I", "torque")  # of Eq. 15, and the RMS [N*m] of the torque
ALONG = ("along_theta", "along_omega", "along_alpha")
"""RMS of the parts of a torque that are proportional to the motion, over the RMS of the predicted
torque: they make up K, B and I, are similar in size, and independent."""
NUMBERS = (
    "K_d",
    "B_d",
    "VAF",
    "rms",
    "VAF_fitted",
    *(f"{x}{end}" for x in QUANTITIES for end in ("", "_measured")),
)
"""Columns of `prediction.csv` that exist without a prediction, too."""
ENDS = {"low": -1.0, "high": 1.0}
# [percent] of Eq. 15; below, K, B and I hardly describe a trial, and others do not learn from it
LOWEST_VAF = 80.0
MISSES = {"trial": pl.String} | dict.fromkeys(
    ("frequency_hz", "torque", "miss", "share"), pl.Float64
)
# with as many trials of the same controller, only these show what the equations lack
FEWEST_OTHERS = 4
DELAY_STEP = 2.5e-4  # change [s] of the delays for the derivatives
# least share of the misfit a named cause explains; its change in standard errors
LEAST_SHARE, CERTAIN = 0.5, 4.0
# a cause is named beside the best one if it leaves at most this multiple of what that leaves
AS_GOOD = 1.5
LEAST_MISFIT = 5e-3  # share of the torque that the delays must leave; sound legs leave up to 0.0035
LEAST_CHANGE = dict.fromkeys(COMPONENTS, 0.05) | {
    "torque_gain": 0.02,
    "angle_delay": 1.5e-3,
    "velocity_delay": 5e-3,
}
"""Smallest named change, relative to a component, or of a delay [s]. A sampled loop acts half a
sample late or later (1 ms at 500 Hz); a velocity from a filtered difference is older still."""


@dataclass(frozen=True)
class Components:
    """The drivetrain as its components were measured."""

    p: DrivetrainParameters  # with the ratios n_T and n_m of the parameter file
    # mean of each component over the trials, in the order of `COMPONENTS`
    values: Mapping[str, float]
    covariance: Array  # of these means, (8, 8)
    freedom: Mapping[str, float]  # degrees of freedom of the variance of each
    trials: Mapping[str, tuple[str, ...]]  # names of the trials, by experiment

    def se(self, name: str) -> float:
        k = list(COMPONENTS).index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def rows(self) -> list[dict[str, Any]]:
        """For JSON, in SI units: each component with its 95 % interval and its trials."""
        found = []
        for name, value in self.values.items():
            freedom, part, se = self.freedom[name], COMPONENTS[name], self.se(name)
            half = float(scipy.special.stdtrit(freedom, 0.975)) * se
            row = {
                "name": name,
                "value": value,
                "unit": PARAMETER_UNITS["k_tau" if name == "k_tau_n_m" else name],
            }
            row |= {
                "standard_error": se,
                "low": value - half,
                "high": value + half,
                "degrees_of_freedom": freedom,
            }
            found.append(finite_or_null(row) | {"experiment": part, "trials": self.trials[part]})
        return found


def components_of(
    tables: Mapping[str, pl.DataFrame], place: Sequence[str | None], file: DrivetrainParameters
) -> Components:
    """The components of one joint and side: means over the trials that count in the campaign's
    tables `actuator`, `belt` and `transmission`. The variance of a mean is from the scatter of
    trials, or from their fits if that is larger; correlations are from the fits. `file` has the
    ratios. Raises InputError: a table has no such trial; a component is negative beyond its
    uncertainty."""
    rows = component_rows(tables, place)
    values, freedom, covariance = (
        dict[str, float](),
        dict[str, float](),
        np.zeros((len(COMPONENTS),) * 2),
    )
    for part, own in rows.items():
        names = [name for name, of in COMPONENTS.items() if of == part]
        k, n = [list(COMPONENTS).index(name) for name in names], len(own)
        within = np.array([[mean_covariance(own, a, b) for b in names] for a in names]) / n
        of_fits = np.sqrt(np.diag(within))
        # of all trials on the bench
        shared = np.array([rms(own[f"{name}_se_bench"].to_numpy()) for name in names])
        alone = np.sqrt(np.maximum(of_fits**2 - shared**2 / n, 0.0))
        scatter = (
            own.select(names).to_numpy().std(axis=0, ddof=1) / np.sqrt(n)
            if n > 1
            else np.zeros(len(names))
        )
        se = np.hypot(np.maximum(alone, scatter), shared)
        covariance[np.ix_(k, k)] = within / np.outer(of_fits, of_fits) * np.outer(se, se)
        freedom |= dict.fromkeys(names, float(n - 1) if n > 1 else np.inf)
        values |= {name: float(np.mean(own[name].to_numpy())) for name in names}
    found = Components(
        file, values, covariance, freedom, {part: tuple(own["trial"]) for part, own in rows.items()}
    )
    for name, value in values.items():
        if value < 0 and value + 3 * found.se(name) < 0:
            part = COMPONENTS[name]
            raise InputError(
                f"{part}.csv: {name} = {value:.4g} is negative; look for the cause in the {part}"
                " trials"
            )
    return replace(found, p=drivetrain_of(values, file))


def component_rows(
    tables: Mapping[str, pl.DataFrame], place: Sequence[str | None]
) -> dict[str, pl.DataFrame]:
    """The rows of each part that count, of one joint and side; raises as `components_of`."""
    at, rows = (
        [pl.col(k).eq_missing(pl.lit(v, pl.String)) for k, v in zip(PLACE, place, strict=True)],
        {},
    )
    for part in PARTS:
        own = tables.get(part, pl.DataFrame())
        # fits to whole trials
        whole = [pl.col("amplitude_deg").is_null()] if "amplitude_deg" in own.columns else []
        # an actuator at rest lacks some
        names = [name for name, of in COMPONENTS.items() if of == part]
        rows[part] = counted(own.filter(*at, *whole).drop_nulls(names)) if len(own) else own
    if missing := [part for part, own in rows.items() if own.is_empty()]:
        stands = (
            ", with a shaft that turns"
            if missing[0] == "actuator" and len(tables.get("actuator", ()))
            else ""
        )
        said = " and no ".join(missing)
        raise InputError(
            f"the campaign has no {said} trials of this joint and side{stands}; record them"
        )
    return rows


def mean_covariance(rows: pl.DataFrame, a: str, b: str) -> float:
    """Mean covariance of two estimates over the trials."""
    if a == b:
        return float((rows[f"{a}_se"].to_numpy() ** 2).mean())
    return float(
        np.mean(
            rows[f"cov_{a}_{b}" if f"cov_{a}_{b}" in rows.columns else f"cov_{b}_{a}"].to_numpy()
        )
    )


def drivetrain_of(values: Mapping[str, float], file: DrivetrainParameters) -> DrivetrainParameters:
    """The drivetrain with these components; a loss that is negative by chance is set to 0."""
    named = {name: max(value, 0.0) for name, value in values.items() if name != "k_tau_n_m"}
    return replace(file, k_tau=values["k_tau_n_m"] / file.n_m, K_s2=0.0, **named)


def predicted_torques(
    record: Record, legs: Sequence[tuple[Controller, DrivetrainParameters]]
) -> Iterator[Array]:
    """Filtered resisting torque (n,) [N*m] of each leg for the recorded angle. Raises InputError:
    it has no bounds."""
    for belt, (law, p) in zip(
        belt_responses(record.theta, record.rate_hz, legs), legs, strict=True
    ):
        if not np.isfinite(belt).all():
            raise InputError(
                f"trial {record.name}: the drivetrain model grows without bounds for K_1 ="
                f" {law.gains.K_1:g}, B_1 = {law.gains.B_1:g}; check the parameter file and the"
                " component trials against the device"
            )
        yield (
            record.low_pass(belt, record.rate_hz)
            + p.B_j * record.motion.omega
            + p.J_j * record.motion.alpha
        )


def miss_over_frequency(record: Record, predicted: Array) -> pl.DataFrame:
    """RMS [N*m] of the recorded `torque` and of its `miss`, recorded less `predicted` (n,), and
    their ratio `share` [percent]: at each frequency of a stepped sine, with its harmonics; for
    another motion in those third octaves that have 0.1 % or more of the torque's power. The mean of
    a stretch of rows is no miss."""
    signals, rows = np.array([record.filtered_torque, record.filtered_torque - predicted]), []
    of_sines = any(np.isfinite(one.frequency_hz) for one in record.groups.strata)
    for part in record.pieces:
        if of_sines:
            hz = next(
                one.frequency_hz
                for one in record.groups.strata
                if one.rows.start <= part.start < one.rows.stop
            )
            rows.append((hz, part.stop - part.start, *signals[:, part].var(axis=1)))
            continue
        f, density = scipy.signal.periodogram(signals[:, part], record.rate_hz, "hann")
        thirds = np.exp2(np.rint(3 * np.log2(f[1:])) / 3)
        for hz in np.unique(thirds):
            rows.append((hz, part.stop - part.start, *(density[:, 1:] @ (thirds == hz) * f[1])))
    table = pl.DataFrame(
        rows, schema=("frequency_hz", "n", "torque", "miss"), orient="row"
    ).group_by("frequency_hz")
    weighted = (
        (pl.col(name) * pl.col("n")).sum() / pl.col("n").sum() for name in ("torque", "miss")
    )
    power = (
        table.agg(*weighted)
        .sort("frequency_hz")
        .filter(pl.col("torque") >= 1e-3 * pl.col("torque").sum())
    )
    found = power.with_columns(pl.col("torque", "miss").sqrt(), trial=pl.lit(record.name))
    return found.with_columns(share=100 * pl.col("miss") / pl.col("torque")).select(*MISSES)


def prediction_terms(
    record: Record, law: Controller, components: Components
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """A row `predicted`, and one for each of `TERMS`, with K, B and I of its torque, its part of
    the RMS `torque` to first order, and `ALONG`, without offset and drift. The prediction has its
    `VAF` [percent] and the `rms` [N*m] of its residual. The second table is `miss_over_frequency`.
    Raises as `predicted_torques`."""
    exact = {"B_j": record.motion.omega, "J_j": record.motion.alpha}  # the torque is linear in them
    steps, legs = dict.fromkeys(DELAYS, DELAY_STEP), [(law, components.p)]
    legs += [(replace(law, **{name: DELAY_STEP}), components.p) for name in DELAYS]  # type: ignore[arg-type]
    for name, value in components.values.items():
        if name not in exact:
            steps[name] = max(0.02 * abs(value), 0.5 * components.se(name))
            changed = {**components.values, name: max(value, 0.0) + steps[name]}
            legs.append((law, drivetrain_of(changed, law.p)))
    predicted, *others = predicted_torques(record, legs)
    found = {"left": record.filtered_torque - predicted, **exact, "torque_gain": predicted}
    found |= {
        name: (x - predicted) / step for (name, step), x in zip(steps.items(), others, strict=True)
    }
    columns = {name: found[name] for name in TERMS}
    motion, recorded, n = record.motion, record.part(record.filtered_torque), record.samples
    time = record.part(record.time)
    moved = (record.part(x) for x in (motion.theta, motion.omega, motion.alpha))
    X = np.array([np.ones(n), time - time.mean(), *moved])
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
    table: dict[str, Any] = {
        "trial": record.name,
        "term": ["predicted", *TERMS],
        "VAF": [vaf, *nothing],
    }
    table["rms"] = [float(Y[1].std()), *nothing]
    sizes = along[2:] / np.sqrt(n) / size
    terms = pl.DataFrame(
        table | dict(zip((*QUANTITIES, *ALONG), (K, B, I, torque, *sizes), strict=True))
    )
    return terms, miss_over_frequency(record, predicted)


def prediction_table(
    terms: Mapping[str, pl.DataFrame], fits: pl.DataFrame, components: Components
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """`prediction.csv` and `prediction_causes.csv` of one joint and side. `terms` holds
    `prediction_terms` by trial, `fits` the rows of `impedance.csv` over all amplitudes of these
    trials.

    The interval of a prediction is for the trial's measured value. It contains the uncertainty of
    the components and of the trial, and what the equations lack, learnt from the *other* trials
    with the same controller."""
    trials = [fits.row(by_predicate=pl.col("trial") == trial, named=True) for trial in terms]
    each = [{row["term"]: row for row in own.to_dicts()} for own in terms.values()]
    rows = [
        {name: fit[name] for name in ("trial", *PLACE, "controller", "K_d", "B_d")}
        | {name: of["predicted"][name] for name in ("VAF", "rms")}
        | {"VAF_fitted": fit["VAF"], "doubtful": fit["doubtful"]}
        for fit, of in zip(trials, each, strict=True)
    ]
    of_part = np.array([[of == part for of in COMPONENTS.values()] for part in PARTS])
    # for each trial: others that Eq. 15 fits, of its controller if enough
    teachers = list[NDArray[np.bool_]]()
    for k, fit in enumerate(trials):
        others = np.array([one["VAF"] >= LOWEST_VAF for one in trials]) & (
            np.arange(len(trials)) != k
        )
        like = others & [one["controller"] == fit["controller"] for one in trials]
        teachers.append(like if np.count_nonzero(like) >= FEWEST_OTHERS else others)
    for row, others in zip(rows, teachers, strict=True):
        row["outside"] = outside_of(
            row, [fit for fit, teaches in zip(trials, others, strict=True) if teaches]
        )
    freedom = [
        min(components.freedom[n] for n, of in COMPONENTS.items() if of == part) for part in PARTS
    ]
    for quantity in QUANTITIES:
        x = np.array(
            [[of[term][quantity] for term in ("predicted", "left", *COMPONENTS)] for of in each]
        )
        predicted, off = x[:, 0], x[:, 1]
        # relative errors
        size = np.hypot(predicted, LITTLE[quantity]) if quantity in "KB" else np.ones(len(off))
        own_se = np.array(
            [fit.get(f"{quantity}_repeat_se") or fit.get(f"{quantity}_se") or 0.0 for fit in trials]
        )
        by_part = np.array(
            [
                [s @ components.covariance @ s for s in np.where(of_part, own, 0.0)]
                for own in x[:, 2:]
            ]
        )
        known = by_part.sum(axis=1) + own_se**2
        for k, (row, others) in enumerate(zip(rows, teachers, strict=True)):
            learnt, value = int(np.count_nonzero(others)), float(predicted[k])
            row |= {quantity: value, f"{quantity}_component_se": float(np.sqrt(by_part[k].sum()))}
            row |= dict.fromkeys(f"{quantity}_{end}" for end in ENDS) | {
                f"{quantity}_measured": value + off[k]
            }
            if learnt < 2:
                continue
            lacking = model_variance((off / size)[others], (known / size**2)[others]) * size[k] ** 2
            variances = np.array([*by_part[k], own_se[k] ** 2, lacking])
            total = welch_satterthwaite(variances, [*freedom, np.inf, learnt - 1])
            half = float(scipy.special.stdtrit(total, 0.975) * np.sqrt(variances.sum()))
            row |= {f"{quantity}_{end}": value + way * half for end, way in ENDS.items()}
    causes = causes_table(each, components, {name: rows[0][name] for name in PLACE})
    return pl.DataFrame(rows, infer_schema_length=None), causes


def outside_of(trial: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> str | None:
    """Which of a trial's K_d and B_d lie outside the range of the others, from which its interval
    is learnt."""
    asked = {name: [fit[name] for fit in others] for name in ("K_d", "B_d")}
    beyond = [name for name, of in asked.items() if of and not min(of) <= trial[name] <= max(of)]
    return " and ".join(beyond) or None


def model_variance(off: Array, known: Array) -> float:
    """Variance of what the equations lack, from differences (n,) between measurement and prediction
    and their `known` variances (n,): it makes their standardised mean square 1 (Paule and Mandel,
    J. Res. Natl. Bur. Stand. 87, 1982, with known mean 0); 0 if the known ones suffice."""

    def excess(v: float) -> float:
        return float(np.mean(off**2 / np.maximum(known + v, 1e-12 * most + 1e-300))) - 1

    most = float(np.max(off**2))
    return float(scipy.optimize.brentq(excess, 0.0, most)) if excess(0.0) > 0 and most > 0 else 0.0


def causes_table(
    each: Sequence[Mapping[str, Any]], components: Components, place: Mapping[str, Any]
) -> pl.DataFrame:
    """A row per component, for the gain of the torque, and per delay: the `change`, in its unit,
    that explains most of all residuals; its standard error, from leaving out one trial at a time
    and from the component; what is `left` with it and `left_without` it [percent of the torque];
    and whether the recordings name it.

    No trial measures the controller's delays, so that they explain first, and a component explains
    their residual. The component that explains most is named, with those that explain as much, if
    it explains `LEAST_SHARE` and its change is certain and not small. The regression is robust, so
    that trials that ring do not dominate."""
    A = np.array([[[of[term][x] for x in ALONG] for term in TERMS] for of in each])
    n, values = len(A), {**components.values, "torque_gain": 1.0}

    def row_of(name: str, fitted: Fitted, without: float) -> dict[str, Any]:
        changes, left = fitted
        (change, *again), se, value = changes[name].tolist(), None, values.get(name)
        if again:
            se = float(
                np.hypot(
                    np.sqrt((n - 1) * np.var(again)),
                    components.se(name) if name in COMPONENTS else 0.0,
                )
            )
        if name == "K_s" and value and change < value:
            # the torque is linear in the compliance of the belt
            change = value * change / (value - change)
        size = change if value is None else abs(change / value)
        certain = se is not None and size > LEAST_CHANGE[name] and abs(change) > CERTAIN * se
        row = {**place, "component": name, "value": value, "change": change, "change_se": se}
        return row | {
            "left": 100 * left,
            "left_without": 100 * without,
            "trials": n,
            "named": bool(certain),
        }

    late = beside_delays(A)[1]
    rows = [row_of(name, beside_delays(A, name), late) for name in values]
    best = min(rows, key=lambda row: row["left"])
    least = best["left"] / 100
    clear = best["named"] and late > LEAST_MISFIT and least < (1 - LEAST_SHARE) * late
    for row in rows:
        row["named"] &= clear and row["left"] <= AS_GOOD * best["left"]
    named = (best["component"],) if clear else ()
    beside, without = beside_delays(A, *named), float(robust_fit(A, named)[1][0])
    delays = [row_of(name, beside, without) for name in DELAYS]
    for row in delays:
        row["named"] &= beside[1] < (1 - LEAST_SHARE) * without
    return pl.DataFrame([*rows, *delays], infer_schema_length=None)


Fitted = tuple[Mapping[str, Array], float]
"""Coefficients of terms by name, of all trials and then (from three on) without each; the residual
of all."""


def beside_delays(A: Array, *names: str) -> Fitted:
    """As `robust_fit`, of terms and the delays, none of which may be negative: no controller knows
    the future."""
    n, names = len(A), (*names, *DELAYS)
    trials = np.vstack([np.ones(n), (1 - np.eye(n))[: n * (n > 2)]])
    used, early = np.ones((len(trials), len(names))), np.ones(len(trials), dtype=np.bool_)
    x, left = np.zeros(used.shape), np.zeros(len(trials))
    while early.any():
        x[early], left[early] = robust_fit(A, names, used[early], trials[early])
        first = x[:, -len(DELAYS) :].argmin(axis=1) - len(DELAYS)
        early = x[range(len(x)), first] < 0
        used[early, first[early]] = 0.0
    return dict(zip(names, x.T, strict=True)), float(left[0])


def robust_fit(
    A: Array, names: Sequence[str], used: Array = ONE, trials: Array = ONE
) -> tuple[Array, Array]:
    """Coefficients (b, k) of k terms in the residuals of the predictions, and the mean absolute
    value (b,) of what is then left; A is (trials, terms, 3), in shares of the torque. Each of the b
    fits uses the terms (b, k) and the trials (b, trials) that are 1, not 0. Huber's M-estimator,
    with a scale by the median."""
    y, counts = (
        A[:, 0].ravel(),
        np.repeat(np.broadcast_to(trials, (len(trials), len(A))), 3, axis=1),
    )
    X = A[:, [TERMS.index(name) for name in names]].transpose(0, 2, 1).reshape(len(y), -1)
    X = X / (scale := np.maximum(np.abs(X).max(axis=0), np.finfo(float).tiny))
    products, pairs = X[:, :, None] * X[:, None], used[:, :, None] * used[:, None]
    unused = np.eye(len(names)) * (1 - used[:, None])
    of_each, middle, weight, x = (
        range(len(counts)),
        counts.sum(axis=1).astype(int),
        counts,
        np.zeros((1, 1)),
    )
    for _ in range(50):  # iteratively reweighted least squares
        normal = np.tensordot(weight, products, 1) * pairs + unused
        before, x = x, solved(normal, (weight * y) @ X * used)[0] * used
        left = np.abs(y - x @ X.T)
        if (np.abs(x - before) <= 1e-13 * np.abs(before)).all():
            break
        rising = np.sort(np.where(counts > 0, left, np.inf), axis=1)
        median = (rising[of_each, (middle - 1) // 2] + rising[of_each, middle // 2])[:, None] / 2
        huber = np.minimum(
            1, 1.5 * median / scipy.special.ndtri(0.75) / np.maximum(left, np.finfo(float).tiny)
        )
        weight = np.where(median > 0, huber * counts, weight)  # at 0 half of the numbers are exact
    return x / scale, (left * counts).sum(axis=1) / middle
