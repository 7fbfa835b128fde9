# SPDX-License-Identifier: Apache-2.0
"""Convert a capture of a motion-capture laboratory to canonical columns in our axes.

It holds markers, force plates, analog channels and model outputs. The baseline of the plates is
subtracted only where the source file asks for it: most files name their first ten frames as empty,
whether the plates were empty or not.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError, naming, printable
from osl_analysis.base.recording import Channel, Kind, Plate, Recording, Rows
from osl_analysis.base.source_file import LaboratorySource, MarkerSource
from osl_analysis.base.trial import AXES, Array, marker_columns
from osl_analysis.ingest.conversion import (
    Converted,
    check_finite_values,
    losses_of,
    origin_of,
    to_si,
)
from osl_analysis.ingest.force_plates import convert_plates, force_axes, metres_per


@dataclass(frozen=True)
class VerticalAxis:
    """Which axis of a laboratory is vertical, by its plates or by a walker."""

    least_level: float = 0.9  # of a plate's normal along the vertical axis
    least_moved: float = 0.1  # of what lies between markers, by which those of a walker move


VERTICAL_AXIS = VerticalAxis()


def convert_capture(recording: Recording, source: MarkerSource) -> Converted:
    """Convert what a source file asks for.

    Returns
    -------
    Converted
        A row per sample of the devices, or per frame without them, null where a frame has none; a
        marker that was not seen is NaN. Time [s] starts at 0 in the first frame.

    Raises
    ------
    InputError
        A channel is missing or occurs twice, a unit or a plate is wrong, or there is nothing to
        read.
    """
    markers, frame_columns, origins = convert_markers(recording, source)
    used = [*markers]
    baseline = baseline_frames(recording, source)
    unloaded = None
    if baseline is not None:
        per_frame = recording.facts["samples_per_frame"]
        unloaded = slice((baseline[0] - 1) * per_frame, baseline[1] * per_frame)
    loads = convert_plates(recording.plates, source, unloaded)
    sample_columns: dict[str, Any] = loads.samples.to_dict()
    origins.update(loads.origins)
    if isinstance(source, LaboratorySource):
        used += [channel for plate in recording.plates for channel in plate.channels]
        for column, output in source.outputs.items():
            channel = recording.find({"label": output.label}, "model output")
            # in the unit of the source file and never in that of the file, which may misstate it
            values = channel.values[:, AXES.index(output.component)]
            origin = origin_of(output, column)
            frame_columns[column] = to_si(output, values, origin["factor"])
            origins[column] = origin
            used.append(channel)
        for column, setting in source.analogs.items():
            channel = recording.find(setting.address, f"analog {setting.ADDRESS}")
            with naming(column, f", as {source.place('analogs', column, 'unit')}"):
                origin = origin_of(setting, column, channel.unit)
            sample_columns[column] = to_si(setting, channel.values, origin["factor"])
            origins[column] = origin
            used.append(channel)
    if not used:
        raise InputError(
            "the source file names nothing that the file has: no marker, plate, analog channel"
            " or model output",
            "name what to read in the source file, or export the trial again with it",
        )
    samples = joined(frame_columns, sample_columns, [channel.rows for channel in used])
    for column in getattr(source, "analogs", ()):
        check_finite_values(column, sample_columns[column], samples["time"].to_numpy())
    facts = {
        **recording.facts,
        "axes": source.axes,
        "plate_zero_frames": baseline,
        **loads.facts,
    }
    warnings = [*recording.loss.remarks]
    up = str(facts.get("vertical_on_screen") or vertical_axis(markers, recording.plates))
    up = up.upper().strip("+")
    if source.axes == ("x", "y", "z") and up not in ("", "-", "Z", "-Z"):
        axes = "`axes: [x, -z, y]`" if up == "Y" else "`axes`"
        warnings.append(
            f"its vertical axis seems to be {printable(up)}; state {axes} in the source file"
        )
    start_s = min(channel.rows.start_s for channel in used)
    return Converted(samples, origins, facts, warnings, losses_of(recording.loss), start_s)


def is_labelled(label: str) -> bool:
    """Whether a marker has a name of its own, behind its subject's: Nexus calls those that it did
    not label `*1`, `*2`, ..."""
    return bool(re.search("(^|:)[^*:][^:]*$", label))


def convert_markers(
    recording: Recording, source: MarkerSource
) -> tuple[list[Channel], dict[str, Array], dict[str, dict[str, Any]]]:
    """The markers that the source file asks for, their coordinates (n,) [m] by column, and where
    each comes from."""
    if source.markers == "all":
        markers = [
            channel
            for channel in recording.channels
            if channel.kind == Kind.MARKER and is_labelled(channel.key)
        ]
    else:
        markers = [recording.find({"label": label}, "marker") for label in source.markers]
    columns = {}
    origins = {}
    for marker in markers:
        name = marker.name or marker.key
        unit = getattr(source, "point_unit", None) or marker.unit
        factor = metres_per(unit, source)
        for axis, column in enumerate(marker_columns(printable(name))):
            if column in columns:
                recording.find({"label": name}, "marker")  # it says how each of them is asked for
            columns[column] = factor * marker.values @ source.rotation[axis]
            origins[column] = {"label": marker.key, "unit": unit, "factor": factor}
    return markers, columns, origins


def baseline_frames(recording: Recording, source: MarkerSource) -> tuple[int, int] | None:
    """First and last frame, counted from 1, in which the plates are stated to be unloaded; None
    without a baseline."""
    zero: Any = getattr(source, "plate_zero", "none")
    if zero == "none" or not recording.plates:
        return None
    first, last = zero
    frames = recording.facts["frames"]
    if not 1 <= first <= last <= frames:
        raise InputError(
            f"the baseline of the plates is frames {first} to {last} of {frames}",
            "state two frames in which the plates are unloaded as `plate_zero`, or none",
        )
    return first, last


def joined(
    frame_columns: dict[str, Array], sample_columns: dict[str, Array], used_rows: Sequence[Rows]
) -> pl.DataFrame:
    """One table of frames and samples: frame 0 and sample 0 are at 0 s."""
    rates = np.array([rows.rate_hz for rows in used_rows], float)
    number = np.arange(used_rows[int(rates.argmax())].count)
    rows = pl.DataFrame({"number": number, "time": number / rates.max(), **sample_columns})
    per_frame = round(rates.max() / rates.min())
    frames = pl.DataFrame({"number": number[::per_frame], **frame_columns})
    return rows.join(frames, on="number", how="left", maintain_order="left").drop("number")


def vertical_axis(markers: Sequence[Channel], plates: Sequence[Plate]) -> str:
    """Tell the axis that points up: across the force plates; else that along which markers keep
    their order, for somebody who walks.

    Empty where nothing tells: plates slope, markers are few, or they stay where they are.
    """
    normals = np.abs([force_axes(plate.corners)[:, 2] for plate in plates])
    if normals.size:
        normal = normals.mean(axis=0)
        return "xyz"[np.argmax(normal)] if normal.max() > VERTICAL_AXIS.least_level else ""
    whole = [marker.values for marker in markers if not np.isnan(marker.values).any()]
    if len(whole) < 4:
        return ""
    positions = np.stack(whole, axis=1)
    spread = np.median(positions, axis=0).std(axis=0)
    moved = np.median(positions.std(axis=0), axis=0)
    # along a vertical axis the markers move by less than half of what lies between them
    vertical = np.argmax(spread)
    walks = moved.max() > VERTICAL_AXIS.least_moved * spread[vertical]
    return "xyz"[vertical] if walks and moved[vertical] < 0.5 * spread[vertical] else ""
