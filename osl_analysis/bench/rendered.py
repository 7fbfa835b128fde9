"""An impedance trial by what moved the joint: the stepped sine of the protocol, or any other motion."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from osl_analysis.bench.any_excitation import WEIGHTING, record_points, record_series, record_table, record_time_base
from osl_analysis.bench.frequency_response import Admittance, SegmentPhasors, no_phasors, phasor_table
from osl_analysis.bench.impedance import (
    amplitude_series,
    impedance_series,
    impedance_table,
    impedance_time_base,
    trial_phasors,
)
from osl_analysis.bench.moving_record import MovingRecord, moving_record
from osl_analysis.bench.series import Series
from osl_analysis.bench.settings import ImpedanceAnalysis
from osl_analysis.bench.stepped_sine import Recorded, SteppedSineTrial, recorded, stepped_sine_trial
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.protocol.likeness import BIN_S, HARDLY, MOVES
from osl_analysis.spectral.tables import NO_RESPONSE, RecordedMotion, ResponseTables, response_tables
from osl_analysis.stats.fit_row import Row
from osl_analysis.trial import Trial

SLOW_TURN_DEG = 1.0
"""Turn of a joint [deg] beyond the noise of any encoder: it moved, if slowly."""
RenderedTrial = SteppedSineTrial | MovingRecord
OF_RECORDS = (
    "theta_rms_deg",
    "angle_noise_share",
    "torque_at_peaks",
    "fitted_s",
    "period_s",
    "periods",
    "realisations",
)
"""Columns of `impedance.csv` that only another motion than a stepped sine fills."""


def rendered_trial(trial: Trial, settings: ImpedanceAnalysis, windows: str | None = None) -> RenderedTrial:
    """The trial for its fit. `excitation` in the settings says what moved the joint; `auto` asks the recording.

    A motion in which half of the moving time is sines of one frequency each is a stepped sine; one that hardly has any,
    and does not have the commanded frequencies in turn, is another motion. Between the two a stepped sine may be
    damaged: it is refused, or fitted as one, and a refusal names the setting by which it is taken for another motion.
    `windows` [s] of the sample sheet state that it is one.

    Raises
    ------
    InputError
        As `stepped_sine_trial` and `moving_record`.
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
    """A stepped sine in an angle that turns by no more than its noise.

    Raises
    ------
    InputError
        There is none: the joint does not move, or slowly.
    """
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
    """A stepped sine that may be damaged, where a part of the moving time are sines.

    Raises
    ------
    InputError
        As `stepped_sine_trial`, or hardly any of it is a sine; the message names the setting for another motion.
    """
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

    `phasors` are those of `sines_of`, where they are known already.
    """
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
    """The trial's rows of `timebase.csv`."""
    return record_time_base(trial) if isinstance(trial, MovingRecord) else impedance_time_base(trial)


def rendered_series(trial: RenderedTrial) -> Series:
    """Measured torque and that of Eq. 15 over the whole trial."""
    return record_series(trial) if isinstance(trial, MovingRecord) else impedance_series(trial)


def shown_series(trial: RenderedTrial, amplitude_deg: float, duration_s: float) -> pl.DataFrame:
    """The last seconds of one amplitude of a stepped sine, or of another motion, measured and modelled (Fig. 4)."""
    if isinstance(trial, MovingRecord):
        return record_points(trial, duration_s)
    return amplitude_series(trial, amplitude_deg, duration_s)
