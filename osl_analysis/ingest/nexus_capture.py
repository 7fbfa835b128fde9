"""A capture in the CSV export of Vicon Nexus: its source file, and the signals that it names, before conversion."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, PositiveInt

from osl_analysis.columns import AXES
from osl_analysis.errors import InputError
from osl_analysis.formats.nexus_csv import NexusSection, read_sections, without_subject
from osl_analysis.ingest.capture import Capture, MarkerTrack, PlateLoad, is_labelled, recording_of
from osl_analysis.ingest.csv_source import Delimiter
from osl_analysis.ingest.raw_channels import channel_facts
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, Conversion
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
    """The columns that the source file asks for, in SI units; the first frame is at 0 s.

    Raises
    ------
    InputError
        No export of Nexus, sections of different frames, a column that is missing or named twice, an unknown unit,
        or a gap in a device's samples.
    """
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
    """A section that must be there."""
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
