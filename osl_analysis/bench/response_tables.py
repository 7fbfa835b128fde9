"""Frequency response of a trial as tables: the response, the structures fitted to it, and the lines of its periods."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.bench.record import Record
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import OslAnalysisError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.models import (
    EQ_9,
    EQ_15,
    FittedLines,
    FittedStructure,
    RationalDrivetrain,
    SecondOrder,
    Structure,
    fit_structure,
    lines_of_periods,
    lines_of_record,
)
from osl_analysis.spectral.realisations import LINES, Realisation, distinct, lines_frame
from osl_analysis.spectral.response import (
    FrequencyResponse,
    local_response,
    periodic_response,
    record_spectrum,
)
from osl_analysis.stats.fit_row import Row, estimates_row

STRUCTURES = (EQ_15, EQ_9)
LEVELS = ("noise_level", "odd_level", "even_level", "total_level")
CURVES = tuple(f"{part}_{name}" for name in ("eq15", "eq9") for part in ("magnitude", "phase_deg"))
RESPONSE: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "method": pl.String, "realisations": pl.Int64,
    **dict.fromkeys(("frequency_hz", "angle_deg", "Z_re", "Z_im", "magnitude", "phase_deg"), pl.Float64),
    **dict.fromkeys(("noise_sd", "total_sd", *LEVELS, *CURVES), pl.Float64),
}  # fmt: skip
"""Columns of `response.csv`."""
ESTIMATED = tuple(f"{name}{end}" for name in ("K", "B", "I", "K_1", "B_1") for end in ("", "_se", "_low", "_high"))
BAND = ("torque", "noise", "odd", "even", "detection", "distortion")
MODELS: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "model": pl.String, "method": pl.String, "weights": pl.String, "interval_method": pl.String,
    **dict.fromkeys(("parameters", "realisations", "periods", "lines"), pl.Int64),
    **dict.fromkeys(("period_s", "period_error_ppm", "lowest_hz", "highest_hz", *ESTIMATED), pl.Float64),
    **dict.fromkeys(("VAF", "misfit", "misfit_ratio", "misfit_p", *(f"{name}_level" for name in BAND)), pl.Float64),
    "excluded": pl.String,
}  # fmt: skip
"""Columns of `response_models.csv`."""


@dataclass(frozen=True)
class ResponseTables:
    """Rows of `response.csv` and `response_models.csv`, and the lines of the periods."""

    response: pl.DataFrame
    models: pl.DataFrame
    lines: pl.DataFrame

    def frames(self) -> Mapping[str, pl.DataFrame]:
        """The frames by name of the table."""
        return {"response": self.response, "response_models": self.models, "response_lines": self.lines}


NO_RESPONSE = ResponseTables(*(pl.DataFrame(schema=schema) for schema in (RESPONSE, MODELS, LINES)))


def response_tables(record: Record, p: DrivetrainParameters | None) -> ResponseTables:
    """The tables of one trial; Eq. 9 where the device has parameters. None of a stepped sine, whose response is in
    `phasors.csv`. The lines are of the signals before the filter: of the periods of the motion, up to its cut-off, else
    of the longest stretch. A structure that cannot be fitted has a row with the reason, and so has a trial without a
    frequency response."""
    if record.is_stepped_sine:
        return NO_RESPONSE
    try:
        found = record.periodic
        if found is not None:
            band = slice(int(np.floor(record.low_pass.cutoff_hz * found.period + 1e-9)) + 1)
            realisations = [
                replace(one, theta=one.theta[:, band], torque=one.torque[:, band], steps=record.steps)
                for one in found.realisations
            ]
            return periodic_tables(record.name, realisations, record.low_pass, p, found.period_error_ppm)
        longest = max(record.pieces, key=lambda piece: piece.stop - piece.start)
        signals = record.theta[longest], record.torque[longest]
        spectrum = record_spectrum(*signals, record.rate_hz, record.low_pass.cutoff_hz)
        response = local_response(spectrum)
    except OslAnalysisError as error:
        reason = {"trial": record.name, "model": EQ_15, "excluded": str(error)}
        return replace(NO_RESPONSE, models=pl.DataFrame([reason], schema=MODELS))
    structures = fitted_structures(lines_of_record(spectrum, record.low_pass), p)
    return ResponseTables(
        response_frame(record.name, response, structures, 1),
        models_frame(record.name, response, structures, {"realisations": 1}),
        NO_RESPONSE.lines,
    )


def periodic_tables(
    trial: str,
    realisations: Sequence[Realisation],
    low_pass: LowPass,
    p: DrivetrainParameters | None,
    period_error_ppm: float | None = None,
) -> ResponseTables:
    """The tables of the realisations of a periodic motion, in one trial or in several.

    Raises InputError: As `lines_of`.
    """
    response, levels = periodic_response(realisations)
    found = fitted_structures(lines_of_periods(realisations, low_pass), p)
    count = len(distinct(realisations))
    facts: Row = {
        "realisations": count,
        "periods": sum(r.periods for r in realisations),
        "period_s": realisations[0].period,
        "period_error_ppm": period_error_ppm,
        **{f"{name}_level": getattr(levels, name) for name in BAND},
    }
    return ResponseTables(
        response_frame(trial, response, found, count),
        models_frame(trial, response, found, facts),
        lines_frame(trial, realisations),
    )


Fitted = Mapping[str, FittedStructure | OslAnalysisError]


def fitted_structures(lines: FittedLines, p: DrivetrainParameters | None) -> Fitted:
    """Eq. 15 and, with parameters, Eq. 9 fitted to lines, or why one cannot be."""
    found: dict[str, FittedStructure | OslAnalysisError] = {}
    first = (0.0, 0.0)
    structures: list[Structure] = [SecondOrder()] if p is None else [SecondOrder(), RationalDrivetrain(p)]
    for structure in structures:
        try:
            one = fit_structure(structure, lines, first)
        except OslAnalysisError as error:
            found[structure.name] = error
            continue
        found[structure.name] = one
        if structure.name == EQ_15:
            first = (one.fit["K"], one.fit["B"])
    return found


def response_frame(trial: str, response: FrequencyResponse, found: Fitted, realisations: int) -> pl.DataFrame:
    """A row per frequency, with the curves of the structures."""
    Z = response.impedance
    columns: dict[str, object] = {
        "trial": trial,
        "method": response.method,
        "realisations": realisations,
        "frequency_hz": response.frequency_hz,
        "angle_deg": np.rad2deg(response.angle),
        "Z_re": Z.real,
        "Z_im": Z.imag,
        "magnitude": np.abs(Z),
        "phase_deg": np.rad2deg(np.angle(Z)),
        "noise_sd": response.noise_sd,
        "total_sd": response.total_sd,
        **{name: getattr(response, name) for name in LEVELS},
    }
    for name, short in zip(STRUCTURES, ("eq15", "eq9"), strict=True):
        one = found.get(name)
        curve = one.impedance(response.frequency_hz) if isinstance(one, FittedStructure) else None
        columns[f"magnitude_{short}"] = None if curve is None else np.abs(curve)
        columns[f"phase_deg_{short}"] = None if curve is None else np.rad2deg(np.angle(curve))
    return pl.DataFrame(columns, schema=RESPONSE).fill_nan(None)


def models_frame(trial: str, response: FrequencyResponse, found: Fitted, facts: Row) -> pl.DataFrame:
    """A row per structure: parameters, misfit beyond the noise, its test, and the levels of the band."""
    shared: Row = {
        "trial": trial,
        "method": response.method,
        "lines": len(response.frequency_hz),
        "lowest_hz": float(response.frequency_hz[0]),
        "highest_hz": float(response.frequency_hz[-1]),
        **facts,
    }
    rows = [
        {**shared, "model": name, **(model_row(one) if isinstance(one, FittedStructure) else {"excluded": str(one)})}
        for name, one in found.items()
    ]
    return pl.DataFrame(rows, schema=MODELS).fill_nan(None)


def model_row(one: FittedStructure) -> Row:
    """The columns of one fitted structure."""
    names = one.structure.parameters
    return {
        "weights": one.weights,
        "interval_method": one.fit.interval_method,
        "parameters": len(names),
        **estimates_row(one.fit, *names),
        "VAF": one.vaf,
        "misfit": one.misfit,
        "misfit_ratio": one.ratio,
        "misfit_p": one.p,
    }
