"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 of any motion, per amplitude and over all, what the gains
should give, and what judges the estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Analysis, analysed, check_stiffer, friction_row
from osl_analysis.bench.effects import (
    HIDDEN,
    IMPEDANCE,
    LITTLE,
    Admittance,
    Causes,
    Fault,
    causes,
    clocks_row,
    frame_stiffness,
    lag_of,
    noise_of_angle,
    plain_sums,
    stiffness_change,
    sums_of,
    taken_by,
)
from osl_analysis.bench.gram import GroupFit, Sums, paired_errors
from osl_analysis.bench.phasors import (
    SegmentPhasors,
    harmonic_shares,
    phasor_table,
    phasors_of_record,
)
from osl_analysis.bench.record import SHORTEST_S, Label, Record
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import IdentifiabilityError, InputError, nearest
from osl_analysis.judge.doubts import (
    EFFECTS,
    LATENESS,
    check_told,
    counted,
    doubtful_row,
    plausible_impedance,
)
from osl_analysis.measured import usual_size
from osl_analysis.model.compensator import CONTROLLERS, Gains, predicted_impedance, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.gain_selection import Weight
from osl_analysis.protocol.stepped_sine import moving_bins
from osl_analysis.spectral.periods import distinct
from osl_analysis.spectral.response import periodic_response
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.repeats import summary_row
from osl_analysis.stats.rounding import distinct_values
from osl_analysis.trial import Array

QUANTITIES = ("K", "B", "I")  # parameters of Eq. 15
WEIGHTING = "power of the filtered motion"
"""How frequencies weigh in the estimates, as in every least-squares fit of filtered signals."""


@dataclass(frozen=True)
class DesiredImpedance:
    """What the leg was asked to render in a trial, as far as it is known."""

    controller: str | None
    """Any name; `compensated` and `uncompensated` are those of the draft. None: none, or not known."""
    K_d: float | None  # desired stiffness [N*m/rad]; None: not known
    B_d: float | None  # desired damping [N*m*s/rad]; None: not known

    def gains(self, p: DrivetrainParameters | None, weight: Weight) -> Gains | None:
        """The gains of a device with these parameters, selected with W of Eq. 14; None where they are not known.

        Raises UnreachableImpedanceError: As `select_gains`.
        """
        if p is None or self.controller is None or self.K_d is None or self.B_d is None or self.unknown_gains():
            return None
        return select_gains(self.controller, self.K_d, self.B_d, p, weight)

    def unknown_gains(self) -> str:
        """Why the gains of this trial are not known, whatever the device; empty where they are."""
        if self.controller is None:
            return "no controller is stated"
        if self.controller not in CONTROLLERS:
            return f"the gains of controller '{self.controller}' are not known{nearest(self.controller, CONTROLLERS)}"
        absent = [name for name in ("K_d", "B_d") if getattr(self, name) is None]
        return f"{' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not stated" if absent else ""

    def columns(self) -> dict[str, pl.Expr]:
        """`controller`, `K_d` and `B_d` as constant columns of a table."""
        numbers = {name: pl.lit(getattr(self, name), pl.Float64) for name in ("K_d", "B_d")}
        return {"controller": pl.lit(self.controller, pl.String), **numbers}


@dataclass(frozen=True)
class Rendered:
    """Eq. 15 of an impedance trial, with the phasors of its sines."""

    analysis: Analysis
    phasors: Sequence[SegmentPhasors]  # none where no sines moved the joint
    effects: Sums  # with the columns of all effects
    found: Causes

    @property
    def record(self) -> Record:
        return self.analysis.record


def rendered_impedance(record: Record, expected: Admittance | None = None) -> Rendered:
    """Eq. 15 of a record. `expected` is the admittance of the linear model, where the gains are known.

    Raises InputError: the joint hardly moves, or its acceleration jumps. Raises IdentifiabilityError: the motion cannot
    tell K from I; the message names the band that is missing.
    """
    steps = steps_turned(record)
    if not record.is_stepped_sine and steps < FEWEST_STEPS:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by {steps:.0f} steps of its encoder, "
            f"{FEWEST_STEPS:g} are needed; move it by more, and check the unit of theta in the source file"
        )
    sums = plain_sums(record, IMPEDANCE)
    if not record.is_stepped_sine:
        check_moves(record, sums, steps)
        if moving_seconds(record) < SHORTEST_S:
            words = moves_little(record, "K, B and I cannot be told from so little")
            raise IdentifiabilityError(f"trial {record.name}: {words}")
    try:
        analysis = analysed(record, sums, IMPEDANCE)
    except IdentifiabilityError as error:
        words = missing_band(record) if record.is_stepped_sine else moves_little(record, str(error))
        raise IdentifiabilityError(f"trial {record.name}: {words}") from error
    if not record.is_stepped_sine:
        check_alias(record, analysis.whole)
        limit = getattr(record.settings, "largest_inertia_error", None)
        check_band(record, analysis.whole, limit)
    for fit in analysis.fits.values():
        check_stiffer(record.name, "K", fit["K"], record.bench)
    effects = sums_of(record, IMPEDANCE, expected)
    return Rendered(analysis, phasors_of_record(record), effects, causes(record, effects, IMPEDANCE))


FEWEST_STEPS = 20.0
"""Steps of the encoder that an angle turns by at least; below, its rounding is no noise but a part of the motion."""
HARDLY_MOVES = 0.1  # share of the acceleration that is the encoder's noise, from which a record is refused
SLOW = 200.0  # steps of the encoder from which a motion is not small but slow, if noise makes its acceleration


def check_moves(record: Record, sums: Sums, steps: float) -> None:
    """Refuse a record that hardly moves, or slowly: noise of the encoder makes its acceleration."""
    share = noise_of_angle(record)[2] / max(own_power(sums, "alpha", ("theta", "omega", "one")), np.finfo(float).tiny)
    if share <= HARDLY_MOVES:
        return
    slow = steps >= SLOW
    remedy = (
        "move it faster, by 0.5 to 6 Hz, or take the stiffness alone by experiment 'torque_angle'"
        if slow
        else "move it by more, or faster, and check the unit of theta in the source file"
    )
    raise InputError(
        f"trial {record.name}: the joint {'moves too slowly' if slow else 'hardly moves'}: theta turns by "
        f"{turn_deg(sums):.2g} deg RMS, and noise of the encoder has {share:.2g} times the power of the acceleration's "
        f"own part behind the filter, at most {HARDLY_MOVES:g} is allowed; {remedy}"
    )


SPIKE = 8.0  # robust standard deviations of third differences that noise does not reach
ROUNDING_REACHES = 4.5  # steps of an encoder that its rounding does not reach in a third difference; four is the most
LARGEST_ALIAS = 0.01
"""Change of B, and of I, by jumps of the acceleration at an unknown instant within a sample, that is refused."""
BESIDE_SPIKE = 15
"""Samples to each side of a spike that it is far above: a hand, or a sweep, is as fast there without a jump."""
BESIDE_JUMP = 3  # samples on each side of a jump from which its size is read


def motion_in(record: Record) -> Array:
    """Angle, velocity and acceleration in the fitted rows of a record, (m, 3)."""
    motion = record.motion
    return np.column_stack([record.part(x) for x in (motion.theta, motion.omega, motion.alpha)])


def check_band(record: Record, fit: GroupFit, largest_inertia_error: float | None) -> None:
    """Refuse a motion whose band cannot tell K from I; the message names the band that is missing."""
    X, torque = motion_in(record), float(np.std(record.part(record.filtered_torque)))
    K = fit["K"], fit.se("K")
    check_told(f"trial {record.name}", record.band_hz, (X - X.mean(axis=0)).T, torque, K, largest_inertia_error)


def jumps(record: Record) -> tuple[NDArray[np.intp], Array]:
    """Rows at which the acceleration jumps within a sample, and by how much [rad/s^2]."""
    theta = record.theta
    third = np.abs(np.diff(theta, 3))
    noise = 1.4826 * usual_size(np.concatenate([third[piece] for piece in record.pieces]))
    step = record.steps[0] or 0.0
    high = np.flatnonzero(third > max(SPIKE * noise, ROUNDING_REACHES * step, np.finfo(float).tiny))
    near = np.clip(high[:, None] + np.arange(-BESIDE_SPIKE, BESIDE_SPIKE + 1), 0, len(third) - 1)
    high = high[third[high] > SPIKE * 1.4826 * np.median(third[near], axis=1)]
    if not high.size:
        return high, np.empty(0)
    first = high[np.diff(high, prepend=-10) > BESIDE_JUMP] + 1  # the middle of the four samples of the difference
    first = first[(first > BESIDE_JUMP + 1) & (first < len(theta) - BESIDE_JUMP - 3)]

    def alpha(start: int) -> float:  # its mean over some rows, of which the first one belongs to row start + 1
        return float(np.diff(theta[start : start + BESIDE_JUMP + 2], 2).mean()) * record.rate_hz**2

    return first, np.array([alpha(i + 1) - alpha(i - 1 - BESIDE_JUMP) for i in first])


def check_alias(record: Record, fit: GroupFit) -> float:
    """Largest change of B and I, as shares, by jumps of the acceleration that lie somewhere within a sample.

    The torque jumps with the acceleration. Without an anti-aliasing filter a sample shows the torque before or after
    the jump, so that its area is known to half a sample: a pseudo-random binary sequence that is clocked with the
    sampling is read late by half a sample in all of its jumps.

    Raises InputError: it is beyond `LARGEST_ALIAS`, and beyond the interval of noise.
    """
    rows, sizes = jumps(record)
    if not rows.size:
        return 0.0
    torque = record.torque
    steps = np.array([torque[i + 1 : i + 3].mean() - torque[i - 2 : i].mean() for i in rows])
    inertia = abs(float(steps @ sizes) / float(sizes @ sizes)) if sizes.any() else 0.0
    error = np.zeros(len(torque))
    np.add.at(error, rows, 0.5 * inertia * sizes)
    late = record.part(record.low_pass(error, record.rate_hz))
    _, *change = np.abs(np.linalg.lstsq(motion_in(record), late, rcond=None)[0])
    beyond = {x: abs(by / fit[x]) if by > fit.se(x) else 0.0 for x, by in zip("BI", change, strict=True)}
    worst = max(beyond, key=lambda name: beyond[name])
    if beyond[worst] > LARGEST_ALIAS:
        size, percent = float(np.median(np.abs(sizes))), 100 * beyond[worst]
        raise InputError(
            f"trial {record.name}: the acceleration jumps within a sample, {len(rows)} times by about {size:.2g} "
            f"rad/s^2, as under a binary sequence: without an anti-aliasing filter the torque's samples change {worst} "
            f"by up to {percent:.1f} %; smooth the command, or record angle and torque through the same low-pass and "
            "state it in the source file"
        )
    return beyond[worst]


def own_power(sums: Sums, column: str, others: Sequence[str]) -> float:
    """Mean square of a column without what is proportional to others."""
    A = sums.total
    own, at, one = sums.names.index(column), sums.index(others), sums.names.index("one")
    left = A[own, own] - A[own, at] @ np.linalg.lstsq(A[np.ix_(at, at)], A[at, own], rcond=1e-14)[0]
    return max(float(left / A[one, one]), 0.0)


def turn_deg(sums: Sums, label: Label = None) -> float:
    """RMS [deg] of the filtered angle about its mean in the rows of a label."""
    A = sums.over(label)
    theta, one = sums.index(["theta", "one"])
    n = A[one, one]
    return float(np.rad2deg(np.sqrt(max(A[theta, theta] / n - (A[theta, one] / n) ** 2, 0.0))))


def steps_turned(record: Record) -> float:
    """Steps of the encoder by which the fitted angle turns, at most as many as there are different values. Without end
    where no step is seen, and more values than a slow motion has."""
    measured, step = record.part(record.bench_angle), record.steps[0]
    values = distinct_values(measured, most=int(SLOW))
    levels = np.inf if values is None else len(values)
    return float(levels if step is None else min(np.ptp(measured) / step, levels))


def missing_band(record: Record) -> str:
    """What a stepped sine that cannot tell K from I has at its poorest amplitude, and which band is missing."""
    at: dict[Label, list[float]] = {}
    for one in record.groups.strata:
        at.setdefault(one.label, []).append(one.frequency_hz)
    found = {label: sorted(set(hz)) for label, hz in at.items()}
    amplitude, hz = min(found.items(), key=lambda item: (len(item[1]), item[1][-1] / item[1][0]))
    return (
        f"K and I cannot be told apart: the sines of {amplitude:g} deg are of {', '.join(f'{f:g}' for f in hz)} Hz "
        "alone, and at one frequency K - I w^2 is one number; the band below "
        f"{hz[0] / 2:.2g} Hz or from {2 * hz[-1]:.2g} Hz is missing, excite it as well"
    )


def moving_seconds(record: Record) -> float:
    """For how long the joint moves within the rows that are fitted."""
    return float(np.count_nonzero(moving_bins(record.time, record.theta)[record.rows()]) / record.rate_hz)


def moves_little(record: Record, why: str) -> str:
    """For how long and at which frequencies a record moves, where Eq. 15 cannot be fitted to it."""
    low, high = record.band_hz
    return (
        f"the joint moves for {moving_seconds(record):.2g} of the {record.seconds:.3g} s that are fitted, at {low:.2g} "
        f"to {high:.2g} Hz: {why.partition(';')[0]}; keep it moving by 0.5 to 6 Hz, or take the stiffness alone by "
        "experiment 'torque_angle'"
    )


def impedance_table(rendered: Rendered) -> pl.DataFrame:
    """The trial's rows of `impedance.csv`: Eq. 15 fitted to each amplitude [deg] and to all of them (amplitude null);
    of a motion that is no stepped sine one row.

    `load_cell_drift` [N*m/min] was subtracted from the torque.
    """
    analysis, record, s = rendered.analysis, rendered.record, rendered.effects
    rows = list[Row]()
    lag, change = lag_of(record, s, IMPEDANCE, rendered.found), stiffness_change(s, IMPEDANCE, rendered.found)
    facts = recorded_facts(rendered) | {"explained_by": explained_by(rendered.found, lag, change)}
    frame = frame_stiffness(s, IMPEDANCE, rendered.found) if lag and lag.found else None
    clocks = clocks_row(record, s, IMPEDANCE, rendered.found)
    for label, fit in analysis.fits.items():
        rows.append(
            {
                **analysis.row(label, *QUANTITIES),
                **lag_row(lag, fit, frame),
                **harmonic_row(rendered, label),
                **friction_row(s, IMPEDANCE, fit, label),
                **spring_row(rendered, label),
                **analysis.shared(label, *QUANTITIES),
                **change_row(change, s, fit, label),
                **clocks,
                "theta_rms_deg": turn_deg(s, label),
                "angle_noise_share": angle_noise_share(record, s, fit, label),
                **facts,
            }
        )
    rows = over_amplitudes(rows, half_widths_of_change(analysis))
    table = pl.DataFrame(rows, infer_schema_length=None, schema_overrides={"explained_by": pl.String})
    table = table.with_columns(pl.col(pl.Null).cast(pl.Float64))
    return table.with_columns(*(bound for name in QUANTITIES for bound in range_over_amplitudes(name)))


def recorded_facts(rendered: Rendered) -> Row:
    """What moved the joint, which is the same in every row: estimates of a device that is no second-order system depend
    on band and weights."""
    record, found = rendered.record, rendered.record.periodic
    kinds = {"cycles": "stepped sine", "periods": "periodic", "stretches": "other"}
    low, high = record.band_hz
    return {
        "excitation": kinds[record.groups.kind] if found is None else "periodic",
        "band_low_hz": low,
        "band_high_hz": high,
        "weighting": WEIGHTING,
        "torque_at_peaks": None if record.is_stepped_sine else torque_at_peaks(rendered),
        "fitted_s": record.seconds,
        "period_s": None if found is None else found.period,
        "periods": None if found is None else float(sum(one.periods for one in found.realisations)),
        "realisations": None if found is None else float(len(distinct(found.realisations))),
    }


def explained_by(found: Causes, lag: Fault | None, change: Fault | None) -> str | None:
    """What explains the misfit of Eq. 15, the best explanation first, as far as it is no fault that was not found."""
    faults = {"lag_s": lag, "K_change": change}
    sure = {e: found.fit[e] for e in found.chosen if e not in faults or ((fault := faults[e]) and fault.found)}
    sure |= {"lag_s": lag.size} if lag and lag.found else {}
    return ", ".join(EFFECTS[effect].format(f"{size:.3g}") for effect, size in sure.items()) or None


def lag_row(lag: Fault | None, fit: GroupFit, frame: float | None) -> Row:
    """Lag of the torque, the damping that it makes, and the shares of B and I of one that was found. Both shares are
    null where one that was not found might yet change I by more than `HIDDEN`."""
    if lag is None:
        return {**lag_damping_row(None, None, fit["K"]), **dict.fromkeys(("lag_share", "lag_inertia_share", FRAME))}
    row: Row = {**lag_damping_row(lag.size, lag.se, fit["K"], 0.0 if lag.found else np.inf)}
    if lag.found:
        return {
            **row,
            **dict(zip(("lag_share", "lag_inertia_share"), lag_shares(lag.size, fit), strict=True)),
            FRAME: frame,
        }
    most = (abs(fit["B"]) + fit["K"] * lag.possible) * lag.possible / float(np.hypot(fit["I"], LITTLE["I"]))
    share = None if most > HIDDEN else 0.0  # of either sign: a large lag has falsified B
    return {**row, "lag_share": share, "lag_inertia_share": share, FRAME: None}


FRAME = "frame_stiffness"


def lag_shares(lag: float, fit: GroupFit) -> tuple[float, float]:
    """Shares of B and of I that a lag [s] makes: exp(-s d) takes K d off B, and d times the joint's own B off I."""
    own_damping = fit["B"] + fit["K"] * lag
    return abs(fit["K"] * lag / fit["B"]), abs(own_damping * lag) / float(np.hypot(fit["I"], LITTLE["I"]))


def harmonic_row(rendered: Rendered, label: Label) -> Row:
    """Even and odd harmonics of the torque, as shares of it: of sines, or of a periodic motion of odd lines."""
    names = ("even_harmonics", "odd_harmonics")
    if rendered.phasors:
        fit = rendered.analysis.fits[label]
        linear = fit["K"], fit["B"], fit["I"]
        return dict(zip(names, harmonic_shares(rendered.phasors, label, linear), strict=True))
    found = rendered.record.periodic
    if found is None:
        return dict.fromkeys(names)
    band = periodic_response(found.realisations).band
    shares = (float(x / band["torque"]) if np.isfinite(x) else None for x in (band["even"], band["odd"]))
    return dict(zip(names, shares, strict=True))


def spring_row(rendered: Rendered, label: Label) -> Row:
    """What a spring that stiffens, and play, make of K, where the causes of the misfit contain them; else 0.

    `stiffening` is the share of K by which a cubic spring stiffens up to the largest angle, `backlash_deg` the width of
    a gap, and `backlash_share` the share of K that it takes off. They stand in the row over all amplitudes.
    """
    names = ("stiffening", "backlash_deg", "backlash_share")
    if label is not None:
        return dict.fromkeys(names)
    s, found, K = rendered.effects, rendered.found, rendered.analysis.whole["K"]
    row: Row = dict.fromkeys(names, 0.0)
    if found.certain("cubic"):
        theta = rendered.record.part(rendered.record.motion.theta) - s.centre
        row["stiffening"] = found.fit["cubic"] * float(np.abs(theta).max()) ** 2 / K
    if found.certain("gap") and found.fit["gap"] > 0:
        taken = -taken_by(s, IMPEDANCE, "gap")["K"] * found.fit["gap"]
        row |= {"backlash_deg": float(np.rad2deg(2 * found.fit["gap"] / K)), "backlash_share": max(taken / K, 0.0)}
    return row


def change_row(change: Fault | None, s: Sums, fit: GroupFit, label: Label) -> Row:
    """`K_drift`, the change of K over the recording beyond noise as a share of K, and `drift_inertia_share`, the share
    of I that it makes. Null where noise, or what Eq. 15 misses, hides a change that would spoil I."""
    names = ("K_drift", "drift_inertia_share")
    if change is None:
        return dict.fromkeys(names)
    taken = abs(taken_by(s, IMPEDANCE, "u_theta", label)["I"]) / float(np.hypot(fit["I"], LITTLE["I"]))
    if change.found:
        size = abs(change.size) + change.possible
        return dict(zip(names, (change.size / fit["K"], taken * size), strict=True))
    return dict.fromkeys(names, None if taken * change.possible > HIDDEN else 0.0)


def angle_noise_share(record: Record, s: Sums, fit: GroupFit, label: Label) -> float:
    """By how much noise of the angle changes I, as a share of it, to first order in its variance.

    Least squares take the columns for exact. With the covariance S of their noise the estimates are off by
    -(X'X/n)^-1 S times the estimates (Fuller, Measurement Error Models, 1987, ch. 2). The noise of angle and
    acceleration is correlated, so that a stiff joint has too large an I, and a light one too small.
    """
    return abs(angle_noise_bias(record, s, fit, label)) / float(np.hypot(fit["I"], LITTLE["I"]))


def angle_noise_bias(record: Record, s: Sums, fit: GroupFit, label: Label = None) -> float:
    """The same change of I [kg*m^2]."""
    still, moving, turning = noise_of_angle(record)
    S = np.array([[still, 0, -moving], [0, moving, 0], [-moving, 0, turning]])
    A = s.over(label)
    at, one = s.index(["theta", "omega", "alpha"]), s.names.index("one")
    X = A[np.ix_(at, at)] / A[one, one] - np.outer(A[at, one], A[at, one]) / A[one, one] ** 2
    return float(-np.linalg.solve(X, S @ [fit["K"], fit["B"], fit["I"]])[2])


SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Shares of the rows with the highest modelled torque that are compared, from sharp peaks of noise to sines."""
LEAST_RANGE = 0.03
"""Least range of the modelled torque in such rows, as a share of its peak: the top of a sine is flat and noisy."""


PEAK_ROWS_HZ = 8.0  # rows per second and Hz of the cut-off of which peaks are compared: the signals have nothing faster


def torque_at_peaks(rendered: Rendered) -> float | None:
    """Smallest ratio of `ratio_at_peaks` over the fitted rows of a record."""
    record = rendered.record
    step = max(int(record.rate_hz / (PEAK_ROWS_HZ * record.low_pass.cutoff_hz)), 1)
    rows = record.rows()[::step]
    return ratio_at_peaks(record.filtered_torque[rows], rendered.analysis.modelled(None, rows))


def ratio_at_peaks(measured: Array, modelled: Array) -> float | None:
    """Smallest SD of the measured torque over that of the modelled one, where the latter is at its peaks.

    Both (n,) [N*m], filtered alike; offsets do not matter. The peaks are the highest and the lowest `SHARES` of the
    modelled torque. The ratio is 1 for a joint of Eq. 15. Noise and distortion of the torque raise it. Friction lowers
    it to 0.7. It is near 0 where the torque is clipped, however noisy the plateau is: equal samples, by which a clipped
    sensor is told, are not needed. None where no peak has the range for a comparison.
    """
    found, ordered = [], np.sort(modelled)
    ends = (float(ordered[-1]), True), (float(ordered[0]), False)
    middle = float(np.median(ordered, overwrite_input=True))
    for top, highest in ends:
        for share in SHARES:
            level = float(np.quantile(ordered, 1 - share if highest else share, overwrite_input=True))
            if abs(top - level) > LEAST_RANGE * abs(top - middle):
                rows = modelled >= level if highest else modelled <= level
                found.append(float(np.std(measured[rows]) / np.std(modelled[rows])))
    return min(found, default=None)


def over_amplitudes(rows: Sequence[Row], halves: Sequence[float]) -> list[Row]:
    """The rows of single amplitudes and, last, of all of them, with `K_change` and `B_change` in the last one: by how
    much K and B change from the smallest to the largest amplitude, as a share of that to all of them.

    A spring that stiffens, or play, changes K with the amplitude; friction changes both. A change is lowered in size by
    the half-width of its 95 % interval, to 0 at most: noise is no change. What it is divided by is not less than
    `LITTLE`. `halves` are those of K and B; of fewer than two amplitudes none.
    """
    found: list[Row] = [{**row, "K_change": None, "B_change": None} for row in rows]
    single = sorted(rows[:-1], key=lambda row: number_in(row, "amplitude_deg"))
    for name, half in zip("KB", halves, strict=False):
        difference = number_in(single[-1], name) - number_in(single[0], name)
        certain = float(np.sign(difference)) * max(abs(difference) - half, 0.0)
        found[-1][f"{name}_change"] = certain / float(np.hypot(number_in(rows[-1], name), LITTLE[name]))
    return found


def number_in(row: Row, name: str) -> float:
    """A number that a row must have."""
    value = row[name]
    assert isinstance(value, float | int)
    return float(value)


def half_widths_of_change(analysis: Analysis) -> list[float]:
    """Half-widths of the 95 % intervals of the change of K and B from the smallest to the largest amplitude; empty for
    one amplitude. Where the frequencies of the two differ, their intervals are independent."""
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) < 2:
        return []
    ends = labels[0], labels[-1]
    paired = paired_errors(analysis.sums, analysis.model, *ends)
    if paired is not None:
        return [float(paired[list(analysis.model).index(name)]) for name in "KB"]
    fits = [analysis.fits[label] for label in ends]
    return [float(np.linalg.norm([fit.interval(name)[1] - fit[name] for fit in fits])) for name in "KB"]


def range_over_amplitudes(name: str) -> list[pl.Expr]:
    """`<name>_amplitudes_low` and `_high`: the lowest and the highest estimate of a single amplitude. They are in the
    row over all amplitudes (amplitude null) if there are two amplitudes or more; null elsewhere."""
    amplitude = pl.col("amplitude_deg")
    single = pl.col(name).filter(amplitude.is_not_null())
    several = amplitude.is_null() & (amplitude.count() > 1)
    bounds = {"low": single.min(), "high": single.max()}
    return [pl.when(several).then(value).alias(f"{name}_amplitudes_{end}") for end, value in bounds.items()]


def prediction_columns(predicted: tuple[float, float, float] | None) -> dict[str, pl.Expr]:
    """`K_predicted`, `B_predicted`, `I_predicted`: what linear theory expects, as constant columns of a table; null
    where it says nothing."""
    names, values = ("K_predicted", "B_predicted", "I_predicted"), predicted or (None, None, None)
    return {name: pl.lit(value, pl.Float64) for name, value in zip(names, values, strict=True)}


def rendered_phasors(rendered: Rendered) -> pl.DataFrame:
    """The trial's rows of `phasors.csv`; none where no sines moved the joint."""
    return phasor_table(rendered.record.name, rendered.phasors)


OF_GAINS = ("whether K is what the gains should give", "whether the bench's frame yields")
LOOKS_ALIKE = "a delay that matters would look like noise or friction in this recording"
BAND_POINTS = 12  # frequencies of a band at which the rendered impedance is predicted
OF_BELT = "K against the belt's K_s"
OF_DRIFT = "whether K changes while it is recorded: noise, or what Eq. 15 misses, may hide it"
OF_CLOCKS = "whether the clocks of angle and torque drift apart: what the fit leaves does not show it"


@dataclass(frozen=True)
class AskedImpedance:
    """What the leg was asked to render, and all that linear theory needs to say what it should have rendered."""

    desired: DesiredImpedance  # controller and desired impedance
    weight: Weight  # W of Eq. 14 with which the gains were selected.
    frequencies_hz: Sequence[float]  # frequencies [Hz] of the protocol

    def not_checked(self, p: DrivetrainParameters | None, lag_known: bool) -> str:
        """What a trial is not checked for, each with its reason; empty if it is checked for all."""
        no_file = "" if p else "the configuration names no parameter file"
        unknown = dict.fromkeys(OF_GAINS, no_file or self.desired.unknown_gains())
        reasons = {OF_BELT: no_file, **unknown, LATENESS: "" if lag_known else LOOKS_ALIKE}
        return "; ".join(f"{what}: {why}" for what, why in reasons.items() if why)

    def left_unchecked(self, p: DrivetrainParameters | None) -> pl.Expr:
        """The column `not_checked` of a table with lags: whether the torque is late, only in rows without a share."""
        known, unknown = (pl.lit(self.not_checked(p, lag_known) or None, pl.String) for lag_known in (True, False))
        return pl.when(pl.col("lag_inertia_share").is_null()).then(unknown).otherwise(known).alias("not_checked")


def judged_impedance(
    record: Record, rails: pl.Expr, p: DrivetrainParameters | None, asked: AskedImpedance | None
) -> tuple[Rendered, pl.DataFrame]:
    """Eq. 15 of a record, and its rows with all that judges them; what the gains should give only where these are
    known.

    Without parameter file (`p`), controller of the draft, K_d and B_d they are not. The column `not_checked` says so,
    and where the motion does not show a change of K over time, or a drift between the clocks of two devices.

    Raises InputError, UnreachableImpedanceError: As `plausible_impedance`, and as `DesiredImpedance.gains`.
    """
    gains = None if asked is None else asked.desired.gains(p, asked.weight)
    expected, predicted = None, None
    if asked is not None and p is not None and gains is not None:
        expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
        band = asked.frequencies_hz
        if not record.is_stepped_sine:
            band = np.linspace(*record.band_hz, BAND_POINTS).tolist()
        predicted = predicted_impedance(gains, p, band)
    rendered = rendered_impedance(record, expected)
    table = plausible_impedance(impedance_table(rendered), rails, p, predicted[0] if predicted else None)
    if asked is None:
        table = table.with_columns(
            not_checked=pl.lit(None if p else f"{OF_BELT}: no parameter file is named", pl.String)
        )
    else:
        known = table.with_columns(**asked.desired.columns(), **prediction_columns(predicted))
        table = known.with_columns(asked.left_unchecked(p))
    unseen = {"K_drift": OF_DRIFT} | ({"clock_drift_ppm": OF_CLOCKS} if record.two_clocks else {})
    for column, words in unseen.items():
        both = pl.concat_str("not_checked", pl.lit(words), separator="; ", ignore_nulls=True)
        table = table.with_columns(
            pl.when(pl.col(column).is_null()).then(both).otherwise("not_checked").alias("not_checked")
        )
    return rendered, table


def by_motion(trials: pl.DataFrame) -> list[pl.DataFrame]:
    """The trials of one condition, apart where their motions differ in band, period or size, in their order."""
    kinds: list[list[int]] = []
    numbers = [name for name in ("band_high_hz", "period_s", "theta_rms_deg") if name in trials.columns]
    values = trials.select(numbers).fill_null(0.0).to_numpy()
    for row, own in enumerate(values):
        near = (kind for kind in kinds if np.allclose(values[kind[0]], own, rtol=0.15))  # realisations of one motion
        found = next(near, None)
        if found is None:
            kinds.append([row])
        else:
            found.append(row)
    return [trials[kind] for kind in kinds]


def repeated_trials_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """A row per condition and motion with two trials or more, and quantity, with Student's interval over the trials.

    Each trial counts with its fit to all of its motion. The interval contains everything that differs from trial to
    trial, as the distortion that friction makes of another realisation of a random motion; the intervals of the single
    trials may not. Doubtful fits are left out where half of the trials or more are sound.
    """
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    same = ("joint", "side", "controller", "K_d", "B_d", "group", "excitation")
    keys = [name for name in same if name in whole.columns]
    rows = []
    for key, trials in (
        (key, part) for key, one in whole.group_by(keys, maintain_order=True) for part in by_motion(one)
    ):
        if len(trials) < 2:
            continue
        used = counted(trials)
        band = {"band_low_hz": trials["band_low_hz"].min(), "band_high_hz": trials["band_high_hz"].max()}
        left_out = {**doubtful_row(trials), "n_left_out": len(trials) - len(used)}
        said = {**dict(zip(keys, key, strict=True)), **band}
        rows += [{**said, "quantity": name, **summary_row(used[name]), **left_out} for name in QUANTITIES]
    if rows:
        return pl.DataFrame(rows, infer_schema_length=None)
    numbers = ("band_low_hz", "band_high_hz", "n", "mean", "sd", "se", "low", "high", "n_doubtful", "n_left_out")
    texts = {name: pl.String() for name in (*keys, "quantity", "interval_method") if name not in ("K_d", "B_d")}
    return pl.DataFrame(schema={name: pl.Float64() for name in keys} | texts | dict.fromkeys(numbers, pl.Float64()))
