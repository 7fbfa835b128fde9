# SPDX-License-Identifier: Apache-2.0
"""A table of dead weights at a load cell: what to state of it in source file and configuration."""

from pathlib import Path

import numpy as np

from osl_analysis import formats
from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.recording import Channel, Recording
from osl_analysis.base.trial import Array
from osl_analysis.base.units import in_si, normalised
from osl_analysis.bench.dead_weights import CellGain, gain_of_weights
from osl_analysis.stats.rounding import significant

METRE, KILOGRAM = "m", "kilogram"  # as `in_si` names them


def gain_in_table(
    table: Path, arm_error: str = "0 mm", mass_error: str = "0 g", gravity: float | None = None
) -> CellGain:
    """Fit the gain of a load cell to the rows of a table.

    Parameters
    ----------
    table
        A text or workbook with the columns `arm`, `mass` and `counts`, the first two with their
        units, as `arm [mm]`.
    arm_error, mass_error
        Standard uncertainties with their units.
    gravity
        [m/s^2] of the place, where it is known.

    Raises
    ------
    InputError
        A column or a unit is missing, or the rows tell no gain.
    """
    recording = formats.read(table)
    with naming(table):
        return gain_of_weights(
            arm=column_in(recording, "arm", METRE),
            mass=column_in(recording, "mass", KILOGRAM),
            counts=np.asarray(named_channel(recording, "counts").values, float),
            arm_error=size_in(arm_error, METRE),
            mass_error=size_in(mass_error, KILOGRAM),
            gravity=gravity,
        )


def named_channel(recording: Recording, name: str) -> Channel:
    """The column of a table that is called so in any case."""
    named = [channel for channel in recording.channels if channel.name.casefold() == name]
    if len(named) != 1:
        names = ", ".join(channel.name for channel in recording.channels)
        raise InputError(
            f"has {len(named)} columns '{name}' (it has {names})",
            "head its columns `arm [mm]`, `mass [g]` and `counts`",
        )
    return named[0]


def column_in(recording: Recording, name: str, si_unit: str) -> Array:
    """A column (rows,) in its SI unit."""
    channel = named_channel(recording, name)
    with naming(f"column '{name}'"):
        return np.asarray(channel.values, float) * factor_to(channel.unit, si_unit)


def size_in(text: str, si_unit: str) -> float:
    """A number with its unit, as `0.5 mm`, in the SI unit."""
    number, _, unit = text.strip().partition(" ")
    try:
        return abs(float(number)) * factor_to(unit, si_unit)
    except ValueError:
        raise InputError(f"'{text}' is no number with a unit", "write it as `0.5 mm`") from None


def factor_to(unit: str, si_unit: str) -> float:
    factor, measured = in_si(normalised(unit))
    if measured != si_unit:
        quantity, example = ("length", "mm") if si_unit == METRE else ("mass", "g")
        raise InputError(f"'{unit}' is no unit of {quantity}", f"state one, such as {example}")
    return factor


def gain_text(gain: CellGain) -> str:
    """What a table of dead weights tells, and where it is stated."""
    shares = [
        f"{name} {significant(100 * share)} %" for name, share in gain.shares.items() if share
    ]
    sign = ", sign: -1" if gain.scale < 0 else ""
    return "\n".join(
        [
            f"scale {significant(abs(gain.scale), 7)} N*m per count, within"
            f" {significant(100 * gain.gain_error)} % (standard uncertainty: {', '.join(shares)})",
            f"zero {gain.zero:.6g} counts, within {significant(gain.zero_error)}",
            f"the rows lie about the line by {significant(gain.scatter_torque)} N*m (RMS)",
            "",
            "in the source file, beside the channel of the torque:",
            f"  torque: {{..., unit: N*m{sign}, scale: {significant(abs(gain.scale), 7)}, offset:"
            f" {-gain.zero:.7g}}}",
            "in config.yaml, which puts it into the interval of each K:",
            f"  dynamometer: {{calibration: {{torque_gain: {significant(gain.gain_error)}}}}}",
        ]
    )
