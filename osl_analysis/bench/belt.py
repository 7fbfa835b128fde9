# SPDX-License-Identifier: Apache-2.0
"""The belt alone on its bench: a line through torque over deflection while loading and unloading
(Fig. 3)."""

from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.trial import Array, Trial
from osl_analysis.bench.bench_settings import BeltAnalysis
from osl_analysis.bench.budgets import fit_tables
from osl_analysis.bench.cycles import BRANCHES, Loop, find_loop, loop_errors, whole
from osl_analysis.bench.impedance import Analysis
from osl_analysis.bench.motion import blocks_of
from osl_analysis.bench.plausibility import check_changes, check_stiffer
from osl_analysis.bench.record import Groups, Label, Record, Stratum, record_of, unlike_groups
from osl_analysis.bench.regression import Model, gram_sums, least_squares, offset_and_drift
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.signals.filters import runs
from osl_analysis.signals.grid import BRIDGE_MORE, uniform_signals
from osl_analysis.stats.budget import Contribution, Row
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.sources import Source

STRAIGHT: Model = {"K_s": "theta", "offset": "one"}
STRAIGHT_AND_DAMPED: Model = {**STRAIGHT, "B_loading": "omega"}
QUADRATIC: Model = {"K_s": "theta", "K_s2": "square", "offset": "one"}
"""On a raised cosine damping and curvature are collinear, so that it has no damping."""
CONSTANT_VELOCITY = 0.05  # SD of a velocity over its mean, below which it makes a constant torque
BRANCH_BLOCKS = 16  # of each branch, whose scatter gives its interval
LEAST_DEFLECTION_DEG = 0.5
LOADED_SHARE = 0.05  # share of the peak where loading begins: the belt's hysteresis reverses below
# of the joint's turn, below which a shaft rests: K_s is off by 1 % at most
LARGEST_TURN_AT_REST = 0.01
POINTS_PER_SECOND = 50.0  # of the curves of Fig. 3


def belt_trial(trial: Trial, p: DrivetrainParameters | None, settings: BeltAnalysis) -> Analysis:
    """Filter and fit one canonical trial.

    The intervals hold what half and twice `LOADED_SHARE` make of the estimates: where loading
    begins is chosen, and the belt's hysteresis bends the curve there. When stamps were taken
    matters to no slow load.

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
        As `branches_of` and `least_squares`, or the bench is softer than the belt.
    """
    signals = uniform_signals(trial, ("theta", "theta_m", "torque"), settings)
    low_pass = settings.low_pass
    rate_hz = signals.rate_hz
    measured = signals.signals
    with naming(f"trial {trial.name}"):
        check_changes("torque", measured["torque"])
        deflection = settings.joint_angle(measured["theta"], measured["torque"])
        if p is None:
            check_locked(low_pass(deflection, rate_hz), low_pass(measured["theta_m"], rate_hz))
        else:
            deflection = belt_deflection(deflection, measured["theta_m"], p)
        no_groups = unlike_groups(np.empty(0), np.empty(0))  # as yet
        record = record_of(signals, settings, no_groups, deflection)
        record = replace(record, actuator=measured)
        analyses: list[Analysis] = []
        for share in (LOADED_SHARE, LOADED_SHARE / 2, 2 * LOADED_SHARE):
            model = analyses[0].model if analyses else None
            loaded = replace(record, groups=branches_of(record, share))
            analyses.append(fit_branches(loaded, settings.load_cell_drift / 60, model))
    belt, early, late = analyses
    fits = {
        label: fit.with_known_error(
            Source.LOADING_BEGINS, (late.fits[label].estimates - early.fits[label].estimates) / 2
        )
        for label, fit in belt.fits.items()
    }
    check_stiffer(signals.trial, "K_s", belt.whole["K_s"], settings.bench_stiffness)
    return replace(belt, fits=fits)


def fit_branches(record: Record, drift: float = 0.0, model: Model | None = None) -> Analysis:
    """Fit load-unload cycles, whose groups are those of `branches_of` and whose angle is the
    belt's deflection.

    `loading` stands for the trial: a straight line `K_s` and `offset`, with the
    damping `B_loading` if the velocity varies. `unloading` is the same. Without its column B_j
    omega shifts K_s by 0.12 N*m/rad on a raised cosine, because loading begins at a velocity and
    ends at rest. The damping holds friction of belt and joint, as much as there is: it is no B_j. A
    constant velocity makes a constant torque, which the offset contains. `model` is that of another
    part of the same cycles, whose estimates are compared.

    The load cell's drift has the standard deviation `drift` [N*m/s]. A line cannot tell drift from
    stiffness, and no scatter shows it: it enters the intervals as type B (JCGM 100:2008, 4.3).
    """
    motion = record.motion
    deflection = motion.theta - motion.theta[0]
    columns = {
        "theta": deflection,
        "omega": motion.omega,
        "square": deflection * np.abs(deflection),
        **offset_and_drift(record.time),
    }
    s = gram_sums(record, columns)
    velocities = [motion.omega[record.is_fitted(branch)] for branch in BRANCHES]
    varies = all(np.std(each) > CONSTANT_VELOCITY * abs(np.mean(each)) for each in velocities)
    if model is None:
        model = STRAIGHT_AND_DAMPED if varies else STRAIGHT
    fits: dict[Label, LinearFit] = {}
    for branch in BRANCHES:
        of_branch = s.chosen(s.groups.of(branch))
        of_ramp = of_branch.estimates([*model.values()], "ramp")
        fit = least_squares(of_branch, model)
        fits[branch] = fit.with_known_error(Source.LOAD_CELL_DRIFT, drift * of_ramp)
    return Analysis(record, s, model, fits, "loading")


def loop_of(theta_s: Array) -> Loop:
    """The cycles of a belt's deflection (n,) [rad]. Raises InputError: the belt hardly deflects, or
    is not unloaded again."""
    largest_deg = np.rad2deg(np.abs(theta_s - theta_s[0]).max())
    if largest_deg < LEAST_DEFLECTION_DEG:
        raise InputError(
            f"the belt deflects by {largest_deg:.3f} deg at most, expected"
            f" {LEAST_DEFLECTION_DEG:g} deg or more",
            "check the angle channels and their units in the source file",
        )
    return find_loop(theta_s)


def branches_of(record: Record, loaded_share: float = LOADED_SHARE) -> Groups:
    """Blocks of all loadings and all unloadings of a belt in usable rows, where it deflects by
    `loaded_share` of its peak or more.

    Raises
    ------
    InputError
        As `loop_of`, or a branch is empty.
    """
    theta_s = record.motion.theta
    loop = loop_of(theta_s)
    load = (theta_s - theta_s[0]) * loop.loading
    branches = []
    for label in BRANCHES:
        is_loaded = np.zeros(len(load), dtype=bool)
        is_loaded[loop.rows(theta_s, label)] = True
        is_loaded &= load >= loaded_share * load.max()
        if not (is_loaded & record.usable).any():
            raise InputError(
                f"no row while {label} is free of gaps that are too long to be bridged", BRIDGE_MORE
            )
        # no shorter than half a period of the cut-off
        longest = max(rows.stop - rows.start for rows in runs(is_loaded))
        seconds = max(longest / record.rate_hz / BRANCH_BLOCKS, 0.5 / record.settings.cutoff_hz)
        rows = runs(is_loaded & record.usable)
        branches.append(blocks_of(rows, record.rate_hz, seconds))
    return Groups(
        "blocks",
        np.concatenate([branch.first for branch in branches]),
        np.concatenate([branch.stop for branch in branches]),
        np.repeat([0, 1], [len(branch.first) for branch in branches]),
        tuple(Stratum(label) for label in BRANCHES),
    )


def check_locked(theta: Array, theta_m: Array) -> None:
    """Refuse a shaft that turns if n_T is not known: its share of the deflection is unknown. Angles
    are (n,) [rad]."""
    turned = np.ptp(theta_m)
    whole = np.ptp(theta)
    if turned > LARGEST_TURN_AT_REST * whole:
        raise InputError(
            f"theta_m turns by {turned:.3g} rad while theta turns by {whole:.3g} rad, and"
            " without a parameter file its ratio n_T to the joint is not known",
            "lock the shaft, or name a parameter file under `parameters` in the configuration",
        )


def belt_table(belt: Analysis) -> dict[str, pl.DataFrame]:
    """The trial's row of `belt.csv`, and its rows of `budget.csv`.

    The row has slopes of loading and unloading, and the area of the mean loop [J]. `energy_lost`
    is this area over the energy K_s theta_s^2/2 at the peak, `stiffening` the relative increase of
    the quadratic belt's slope from rest to the peak."""
    loading = belt.calibrated["loading"]
    unloading = belt.calibrated["unloading"]
    record = belt.record
    sums = belt.sums
    theta = record.motion.theta
    torque = record.filtered_torque
    peak = np.abs(sums.columns["theta"]).max()
    sums_loading = sums.chosen(sums.groups.of("loading"))
    of_line, of_square, _ = sums_loading.estimates([*QUADRATIC.values()])

    # the torque, and each error of it
    errors = loop_errors(torque, record.rate_hz, record.is_fitted(), record.settings.calibration)
    torques = np.array([torque, *errors])
    cycles = [whole(cycle) for cycle in loop_of(theta).cycles]
    works = [np.trapezoid(torques[:, rows], theta[rows]) for rows in cycles]
    area, *area_errors = np.mean(works, axis=0)

    turn = None  # of the actuator's shaft per turn of the joint, while the belt is loaded
    if record.actuator:
        rows = record.is_fitted("loading")
        of_joint = record.actuator["theta"][rows]
        turn = np.polyfit(of_joint, record.actuator["theta_m"][rows], 1)[0]

    names = [name for name in ("K_s", "B_loading") if name in belt.model]
    budgets = belt.budgets("loading", *names)
    stiffening = 2 * of_square * peak / of_line
    bent = abs(of_square) * peak  # half of the range of slopes, from rest to the peak
    budgets["K_s"] = budgets["K_s"].plus(
        Contribution(Source.NONLINEAR_SPRING, bent, basis="measured", part="motion")
    )
    row: Row = {
        "trial": record.name,
        "VAF": loading.vaf,
        "unloading": unloading["K_s"],
        "unloading_se_bench": unloading.budget("K_s").se_bench,
        "hysteresis_area": area,
        "hysteresis_area_se_bench": float(np.linalg.norm(area_errors)),
        "energy_lost": area / (loading["K_s"] * peak**2 / 2),
        "shaft_turn": turn,
        "stiffening": stiffening,
    }
    return fit_tables("belt", (row, budgets))


def belt_curve(belt: Analysis) -> pl.DataFrame:
    """Deflection [deg] and torque [N*m] from rest, by branch, for Fig. 3."""
    record = belt.record
    theta_s = record.motion.theta
    torque = record.filtered_torque
    unloads = np.zeros(len(theta_s), dtype=bool)
    unloads[loop_of(theta_s).rows(theta_s, "unloading")] = True
    columns = {
        "branch": np.where(unloads, "unloading", "loading"),
        "theta_s_deg": np.rad2deg(theta_s - theta_s[0]),
        "torque": torque - torque[0],
    }
    step = max(round(record.rate_hz / POINTS_PER_SECOND), 1)
    return pl.DataFrame({"trial": record.name, **columns}).gather_every(step)
