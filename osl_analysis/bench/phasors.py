"""Phasors of angle and torque in each segment of a stepped sine (Fig. 7), and harmonics of the torque."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isclose

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.record import Label, Record
from osl_analysis.errors import InputError
from osl_analysis.stats.covariance import FEWEST_CYCLES, Cycles
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.sinusoid import (
    ComplexEstimate,
    Phasor,
    Sinusoid,
    complex_from_row,
    complex_mean,
    complex_quotient,
    complex_row,
    polar_row,
    sinusoid,
    with_known_error,
)
from osl_analysis.trial import Array

RESPONSE_KEYS = ("trial", "joint", "side", "controller", "K_d", "B_d", "frequency_hz")
"""Columns of the phasor table whose rows differ in the amplitude only."""


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment."""

    amplitude_deg: float  # measured amplitude [deg] by which the fits to this and the other frequencies are named
    frequency_hz: float  # frequency [Hz]
    theta: Phasor  # of the joint angle [rad]
    torque: Phasor  # of the resisting torque [N*m]
    compliance_error: float = 0.0
    """Standard error [rad/(N*m)] of the bench's compliance, whose yielding was taken off the angle."""
    commanded_deg: float | None = None  # amplitude of the protocol that it follows [deg]

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)]. An error of the bench's compliance c changes the angle by
        -c torque, and Y by -c."""
        return with_known_error(complex_quotient(self.theta, self.torque), self.compliance_error)


def phasors_of_record(record: Record) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment of a stepped sine, amplitude by amplitude; none of another motion.
    The last cycle is not used. If the angle lags the command by more at one frequency than at another, this cycle
    contains the beginning of the next frequency."""
    if not record.is_stepped_sine:
        return []
    order = sorted(
        range(len(record.groups.strata)), key=lambda k: record.groups.labels.index(record.groups.strata[k].label)
    )
    try:
        return [phasors_of(record, k) for k in order]
    except InputError as error:
        raise InputError(f"trial {record.name}, {error}") from error


def phasors_of(record: Record, k: int) -> SegmentPhasors:
    """Phasors of one stratum of a record."""
    groups, one = record.groups, record.groups.strata[k]
    assert isinstance(one.label, float)
    rows, cycles = cycles_in(groups.first[groups.stratum == k], groups.stop[groups.stratum == k])
    sine = sinusoid(record.time[rows], one.frequency_hz, cycles)
    error = record.bench.compliance_error if record.bench else 0.0
    signals = {"theta": record.theta[rows], "torque": record.torque[rows]}
    return segment_phasors(one.label, one.commanded, sine, signals, error)


def cycles_in(first: Array, stop: Array) -> tuple[NDArray[np.intp] | slice, Cycles | None]:
    """The rows of the cycles of a stratum, and the cycles among them; None if there are fewer than five."""
    starts = np.floor(first + 1e-6).astype(np.intp)
    ends = np.ceil(stop - 1e-6).astype(np.intp)
    apart = np.flatnonzero(starts[1:] > ends[:-1]) + 1
    runs = [slice(int(starts[a]), int(ends[b - 1])) for a, b in zip([0, *apart], [*apart, len(first)], strict=True)]
    lengths = [run.stop - run.start for run in runs]
    before = np.repeat(np.cumsum([0, *lengths[:-1]]) - [run.start for run in runs], np.diff([0, *apart, len(first)]))
    rows = runs[0] if len(runs) == 1 else np.concatenate([np.r_[run] for run in runs])
    if len(first) < FEWEST_CYCLES:
        return rows, None
    return rows, Cycles(np.maximum(first + before, 0), stop + before, np.zeros(len(first), dtype=np.intp))


def segment_phasors(
    label: float, commanded: float | None, sine: Sinusoid, signals: Mapping[str, Array], compliance_error: float = 0.0
) -> SegmentPhasors:
    """Phasors of one segment of the raw signals `theta` and `torque` [rad, N*m] in its rows, with its sine."""
    found = sine.phasors(signals)
    commanded_deg = None if commanded is None else round(float(np.rad2deg(commanded)), 9)
    return SegmentPhasors(label, sine.frequency_hz, found["theta"], found["torque"], compliance_error, commanded_deg)


def at_amplitude(phasors: Sequence[SegmentPhasors], label: Label) -> list[SegmentPhasors]:
    """The segments of one amplitude [deg], or all (None)."""
    return [s for s in phasors if not isinstance(label, float) or isclose(s.amplitude_deg, label, rel_tol=1e-5)]


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """A row per amplitude and frequency: phasors of angle [rad] and torque [N*m], Y [rad/(N*m)], distortions."""
    rows = [{"trial": trial, **phasor_row(segment)} for segment in phasors]
    return pl.DataFrame(rows, schema_overrides={"commanded_deg": pl.Float64})


def phasor_row(segment: SegmentPhasors) -> Row:
    """Phasors and Y with covariances and degrees of freedom, the distortions, magnitude and phase of Y."""
    admittance = segment.admittance
    return {
        "amplitude_deg": segment.amplitude_deg,
        "frequency_hz": segment.frequency_hz,
        **complex_row("theta", segment.theta),
        **complex_row("torque", segment.torque),
        "theta_distortion": segment.theta.distortion,
        "torque_distortion": segment.torque.distortion,
        **complex_row("Y", admittance),
        **{f"Y_{name}": value for name, value in polar_row(admittance).items()},
        "Y_se_bench": segment.compliance_error,
        "interval_method": max(segment.theta.interval_method, segment.torque.interval_method, key=len),
        "commanded_deg": segment.commanded_deg,
    }


def no_phasors() -> pl.DataFrame:
    """The columns of `phasor_table` without a row, for a trial that no sine moved."""
    return example_phasors().clear()


def example_phasors() -> pl.DataFrame:
    """One row of `phasor_table`, of a sine that stands for no trial; only its columns count."""
    time = np.arange(200) / 200
    sine = np.sin(2 * np.pi * 10 * time)
    return phasor_table("", [segment_phasors(1.0, None, sinusoid(time, 10.0), {"theta": sine, "torque": sine})])


def no_responses() -> pl.DataFrame:
    """The columns of `frequency_response_table` without a row."""
    numbers = ("K_d", "B_d", "frequency_hz")
    keys = {name: pl.lit(None, pl.Float64 if name in numbers else pl.String) for name in RESPONSE_KEYS}
    row = pl.DataFrame([mean_response_row(example_phasors().with_columns(doubtful=pl.lit("")))])
    return row.select(**keys).hstack(row).clear()


def frequency_response_table(phasors: pl.DataFrame) -> pl.DataFrame:
    """Complex mean of Y over the amplitudes, a row per trial and frequency, from the gathered phasor tables."""
    keys = [key for key in RESPONSE_KEYS if key in phasors.columns]
    groups = phasors.group_by(keys, maintain_order=True)
    rows = [{**dict(zip(keys, values, strict=True)), **mean_response_row(group)} for values, group in groups]
    if not rows:
        return no_responses()
    return pl.DataFrame(rows, schema_overrides={key: phasors.schema[key] for key in keys}, infer_schema_length=None)


def mean_response_row(amplitudes: pl.DataFrame) -> Row:
    """Mean of Y over amplitudes at one frequency: magnitude [rad/(N*m)] and phase [deg] with 95 % intervals.

    The intervals contain the noise of the phasors only. `_min` and `_max` are the values of the single amplitudes.
    Their phases are computed relative to that of the mean, so that they do not jump at 180 degrees. `doubtful` lists
    the reasons of doubtful phasors with their amplitudes.
    """
    rows = list(amplitudes.iter_rows(named=True))
    shared = max(float(row["Y_se_bench"]) for row in rows)
    responses = [complex_from_row("Y", row | {"Y_var_re": row["Y_var_re"] - shared**2}) for row in rows]
    mean = with_known_error(complex_mean(responses), shared)  # all amplitudes share the error of the bench
    phases = [np.rad2deg(mean.phase + np.angle(r.value / mean.value)) for r in responses]
    reasons = amplitudes.select("amplitude_deg", "doubtful").drop_nulls().filter(pl.col("doubtful") != "").rows()
    return {
        **polar_row(mean),
        **complex_row("Y", mean),
        "interval_method": " and ".join(amplitudes["interval_method"].unique().sort()),
        "magnitude_min": min(r.magnitude for r in responses),
        "magnitude_max": max(r.magnitude for r in responses),
        "phase_min_deg": float(min(phases)),
        "phase_max_deg": float(max(phases)),
        "n_amplitudes": len(responses),
        "doubtful": "; ".join(f"at {amplitude:g} deg: {reason}" for amplitude, reason in reasons),
    }


def harmonic_shares(phasors: Sequence[SegmentPhasors], linear: tuple[float, float, float]) -> tuple[float, float]:
    """Even and odd harmonics of the torque beyond those of a linear joint (K, B, I), as shares of the fundamental.

    The angle's own harmonics make some of the torque's: these are taken off first. Even harmonics, 2 and 4, count as
    far as all segments have the same: asymmetry. A symmetric joint that chatters has some, at any phase. Odd ones, 3
    and 5, are those of friction, play, or a spring that stiffens.
    """
    K, B, I = linear
    own = []
    for one in phasors:
        k = np.arange(1, one.torque.harmonics.size + 1)
        s = 2j * np.pi * one.frequency_hz * k
        left = one.torque.harmonics - (K + B * s + I * s**2) * one.theta.harmonics
        own.append(left * np.exp(-1j * k * one.theta.phase))
    size, left = np.array([abs(one.torque.value) for one in phasors]), np.array(own)
    even = (left / size[:, None])[:, [1, 3]].mean(axis=0)
    return float(np.linalg.norm(even)), float(np.linalg.norm(left[:, [2, 4]]) / np.linalg.norm(size))
