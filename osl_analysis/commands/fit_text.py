"""The estimates of a fitted trial as text, for the command line and notebooks."""

import json
from collections.abc import Mapping
from typing import Any

import polars as pl

from osl_analysis.table import finite_or_null

UNITS = {
    "K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²", "K_s": "N·m/rad", "B_j": "N·m·s/rad", "J_j": "kg·m²",
    "T_C": "N·m", "k_tau_n_m": "N·m/A", "f_C": "N·m", "f_G": "N·m/A", "B_m": "N·m·s/rad", "J_m": "kg·m²",
    "offset": "N·m", "drift": "N·m/s", "K_secant": "N·m/rad", "K_unloading": "N·m/rad", "energy_stored": "J",
    "energy_returned": "J", "energy_lost": "J",
}  # fmt: skip


def estimates_json(estimates: pl.DataFrame) -> str:
    """The estimates as JSON in SI units: an object per fit, null for what is not finite."""
    return json.dumps([finite_or_null(row) for row in estimates.to_dicts()], indent=2)


def estimates_text(estimates: pl.DataFrame) -> str:
    """The estimates as text: a line per fit and quantity, with 95 % interval and VAF."""
    lines = []
    for row in estimates.to_dicts():
        amplitude = row.get("amplitude_deg")
        which = motion_text(row) if amplitude is None else f"{amplitude:g} deg"
        which = f"mean of cycles: {row['cycles']}" if "cycles" in row else which
        quality = f"VAF {row['VAF']:.2f} %"
        if "R2" in row:
            quality += f", R2 {row['R2']:.5f}, condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {which}: {quality}")
        for name in estimated(row):
            high = row[f"{name}_high"]
            half = f"± {high - row[name]:<10.2g}" if high is not None else f"{'':<12}"
            lines.append(f"  {name:<15}{row[name]:>12.5g} {half} {UNITS[name]}{amplitudes_text(row, name)}")
        if row.get("doubtful"):
            lines.append(f"  doubtful: {row['doubtful']}")
    return "\n".join(
        [*lines, "± is the half-width of the 95 % interval of noise, by the method that interval_method names"]
    )


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities that a fit estimates. A belt that moves at a constant velocity has no B_j."""
    return [name for name in UNITS if f"{name}_se" in row and row[name] is not None]


def motion_text(row: Mapping[str, Any]) -> str:
    """What a fit without an amplitude is a fit to."""
    excitation = row.get("excitation")
    if excitation in (None, "stepped sine"):
        return "all amplitudes"
    band = f"{row['band_low_hz']:.3g} to {row['band_high_hz']:.3g} Hz, {row['theta_rms_deg']:.2g} deg RMS"
    return f"{row['fitted_s']:.1f} s of {'periodic' if excitation == 'periodic' else 'any'} motion, {band}"


def amplitudes_text(row: Mapping[str, Any], name: str) -> str:
    """The lowest and the highest estimate of a single amplitude, if the row has them."""
    low, high = row.get(f"{name}_amplitudes_low"), row.get(f"{name}_amplitudes_high")
    return "" if low is None or high is None else f", single amplitudes {low:.5g} to {high:.5g}"
