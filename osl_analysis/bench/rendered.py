"""An impedance trial by what moved the joint, the stepped sine of the protocol or any other motion: its rows of the
tables, judged by what the leg was asked to render where that is known, and means over trials of one condition.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench.any_excitation import WEIGHTING, record_points, record_series, record_table, record_time_base
from osl_analysis.bench.impedance import (
    DesiredImpedance,
    amplitude_series,
    impedance_series,
    impedance_table,
    impedance_time_base,
    prediction_columns,
    trial_phasors,
)
from osl_analysis.bench.moving_record import MovingRecord, moving_record
from osl_analysis.bench.phasors import Admittance, SegmentPhasors, no_phasors, phasor_table
from osl_analysis.bench.series import Series
from osl_analysis.bench.settings import ImpedanceAnalysis
from osl_analysis.bench.stepped_sine import Recorded, SteppedSineTrial, recorded, stepped_sine_trial
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.doubts import counted, doubtful_row
from osl_analysis.judge.impossible import Saturated, not_checked, plausible_impedance
from osl_analysis.model.compensator import predicted_impedance
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.gain_selection import Weight
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.protocol.likeness import BIN_S, HARDLY, MOVES
from osl_analysis.spectral.tables import NO_RESPONSE, RecordedMotion, ResponseTables, response_tables
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.repeats import summary_row
from osl_analysis.trial import Trial

SLOW_TURN_DEG = 1.0  # turn of a joint [deg] beyond the noise of any encoder: it moved, if slowly
RenderedTrial = SteppedSineTrial | MovingRecord
OF_RECORDS = (
    "theta_rms_deg", "angle_noise_share", "torque_at_peaks", "fitted_s", "period_s", "periods", "realisations",
)  # fmt: skip
"""Columns of `impedance.csv` that only another motion than a stepped sine fills."""


def rendered_trial(trial: Trial, settings: ImpedanceAnalysis, windows: str | None = None) -> RenderedTrial:
    """The trial for its fit. `excitation` in the settings says what moved the joint; `auto` asks the recording.

    A motion in which half of the moving time is sines of one frequency each is a stepped sine; one that hardly has any,
    and does not have the commanded frequencies in turn, is another motion. Between the two a stepped sine may be
    damaged: it is refused, or fitted as one, and a refusal names the setting by which it is taken for another motion.
    `windows` [s] of the sample sheet state that it is one.

    Raises InputError: As `stepped_sine_trial` and `moving_record`.
    """
    if settings.excitation == "any" or (windows and settings.excitation == "auto"):
        return moving_record(trial, settings, windows)
    if settings.excitation == "stepped_sine":
        return stepped_sine_trial(trial, settings)
    known = recorded(trial, settings)
    if known.motion.kind == "other":
        return moving_record(trial, settings, windows, known.signals)
    if not known.motion.moves:
        return perhaps_at_rest(trial, settings, known)
    if known.motion.kind == "stepped sine":
        return stepped_sine_trial(trial, settings, known)
    return perhaps_damaged(trial, settings, known)


def perhaps_at_rest(trial: Trial, settings: ImpedanceAnalysis, known: Recorded) -> SteppedSineTrial:
    """A stepped sine in an angle that turns by no more than its noise."""
    try:
        return stepped_sine_trial(trial, settings, known)
    except InputError as error:
        degrees = np.rad2deg(np.ptp(known.signals["theta"]))
        if degrees > SLOW_TURN_DEG:
            raise InputError(
                f"trial {trial.name}: the joint moves too slowly: theta changes by {degrees:.3g} deg in all, but by no "
                f"more than {100 * MOVES:g} % of it, or its noise, within {BIN_S:g} s; move it by 0.5 to 6 Hz, or take "
                "the stiffness alone by experiment 'torque_angle'"
            ) from error
        raise InputError(
            f"trial {trial.name}: the joint does not move: theta turns by {degrees:.3g} deg in all; check the channel "
            "and the unit of theta in the source file, and that this is the recording of the trial"
        ) from error


def perhaps_damaged(trial: Trial, settings: ImpedanceAnalysis, known: Recorded) -> SteppedSineTrial:
    """A stepped sine that may be damaged, where a part of the moving time are sines."""
    sines = known.motion.sines
    meant = (
        f"{100 * sines:.0f} % of the moving time are sines of one frequency: if another motion was meant, "
        "state `excitation: any` under `dynamometer` in the configuration, or its windows in the sheet"
    )
    try:
        found = stepped_sine_trial(trial, settings, known)
    except InputError as error:
        raise InputError(f"{error}; {meant}") from error
    if sines < HARDLY:
        raise InputError(
            f"trial {trial.name}: theta has the commanded frequencies, but is no stepped sine; look for spikes, hum "
            f"and a mount that turns; {meant}, or `excitation: stepped_sine` to fit what there is"
        )
    return found


def sines_of(trial: RenderedTrial) -> list[SegmentPhasors]:
    """The phasors of all segments of a stepped sine, none where no sines moved the joint; raises as `trial_phasors`."""
    return [] if isinstance(trial, MovingRecord) else trial_phasors(trial)


def rendered_table(
    trial: RenderedTrial, expected: Admittance | None, phasors: Sequence[SegmentPhasors] | None = None
) -> pl.DataFrame:
    """The trial's rows of `impedance.csv`; `expected` and what is raised as in `impedance_table` and `record_table`.
    `phasors` are those of `sines_of`, where they are known already."""
    if isinstance(trial, MovingRecord):
        return record_table(trial, expected)
    try:
        table = impedance_table(trial, trial_phasors(trial) if phasors is None else phasors, expected)
    except IdentifiabilityError as error:
        raise IdentifiabilityError(f"trial {trial.name}: {missing_band(trial)}") from error
    low, high = band_hz(trial)
    row: Row = {"excitation": "stepped sine", "band_low_hz": low, "band_high_hz": high, "weighting": WEIGHTING}
    nothing = {name: pl.lit(None, pl.Float64) for name in OF_RECORDS}
    return table.with_columns(**{name: pl.lit(value) for name, value in row.items()}, **nothing)


def missing_band(trial: SteppedSineTrial) -> str:
    """What a stepped sine that cannot tell K from I has at its poorest amplitude, and which band is missing."""
    at = {block.amplitude_deg: sorted({s.frequency_hz for s in block.segments}) for block in trial.blocks}
    amplitude, found = min(at.items(), key=lambda item: (len(item[1]), item[1][-1] / item[1][0]))
    return (
        f"K and I cannot be told apart: the sines of {amplitude:g} deg are of {', '.join(f'{f:g}' for f in found)} Hz "
        "alone, and at one frequency K - I w^2 is one number; the band below "
        f"{found[0] / 2:.2g} Hz or from {2 * found[-1]:.2g} Hz is missing, excite it as well"
    )


def band_hz(trial: RenderedTrial) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] that moved the joint."""
    if isinstance(trial, MovingRecord):
        return trial.band_hz
    frequencies = [segment.frequency_hz for segment in trial.segments(None)]
    return min(frequencies), max(frequencies)


def rendered_phasors(trial: RenderedTrial, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """The trial's rows of `phasors.csv` from the phasors of `sines_of`; none where no sines moved the joint."""
    return no_phasors() if isinstance(trial, MovingRecord) else phasor_table(trial.name, phasors)


def rendered_response(trial: RenderedTrial, p: DrivetrainParameters | None) -> ResponseTables:
    """The trial's rows of `response.csv` and its models; none of a stepped sine, whose response is in `phasors.csv`."""
    if isinstance(trial, SteppedSineTrial):
        return NO_RESPONSE
    signals = trial.theta, trial.torque, trial.rate_hz
    motion = RecordedMotion(trial.name, *signals, trial.low_pass, trial.periodic, trial.pieces, trial.steps)
    return response_tables(motion, p)


def rendered_time_base(trial: RenderedTrial) -> pl.DataFrame:
    return record_time_base(trial) if isinstance(trial, MovingRecord) else impedance_time_base(trial)


def rendered_series(trial: RenderedTrial) -> Series:
    return record_series(trial) if isinstance(trial, MovingRecord) else impedance_series(trial)


def shown_series(trial: RenderedTrial, amplitude_deg: float, duration_s: float) -> pl.DataFrame:
    """The last seconds of one amplitude of a stepped sine, or of another motion, measured and modelled (Fig. 4)."""
    if isinstance(trial, MovingRecord):
        return record_points(trial, duration_s)
    return amplitude_series(trial, amplitude_deg, duration_s)


OF_GAINS, OF_LAG = (
    "whether K is what the gains should give, whether the bench's frame yields",
    "whether the torque is late",
)
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
        """What a trial is not checked for, and why; empty if it is checked for all."""
        of_gains = OF_GAINS if lag_known else f"{OF_GAINS}, {OF_LAG}"
        if p is None:
            return f"{OF_BELT}, {of_gains}: the configuration names no parameter file"
        why = self.desired.unknown_gains()
        if why:
            return f"{of_gains}: {why}"
        return "" if lag_known else f"{OF_LAG}: {LOOKS_ALIKE}"

    def left_unchecked(self, p: DrivetrainParameters | None) -> pl.Expr:
        """The column `not_checked` of a table with lags: whether the torque is late, only in rows without a share."""
        known, unknown = (pl.lit(self.not_checked(p, lag_known) or None, pl.String) for lag_known in (True, False))
        return pl.when(pl.col("lag_inertia_share").is_null()).then(unknown).otherwise(known).alias("not_checked")


def judged_impedance(
    rendered: RenderedTrial,
    rails: Saturated,
    p: DrivetrainParameters | None,
    asked: AskedImpedance | None,
    phasors: Sequence[SegmentPhasors] | None = None,
) -> pl.DataFrame:
    """The rows of Eq. 15 with all that judges them; what the gains should give only where these are known.

    `phasors` as in `rendered_table`.

    Without parameter file (`p`), controller of the draft, K_d and B_d they are not. The column `not_checked` says so,
    and where the motion does not show a change of K over time, or a drift between the clocks of two devices.

    Raises InputError, UnreachableImpedanceError: As `plausible_impedance`, and as `DesiredImpedance.gains`.
    """
    table = judged_by_gains(rendered, rails, p, asked, phasors)
    two_clocks = rendered.uniform is not None and not rendered.uniform.one_device("theta", "torque")
    unseen = {"K_drift": OF_DRIFT} | ({"clock_drift_ppm": OF_CLOCKS} if two_clocks else {})
    for column, words in unseen.items():
        both = pl.concat_str("not_checked", pl.lit(words), separator="; ", ignore_nulls=True)
        table = table.with_columns(
            pl.when(pl.col(column).is_null()).then(both).otherwise("not_checked").alias("not_checked")
        )
    return table


def judged_by_gains(
    rendered: RenderedTrial,
    rails: Saturated,
    p: DrivetrainParameters | None,
    asked: AskedImpedance | None,
    phasors: Sequence[SegmentPhasors] | None,
) -> pl.DataFrame:
    """As `judged_impedance`, without what the motion alone leaves unchecked."""
    gains = None if asked is None else asked.desired.gains(p, asked.weight)
    if asked is None or p is None or gains is None:
        table = plausible_impedance(rendered_table(rendered, None, phasors), rails, p)
        if asked is None:
            return table.with_columns(not_checked("" if p else f"{OF_BELT}: no parameter file is named"))
        known = table.with_columns(**asked.desired.columns(), **prediction_columns(None))
        return known.with_columns(asked.left_unchecked(p))
    table = rendered_table(rendered, joint_admittance(gains.K_1, gains.B_1, p, p.J_j), phasors)
    band = np.linspace(*rendered.band_hz, BAND_POINTS).tolist() if isinstance(rendered, MovingRecord) else None
    predicted = predicted_impedance(gains, p, band or asked.frequencies_hz)
    plausible = plausible_impedance(table, rails, p, predicted[0])
    judged = plausible.with_columns(**asked.desired.columns(), **prediction_columns(predicted))
    return judged.with_columns(asked.left_unchecked(p))


SAME_MOTION = 0.15  # largest relative difference of band, period and size of motions that are realisations of one
QUANTITIES = ("K", "B", "I")  # estimates that are averaged
SAME = ("joint", "side", "controller", "K_d", "B_d", "group", "excitation")
"""Columns in which the trials of one row agree, as far as the table of fits has them."""
TEXT = ("joint", "side", "controller", "group", "excitation", "quantity", "interval_method")  # columns of text
NUMBERS = ("band_low_hz", "band_high_hz", "n", "mean", "sd", "se", "low", "high", "n_doubtful", "n_left_out")
"""Columns of numbers beside the condition."""


def alike(trials: pl.DataFrame) -> list[pl.DataFrame]:
    """The trials of one condition, apart where their motions differ in band, period or size, in their order."""
    kinds: list[list[int]] = []
    numbers = [name for name in ("band_high_hz", "period_s", "theta_rms_deg") if name in trials.columns]
    values = trials.select(numbers).fill_null(0.0).to_numpy()
    for row, own in enumerate(values):
        near = (kind for kind in kinds if np.allclose(values[kind[0]], own, rtol=SAME_MOTION))
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
    keys = [name for name in SAME if name in whole.columns]
    rows = []
    for key, trials in ((key, part) for key, same in whole.group_by(keys, maintain_order=True) for part in alike(same)):
        if len(trials) < 2:
            continue
        used = counted(trials)
        band = {"band_low_hz": trials["band_low_hz"].min(), "band_high_hz": trials["band_high_hz"].max()}
        left_out = {**doubtful_row(trials), "n_left_out": len(trials) - len(used)}
        said = {**dict(zip(keys, key, strict=True)), **band}
        rows += [{**said, "quantity": name, **summary_row(used[name]), **left_out} for name in QUANTITIES]
    if rows:
        return pl.DataFrame(rows, infer_schema_length=None)
    columns = (*keys, "quantity", "interval_method", *NUMBERS)
    return pl.DataFrame(schema={name: pl.String() if name in TEXT else pl.Float64() for name in columns})
