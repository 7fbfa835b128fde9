"""Motion capture to canonical columns: the steps that all formats share after their files are decoded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.columns import marker_columns, plate_columns, unit_of
from osl_analysis.errors import InputError, printable
from osl_analysis.ingest.recording import Recording, check_finite
from osl_analysis.ingest.source_fields import CaptureSource
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array

Columns = dict[str, Array]
Origins = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class MarkerTrack:
    """One marker's positions, in the axes of the file."""

    label: str  # label in the file
    name: str  # the label without its subject, which names the columns
    positions: Array  # (frames, 3) in `unit`; NaN where the marker was not seen
    unit: str  # unit of the positions, as the file or the source file spells it


@dataclass(frozen=True)
class PlateLoad:
    """Recording of one force plate, in the axes of the file."""

    number: int
    type: int  # type 1 to 4 of the C3D manual; 2 where forces and moments were exported
    corners: Array  # (4, 3) [m]
    force: Array  # (samples, 3) [N], on the foot
    moment: Array  # (samples, 3) [N*m], on the foot, about the centre of the corners
    origin: Mapping[str, Any]  # source channels, for the provenance
    channels: Sequence[Mapping[str, Any]] = ()
    """What each raw channel shows, as `raw_channels.channel_facts` gives it."""


@dataclass(frozen=True)
class Capture:
    """The signals of a capture that a source file names, before conversion of units, signs and axes."""

    frames: int  # number of frames; frame 0 and analog sample 0 are at 0 s
    frame_rate: float  # [Hz]
    samples_per_frame: int  # samples of the analog channels and plates per frame
    first_frame: int  # number of the first frame, as the laboratory counts
    markers: Sequence[MarkerTrack] = ()  # the markers that are asked for
    outputs: Mapping[str, Array] = field(default_factory=dict)
    """By canonical column the model output's component, (frames,)."""
    analogs: Mapping[str, tuple[Array, str]] = field(default_factory=dict)
    """By canonical column the channel, (samples,), and the unit that the file states."""
    plates: Sequence[PlateLoad] = ()  # the force plates that are asked for
    facts: Mapping[str, Any] = field(default_factory=dict)  # further facts, for the provenance
    warnings: Sequence[str] = ()  # warnings, a sentence each


def recording_of(capture: Capture, source: CaptureSource) -> Recording:
    """The columns that the source file asks for, in SI units and our axes.

    Markers and model outputs have a sample per frame, plates and analogs several: a row per analog sample, and null
    where a frame has none. A marker that was not seen is NaN.
    """
    markers, marker_origins = marker_signals(capture, source)
    outputs, output_origins = output_signals(capture, source)
    analogs, analog_origins = analog_signals(capture, source)
    plates, plate_origins = plate_signals(capture, source)
    fast, slow = {**plates, **analogs}, {**markers, **outputs}
    if not fast and not slow:
        raise InputError(
            "the source file names nothing that the file has: no marker, plate, analog channel or model output; name "
            "what to read in the source file, or export the trial again with it"
        )
    ratio = capture.samples_per_frame if fast else 1
    time = np.arange(capture.frames * ratio) / (capture.frame_rate * ratio)
    for column, values in fast.items():
        check_finite(column, values, time)
    facts = {
        "frame_rate_hz": capture.frame_rate,
        "samples_per_frame": capture.samples_per_frame,
        "first_frame": capture.first_frame,
        "axes": source.axes,
        "plates": [geometry(plate, source.rotation) for plate in capture.plates],
        **capture.facts,
    }
    origins = {**plate_origins, **analog_origins, **marker_origins, **output_origins}
    hidden = f"none of the {len(capture.markers)} markers was seen in any of the {capture.frames} frames"
    seen = not capture.markers or any(np.isfinite(marker.positions).any() for marker in capture.markers)
    warnings = [*capture.warnings, *[hidden] * (not seen)]
    return Recording(interleaved(time, fast, slow, ratio), origins, facts, warnings)


def interleaved(time: Array, fast: Columns, slow: Columns, ratio: int) -> pl.DataFrame:
    """Columns of both rates under one time [s]; every `ratio`-th row has a sample of the slow ones."""
    index = pl.Series("index", np.arange(time.size))
    rows = pl.DataFrame([index, pl.Series("time", time), *(pl.Series(name, values) for name, values in fast.items())])
    frames = pl.DataFrame([index.gather_every(ratio), *(pl.Series(name, values) for name, values in slow.items())])
    return rows.join(frames, on="index", how="left", maintain_order="left").drop("index")


def marker_signals(capture: Capture, source: CaptureSource) -> tuple[Columns, Origins]:
    """Three columns [m] per marker, (frames,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for marker in capture.markers:
        factor = si_factor(marker.unit, "m")
        turned = marker.positions @ source.rotation.T * factor
        for axis, column in enumerate(marker_columns(printable(marker.name))):
            if column in columns:
                raise InputError(f"marker '{marker.name}' occurs twice; list those to read under `markers`")
            columns[column] = turned[:, axis]
            origin = {"label": marker.label, "component": source.axes[axis], "unit": marker.unit}
            origins[column] = {**origin, "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def output_signals(capture: Capture, source: CaptureSource) -> tuple[Columns, Origins]:
    """Model outputs, (frames,) each. The unit of the source file is used, never that of the file."""
    columns = {c: source.outputs[c].to_si(values, unit_of(c)) for c, values in capture.outputs.items()}
    return columns, {column: source.outputs[column].origin(column) for column in columns}


def analog_signals(capture: Capture, source: CaptureSource) -> tuple[Columns, Origins]:
    """Analog channels, (samples,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for column, (values, unit) in capture.analogs.items():
        try:
            columns[column] = source.analogs[column].to_si(values, unit_of(column), unit)
        except InputError as error:
            raise InputError(f"{column}: {error}, as {source.place('analogs', column, 'unit')}") from error
        origins[column] = source.analogs[column].origin(column, unit)
    return columns, origins


def plate_signals(capture: Capture, source: CaptureSource) -> tuple[Columns, Origins]:
    """Force [N] and moment [N*m] columns per plate, (samples,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for plate in capture.plates:
        for quantity, values in (("force", plate.force), ("moment", plate.moment)):
            turned = values @ source.rotation.T
            for axis, column in enumerate(plate_columns(plate.number, quantity)):
                columns[column] = turned[:, axis]
                origins[column] = {"plate": plate.number, **plate.origin, "si_unit": unit_of(column)}
    return columns, origins


def geometry(plate: PlateLoad, rotation: Array) -> dict[str, Any]:
    """A plate's number, type, corners [m] in our axes and raw channels, for the trial's provenance."""
    return {
        "plate": plate.number,
        "type": plate.type,
        "corners": (plate.corners @ rotation.T).tolist(),
        "channels": list(plate.channels),
    }


def is_labelled(name: str) -> bool:
    """Whether a marker has a name of its own: Nexus calls those that it did not label `*1`, `*2`, ..."""
    return bool(name) and not name.startswith("*")
