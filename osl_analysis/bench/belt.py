"""Belt stiffness (Fig. 3): slope of the torque on the belt's deflection while loading, with the actuator locked."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Series, check_stiffer, time_base_row, time_base_words, timebase_table
from osl_analysis.bench.record import joint_angle
from osl_analysis.bench.settings import BeltAnalysis, BenchStiffness
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.judge.doubts import summary_of_trials
from osl_analysis.judge.impossible import check_changes
from osl_analysis.measured import check_measured
from osl_analysis.model.drivetrain import belt_deflection
from osl_analysis.signals import LowPass
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, with_shared_error
from osl_analysis.stats.slow_motion import fit_slow_motion
from osl_analysis.timebase.grid import UniformSignals, uniform_signals
from osl_analysis.trial import Array, Trial

ONSET_FRACTION = 0.05
"""Deflection at which loading begins, as a share of the peak; below it the hysteresis of the belt reverses."""
LARGEST_FALL = 0.2  # largest fall of the deflection while loading, as a share of the peak
SMALLEST_DEFLECTION = np.deg2rad(0.5)
CONSTANT_VELOCITY = 0.05
"""Scatter of the velocity on one branch, as a share of its mean, up to which it counts as constant."""


@dataclass(frozen=True)
class BeltFit:
    """Fits to one load-unload cycle."""

    K_s: float  # slope while loading [N*m/rad]
    loading: LinearFit
    """Straight line with damping while loading: `K_s`, `offset` [N*m], and `B_j` [N*m per rad and sample] where the
    velocity is not constant."""
    unloading: LinearFit  # the same while unloading
    quadratic: LinearFit  # torque on theta_s and theta_s |theta_s| while loading: `K_s`, `K_s2` [N*m/rad^2], `offset`
    hysteresis_area: float  # area of the loop [N*m*rad = J]

    def widened(self, softer: "BeltFit") -> "BeltFit":
        """The fit with the error of the bench's stiffness in its intervals, as type B."""
        return replace(
            self,
            loading=with_shared_error(self.loading, softer.loading.estimates - self.loading.estimates),
            unloading=with_shared_error(self.unloading, softer.unloading.estimates - self.unloading.estimates),
            quadratic=with_shared_error(self.quadratic, softer.quadratic.estimates - self.quadratic.estimates),
        )


def fit_belt_stiffness(
    theta_s: Array, torque: Array, every: int = 1, drift: float = 0.0, usable: NDArray[np.bool_] | None = None
) -> BeltFit:
    """Fit one load-unload cycle: belt deflection theta_s [rad] and resisting torque [N*m], shape (n,).

    Rows that are not `usable` (n,) are not fitted.

    For the intervals: noise is independent after `every` samples (`LowPass.independent_samples`), and the load cell's
    drift has a standard deviation of `drift` [N*m per sample]. A straight line cannot tell a drift during the ramp from
    stiffness.
    """
    check_measured("theta_s", theta_s)
    check_measured("torque", torque)
    if not len(theta_s):
        raise InputError("no samples of the belt; record the trial again")
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    velocity = np.gradient(theta_s)
    good = np.arange(len(theta_s)) if usable is None else np.flatnonzero(usable)
    there, back = good[(good >= onset) & (good <= peak)], good[(good >= peak) & (good < release)]
    loading, unloading = (
        fit_straight_belt(Branch(deflection[rows], velocity[rows], torque[rows]), every, drift)
        for rows in (there, back)
    )
    quadratic = fit_quadratic_belt(Branch(deflection[there], velocity[there], torque[there]), every, drift)
    return BeltFit(loading["K_s"], loading, unloading, quadratic, float(np.trapezoid(torque, theta_s)))


def loaded_rows(deflection: Array) -> tuple[int, int, int]:
    """Rows of one load-unload cycle: the onset of loading, the peak, and the row after unloading."""
    peak = int(np.argmax(np.abs(deflection)))
    if abs(deflection[peak]) < SMALLEST_DEFLECTION:
        raise InputError(
            f"the belt deflects by {np.rad2deg(abs(deflection[peak])):.3f} deg at most, expected 0.5 deg or more; "
            "check the angle channels and their units in the source file"
        )
    loaded = np.abs(deflection) >= ONSET_FRACTION * abs(deflection[peak])
    onset = int(np.argmax(loaded))
    release = len(loaded) - int(np.argmax(loaded[::-1]))
    if release - peak < 10 or release == len(loaded):
        raise InputError("the trial ends while the belt is still loaded; record the way back too")
    way = deflection[onset : peak + 1] * np.sign(deflection[peak])
    fall = float(np.max(np.maximum.accumulate(way) - way))
    if fall > LARGEST_FALL * abs(float(way[-1])):
        raise InputError(
            f"the belt falls back by {np.rad2deg(fall):.2f} deg before its peak of {np.rad2deg(abs(way[-1])):.2f} deg: "
            "this is no single loading; check that the trial is of experiment 'belt'"
        )
    return onset, peak, release


@dataclass(frozen=True)
class Branch:
    """The usable rows of loading or unloading, shape (n,) each."""

    theta_s: Array  # deflection [rad] from the first row of the trial on
    velocity: Array  # velocity of the joint [rad per sample]; the actuator is locked
    torque: Array  # resisting torque [N*m]

    @property
    def damping(self) -> dict[str, Array]:
        """The column of the joint's damping; none where the velocity is constant. Left in the slope, B_j omega shifts
        K_s by 0.12 N*m/rad on a raised cosine, because loading begins at a velocity and ends at rest. At a constant
        velocity it is a constant torque, which the offset contains, and K_s does not depend on it."""
        constant = float(np.std(self.velocity)) <= CONSTANT_VELOCITY * abs(float(np.mean(self.velocity)))
        return {} if constant else {"B_j": self.velocity}


def fit_straight_belt(branch: Branch, every: int, drift: float) -> LinearFit:
    """Straight line with intercept: `K_s` [N*m/rad], `offset` [N*m], and damping; curvature does not count as noise."""
    theta_s, velocity = branch.theta_s, branch.velocity
    columns = {"K_s": theta_s, "offset": np.ones_like(theta_s), **branch.damping}
    richer = {"K_s2": theta_s * np.abs(theta_s), "B_j": velocity}
    beside = {name: column for name, column in richer.items() if name not in columns}
    return fit_slow_motion(branch.torque, columns, beside, every, drift)


def fit_quadratic_belt(branch: Branch, every: int, drift: float) -> LinearFit:
    """Quadratic belt with intercept, odd in the deflection: `K_s`, `K_s2` [N*m/rad^2], `offset` [N*m]. On a raised
    cosine damping and curvature look alike, so that this fit has no damping; it does not count as noise."""
    theta_s = branch.theta_s
    columns = {"K_s": theta_s, "K_s2": theta_s * np.abs(theta_s), "offset": np.ones_like(theta_s)}
    return fit_slow_motion(branch.torque, columns, {"B_j": branch.velocity}, every, drift)


CURVE_STEP_HZ = 50.0  # points per second of the torque-deflection curve that is kept for the figure
LOCKED = 0.01
"""Largest turn of the shaft, as a share of the joint's, that counts as rest where n_T is not known: K_s is 1 % off at
most."""
PLACE = ("joint", "side")
SUMMARISED = ("K_s", "unloading", "hysteresis_area", "quadratic_K_s2")
"""Columns of the belt table of which `belt_summary.csv` has a mean over trials."""


@dataclass(frozen=True)
class BeltTrial:
    """Filtered signals of one belt trial, shape (n,) each, and their fit."""

    name: str  # name of the trial
    time: Array  # time [s]
    rate_hz: float  # sampling rate [Hz]
    low_pass: LowPass  # the filter of angles and torque
    theta_s: Array  # belt deflection [rad]
    torque: Array  # resisting torque [N*m]
    fit: BeltFit  # the fit to them
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a trial that no file holds."""
    bench: BenchStiffness | None = None  # stiffness of the bench; its yielding is taken off the angle
    other: "BeltTrial | None" = None
    """The same if undecided stamps were taken the other way; None where all are decided."""


def belt_trial(trial: Trial, p: DrivetrainParameters | None, settings: BeltAnalysis) -> BeltTrial:
    """Filter and fit one canonical trial. Without parameters (None) the ratio n_T is not known: the shaft must rest.

    Raises InputError: As `fit_belt_stiffness`, or a signal is missing or irregular; the message names the trial.
    """
    signals = uniform_signals(trial, ("theta", "theta_m", "torque"), settings.gap_limits)
    other, bench = signals.other(), settings.bench_stiffness
    try:
        belt = belt_of(signals, p, settings)
        if bench is not None:
            softer = belt_of(signals, p, settings, bench.compliance_error).fit
            belt = replace(belt, fit=belt.fit.widened(softer))
        return replace(belt, other=None if other is None else belt_of(other, p, settings))
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def belt_of(
    signals: UniformSignals, p: DrivetrainParameters | None, settings: BeltAnalysis, more_compliance: float = 0.0
) -> BeltTrial:
    """The trial behind uniform signals; raises as `belt_trial`, without the trial's name. The bench is softer than its
    settings by `more_compliance` [rad/(N*m)]."""
    low_pass, rate, bench = settings.low_pass, signals.rate_hz, settings.bench_stiffness
    check_changes("torque", signals["torque"])
    compliance = (bench.compliance if bench else 0.0) + more_compliance
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    if p is None:
        check_locked(low_pass(theta, rate), low_pass(signals["theta_m"], rate))
    deflection = theta if p is None else belt_deflection(theta, signals["theta_m"], p)
    theta_s, torque = low_pass(deflection, rate), low_pass(signals["torque"], rate)
    every, drift = low_pass.independent_samples(rate), settings.load_cell_drift / 60 / rate
    fit = fit_belt_stiffness(theta_s, torque, every, drift, signals.usable)
    check_stiffer(signals.trial, "K_s", fit.K_s, bench)
    return BeltTrial(signals.trial, signals.time, rate, low_pass, theta_s, torque, fit, signals, bench)


def check_locked(theta: Array, theta_m: Array) -> None:
    """Refuse a shaft that turns where n_T is not known, and so its share of the deflection; angles (n,) [rad]."""
    turned, whole = float(np.ptp(theta_m)), float(np.ptp(theta))
    if turned > LOCKED * whole:
        raise InputError(
            f"theta_m turns by {turned:.3g} rad while theta turns by {whole:.3g} rad, and without a parameter file its "
            "ratio n_T to the joint is not known; lock the shaft, or name a parameter file under `parameters` in the "
            "configuration"
        )


def belt_table(belt: BeltTrial) -> pl.DataFrame:
    """The trial's row of `belt.csv`: loading and unloading slope, loop area [J], quadratic belt, what a line lacks.
    `energy_lost` is the loop's area divided by the energy K_s theta_s^2/2 at the peak. `stiffening` is the share by
    which the slope of the quadratic belt grows from rest to the peak."""
    fit, peak = belt.fit, float(np.max(np.abs(belt.theta_s - belt.theta_s[0])))
    row: Row = {
        "trial": belt.name,
        **estimates_row(fit.loading, "K_s", "offset"),
        **covariance_row(fit.loading, "K_s", "offset"),
        **damping_row(fit.loading, belt.rate_hz),
        **diagnostics_row(fit.loading, belt.rate_hz, belt.low_pass),
        "unloading": fit.unloading["K_s"],
        "unloading_se": fit.unloading.se("K_s"),
        "hysteresis_area": fit.hysteresis_area,
        "quadratic_K_s": fit.quadratic["K_s"],
        "quadratic_K_s2": fit.quadratic["K_s2"],
        "quadratic_K_s2_se": fit.quadratic.se("K_s2"),
        "quadratic_VAF": fit.quadratic.vaf,
        "energy_lost": fit.hysteresis_area / (fit.K_s * peak**2 / 2),
        "stiffening": 2 * fit.quadratic["K_s2"] * peak / fit.quadratic["K_s"],
        **time_base_row(fit.loading, None if belt.other is None else belt.other.fit.loading, ["K_s"]),
    }
    return pl.DataFrame([row])


def damping_row(loading: LinearFit, rate_hz: float) -> Row:
    """`B_j` [N*m*s/rad] while loading, as `estimates_row` has it; null where the velocity is constant."""
    if "B_j" not in loading.names:
        return dict.fromkeys(("B_j", "B_j_se", "B_j_low", "B_j_high"))
    return {name: value / rate_hz for name, value in estimates_row(loading, "B_j").items()}


def belt_time_base(belt: BeltTrial) -> pl.DataFrame:
    words = time_base_words(belt.fit.loading, None if belt.other is None else belt.other.fit.loading, ["K_s"])
    return timebase_table(belt.uniform, words, belt.bench)


def belt_curve(belt: BeltTrial) -> pl.DataFrame:
    """Deflection [deg] and torque [N*m] relative to rest, by branch, for Fig. 3."""
    step = max(round(belt.rate_hz / CURVE_STEP_HZ), 1)
    theta_s, torque = belt.theta_s[::step], belt.torque[::step]
    deflection = np.rad2deg(theta_s - theta_s[0])
    branch = np.where(np.arange(len(theta_s)) <= np.argmax(np.abs(deflection)), "loading", "unloading")
    return pl.DataFrame(
        {"trial": [belt.name] * len(branch), "branch": branch, "theta_s_deg": deflection, "torque": torque - torque[0]}
    )


def belt_series(belt: BeltTrial) -> Series:
    """Torque against deflection beside the straight line, which is fitted while loading."""
    loading = belt.fit.loading
    deflection = belt.theta_s - belt.theta_s[0]
    onset, peak, _ = loaded_rows(deflection)
    usable = None if belt.uniform is None else belt.uniform.usable
    fitted = np.ones(len(deflection), dtype=bool) if usable is None else usable.copy()
    fitted[:onset] = fitted[peak + 1 :] = False
    damping = loading["B_j"] * np.gradient(belt.theta_s) if "B_j" in loading.names else 0.0
    model = loading["K_s"] * deflection + damping + loading["offset"]
    return Series(belt.time, belt.torque, model, deflection, fitted)


def belt_summary(table: pl.DataFrame) -> pl.DataFrame:
    return summary_of_trials(table, SUMMARISED)


def belt_figure_points(curves: pl.DataFrame, table: pl.DataFrame, summary: pl.DataFrame) -> pl.DataFrame:
    """The numbers of Fig. 3: the curves with what they differ by from the mean slope and the reason why a fit is
    doubtful, and the mean slope as two points. `curves` are the trials' `belt_curve`s, `table` is `belt.csv`, `summary`
    is `belt_summary.csv`."""
    facts = table.select("trial", *PLACE, "doubtful")
    marked_curves = curves.join(facts, on="trial", how="left", maintain_order="left")
    parts = marked_curves.partition_by(PLACE, maintain_order=True)
    return pl.concat([frame for part in parts for frame in beside_mean_slope(part, summary)], how="diagonal")


def beside_mean_slope(curves: pl.DataFrame, summary: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The belts of one joint and side with the `deviation` of torque [N*m] from the mean slope; this slope as two
    points, from 0 to the largest deflection, with the mean area of the loops [J]."""
    place = curves.select(PLACE).row(0, named=True)
    same = [pl.col(name).eq_missing(pl.lit(value, pl.String)) for name, value in place.items()]
    numbers = {
        f"{quantity}{ending}": summary.filter(pl.col("quantity") == quantity, *same)[column][0]
        for quantity in ("K_s", "hysteresis_area")
        for ending, column in (("", "mean"), ("_low", "low"), ("_high", "high"))
    }
    slope = numbers["K_s"] * np.pi / 180
    deflection = curves["theta_s_deg"]
    ends = pl.DataFrame({"theta_s_deg": [0.0, deflection[int(np.argmax(deflection.abs().to_numpy()))]]})
    constant = {"trial": "mean slope", "branch": "loading", **place, **numbers}
    types = dict.fromkeys(numbers, pl.Float64)
    mean = ends.with_columns(
        torque=slope * pl.col("theta_s_deg"),
        **{name: pl.lit(value, types.get(name, pl.String)) for name, value in constant.items()},
    )
    return curves.with_columns(deviation=pl.col("torque") - slope * pl.col("theta_s_deg")), mean
