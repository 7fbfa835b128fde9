"""The belt alone on its bench: a line through torque over deflection while loading and unloading
(Fig. 3)."""

from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import BeltAnalysis
from osl_analysis.bench.impedance import Analysis, torque_errors, widened
from osl_analysis.bench.motion import signals_of, stretches_of
from osl_analysis.bench.plausibility import check_changes, check_stiffer
from osl_analysis.bench.record import Groups, Label, Record, record_of
from osl_analysis.bench.regression import GroupFit, Model, fit_groups, gram_sums
from osl_analysis.bench.summaries import PLACE
from osl_analysis.bench.torque_angle import branch_rows, find_cycles, whole
from osl_analysis.dictionary import table_of
from osl_analysis.errors import InputError, naming
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.signals import runs
from osl_analysis.signals.grid import BRIDGE_MORE
from osl_analysis.stats.estimates import Row, estimates_row
from osl_analysis.trial import Array, Trial

BRANCHES = {"loading": 1, "unloading": -1}  # and how the deflection's size changes
STRAIGHT: Model = {"K_s": "theta", "offset": "one"}
STRAIGHT_AND_DAMPED: Model = {**STRAIGHT, "B_j": "omega"}
QUADRATIC: Model = {"K_s": "theta", "K_s2": "square", "offset": "one"}
"""On a raised cosine damping and curvature are collinear, so that it has no damping."""
CONSTANT_VELOCITY = 0.05  # SD of a velocity over its mean, below which it makes a constant torque
STRETCHES = 16  # of each branch, whose scatter gives its interval
LEAST_DEFLECTION_DEG = 0.5
LOADED = 0.05  # share of the peak where loading begins: the belt's hysteresis reverses below
LARGEST_TURN = 0.01  # of the joint's turn, below which a shaft rests: K_s is off by 1 % at most
POINTS_PER_SECOND = 50.0  # of the curves of Fig. 3


def belt_trial(trial: Trial, p: DrivetrainParameters | None, settings: BeltAnalysis) -> Analysis:
    """Filter and fit one canonical trial.

    The intervals hold what half and twice `LOADED` make of the estimates: where loading begins is
    chosen, and the belt's hysteresis bends the curve there. When stamps were taken matters to no
    slow load.

    Parameters
    ----------
    trial
        With `theta`, `theta_m` and `torque`.
    p
        Parameters of the device. None: the ratio n_T is not known, and the shaft must rest.
    settings
        How it is analysed.

    Raises
    ------
    InputError, IdentifiabilityError
        As `branches_of` and `fit_groups`, or the bench is softer than the belt.
    """
    signals = signals_of(trial, ("theta", "theta_m", "torque"), settings)
    low_pass, rate_hz = settings.low_pass, signals.rate_hz
    with naming(f"trial {trial.name}"):
        check_changes("torque", signals["torque"])
        deflection = settings.joint_angle(signals["theta"], signals["torque"])
        if p is None:
            check_locked(low_pass(deflection, rate_hz), low_pass(signals["theta_m"], rate_hz))
        else:
            deflection = belt_deflection(deflection, signals["theta_m"], p)
        theta_s = low_pass(deflection, rate_hz)
        analyses: list[Analysis] = []
        for share in (LOADED, LOADED / 2, 2 * LOADED):
            groups = branches_of(theta_s, rate_hz, signals.usable, settings.cutoff_hz, share)
            record = record_of(signals, settings, groups, deflection)
            record = replace(record, actuator=signals.signals)
            model = analyses[0].model if analyses else None
            analyses.append(fit_branches(record, settings.load_cell_drift / 60, model))
    belt, early, late = analyses
    fits = {
        label: widened(fit, (late.fits[label].estimates - early.fits[label].estimates) / 2)
        for label, fit in belt.fits.items()
    }
    check_stiffer(signals.trial, "K_s", belt.whole["K_s"], settings.bench_stiffness)
    return replace(belt, fits=fits)


def fit_branches(record: Record, drift: float = 0.0, model: Model | None = None) -> Analysis:
    """Fit load-unload cycles, whose groups are those of `branches_of` and whose angle is the
    belt's deflection.

    `loading` stands for the trial: a straight line `K_s` and `offset`, with the joint's damping
    `B_j` if the velocity varies. `unloading` is the same. Without its column B_j omega shifts K_s
    by 0.12 N*m/rad on a raised cosine, because loading begins at a velocity and ends at rest. A
    constant velocity makes a constant torque, which the offset contains. `model` is that of another
    stretch of the same cycles, whose estimates are compared.

    The load cell's drift has the standard deviation `drift` [N*m/s]. A line cannot tell drift from
    stiffness, and no scatter shows it: it enters the intervals as type B (JCGM 100:2008, 4.3).
    """
    motion = record.motion
    deflection = motion.theta - motion.theta[0]
    columns = {
        "theta": deflection,
        "omega": motion.omega,
        "one": np.ones_like(deflection),
        "square": deflection * np.abs(deflection),
        "ramp": record.time - record.time.mean(),
    }
    s = gram_sums(record, columns, ["theta", "omega", "one", "square"])
    velocities = [motion.omega[record.rows(branch)] for branch in BRANCHES]
    varies = all(np.std(each) > CONSTANT_VELOCITY * abs(np.mean(each)) for each in velocities)
    if model is None:
        model = STRAIGHT_AND_DAMPED if varies else STRAIGHT
    fits: dict[Label, GroupFit] = {}
    for branch in BRANCHES:
        of_branch = s.of(branch)
        of_ramp = of_branch.estimates([*model.values()], "ramp")
        fit = widened(fit_groups(of_branch, model), drift * of_ramp)
        if drift:
            fit = replace(fit, interval_method=f"{fit.interval_method} + drift")
        fits[branch] = fit
    return Analysis(record, s, model, fits, {}, "loading")


def load_of(theta_s: Array) -> Array:
    """Deflection (n,) [rad] of a belt from its first sample on, to the side of its peak. Raises
    InputError: the belt hardly deflects."""
    deflection = theta_s - theta_s[0]
    at_peak = float(deflection[np.argmax(np.abs(deflection))])
    if abs(at_peak) < np.deg2rad(LEAST_DEFLECTION_DEG):
        raise InputError(
            f"the belt deflects by {np.rad2deg(abs(at_peak)):.3f} deg at most, expected"
            f" {LEAST_DEFLECTION_DEG:g} deg or more; check the angle channels and their units in"
            " the source file"
        )
    return np.asarray(deflection * np.sign(at_peak))


def branches_of(
    theta_s: Array,
    rate_hz: float,
    usable: NDArray[np.bool_],
    cutoff_hz: float,
    loaded_share: float = LOADED,
) -> Groups:
    """Stretches of all loadings and all unloadings of a deflection theta_s (n,) [rad] in usable
    rows, where the belt deflects by `loaded_share` of its peak or more.

    Raises
    ------
    InputError
        The belt hardly deflects, is not unloaded again, or a branch is empty.
    """
    load = load_of(theta_s)
    cycles, _ = find_cycles(load)
    is_loaded = load >= loaded_share * load.max()
    branches = []
    for label, direction in BRANCHES.items():
        inside = np.zeros(len(load), dtype=np.bool_)
        inside[branch_rows(cycles, load, direction)] = True
        if not (inside & is_loaded & usable).any():
            raise InputError(
                f"no row while {label} is free of gaps that are too long to be bridged;"
                f" {BRIDGE_MORE}"
            )
        # no shorter than half a period of the cut-off
        longest = max(rows.stop - rows.start for rows in runs(inside & is_loaded))
        seconds = max(longest / rate_hz / STRETCHES, 0.5 / cutoff_hz)
        rows = runs(inside & is_loaded & usable)
        branches.append(stretches_of(rows, rate_hz, seconds, label))
    return Groups(
        "stretches",
        np.concatenate([branch.first for branch in branches]),
        np.concatenate([branch.stop for branch in branches]),
        np.repeat([0, 1], [len(branch.first) for branch in branches]),
        tuple(branch.strata[0] for branch in branches),
    )


def mean_loop(theta_s: Array, torque: Array) -> Array:
    """The work of torques (..., n) [N*m] over a deflection (n,) [rad] in a cycle [J], the mean of
    all cycles (...)."""
    cycles, _ = find_cycles(load_of(theta_s))
    parts = [whole(cycle) for cycle in cycles]
    works = [np.trapezoid(torque[..., rows], theta_s[rows]) for rows in parts]
    return np.asarray(np.mean(works, axis=0))


def check_locked(theta: Array, theta_m: Array) -> None:
    """Refuse a shaft that turns if n_T is not known: its share of the deflection is unknown. Angles
    are (n,) [rad]."""
    turned, whole = float(np.ptp(theta_m)), float(np.ptp(theta))
    if turned > LARGEST_TURN * whole:
        raise InputError(
            f"theta_m turns by {turned:.3g} rad while theta turns by {whole:.3g} rad, and without a"
            " parameter file its ratio n_T to the joint is not known; lock the shaft, or name a"
            " parameter file under `parameters` in the configuration"
        )


def belt_table(belt: Analysis) -> pl.DataFrame:
    """The trial's row of `belt.csv`: slopes of loading and unloading, area of the mean loop [J].
    `energy_lost` is this area over the energy K_s theta_s^2/2 at the peak.
    `stiffening` is the relative increase of the quadratic belt's slope from rest to the peak."""
    loading, unloading = (belt.calibrated[branch] for branch in BRANCHES)
    record, sums = belt.record, belt.sums
    theta, torque = record.motion.theta, record.filtered_torque
    peak = float(np.max(np.abs(sums.columns["theta"])))
    of_line, of_square, _ = sums.of("loading").estimates([*QUADRATIC.values()])

    area = float(mean_loop(theta, torque))
    errors = torque_errors(torque, record.rate_hz, record.rows(), record.settings.calibration)
    by_torque = np.linalg.norm(mean_loop(theta, errors))
    by_gain = area * record.settings.calibration.polar(0.0)[0]

    turn = None  # of the actuator's shaft per turn of the joint, while the belt is loaded
    if record.actuator:
        rows = record.rows("loading")
        theta_bench, theta_m = (record.actuator[name][rows] for name in ("theta", "theta_m"))
        turn = float(np.polyfit(theta_bench, theta_m, 1)[0])

    row: Row = {
        "trial": record.name,
        **belt.row("loading", "K_s"),
        **estimates_row(loading, *(name for name in ("B_j",) if name in belt.model)),
        "unloading": unloading["K_s"],
        "unloading_se_bench": unloading.se_bench("K_s"),
        "hysteresis_area": area,
        "hysteresis_area_se_bench": float(np.hypot(by_gain, by_torque)),
        "energy_lost": area / (loading["K_s"] * peak**2 / 2),
        "shaft_turn": turn,
        "stiffening": 2 * of_square * peak / of_line,
    }
    return table_of([row], "belt", complete=True)


def belt_curve(belt: Analysis) -> pl.DataFrame:
    """Deflection [deg] and torque [N*m] from rest, by branch, for Fig. 3."""
    record = belt.record
    theta_s, torque = record.motion.theta, record.filtered_torque
    load = load_of(theta_s)
    unloads = np.zeros(len(load), dtype=np.bool_)
    unloads[branch_rows(find_cycles(load)[0], load, -1)] = True
    columns = {
        "branch": np.where(unloads, "unloading", "loading"),
        "theta_s_deg": np.rad2deg(theta_s - theta_s[0]),
        "torque": torque - torque[0],
    }
    step = max(round(record.rate_hz / POINTS_PER_SECOND), 1)
    return pl.DataFrame({"trial": record.name, **columns}).gather_every(step)


def belt_figure_points(
    curves: pl.DataFrame, table: pl.DataFrame, summary: pl.DataFrame
) -> pl.DataFrame:
    """The numbers of Fig. 3 for each joint and side.

    Parameters
    ----------
    curves
        `belt_curve` of each trial.
    table
        `belt.csv`.
    summary
        Its summary.

    Returns
    -------
    DataFrame
        The curves with their `deviation` of torque [N*m] from the mean slope, and why a fit is
        doubtful; the mean slope as two points, from 0 to the largest deflection, with the loops'
        mean area [J]. There is no mean slope where all trials are doubtful.
    """
    doubts = table.select("trial", *PLACE, "doubtful")
    points = curves.join(doubts, "trial", how="left", maintain_order="left")
    numbers: list[str] = []
    for quantity in ("K_s", "hysteresis_area"):
        names = {"mean": quantity, "low": f"{quantity}_low", "high": f"{quantity}_high"}
        means = summary.filter(quantity=quantity).select(*PLACE, *names).rename(names)
        points = points.join(means, PLACE, how="left", nulls_equal=True, maintain_order="left")
        numbers += names.values()
    on_slope = pl.col("K_s") * np.pi / 180 * pl.col("theta_s_deg")  # null without a mean

    largest = points.sort(pl.col("theta_s_deg").abs()).group_by(PLACE, maintain_order=True).last()
    ends = pl.concat([largest.with_columns(theta_s_deg=0.0), largest])
    lines = ends.with_columns(trial=pl.lit("mean slope"), branch=pl.lit("loading"), torque=on_slope)
    lines = lines.drop_nulls("torque").drop("doubtful")
    curves = points.with_columns(deviation=pl.col("torque") - on_slope).drop(numbers)
    return pl.concat([curves, lines], how="diagonal")
