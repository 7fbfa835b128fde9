"""A capture in TRC: its source file, its markers, and what it holds."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import model_validator

from osl_analysis.errors import InputError
from osl_analysis.formats.trc import TrcFile, read_trc
from osl_analysis.ingest.c3d_capture import place_of
from osl_analysis.ingest.capture import Capture, MarkerTrack, is_labelled, recording_of
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, misplaced
from osl_analysis.ingest.unit_names import LengthUnit
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array

FLAT = 0.5
"""Largest ratio of the motion of markers along an axis to their distance along it, where the axis may be vertical."""


class TrcSource(CaptureSource):
    """A capture in TRC. It holds markers only. OpenSim's own axes are x forward, y up, z to the right: `[x, -z, y]`."""

    format: Literal["trc"]
    """Format of the file."""
    point_unit: LengthUnit | None = None
    """Unit of length, where the file's Units is absent or wrong."""

    @model_validator(mode="after")
    def _markers_only(self) -> "TrcSource":
        for key in ("analogs", "outputs"):
            if getattr(self, key):
                raise misplaced("a TRC file holds markers only; map the others in the source file of a log", key)
        if self.point_unit is not None:
            si_factor(self.point_unit, "m")
        return self


def read_trc_capture(path: Path, source: TrcSource) -> Recording:
    """The markers that the source file asks for [m]; the first frame is at 0 s.

    Raises
    ------
    InputError
        The file cannot be read, a marker is missing or named twice, or the unit of length is unknown.
    """
    file = read_trc(path)
    unit = source.point_unit or file.unit
    try:
        si_factor(unit, "m")
    except InputError as error:
        raise InputError(f"{path}: Units: {error}, as {source.place('point_unit')}") from error
    labels = [one for one in file.labels if is_labelled(one)] if source.markers == "all" else source.markers
    frames = file.positions.shape[0]
    facts = {"time": {"start": file.start}}
    upward = f"{path.name}: its vertical axis seems to be y; state `axes: [x, -z, y]` in the source file"
    warnings = [upward] * (source.axes == ("x", "y", "z") and vertical_axis(file.positions) == "y")
    warnings += [f"{path.name}: {note}" for note in file.notes]
    try:
        markers = [MarkerTrack(one, one, track_of(file, one), unit) for one in labels]
        capture = Capture(frames, file.rate, 1, file.first_frame, markers, facts=facts, warnings=warnings)
        return recording_of(capture, source)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def track_of(file: TrcFile, label: str) -> Array:
    """Positions of a marker by its label, (frames, 3)."""
    return np.asarray(file.positions[:, place_of(label, file.labels, "marker")])


def vertical_axis(positions: Array) -> str:
    """The axis along which the markers, (frames, markers, 3), keep their order: up, for somebody who stands or walks.

    Empty where the file does not tell: there are few markers, or they stay where they are.
    """
    seen = positions[:, ~np.isnan(positions).any(axis=(0, 2))]
    if seen.shape[1] < 4:
        return ""
    apart = np.median(seen, axis=0).std(axis=0)
    moved = np.median(seen.std(axis=0), axis=0)
    candidates = np.flatnonzero((apart == apart.max()) & (moved < FLAT * apart))
    return "xyz"[candidates[0]] if candidates.size and moved.max() > moved[candidates[0]] else ""


def inspect_trc(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen; raises InputError as `read_trc`."""
    file = read_trc(path)
    frames = file.positions.shape[0]
    facts = {
        "frames": f"{frames}, from {file.first_frame} on, at {file.rate:g} Hz",
        "unit of length": file.unit or "none",
        "time of the first frame": f"{file.start:g} s",
        "vertical axis": vertical_axis(file.positions) or "not told by the markers",
    }
    channels = [marker_channel(file, place) for place in range(len(file.labels))]
    twice = sorted({label for label in file.labels if file.labels.count(label) > 1})
    remarks = [*file.notes, *[f"markers of the same label: {', '.join(twice)}"] * bool(twice)]
    axes = {"axes": ["x", "-z", "y"]} if vertical_axis(file.positions) == "y" else {}
    return Overview("trc", facts, channels, remarks, axes)


def marker_channel(file: TrcFile, place: int) -> RecordedChannel:
    """One marker for the list."""
    positions = file.positions[:, place]
    seen = ~np.isnan(positions).any(axis=1)
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    label = {"label": file.labels[place]}
    return RecordedChannel("marker", label, file.unit, int(seen.sum()), file.rate, note, missing=missing, centre=centre)
