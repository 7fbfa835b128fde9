"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 fitted to any motion, per amplitude and
over all, the impedance that the gains should render, and the evidence on which the estimates are
judged."""

from dataclasses import dataclass

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
    without_lag,
)
from osl_analysis.bench.effects import IMPEDANCE, Fault
from osl_analysis.bench.gram import FEWEST_UNITS, GroupFit, Sums, combined, estimates_of, solved
from osl_analysis.bench.joint_inference import impedance_fits
from osl_analysis.bench.record import Record, actuator_turns
from osl_analysis.bench.row_groups import Label
from osl_analysis.errors import nearest
from osl_analysis.inference.constants import BLOCKS
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance
from osl_analysis.signals.clock_drift import NO_DRIFT
from osl_analysis.spectral.periods import distinct
from osl_analysis.stats.regression import Row, lag_damping_row
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
    admittance of the linear model, where the gains are known. Raises as `fitted_motion`.

    Eq. 15, torque = K theta + B omega + I alpha + offset + drift, is `IMPEDANCE`. `fitted_motion`
    solves it for each amplitude and for all, by `gram.fit_groups`. The sums with all effects tell
    what else the torque may hold.
    """
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
    # of a joint that is no leg, K, B and I of the whole trial are those of the inference
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


def fit_and_judge_impedance(
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
