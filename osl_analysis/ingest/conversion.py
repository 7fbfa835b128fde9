"""Recorded numbers as SI units, and what the provenance of a trial says of the conversion."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.source_file import Conversion
from osl_analysis.trial import unit_of
from osl_analysis.units import quantity, si_factor

# facts on a sensor, which the provenance has in SI units
OF_SENSOR = {"delay", "low_pass", "resolution", "bits", "range"}


def to_si(
    conversion: Conversion, raw: NDArray[Any], si_unit: str, unit_of_file: str = ""
) -> NDArray[np.float64]:
    """Convert recorded numbers, of any shape, to the SI unit.

    `unit_of_file` counts if the source file states no unit.
    """
    unit = unit_of_file if conversion.unit is None else conversion.unit
    factor = si_factor(unit, si_unit)
    gain = conversion.sign * conversion.scale * factor
    with np.errstate(over="ignore"):  # infinite values are refused later, by name
        return np.asarray(gain * (raw + conversion.offset))


def origin_of(conversion: Conversion, column: str, unit_of_file: str = "") -> dict[str, Any]:
    """Say where a canonical column comes from, for the trial's provenance.

    Returns
    -------
    dict
        The address and conversion, and the stated facts on the sensor in SI units. `range` is that
        of the column, after `sign` and `offset`.
    """
    si_unit = unit_of(column)
    unit = unit_of_file if conversion.unit is None else conversion.unit
    origin = conversion.model_dump(exclude=OF_SENSOR)
    origin["unit"] = unit
    origin["factor"] = si_factor(unit, si_unit)
    origin["si_unit"] = si_unit
    if conversion.delay is not None:
        origin["delay"] = quantity(conversion.delay, "s")
    if conversion.low_pass is not None:
        cutoff_hz = quantity(conversion.low_pass.cutoff, "Hz")
        origin["low_pass"] = {"cutoff_hz": cutoff_hz, "order": conversion.low_pass.order}
    if conversion.resolution is not None or conversion.bits is not None:
        origin["resolution"] = conversion.step(si_unit)
    if conversion.range is not None:
        offset = conversion.scale * origin["factor"] * conversion.offset
        ends = [conversion.sign * (end + offset) for end in conversion.ends(si_unit)]
        origin["range"] = sorted(ends)
    return origin
