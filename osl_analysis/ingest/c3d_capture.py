"""A motion capture recording to canonical columns, by a source file: markers, plates, analogs, model outputs."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.columns import AXES, marker_columns, plate_columns, unit_of
from osl_analysis.errors import InputError, printable
from osl_analysis.formats.c3d_file import C3DRecording, read_c3d
from osl_analysis.ingest.c3d_plates import baseline_frames, channel_numbers, plates_of
from osl_analysis.ingest.recording import Recording, check_finite, listing
from osl_analysis.ingest.source_file import C3dSource
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array

Columns = dict[str, Array]
Origins = dict[str, dict[str, Any]]


def read_capture(path: Path, source: C3dSource) -> Recording:
    """The columns that the source file asks for, in SI units; frame 0 and analog sample 0 are at 0 s.

    Markers and model outputs have a sample per frame, plates and analogs several: a row per analog sample, and
    null where a frame has none. A point that was not seen is NaN.

    Raises
    ------
    InputError
        The file cannot be read, a marker, plate or channel is missing or named twice, a unit is unknown, or an
        analog value is not finite.
    """
    recording = read_c3d(path)
    header = recording.header
    try:
        markers, marker_origins = read_markers(recording, source)
        outputs, output_origins = read_outputs(recording, source)
        analogs, analog_origins = read_analogs(recording, source)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    plates, plate_origins, geometry = read_plates(recording, source)
    fast = {**plates, **analogs}
    ratio = header.samples_per_frame if fast else 1
    facts = {
        "frame_rate_hz": header.rate,
        "samples_per_frame": header.samples_per_frame,
        "first_frame": header.first_frame,
        "axes": source.axes,
        "plate_zero_frames": baseline_frames(recording, source) if geometry else None,
        "plates": geometry,
        "body_mass_kg": next(iter(header.numbers("PROCESSING:BODYMASS").tolist()), None),
    }
    time = np.arange(header.frames * ratio) / (header.rate * ratio)
    for column, values in fast.items():
        check_finite(f"{path}: {column}", values, time)
    columns = {**plate_origins, **analog_origins, **marker_origins, **output_origins}
    return Recording(
        interleaved(time, fast, {**markers, **outputs}, ratio), columns, facts, warnings(recording, source)
    )


def interleaved(time: Array, fast: Columns, slow: Columns, ratio: int) -> pl.DataFrame:
    """Columns of both rates under one time [s]; every `ratio`-th row has a sample of the slow ones."""
    index = pl.Series("index", np.arange(time.size))
    rows = pl.DataFrame([index, pl.Series("time", time), *(pl.Series(name, values) for name, values in fast.items())])
    frames = pl.DataFrame([index.gather_every(ratio), *(pl.Series(name, values) for name, values in slow.items())])
    return rows.join(frames, on="index", how="left", maintain_order="left").drop("index")


def read_markers(recording: C3DRecording, source: C3dSource) -> tuple[Columns, Origins]:
    """Three columns [m] per marker, (frames,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for label in wanted_markers(recording, source):
        unit = source.point_unit or recording.point_unit()
        factor = si_factor(unit, "m")
        place = place_of(label, recording.point_labels, "marker")
        place_in_laboratory = recording.points[:, place] @ source.rotation.T * factor
        for axis, column in enumerate(marker_columns(printable(label))):
            columns[column] = place_in_laboratory[:, axis]
            where = {"label": label, "component": source.axes[axis]}
            origins[column] = {**where, "unit": unit, "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def wanted_markers(recording: C3DRecording, source: C3dSource) -> tuple[str, ...]:
    """Labels that the source file asks for; "all" leaves out model outputs and what Nexus did not label (`*1`)."""
    if source.markers != "all":
        return source.markers
    outputs = recording.model_outputs
    return tuple(
        label for label in recording.point_labels if label and not label.startswith("*") and label not in outputs
    )


def read_outputs(recording: C3DRecording, source: C3dSource) -> tuple[Columns, Origins]:
    """Model outputs stored as points, (frames,) each; the source file's unit holds, never the file's."""
    columns: Columns = {}
    origins: Origins = {}
    for column, output in source.outputs.items():
        place = place_of(output.label, recording.point_labels, "model output")
        factor = si_factor(output.unit, unit_of(column))
        raw = recording.points[:, place, AXES.index(output.component)]
        columns[column] = output.sign * factor * raw
        origins[column] = {**output.model_dump(), "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def read_analogs(recording: C3DRecording, source: C3dSource) -> tuple[Columns, Origins]:
    """Analog channels, (samples,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for column, analog in source.analogs.items():
        place = place_of(analog.channel, recording.analog_labels, "analog channel")
        unit = analog.unit if analog.unit is not None else recording.analog_unit(place)
        factor = si_factor(unit, unit_of(column))
        columns[column] = analog.sign * factor * recording.analogs[:, place]
        origins[column] = {**analog.model_dump(), "unit": unit, "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def read_plates(recording: C3DRecording, source: C3dSource) -> tuple[Columns, Origins, list[dict[str, Any]]]:
    """Force and moment columns per plate, (samples,) each, and the plates' numbers, types and corners [m]."""
    columns: Columns = {}
    origins: Origins = {}
    geometry = []
    for plate, channels in plates_of(recording, source):
        geometry.append({"plate": plate.number, "type": plate.type, "corners": plate.corners.tolist()})
        numbers = channel_numbers(recording, plate)
        units = [recording.analog_unit(number) for number in numbers]
        origin = {"plate": plate.number, "type": plate.type, "analogs": [n + 1 for n in numbers], "units": units}
        for quantity, values in zip(("force", "moment"), plate.wrench(channels), strict=True):
            for axis, column in enumerate(plate_columns(plate.number, quantity)):
                columns[column] = values[:, axis]
                origins[column] = {**origin, "si_unit": unit_of(column)}
    return columns, origins, geometry


def place_of(label: str, labels: list[str], what: str) -> int:
    """Index of a label that must stand exactly once."""
    count = Counter(labels)[label]
    if count == 0:
        raise InputError(f"no {what} '{label}'; the file has {listing(sorted(set(labels)))}")
    if count > 1:
        raise InputError(f"{what} '{label}' stands {count} times; rename them, or list others in the source file")
    return labels.index(label)


def warnings(recording: C3DRecording, source: C3dSource) -> list[str]:
    """What a reader of the trial should know about the recording."""
    found, name, header = [], printable(recording.path.name), recording.header
    rate = header.numbers("ANALOG:RATE")
    actual = header.rate * header.samples_per_frame
    if header.channels and rate.size and abs(rate[0] - actual) > 1e-3 * actual:
        found.append(f"{name}: ANALOG:RATE is {rate[0]} Hz, the frames hold samples at {actual} Hz; the latter is used")
    upward = "".join(header.texts("POINT:Y_SCREEN")[:1]).upper()
    if source.axes == ("x", "y", "z") and upward not in ("", "+Z", "-Z", "Z"):
        found.append(f"{name}: its vertical axis seems to be {printable(upward)}; state `axes` in the source file")
    return found
