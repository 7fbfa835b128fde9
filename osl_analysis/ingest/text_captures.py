"""Captures in text, the CSV export of Vicon Nexus and TRC: source files, signals, and what they hold."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, PositiveInt, model_validator

from osl_analysis.columns import AXES
from osl_analysis.errors import InputError
from osl_analysis.formats.nexus_csv import NexusSection, read_sections, without_subject
from osl_analysis.formats.trc import TrcFile, read_trc
from osl_analysis.ingest.c3d_capture import place_of
from osl_analysis.ingest.capture import Capture, MarkerTrack, PlateLoad, is_labelled, recording_of
from osl_analysis.ingest.csv_log import Delimiter
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.plates import channel_facts
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, Conversion, misplaced
from osl_analysis.ingest.units import LengthUnit, si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

MILLIMETRE = 1e-3
SLOW = ("Trajectories", "Model Outputs")

Point = tuple[float, float, float]
Sections = dict[str, NexusSection]


class NexusAnalog(Conversion):
    """One device channel. Without `unit`, the unit in the file's row of units is used."""

    device: str
    """Name of the device's output, such as `EMG2000 - Voltage`."""
    component: str
    """Name of the column under it."""


class NexusPlate(Settings):
    """A force plate among the devices. Its outputs are in the axes of the file, which does not say where it lies."""

    device: str
    """The plate's outputs are called `<device> - Force` and `<device> - Moment`."""
    corners: tuple[Point, Point, Point, Point]
    """Corners of the surface in the file's axes [mm]."""
    moment_about: Point | None = None
    """Point about which the file's moment is taken [mm]; without it the centre of the corners."""
    sign: Literal[1, -1] = 1
    """-1 if the file has the force on the plate instead of the force on the foot."""

    def centre(self) -> Array:
        """Centre of the corners, (3,) [mm]."""
        return np.asarray(np.mean(self.corners, axis=0))


class NexusSource(CaptureSource):
    """The CSV export of Vicon Nexus: sections Devices, Trajectories and Model Outputs in any order.

    Labels are given with or without their subject (`LTOE` for `Anna:LTOE`).
    """

    format: Literal["nexus_csv"]
    """Format of the file."""
    delimiter: Delimiter = "auto"
    """Sign between cells; `auto` takes the first of tab, `;`, `|` and `,` that the header has."""
    decimal: Literal[".", ","] = "."
    """Decimal sign."""
    analogs: dict[str, NexusAnalog] = Field(default={})
    """The device channel of each canonical column."""
    plates: dict[PositiveInt, NexusPlate] = Field(default={})
    """Force plates by number, counted from 1."""


def read_nexus_capture(path: Path, source: NexusSource) -> Recording:
    """The columns that the source file asks for, in SI units; the first frame is at 0 s."""
    sections = read_sections(path, source.delimiter, source.decimal)
    try:
        return recording_of(nexus_capture(sections, source), source)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def nexus_capture(sections: Sections, source: NexusSource) -> Capture:
    """The signals that the source file names, before conversion to SI units."""
    markers = [nexus_track(sections, label) for label in nexus_markers(sections, source)]
    outputs = {
        column: section_of(sections, "Model Outputs").column(output.label, output.component)[0]
        for column, output in source.outputs.items()
    }
    analogs = {
        column: section_of(sections, "Devices").column(analog.device, analog.component)
        for column, analog in source.analogs.items()
    }
    plates = [plate_load(sections, number, plate) for number, plate in source.plates.items()]
    first, rate, ratio, frames = timing(sections, bool(markers or outputs), bool(analogs or plates))
    return Capture(frames, rate, ratio, first, markers, outputs, analogs, plates)


def timing(sections: Sections, slow: bool, fast: bool) -> tuple[int, float, int, int]:
    """First frame, frame rate [Hz], samples per frame and number of frames, of the sections that are used."""
    used = [sections[title] for title in SLOW if slow and title in sections]
    devices = [sections["Devices"]] if fast else []
    if not used and not devices:
        raise InputError("nothing to read; name markers, outputs, analogs or plates in the source file")
    spans = set()
    for section in [*used, *devices]:
        first, ratio = section.counts()
        spans.add((first, len(section.rows) / ratio, round(section.rate / ratio, 6)))
    if len(spans) != 1:
        raise InputError(
            f"its sections differ in first frame, number of frames or frame rate: {sorted(spans)}; export all "
            "of the same frames"
        )
    first, frames, rate = spans.pop()
    if frames != int(frames):
        raise InputError("the last frame lacks sub frames; export the trial again")
    return first, rate, devices[0].counts()[1] if devices else 1, int(frames)


def section_of(sections: Sections, title: str) -> NexusSection:
    if title not in sections:
        raise InputError(f"no section {title}; the file has {', '.join(sections)}; export it too")
    return sections[title]


def nexus_markers(sections: Sections, source: NexusSource) -> tuple[str, ...]:
    """Labels of the markers to read; "all" excludes `*1`, a subject alone (`Anna:`) and nothing."""
    if source.markers != "all":
        return source.markers
    names = sections["Trajectories"].names if "Trajectories" in sections else []
    return tuple(dict.fromkeys(name for name in names if is_labelled(without_subject(name))))


def nexus_track(sections: Sections, label: str) -> MarkerTrack:
    """One marker by its label; it was not seen where the cells are empty, or at the exact origin."""
    columns = [section_of(sections, "Trajectories").column(label, axis) for axis in AXES]
    positions = np.column_stack([values for values, _ in columns])
    positions[(positions == 0).all(axis=1)] = np.nan
    return MarkerTrack(label, without_subject(label), positions, columns[0][1])


def plate_load(sections: Sections, number: int, plate: NexusPlate) -> PlateLoad:
    """Force and moment about the centre of the plate, on the foot."""
    force, exported = triple(sections, plate, "Force", "N"), triple(sections, plate, "Moment", "N*m")
    about = plate.centre() if plate.moment_about is None else np.array(plate.moment_about)
    moment = exported + np.cross((about - plate.centre()) * MILLIMETRE, force)
    origin = {"device": plate.device, "sign": plate.sign}
    labels = [f"{plate.device} {kind[0]}{axis}" for kind in ("Force", "Moment") for axis in AXES]
    raw = channel_facts(labels, np.hstack([force, exported]), force, section_of(sections, "Devices").rate)
    return PlateLoad(number, 2, np.array(plate.corners) * MILLIMETRE, force, moment, origin, raw)


def triple(sections: Sections, plate: NexusPlate, kind: str, si_unit: str) -> Array:
    """Force [N] or moment [N*m] of a plate on the foot, (samples, 3)."""
    conversion, devices = Conversion(sign=plate.sign), section_of(sections, "Devices")
    columns = [devices.column(f"{plate.device} - {kind}", f"{kind[0]}{axis}") for axis in AXES]
    return np.column_stack([conversion.to_si(values, si_unit, unit) for values, unit in columns])


KINDS = {"Trajectories": "marker", "Model Outputs": "model output"}
FLAT = 0.5
"""Largest ratio of the motion of markers along an axis to their distance along it, where the axis may be vertical."""


def inspect_nexus(path: Path) -> Overview:
    sections = read_sections(path)
    facts, remarks = {}, []
    for title, section in sections.items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        try:
            section.counts()
        except InputError as error:
            remarks.append(f"{title}: {error}")
    try:
        channels = [channel for section in sections.values() for channel in section_channels(section)]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return Overview("nexus_csv", facts, channels, remarks)


def section_channels(section: NexusSection) -> Iterator[RecordedChannel]:
    """A section's columns: one per trajectory, and per component of anything else."""
    kind = KINDS.get(section.title, "device")
    for place, (name, component) in enumerate(zip(section.names, section.components, strict=True)):
        if not name or (kind == "marker" and component.casefold() != "x"):
            continue
        address = {"label": name} if kind == "marker" else {"device": name, "component": component}
        values = section.values(place)
        missing = float(np.isnan(values).mean())
        note = f"missing in {missing:.1%} of the rows" if missing else ""
        yield RecordedChannel(
            kind, address, section.units[place], int((~np.isnan(values)).sum()), section.rate, note, missing=missing
        )


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
        return self


def read_trc_capture(path: Path, source: TrcSource) -> Recording:
    """The markers that the source file asks for [m]; the first frame is at 0 s."""
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
    positions = file.positions[:, place]
    seen = ~np.isnan(positions).any(axis=1)
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    label = {"label": file.labels[place]}
    return RecordedChannel("marker", label, file.unit, int(seen.sum()), file.rate, note, missing=missing, centre=centre)
