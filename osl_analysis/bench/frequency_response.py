"""Frequency response of a trial: of a stepped sine the mean of its phasors over the amplitudes
(Fig. 7), of any other motion the impedance at the lines of its spectrum (`response.csv`)."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.complex_estimate import (
    POLAR,
    BenchError,
    ComplexEstimate,
    complex_mean,
    polar_row,
)
from osl_analysis.bench.effects import Admittance
from osl_analysis.bench.group_fit import GroupFit
from osl_analysis.bench.phasors import SHARED
from osl_analysis.bench.record import Record
from osl_analysis.errors import InputError
from osl_analysis.spectral.periods import distinct
from osl_analysis.spectral.response import (
    ResponseColumns,
    local_response,
    periodic_response,
    record_spectrum,
)
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array

OF_TRIAL: dict[str, type[pl.DataType]] = {
    **dict.fromkeys(("trial", "joint", "side", "controller"), pl.String),
    **dict.fromkeys(("K_d", "B_d", "frequency_hz"), pl.Float64),
}
"""Columns in which the phasors of one trial and frequency agree; they differ only in amplitude."""
MEAN_OVER_AMPLITUDES: dict[str, type[pl.DataType]] = {
    **dict.fromkeys(POLAR, pl.Float64),
    **dict.fromkeys(("damping", "damping_low", "damping_high"), pl.Float64),
    "interval_method": pl.String,
    **dict.fromkeys(("magnitude_amplitudes_low", "magnitude_amplitudes_high"), pl.Float64),
    **dict.fromkeys(("phase_deg_amplitudes_low", "phase_deg_amplitudes_high"), pl.Float64),
    "doubtful": pl.String,
}
"""The other columns of `frequency_response.csv`."""
RESPONSE_COLUMNS: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "method": pl.String, "realisations": pl.Int64,
    **dict.fromkeys(("frequency_hz", "magnitude", "phase_deg"),
    pl.Float64),
    **dict.fromkeys(("noise_sd", "total_sd", "noise_level", "odd_level", "even_level",
    "total_level"), pl.Float64),
    **dict.fromkeys(("magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9"),
    pl.Float64),
}  # fmt: skip
"""Columns of `response.csv`."""
LINE_ROUNDING = 1e-9  # of a line's number: the cut-off times the period may lie this much below it


def frequency_response_table(phasors: pl.DataFrame) -> pl.DataFrame:
    """Average Y over the amplitudes, one row per trial and frequency.

    Parameters
    ----------
    phasors : pl.DataFrame
        Rows of `phasors.csv` of one or several trials, with the causes of their doubt.

    Returns
    -------
    pl.DataFrame
        Magnitude [rad/(N*m)] and phase [deg] of the complex mean with 95 % intervals, the damping,
        and the extremes over the amplitudes; their phases are relative to the mean's, so that none
        jumps at 180 degrees. The intervals contain the noise of the phasors and the error of the
        bench, not how much Y depends on the amplitude. `doubtful` lists causes of doubt.
    """
    keys = list(OF_TRIAL)
    if len(phasors):
        keys = [key for key in OF_TRIAL if key in phasors.columns]
    amplitudes_of: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in phasors.iter_rows(named=True):
        amplitudes_of.setdefault(tuple(row[key] for key in keys), []).append(row)
    rows = []
    for values, amplitudes in amplitudes_of.items():
        of_trial = dict(zip(keys, values, strict=True))
        rows.append({**of_trial, **mean_over_amplitudes(amplitudes)})
    schema: dict[str, Any] = {key: phasors.schema.get(key, OF_TRIAL[key]) for key in keys}
    return pl.DataFrame(rows, schema=schema | MEAN_OVER_AMPLITUDES)


def mean_over_amplitudes(rows: Sequence[Mapping[str, Any]]) -> Row:
    """The columns `MEAN_OVER_AMPLITUDES` of one trial and frequency, of a row per amplitude."""
    # which a table has no column of where none is stated
    compliance, gain, phase = (max(row.get(name) or 0.0 for row in rows) for name in SHARED)
    bench_error = BenchError(compliance, gain, phase)
    # all amplitudes share the bench's error: averaging does not lessen it
    responses = [bench_error.taken_off(admittance_of_row(row)) for row in rows]
    mean = bench_error.added_to(complex_mean(responses))
    sizes = [response.magnitude for response in responses]
    phases_deg = [
        float(np.rad2deg(mean.phase + np.angle(response.value / mean.value)))
        for response in responses
    ]
    doubts = dict.fromkeys(row["doubtful"] for row in rows)
    return {
        **polar_row(mean),
        **damping_row(mean, rows[0]["frequency_hz"]),
        "interval_method": " and ".join(sorted({row["interval_method"] for row in rows})),
        "magnitude_amplitudes_low": min(sizes),
        "magnitude_amplitudes_high": max(sizes),
        "phase_deg_amplitudes_low": min(phases_deg),
        "phase_deg_amplitudes_high": max(phases_deg),
        "doubtful": "; ".join(doubt for doubt in doubts if doubt),
    }


def admittance_of_row(row: Mapping[str, Any]) -> ComplexEstimate:
    """Y of a row of `phasors.csv`, with the error of the bench in its covariance."""
    covariance = np.array([[row["Y_var_re"], row["Y_cov"]], [row["Y_cov"], row["Y_var_im"]]])
    value = complex(row["Y_re"], row["Y_im"])
    return ComplexEstimate(value, covariance, row["Y_degrees_of_freedom"])


def damping_row(Y: ComplexEstimate, frequency_hz: float) -> Row:
    """The damping of a response, `damping` [N*m*s/rad], with its 95 % interval to first order.

    It is the real part of the impedance torque/velocity, Re(Z/(j w)) = Im(Z)/w with Z = 1/Y. It is
    positive if the joint takes in energy at this frequency.
    """
    w = 2 * np.pi * frequency_hz
    Z = 1 / Y.value
    slope = -(Z**2)  # dZ = slope dY
    # d Im(Z) = Im(slope) dRe(Y) + Re(slope) dIm(Y)
    gradient = np.array([slope.imag, slope.real]) / w
    half = float(Y.quantile * np.sqrt(Y.variance_along(gradient)))
    damping = Z.imag / w
    return {"damping": damping, "damping_low": damping - half, "damping_high": damping + half}


@dataclass(frozen=True)
class MeasuredResponse:
    """The impedance of a trial at the lines of its spectrum."""

    method: str  # "robust", "fast" or "local polynomial" (spectral/response.py)
    realisations: int  # of a periodic motion; 1 of any other
    columns: ResponseColumns


def impedance_over_frequency(
    record: Record, fit: GroupFit | None = None, expected: Admittance | None = None
) -> pl.DataFrame:
    """Compute the trial's rows of `response.csv`.

    Parameters
    ----------
    record : Record
        A recording of the bench.
    fit : GroupFit, optional
        The fit of K, B and I, whose Eq. 15 stands beside the response.
    expected : Admittance, optional
        The response expected from the gains (Eq. 9), which stands there, too.

    Returns
    -------
    pl.DataFrame
        A row per line of the unfiltered signals: of the periods up to the filter's cut-off, else of
        the longest stretch. No rows for a stepped sine, whose response is in `phasors.csv`; none
        for a motion without a response, of which a warning gives the reason.
    """
    if record.is_stepped_sine:
        return pl.DataFrame(schema=RESPONSE_COLUMNS)
    try:
        measured = measured_response(record)
    except InputError as error:
        warnings.warn(f"trial {record.name}: no frequency response: {error}", stacklevel=2)
        return pl.DataFrame(schema=RESPONSE_COLUMNS)
    s = np.asarray(2j * np.pi * measured.columns["frequency_hz"], dtype=np.complex128)
    models: dict[str, object] = {}
    if fit is not None:
        models |= polar_columns("eq15", fit["K"] + fit["B"] * s + fit["I"] * s**2)
    if expected is not None:
        models |= polar_columns("eq9", 1 / expected(s))
    columns: dict[str, object] = {
        **dict.fromkeys(RESPONSE_COLUMNS),
        **measured.columns,
        **models,
        "trial": record.name,
        "method": measured.method,
        "realisations": measured.realisations,
    }
    return pl.DataFrame(columns, schema=RESPONSE_COLUMNS).fill_nan(None)


def measured_response(record: Record) -> MeasuredResponse:
    """The response of a record, of its periods where it has some. Raises InputError: none."""
    periodic = record.periodic
    if periodic is None:
        longest = max(record.pieces, key=lambda piece: piece.stop - piece.start)
        spectrum = record_spectrum(
            record.theta[longest],
            record.torque[longest],
            record.rate_hz,
            record.low_pass.cutoff_hz,
        )
        return MeasuredResponse("local polynomial", 1, local_response(spectrum))
    last_line = int(np.floor(record.low_pass.cutoff_hz * periodic.period + LINE_ROUNDING))
    realisations = [
        replace(realisation, spectra=realisation.spectra[..., : last_line + 1])
        for realisation in periodic.realisations
    ]
    count = len(distinct(realisations))
    method = "robust" if count > 1 else "fast"
    return MeasuredResponse(method, count, periodic_response(realisations))


def polar_columns(model: str, Z: NDArray[np.complex128]) -> dict[str, Array]:
    """Magnitude and phase of the impedance (m,) that a model predicts."""
    return {f"magnitude_{model}": np.abs(Z), f"phase_deg_{model}": np.rad2deg(np.angle(Z))}
