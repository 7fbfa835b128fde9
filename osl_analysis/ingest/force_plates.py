# SPDX-License-Identifier: Apache-2.0
"""Convert force plates of any format to force and moment on the foot, about the surface's centre.

No centre of pressure is computed, so that the columns are valid for an unloaded plate, too
(C3D manual, Kistler). Corners (4, 3) [m] go round the edge; the first lies in the quadrant +x, +y
of the plate's own axes, as in C3D files.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError, naming, printable
from osl_analysis.base.recording import EXPORTED, MEASURED_BY_TYPE, Plate
from osl_analysis.base.source_file import PlateUnits, Source
from osl_analysis.base.trial import Array, plate_columns
from osl_analysis.base.units import in_si, normalised, si_factor
from osl_analysis.ingest.conversion import Converted, check_finite_values
from osl_analysis.signals.filters import longest_of
from osl_analysis.signals.plateaus import repeats, run_at_extreme

VOLT = "V"


@dataclass(frozen=True)
class UsedPlate:
    """From which change of its force a plate was stepped on."""

    force_N: float = 50.0  # [N]; a force that changes by less is of no foot
    share: float = 0.2  # of its range: where a force changes by this, every channel should


USED_PLATE = UsedPlate()


def convert_plates(
    plates: Sequence[Plate],
    source: Any,
    unloaded: slice | None = None,
    rate_hz: float | None = None,
) -> Converted:
    """Convert what the channels of plates recorded.

    Parameters
    ----------
    source
        Where there are plates it has axes; its `point_unit` and `plate_units` replace the units of
        the file.
    unloaded
        Samples of the baseline that is taken off; None: none is.
    rate_hz
        Of the samples; that of the channels' rows if None.

    Raises
    ------
    InputError
        A parameter or a unit of a plate is wrong, or a sample is not finite.
    """
    length_of_all = getattr(source, "point_unit", None)
    units: PlateUnits | None = getattr(source, "plate_units", None)
    columns: dict[str, Array] = {}
    origins = {}
    facts = []
    for plate in plates:
        with naming(f"plate {plate.number}", " (or name the others alone under `plates`)"):
            length = length_of_all or plate.length_unit
            metre = metres_per(length, source)
            corners = plate.corners * metre
            if not np.isfinite(force_axes(corners)).all():
                raise InputError("its corners span no plane", "correct them")
            raw = np.column_stack([channel.values for channel in plate.channels]).astype(float)
            rate = rate_hz or plate.channels[0].rows.rate_hz or 1.0
            for channel, values in zip(plate.channels, raw.T, strict=True):
                time = np.arange(values.size) / rate
                check_finite_values(f"channel '{channel.key}'", values, time)
            readings = raw
            if unloaded is not None:
                baseline = raw[unloaded].mean(axis=0)
                if plate.type == 1:
                    baseline[3:5] = 0.0  # an unloaded plate has no centre of pressure
                readings = raw - baseline
            readings = readings @ to_newtons(plate, units, length)
            force, moment = wrench(plate.type, corners, plate.origin * metre, readings)

        names = plate_columns(plate.number)
        turned = np.hstack([force @ source.rotation.T, moment @ source.rotation.T])
        columns.update(zip(names, plate.sign * turned.T, strict=True))
        origins.update({column: {"plate": plate.number, **plate.facts} for column in names})
        facts.append(
            {
                "plate": plate.number,
                "type": plate.type,
                "corners": (corners @ source.rotation.T).tolist(),
                "channels": channel_facts(plate, raw, np.linalg.norm(force, axis=1), rate),
            }
        )
    return Converted(pl.DataFrame(columns), origins, {"plates": facts})


def to_newtons(plate: Plate, units: PlateUnits | None, length: str) -> Array:
    """Matrix (channels, quantities) by which the readings of a plate become N, N*m and m."""
    stated_units = {"N": units.force, "N*m": units.moment, "m": units.length} if units else {}
    calibrated = {"N": "N", "N*m": f"N*{length}"} if plate.calibration is not None else {}
    about_lengths = ", length: mm" if plate.type == 1 else ""
    remedy = (
        "; or state the units that hold for all plates, as in"
        f" `plate_units: {{force: N, moment: N*mm{about_lengths}}}`, in the source file"
    )
    if in_si(normalised(plate.channels[0].unit))[1] == VOLT:
        remedy += ", or for channels in V the `calibration` of type 4 or 5 under `plate_geometry`"
    factors = []
    for channel, quantity in zip(plate.channels, MEASURED_BY_TYPE[plate.type], strict=False):
        unit = stated_units.get(quantity) or calibrated.get(quantity) or channel.unit
        with naming(f"analog channel '{channel.key}'", remedy):
            factors.append(si_factor(unit, quantity))
    mixing = np.eye(len(factors)) if plate.calibration is None else plate.calibration.T
    return mixing * factors


def wrench(kind: int, corners: Array, origin: Array, channels: Array) -> tuple[Array, Array]:
    """Compute force and moment of one plate about its surface's centre, on the foot.

    Parameters
    ----------
    kind
        1 to 4, as in the C3D manual; 0 for force and moment in the laboratory's axes.
    corners
        Shape (4, 3) [m], in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of the plate's
        axes, whose z points down, with a negative Fz under load.
    origin
        FORCE_PLATFORM:ORIGIN, shape (3,) [m].
    channels
        Shape (n, channels), in N, N*m and m; of type 4 calibrated. An exported moment is about the
        point of the channels 7 to 9, or else about the origin.

    Returns
    -------
    force, moment
        Shape (n, 3) each [N], [N*m], in the laboratory's axes.
    """
    force = channels[:, :3]
    moment = channels[:, 3:6]  # or the centre of pressure, by kind
    if kind == EXPORTED:
        about = channels[:, 6:] if has_point(channels) else origin
        return force, moment + np.cross(about - np.mean(corners, axis=0), force)
    axes = force_axes(corners)
    # from the plate's origin to the surface's centre: the origin lies under the surface and z
    # points down, so z is negative; a file with a positive z stores the opposite vector
    centre = -origin if origin[2] > 0 else origin
    if kind == 3:
        # Kistler's four sensors, at distances a and b, in a depth that files write with either sign
        a = origin[0]
        b = origin[1]
        x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
        force = np.column_stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
        about_z = b * (-x12 + x34) + a * (y14 - y23)
        moment = np.column_stack([b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4), about_z])
        centre = np.array([0.0, 0.0, -abs(origin[2])])
    elif kind == 1:
        # centre of pressure x and y, free moment: M = p x F + (0, 0, T)
        moment = np.cross(moment * (1, 1, 0), force) + moment * (0, 0, 1)
    return force @ axes.T, (moment - np.cross(centre, force)) @ axes.T


def channel_facts(plate: Plate, raw: Array, load: Array, rate_hz: float) -> list[dict[str, Any]]:
    """Tell of each channel of a plate its longest run at an extreme (`clipped_...`) and of one
    value while the force changes (`stands_...`): the rotation hides them.

    Parameters
    ----------
    raw
        Shape (samples, channels). Of nine the last three are a point, and no moment about a centre
        of pressure moves by definition.
    load
        Size of the force (samples,) [N].
    """
    least = max(USED_PLATE.share * np.ptp(load), USED_PLATE.force_N)
    judged = plate.channels[:3] if has_point(raw) else plate.channels
    facts = []
    for channel, values in zip(judged, raw.T, strict=False):
        rail = run_at_extreme(values)
        runs = repeats(values)
        changes = [np.ptp(load[first:stop]) > least for first, stop in runs]
        longest = longest_of(runs[changes])
        fact = {"label": printable(channel.name or channel.key), "clipped_at": values[rail.start]}
        # of none the end is before the begin
        for what, run in (("clipped", rail), ("stands", longest)):
            fact[f"{what}_from_s"] = run.start / rate_hz
            fact[f"{what}_to_s"] = (run.stop - 1) / rate_hz
        facts.append(fact)
    return facts


def has_point(channels: Array) -> bool:
    """Whether channels (n, channels) of a plate are force, moment and the point about which it
    is."""
    return channels.shape[1] == len(MEASURED_BY_TYPE[EXPORTED])


def metres_per(unit: str, source: Source) -> float:
    """The factor from a recording's unit of length to m."""
    with naming("unit of length", f", as {source.place('point_unit')}"):
        return si_factor(unit, "m")


def force_axes(corners: Array) -> Array:
    """Find the axes in which a plate reports its force.

    Parameters
    ----------
    corners : Array
        (4, 3) [m] in the laboratory.

    Returns
    -------
    Array
        Unit vectors x, y, z as columns (3, 3). x runs from corner 2 to corner 1, z is normal to the
        surface. Not finite where the corners span no plane.
    """
    x, y = corners[0] - corners[[1, 3]]
    z = np.cross(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x / np.linalg.norm(x)
        z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def plate_axes(corners: Array) -> Array:
    """Find axes along a plate's edges, (3, 3) as columns, with z up; x and y may point either way.

    A plate's own z points down in many laboratories (`force_axes`).
    """
    axes = force_axes(corners)
    return axes if axes[2, 2] >= 0 else axes * [1.0, -1.0, -1.0]


def distance_from_plate(points: Array, corners: Array) -> Array:
    """Find the distance of points from the plate.

    Parameters
    ----------
    points : Array
        (k, 2) [m] in the axes of the plate, from its centre.
    corners : Array
        (4, 3) [m].

    Returns
    -------
    Array
        Distance (k,) [m] from the nearest edge; 0 on the plate.
    """
    half_sides = np.linalg.norm(corners[0] - corners[[1, 3]], axis=1) / 2
    excess = np.maximum(np.abs(points) - half_sides, 0.0)
    return np.linalg.norm(excess, axis=1)
