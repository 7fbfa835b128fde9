"""Frequency response of a trial as tables: the response, the structures fitted to it, and the lines of its periods."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.bench.record import Record
from osl_analysis.bench.settings import Calibration
from osl_analysis.errors import OslAnalysisError
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import LINES, Realisation, Spectrum, distinct, lines_frame
from osl_analysis.spectral.response import (
    FittedLines,
    RationalDrivetrain,
    ResponseColumns,
    SecondOrder,
    Structure,
    fit_structure,
    lines_of_periods,
    lines_of_record,
    local_response,
    periodic_response,
    record_spectrum,
)
from osl_analysis.stats.regression import Row, estimates_row, with_shared_error

# columns of the two tables
RESPONSE_COLUMNS: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "method": pl.String, "realisations": pl.Int64,
    **dict.fromkeys(("frequency_hz", "angle_deg", "Z_re", "Z_im", "magnitude", "phase_deg"), pl.Float64),
    **dict.fromkeys(("noise_sd", "total_sd", "noise_level", "odd_level", "even_level", "total_level"), pl.Float64),
    **dict.fromkeys(("magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9"), pl.Float64),
}  # fmt: skip
ESTIMATED = tuple(f"{name}{end}" for name in ("K", "B", "I", "K_1", "B_1") for end in ("", "_se", "_low", "_high"))
BAND = ("torque", "noise", "odd", "even", "detection", "distortion")
MODELS: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "model": pl.String, "method": pl.String, "weights": pl.String, "interval_method": pl.String,
    **dict.fromkeys(("parameters", "realisations", "periods", "lines"), pl.Int64),
    **dict.fromkeys(("period_s", "period_error_ppm", "lowest_hz", "highest_hz", *ESTIMATED), pl.Float64),
    **dict.fromkeys(("VAF", "misfit", "misfit_ratio", "misfit_p", *(f"{name}_level" for name in BAND)), pl.Float64),
    "excluded": pl.String,
}  # fmt: skip


def response_tables(record: Record, p: DrivetrainParameters | None, reflexive: bool = False) -> dict[str, pl.DataFrame]:
    """Rows of `response.csv` and `response_models.csv` of one trial, and the lines of its periods; Eq. 9 where the
    device has parameters. None of a stepped sine, whose response is in `phasors.csv`. The lines are of unfiltered
    signals: of the periods up to the filter's cut-off, else of the longest stretch. What cannot be fitted has a row
    with the reason; of a `reflexive` joint, whose response contains the reflex, no structure is fitted."""
    schemas = {"response": RESPONSE_COLUMNS, "response_models": MODELS, "response_lines": LINES}
    nothing = {name: pl.DataFrame(schema=schema) for name, schema in schemas.items()}
    if record.is_stepped_sine:
        return nothing
    try:
        found = record.periodic
        if found is not None:
            band = slice(int(np.floor(record.low_pass.cutoff_hz * found.period + 1e-9)) + 1)
            steps = record.steps
            realisations = [replace(one, spectra=one.spectra[..., band], steps=steps) for one in found.realisations]
            of = record.low_pass, p, record.calibration, found.period_error_ppm
            tables = periodic_tables(record.name, realisations, *of)
        else:
            longest = max(record.pieces, key=lambda piece: piece.stop - piece.start)
            signals = record.theta[longest], record.torque[longest]
            spectrum = record_spectrum(*signals, record.rate_hz, record.low_pass.cutoff_hz)
            facts: Row = {"method": "local polynomial", "realisations": 1}
            lines = lines_of_record(spectrum, record.low_pass)
            tables = frames_of(record.name, local_response(spectrum), lines, p, facts, record.calibration)
        if not reflexive:
            return nothing | tables
        curves = (pl.lit(None, pl.Float64).alias(name) for name in RESPONSE_COLUMNS if "_eq" in name)
        nothing["response"], reason = tables["response"].with_columns(curves), "a person's reflex is in the response"
    except OslAnalysisError as error:
        reason = str(error)
    row = {"trial": record.name, "model": SecondOrder.name, "excluded": reason}
    return nothing | {"response_models": pl.DataFrame([row], schema=MODELS)}


def periodic_tables(
    trial: str,
    realisations: Sequence[Realisation],
    low_pass: LowPass,
    p: DrivetrainParameters | None,
    stated: Calibration,
    period_error_ppm: float | None = None,
) -> dict[str, pl.DataFrame]:
    """The tables of the realisations of a periodic motion, in one trial or in several; raises as `lines_of`."""
    response, band = periodic_response(realisations)
    count = len(distinct(realisations))
    facts: Row = {
        "method": "robust" if count > 1 else "fast",
        "realisations": count,
        "periods": sum(r.periods for r in realisations),
        "period_s": realisations[0].period,
        "period_error_ppm": period_error_ppm,
        **{f"{name}_level": level for name, level in band.items()},
    }
    frames = frames_of(trial, response, lines_of_periods(realisations, low_pass), p, facts, stated)
    return {**frames, "response_lines": lines_frame(trial, realisations)}


def calibration_errors(lines: FittedLines, stated: Calibration) -> list[Spectrum]:
    """The torque (n, m) [N*m] with one standard uncertainty more, each: gains, hysteresis, delay; none is stated: none.
    That of the angle's gain is as one of the torque's."""
    gain, turn = stated.polar(0.0)
    errors = (gain, -1j * turn, -lines.s * stated.delay)
    return [np.asarray(lines.torque * (1 + error)) for error in errors if np.any(error)]


def frames_of(
    trial: str,
    response: ResponseColumns,
    lines: FittedLines,
    p: DrivetrainParameters | None,
    facts: Row,
    stated: Calibration,
) -> dict[str, pl.DataFrame]:
    """A row per frequency, with the curves of the structures fitted to the lines; and a row per structure: parameters,
    misfit beyond the noise, its test, and the `facts`."""
    frequency = response["frequency_hz"]
    columns: dict[str, object] = {**dict.fromkeys(RESPONSE_COLUMNS), "trial": trial, **response}
    columns |= {name: facts[name] for name in ("method", "realisations")}
    shared: Row = {"trial": trial, "lines": len(frequency), **facts}
    shared |= {"lowest_hz": float(frequency[0]), "highest_hz": float(frequency[-1])}
    rows, first = list[Row](), (0.0, 0.0)
    structures: list[Structure] = [SecondOrder()] if p is None else [SecondOrder(), RationalDrivetrain(p)]
    for structure in structures:
        row: Row = {**shared, "model": structure.name}
        try:
            fit, found = fit_structure(structure, lines, first)
            for late in calibration_errors(lines, stated):
                other = fit_structure(structure, replace(lines, torque=late), first)[0]
                fit = with_shared_error(fit, other.estimates - fit.estimates)
        except OslAnalysisError as error:
            rows.append(row | {"excluded": str(error)})
            continue
        if isinstance(structure, SecondOrder):
            first = (fit["K"], fit["B"])
        s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)
        curve = structure.impedance(fit.estimates[: len(structure.parameters)], s)
        short = "eq15" if isinstance(structure, SecondOrder) else "eq9"
        columns |= {f"magnitude_{short}": np.abs(curve), f"phase_deg_{short}": np.rad2deg(np.angle(curve))}
        row |= {"interval_method": fit.interval_method, "parameters": len(structure.parameters)}
        rows.append({**row, **estimates_row(fit, *structure.parameters), **found})
    return {
        "response": pl.DataFrame(columns, schema=RESPONSE_COLUMNS).fill_nan(None),
        "response_models": pl.DataFrame(rows, schema=MODELS).fill_nan(None),
    }
