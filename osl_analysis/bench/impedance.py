"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 fitted to any motion, per amplitude and
over all, the impedance that the gains should render, and the evidence on which the estimates are
judged."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench import effects
from osl_analysis.bench.analysis import (
    LITTLE,
    QUANTITIES,
    Analysis,
    angle_noise_share,
    check_resists,
    fitted_motion,
    plausible_impedance,
    share_of_inertia,
    turn_deg,
    widened,
    without_lag,
)
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.effects import IMPEDANCE, Fault
from osl_analysis.bench.gram import FEWEST_UNITS, GroupFit, Sums, combined, estimates_of, solved
from osl_analysis.bench.joint_inference import impedance_fits, misfit_of_losses
from osl_analysis.bench.record import Record, actuator_turns
from osl_analysis.bench.row_groups import Label
from osl_analysis.errors import InputError, nearest
from osl_analysis.inference.constants import BLOCKS
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance
from osl_analysis.signals.clock_drift import NO_DRIFT
from osl_analysis.spectral.periods import distinct
from osl_analysis.stats.regression import Row, estimates_row, lag_damping_row
from osl_analysis.stats.repeats import (
    alike_sizes,
    counted,
    doubtful_row,
    over_repeats,
    repeating_trials,
    summary_row,
)
from osl_analysis.table import held_against_desired
from osl_analysis.trial import Array


@dataclass(frozen=True)
class DesiredImpedance:
    """What the leg was asked to render in a trial, as far as it is known."""

    controller: str | None
    """Any name; `compensated` and `uncompensated` are those of the draft. None: none, or not
    known."""
    K_d: float | None  # desired stiffness [N*m/rad]; None: not known
    B_d: float | None  # desired damping [N*m*s/rad]; None: not known

    def gains(self, p: DrivetrainParameters | None, weight: Weight) -> Gains | None:
        """The gains of a device with these parameters, selected with W of Eq. 14; None where they
        are not known.

        Raises UnreachableImpedanceError: As `select_gains`."""
        if (
            p is None
            or self.controller is None
            or self.K_d is None
            or self.B_d is None
            or self.unknown_gains()
        ):
            return None
        return select_gains(self.controller, self.K_d, self.B_d, p, weight)

    def unknown_gains(self) -> str:
        """Why the gains of this trial are not known, whatever the device; empty where they are."""
        if self.controller is None:
            return "no controller is stated"
        if self.controller not in CONTROLLERS:
            return (
                f"the gains of controller '{self.controller}' are not"
                f" known{nearest(self.controller, CONTROLLERS)}"
            )
        absent = [name for name in ("K_d", "B_d") if getattr(self, name) is None]
        return (
            f"{' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not stated"
            if absent
            else ""
        )

    def columns(self) -> dict[str, pl.Expr]:
        """`controller`, `K_d` and `B_d` as constant columns of a table."""
        numbers = {name: pl.lit(getattr(self, name), pl.Float64) for name in ("K_d", "B_d")}
        return {"controller": pl.lit(self.controller, pl.String), **numbers}


def rendered_impedance(
    record: Record, expected: effects.Admittance | None = None
) -> tuple[Analysis, Sums]:
    """Eq. 15 of a record, and the sums with the columns of all effects. `expected` is the
    admittance of the linear model, where the gains are known. Raises as `fitted_motion`."""
    analysis = fitted_motion(record, effects.plain_sums(record, IMPEDANCE), IMPEDANCE)
    return analysis, effects.sums_of(record, IMPEDANCE, expected)


def impedance_table(
    analysis: Analysis, s: Sums, p: DrivetrainParameters | None = None
) -> pl.DataFrame:
    """The trial's rows of `impedance.csv`: Eq. 15 fitted to each amplitude [deg] and to all of them
    (amplitude null). A motion that is no stepped sine has one row. What describes the motion is the
    same in every row: the estimates of a device that is not of second order depend on band and
    weights. The device's parameters and theta_m give the belt, which shows a lag that Eq. 15 hides
    where it does not fit the drivetrain. Without parameters a joint whose actuator turns is taken
    for a leg, since its drivetrain is no fault of the recording."""
    record = analysis.record
    belt = effects.belt_of_leg(record, p)
    is_leg = belt is not None or (p is None and actuator_turns(record))
    check_drives_nothing(analysis)
    fits = impedance_fits(analysis, s, is_leg)
    lag, late = (belt.torque, belt.theta_m) if belt else (None, None)
    repeats, drift = effects.repeats_row(record, s, IMPEDANCE), fits[None].clock_drift
    clocks: Row = {name: repeats[name] for name in NO_DRIFT}
    if drift is not None and clocks["clock_drift_ppm"] is None:
        clocks = effects.clocks_row(record, drift.ppm, drift.standard_error, BLOCKS - 1)
    of_trial: Row = {
        **motion_row(record),
        "K_s_ratio": belt.K_s / p.K_s if belt and p else None,
        "theta_m_lag_s": late.size if late else None,
        "theta_m_lag_se_s": late.se if late else None,
        "certain_theta_m_lag_s": late.size * late.found if late else None,
        "K_drift": repeats["K_drift"],
        **clocks,
    }
    of_whole = over_amplitudes(analysis)
    rows = list[Row]()
    for label, fit in analysis.fits.items():
        rows.append(
            {
                **analysis.place(label),
                **fits[label].to_row(),
                **analysis.beside_estimates(label, *QUANTITIES),
                **lag_row(lag, fit),
                **analysis.shared(label, *QUANTITIES),
                "theta_rms_deg": turn_deg(s, label),
                "fitted_s": len(record.rows(label)) / record.rate_hz,
                "recorded_s": float(np.ptp(record.time)),
                "angle_noise_share": angle_noise_share(record, s, fit, label),
                **without_lag(analysis, lag, label),
                **of_trial,
                **(of_whole if label is None else dict.fromkeys(of_whole)),
            }
        )
    texts = dict.fromkeys(("fault", "fault_family", "explanations", "widened_because"), pl.String)
    table = pl.DataFrame(rows, infer_schema_length=None, schema_overrides=texts)
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))


def check_drives_nothing(analysis: Analysis) -> None:
    """Refuse a torque that drives the motion. With the right sign a joint may do so by K alone.
    Raises InputError."""
    fit = analysis.whole
    if fit.interval("B")[0] < 0 or fit.interval("I")[1] < 0:
        check_resists(analysis.record.name, "K", fit["K"], fit.interval("K")[1])


def motion_row(record: Record) -> Row:
    """What moved the joint."""
    (low, high), periodic = record.band_hz, record.periodic
    kinds = {"cycles": "stepped sine", "periods": "periodic", "stretches": "other"}
    row: Row = {
        "excitation": kinds[record.groups.kind] if periodic is None else "periodic",
        "band_low_hz": low,
        "band_high_hz": high,
        "cutoff_hz": float(record.low_pass.cutoff_hz),
        **dict.fromkeys(("period_s", "periods", "realisations")),
    }
    if periodic is not None:
        row |= {
            "period_s": periodic.period,
            "realisations": float(len(distinct(periodic.realisations))),
        }
        row["periods"] = float(sum(one.periods for one in periodic.realisations))
    return row


def lag_row(lag: Fault | None, fit: GroupFit) -> Row:
    """Lag of a leg's torque behind the angle by its belt, the damping that this lag makes, and the
    shares of B and I due to a lag that was found: exp(-s d) takes K d off B, and d times the
    joint's own B off I."""
    if lag is None:
        return {
            **lag_damping_row(None, None, fit["K"]),
            "lag_share": None,
            "lag_inertia_share": None,
        }
    row: Row = {**lag_damping_row(lag.size, lag.se, fit["K"], 0.0 if lag.found else np.inf)}
    K, B, size = fit["K"], fit["B"], lag.size * lag.found
    return row | {
        "lag_share": abs(K * size / B),
        "lag_inertia_share": abs((B + K * size) * size) / share_of_inertia(fit),
    }


def over_amplitudes(analysis: Analysis) -> Row:
    """Columns of the row over all amplitudes on the single ones, null for fewer than two: the
    relative changes `K_change` and `B_change` from the smallest to the largest amplitude, and the
    lowest and the highest estimates.

    A stiffening spring, or play, changes K with the amplitude; friction changes K and B. A change
    is reduced by the half-width of its 95 % interval, at most to 0: noise is no change. Its divisor
    has `LITTLE` added in quadrature. If both amplitudes have the same frequencies, each frequency
    is left out of both in turn: what the model misses at both alike then is no error of the
    difference. Else their intervals are independent."""
    bounds = [f"{name}_amplitudes_{end}" for name in QUANTITIES for end in ("low", "high")]
    row: Row = dict.fromkeys(("K_change", "B_change", *bounds))
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) < 2:
        return row
    model, (small, large) = analysis.model, (analysis.fits[labels[k]] for k in (0, -1))
    for name in QUANTITIES:
        single = [analysis.fits[label][name] for label in labels]
        row |= {f"{name}_amplitudes_low": min(single), f"{name}_amplitudes_high": max(single)}
    halves = difference_halves(analysis, labels[0], labels[-1])
    for name in "KB":
        difference = large[name] - small[name]
        certain = float(np.sign(difference)) * max(
            abs(difference) - float(halves[list(model).index(name)]), 0.0
        )
        row[f"{name}_change"] = certain / float(np.hypot(analysis.whole[name], LITTLE[name]))
    return row


def difference_halves(analysis: Analysis, *ends_of: Label) -> Array:
    """Half-widths (p,) of the 95 % intervals of the differences between the estimates of two
    amplitudes."""
    s, model = analysis.sums, analysis.model
    small, large = (analysis.fits[label] for label in ends_of)
    halves = np.linalg.norm(
        [[fit.interval(name)[1] - fit[name] for name in model] for fit in (small, large)], axis=0
    )
    strata = [(one.label, round(one.frequency_hz, 1), k) for k, one in enumerate(s.groups.strata)]
    of_small, of_large = ({hz: k for label, hz, k in strata if label == end} for end in ends_of)
    paired = of_small.keys() == of_large.keys() and len(of_small) >= FEWEST_UNITS
    if paired and small.repeat is not None and large.repeat is not None:
        at, differences = s.index(list(model.values())), list[Array]()
        for hz in of_small:
            rest = s.groups.stratum != of_small[hz], s.groups.stratum != of_large[hz]
            less, more = (
                estimates_of(s.over(s.groups.of(label) & keep), at, s.torque)
                for label, keep in zip(ends_of, rest, strict=True)
            )
            differences.append(more - less)
        m, apart = len(differences), np.array(differences) - np.mean(differences, axis=0)
        noise, never = small.repeat + large.repeat, np.full(len(model), np.inf)
        covariance, freedom = combined(noise, never, apart.T @ apart * (m - 1) / m, m)
        halves = scipy.special.stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance))
    return np.asarray(halves)


def judged_impedance(
    record: Record,
    rails: pl.Expr,
    p: DrivetrainParameters | None,
    desired: DesiredImpedance | None,
    gains: Gains | None = None,
) -> tuple[Analysis, pl.DataFrame]:
    """Eq. 15 of a record, and its rows with all that judges them. What the `gains` should render is
    known only with a parameter file (`p`). Raises as `plausible_impedance`."""
    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j) if p and gains else None
    analysis, s = rendered_impedance(record, expected)
    predicted = None
    # Eq. 15 fitted to the linear model's torque in the recorded motion: a drivetrain is of higher
    # order
    if expected:
        at = s.index(list(IMPEDANCE.values()))
        predicted = estimates_of(s.total, at, s.names.index("linear"))[:3].tolist()
    K_given, K_d = predicted[0] if predicted else None, desired.K_d if desired else None
    table = impedance_table(analysis, s, p)
    stated = (
        bool(desired and (desired.controller or desired.K_d))
        or table["K_s_ratio"].drop_nulls().len() > 0
    )
    table = plausible_impedance(table, rails, p, stated, K_given, K_d)
    gap = pl.lit(None, pl.Float64)
    if predicted and gains and gains.cancels_friction:
        sizes = list[float]()  # SD of torque over angle [N*m/rad] in each row
        for total in map(s.over, analysis.fits):
            at, one = [s.torque, s.names.index("theta")], s.names.index("one")
            torque, theta = (
                total[k, k] / total[one, one] - (total[k, one] / total[one, one]) ** 2 for k in at
            )
            sizes.append(float(np.sqrt(torque / theta)))
        half = (pl.col("B_high") - pl.col("B_low")) / 2
        apart = predicted[1] - pl.col("B")
        gap = apart.sign() * (apart.abs() - half).clip(0) / pl.Series(sizes)
    table = table.with_columns(B_gap_s=gap)
    if desired is not None:
        values = zip(QUANTITIES, predicted or (None, None, None), strict=True)
        should_be = {f"{name}_predicted": pl.lit(value, pl.Float64) for name, value in values}
        errors = [torque_error(analysis.sums, label, desired) for label in analysis.fits]
        rated = getattr(record.settings, "rated_torque", None)
        error = pl.Series(errors, dtype=pl.Float64)
        should_be |= {
            "torque_error": pl.lit(error),
            "torque_error_share": pl.lit(error * (100 / rated if rated else None)),
        }
        table = table.with_columns(**desired.columns(), **should_be)
    return analysis, table.with_columns(clocks=pl.lit(2 if record.two_clocks else 1))


def torque_error(s: Sums, label: Label, desired: DesiredImpedance) -> float | None:
    """RMS [N*m] of tau - (K_d theta + B_d omega) in the rows of a label: the error of the rendered
    torque. Offset and drift are the load cell's, and left out. None where K_d or B_d is not
    known."""
    if desired.K_d is None or desired.B_d is None:
        return None
    total, (theta, omega, one, ramp) = s.over(label), s.index(["theta", "omega", "one", "ramp"])
    w = np.zeros(len(total))
    w[[s.torque, theta, omega]] = 1.0, -desired.K_d, -desired.B_d
    own = np.ix_([one, ramp], [one, ramp])
    across = (total @ w)[[one, ramp]]
    left = float(w @ total @ w - across @ solved(total[own], across)[0])
    return float(np.sqrt(max(left, 0.0) / total[one, one]))


@dataclass(frozen=True)
class Known:
    """A spring, an inertia, or both, that calibrate a bench."""

    stiffness: float | None  # [N*m/rad]
    inertia: float | None  # [kg*m^2]
    share: float = 0.0  # their relative standard uncertainty


SPRING_LOSS = 1e-3
"""Half-width of the loss factor of a spring, tan(phase), about 0: steel and clamps have 1e-4 to
1e-3."""


def late_fits(record: Record, is_spring: bool) -> tuple[GroupFit, GroupFit]:
    """Eq. 15 with friction and a late torque, as two fits. For a spring the second allows damping,
    and the first is the same if this damping is certain, else without."""
    few, model = record.coarse, {**IMPEDANCE, "T_C": "T_C"}
    columns, centre = effects.effect_columns(record)
    seek = partial(effects.late_fit, few, columns, centre=centre, rounded=record.rounded)
    if not is_spring:
        return (seek(model=model)[0],) * 2
    bare, _ = seek(model={name: column for name, column in model.items() if name != "B"})
    each = [seek(model=model, lag=lag) for lag in (0.0, bare["lag_s"])]
    # beside a damping the search may end in the false minimum of a delay, or find none
    both, _ = min(
        each, key=lambda one: abs(one[1]) > effects.LAG_FOUND or one[0].interval("B")[1] < 0
    )
    return both if both["B"] > 0 and both.certain("B", effects.FALSE_ALARM) else bare, both


def calibration_table(analysis: Analysis, known: Known) -> pl.DataFrame:
    """The trial's row of `calibration.csv`: Eq. 15 of a known spring or inertia, with friction and
    a late torque, and what else than a delay may make the torque late.

    A spring has no damping beyond `SPRING_LOSS`, unless the fit that allows one, whose `B` is
    given, is certain of it: torque in phase with the velocity, beside friction, is a delay. For an
    inertia, higher derivatives tell a delay from the damping of its bearing. `gain` is the measured
    K or I over the known one; the rest is the fixture's.

    Raises InputError: nothing is known; IdentifiabilityError: as `fit_groups`."""
    record, of = analysis.record, known.stiffness or known.inertia
    if not of or of < 0:
        raise InputError(
            f"trial {record.name}: a calibration needs what is known; fill in known_K [N*m/rad] of"
            " its spring, or known_I [kg*m^2] of its inertia, in the sample sheet"
        )
    main, beside = ("K", "I") if known.stiffness else ("I", "K")
    fit, both = late_fits(record, known.stiffness is not None)
    gain = fit[main] / of
    check_resists(record.name, main, gain)
    other = fit[beside] / gain
    turn = np.zeros((3, len(fit.names)))
    at, to = fit.names.index(main), fit.names.index(beside)
    turn[0, fit.names.index("lag_s")], turn[1, at], turn[2, at], turn[2, to] = (
        1.0,
        1 / of,
        -other / fit[main],
        1 / gain,
    )
    name, taken = ("inertia", known.inertia or 0.0) if known.stiffness else ("weight", 0.0)
    found = replace(
        fit,
        names=("lag_s", "gain", name),
        estimates=np.array([fit["lag_s"], gain, other - taken]),
        covariance=turn @ fit.covariance @ turn.T,
        degrees_of_freedom=np.array([fit.freedom(one) for one in ("lag_s", main, beside)]),
    )
    found = widened(found, known.share * np.array([0.0, gain, other - taken]))
    if fit is not both:
        found = widened(
            found,
            np.array([SPRING_LOSS / (2 * np.pi * np.sqrt(np.prod(record.band_hz) * 3)), 0.0, 0.0]),
        )
    row = dict.fromkeys(
        f"{one}{end}" for one in ("inertia", "weight") for end in ("", "_se", "_low", "_high")
    )
    row |= estimates_row(found, *found.names)
    certain = {}
    for one, off in (("lag_s", found["lag_s"]), ("gain", gain - 1)):
        certain[one] = float(np.sign(off)) * max(
            abs(off) - (found.interval(one)[1] - found[one]), 0.0
        )
    to_state = (
        f"calibration: {{torque_gain: {found.se('gain'):.2g}, delay: {found.se('lag_s'):.2g}}}"
    )
    row |= {**estimates_row(both, "B"), **estimates_row(fit, "T_C"), **analysis.judged()}
    row |= {
        "certain_lag_s": certain["lag_s"],
        "certain_gain_error": certain["gain"],
        "to_state": to_state,
    }
    stated = {"known_K": known.stiffness, "known_I": known.inertia, "known_share": known.share}
    row = {"trial": record.name, **stated, **row, **analysis.time_base_row(None, QUANTITIES)}
    misfit = misfit_of_losses(record) if certain["lag_s"] else None
    row |= {"explanations": misfit.explanations if misfit else None}
    return pl.DataFrame([row], infer_schema_length=None).with_columns(
        pl.col(pl.Null).cast(pl.Float64)
    )


def repeated_trials_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """A row per quantity and condition with two trials or more of like motion, with Student's
    interval over the trials. Motions are alike in band, period and size (`alike_sizes`).

    Each trial counts with its fit to all of its motion. The interval contains all that differs from
    trial to trial, such as the distortion by friction of another realisation of a random motion,
    which the interval of a single trial may not. Doubtful fits are left out if half of the trials
    or more are sound. Trials without a stated K_d may each have been asked for another, so that
    only `repeating_trials` of them are repeats."""
    whole = (
        impedance.filter(pl.col("amplitude_deg").is_null())
        if "amplitude_deg" in impedance.columns
        else impedance
    )
    same = ("joint", "side", "controller", "K_d", "B_d", "group", "excitation")
    keys, rows = [name for name in same if name in whole.columns], list[dict[str, object]]()
    sizes = [
        name for name in ("band_high_hz", "period_s", "theta_rms_deg") if name in whole.columns
    ]
    told = whole.select("^(K|B|I|B_viscous|f_C)$").columns
    own = (
        pl.when(pl.col("K_d").is_null()).then(repeating_trials(whole))
        if "K_d" in whole.columns
        else pl.lit("")
    )
    for (*key, _), condition in whole.with_columns(own=own).group_by(
        [*keys, "own"], maintain_order=True
    ):
        alike = [
            alike_sizes(condition[name].cast(pl.Float64)).alias(f"{name}_alike") for name in sizes
        ]
        groups = condition.with_columns(alike).group_by(
            [one.name for one in alike] or keys, maintain_order=True
        )
        for trials in (of_motion for _, of_motion in groups if len(of_motion) > 1):
            used = counted(trials.with_columns(pl.col("^B_se_bench$").alias("B_viscous_se_bench")))
            band = {
                "band_low_hz": trials["band_low_hz"].min(),
                "band_high_hz": trials["band_high_hz"].max(),
            }
            left_out = {**doubtful_row(trials), "n_left_out": len(trials) - len(used)}
            said = {**dict(zip(keys, key, strict=True)), **band}
            rows += [
                {**said, "quantity": name, **summary_row(used, name), **left_out} for name in told
            ]
    if rows:
        return pl.DataFrame(rows, infer_schema_length=None).filter(pl.col("n") > 0)
    numbers = (
        "band_low_hz",
        "band_high_hz",
        "n",
        "mean",
        "sd",
        "se",
        "low",
        "high",
        "n_doubtful",
        "n_left_out",
    )
    texts = {
        name: pl.String()
        for name in (*keys, "quantity", "interval_method")
        if name not in ("K_d", "B_d")
    }
    return pl.DataFrame(
        schema={name: pl.Float64() for name in keys} | texts | dict.fromkeys(numbers, pl.Float64())
    )


COMPARED: Mapping[str, tuple[str, pl.Expr]] = {
    "torque_error": ("N*m", pl.col("torque_error")),
    "K_error": ("%", 100 * (pl.col("K") / pl.col("K_d") - 1).abs()),
    "B_error": ("N*m*s/rad", (pl.col("B") - pl.col("B_d")).abs()),
    "VAF": ("%", pl.col("VAF")),
}
"""Unit and value of each compared quantity; less is better, except for the VAF."""
ASKED = (*PLACE, "K_d", "B_d")


def compensation_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """`compensation.csv` from the rows of `impedance.csv`, of the trials that a mean counts
    (`counted`).

    Repeats of a condition count as their mean. The interval of a difference is Student's over pairs
    of trials: amplitudes of one trial are no independent pairs. Amplitudes are the commanded ones;
    where none is stated, the measured ones that are alike."""
    size = "commanded_deg" if impedance["commanded_deg"].is_not_null().any() else "amplitude_deg"
    used = counted(impedance)
    sizes = alike_sizes(used[size].cast(pl.Float64))
    known = held_against_desired(used).with_columns(sizes)
    known = known.drop_nulls(["K_d", "B_d"]).filter(pl.col("K_d") != 0)
    values = {name: value.mean() for name, (_, value) in COMPARED.items()}
    means = known.group_by(*ASKED, size, "controller").agg(**values)
    sides = [means.filter(pl.col("controller") == name).drop("controller") for name in CONTROLLERS]
    both = sides[0].join(sides[1], on=[*ASKED, size], nulls_equal=True).sort(*ASKED, size)
    whole, single = (both.filter(pl.col(size).is_null() == of_whole) for of_whole in (True, False))
    sets = [("trials", None, whole), ("amplitudes", None, single)]
    for by, rows in (("K_d", whole), ("B_d", whole), (size, single)):
        sets += [(by, at, rows.filter(pl.col(by) == at)) for at in rows[by].unique().sort()]
    found = []
    for by, at, rows in sets:
        for of_place in rows.partition_by(PLACE, maintain_order=True):
            place = of_place.select(PLACE).row(0, named=True)
            found += [{**place, **paired(of_place, name), "by": by, "at": at} for name in COMPARED]
    types: dict[str, Any] = dict.fromkeys((*PLACE, "quantity", "unit", "by"), pl.String) | {
        "at": pl.Float64
    }
    types |= {"pairs": pl.Int64, "better": pl.Int64} | dict.fromkeys(
        ("compensated", "uncompensated"), pl.Float64
    )
    types |= dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64)
    return pl.DataFrame(found, schema=types)


def paired(pairs: pl.DataFrame, name: str) -> dict[str, Any]:
    """The comparison of one quantity over pairs."""
    difference = pairs[name] - pairs[f"{name}_right"]
    by_trial = (
        pairs.select("K_d", "B_d", difference=difference)
        .group_by("K_d", "B_d")
        .agg(pl.col("difference").mean())
    )
    better = int((difference > 0 if name == "VAF" else difference < 0).sum())
    row = {"quantity": name, "unit": COMPARED[name][0], "pairs": len(pairs), "better": better}
    row |= {"compensated": pairs[name].mean(), "uncompensated": pairs[f"{name}_right"].mean()}
    values = np.sort(by_trial["difference"].to_numpy())
    found = over_repeats(values) if len(values) > 1 else None
    row |= {"difference": values.mean() if len(values) else None}
    return row | {f"difference_{end}": found and getattr(found, end) for end in ("low", "high")}
