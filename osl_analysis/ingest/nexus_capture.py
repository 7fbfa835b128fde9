"""A Nexus CSV export to canonical columns, by a source file: markers, plates, analogs, model outputs."""

from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.columns import AXES, marker_columns, plate_columns, unit_of
from osl_analysis.errors import InputError, printable
from osl_analysis.formats.nexus_csv import Section, read_sections, short
from osl_analysis.ingest.c3d_capture import Columns, Origins, interleaved
from osl_analysis.ingest.csv_source import NexusPlate, NexusSource
from osl_analysis.ingest.recording import Recording, check_finite
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array

MILLIMETRE = 1e-3

Sections = dict[str, Section]


def read_nexus(path: Path, source: NexusSource) -> Recording:
    """The columns that the source file asks for, in SI units; the first frame is at 0 s.

    Raises
    ------
    InputError
        No export of Nexus, sections of different frames, a column that is missing or named twice, an unknown unit,
        or a gap in a device's samples.
    """
    sections = read_sections(path, source)
    try:
        return recording_of(sections, source)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def recording_of(sections: Sections, source: NexusSource) -> Recording:
    """The columns that the source file asks for, under one time [s]."""
    markers, marker_origins = read_markers(sections, source)
    outputs, output_origins = read_outputs(sections, source)
    analogs, analog_origins = read_analogs(sections, source)
    plates, plate_origins = read_plates(sections, source)
    slow, fast = {**markers, **outputs}, {**plates, **analogs}
    first, rate, ratio, frames = timing(sections, bool(slow), bool(fast))
    time = np.arange(frames * ratio) / (rate * ratio)
    for column, values in fast.items():
        check_finite(column, values, time)
    facts = {
        "frame_rate_hz": rate,
        "samples_per_frame": ratio,
        "first_frame": first,
        "axes": source.axes,
        "plates": [geometry(number, plate, source.rotation) for number, plate in source.plates.items()],
    }
    origins = {**plate_origins, **analog_origins, **marker_origins, **output_origins}
    return Recording(interleaved(time, fast, slow, ratio), origins, facts)


def timing(sections: Sections, slow: bool, fast: bool) -> tuple[int, float, int, int]:
    """First frame, frame rate [Hz], samples per frame and number of frames, of the sections that are used."""
    used = [sections[title] for title in ("Trajectories", "Model Outputs") if slow and title in sections]
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


def section(sections: Sections, title: str) -> Section:
    """A section that must be there."""
    if title not in sections:
        raise InputError(f"no section {title}; the file has {', '.join(sections)}: export it too")
    return sections[title]


def read_markers(sections: Sections, source: NexusSource) -> tuple[Columns, Origins]:
    """Three columns [m] per marker, NaN where it was not seen: an empty cell, or the exact origin."""
    columns: Columns = {}
    origins: Origins = {}
    if not source.markers or (source.markers == "all" and "Trajectories" not in sections):
        return columns, origins
    where = section(sections, "Trajectories")
    for label in wanted_markers(where) if source.markers == "all" else source.markers:
        places = [where.place(label, axis) for axis in AXES]
        unit = where.units[places[0]]
        factor = si_factor(unit, "m")
        values = np.column_stack([where.values(place) for place in places])
        values[(values == 0).all(axis=1)] = np.nan
        turned = values @ source.rotation.T * factor
        for axis, column in enumerate(marker_columns(printable(short(label)))):
            if column in columns:
                raise InputError(f"marker '{short(label)}' is there twice; list those to read under `markers`")
            columns[column] = turned[:, axis]
            origins[column] = {"label": label, "component": source.axes[axis], "unit": unit, "factor": factor}
            origins[column]["si_unit"] = unit_of(column)
    return columns, origins


def wanted_markers(where: Section) -> tuple[str, ...]:
    """Labels of all trajectories but those that have none: `*1`, a subject alone (`Anna:`), nothing."""
    names = dict.fromkeys(name for name in where.names if short(name) and not short(name).startswith("*"))
    return tuple(names)


def read_outputs(sections: Sections, source: NexusSource) -> tuple[Columns, Origins]:
    """Model outputs, (frames,) each; the source file's unit holds, never the file's."""
    columns: Columns = {}
    origins: Origins = {}
    for column, output in source.outputs.items():
        where = section(sections, "Model Outputs")
        factor = si_factor(output.unit, unit_of(column))
        columns[column] = output.sign * factor * where.values(where.place(output.label, output.component))
        origins[column] = {**output.model_dump(), "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def read_analogs(sections: Sections, source: NexusSource) -> tuple[Columns, Origins]:
    """Device channels, (samples,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for column, analog in source.analogs.items():
        where = section(sections, "Devices")
        place = where.place(analog.device, analog.component)
        unit = analog.unit if analog.unit is not None else where.units[place]
        factor = si_factor(unit, unit_of(column))
        columns[column] = analog.sign * factor * where.values(place)
        origins[column] = {**analog.model_dump(), "unit": unit, "factor": factor, "si_unit": unit_of(column)}
    return columns, origins


def read_plates(sections: Sections, source: NexusSource) -> tuple[Columns, Origins]:
    """Force [N] and moment [N*m] about the centre of the plate, on the foot, (samples,) each."""
    columns: Columns = {}
    origins: Origins = {}
    for plate_number, plate in source.plates.items():
        where = section(sections, "Devices")
        force, moment = (triple(where, plate, kind) for kind in ("Force", "Moment"))
        about = plate.centre() if plate.moment_about is None else np.array(plate.moment_about)
        moment = moment + np.cross((about - plate.centre()) * MILLIMETRE, force)
        origin = {"plate": plate_number, "device": plate.device, "sign": plate.sign}
        for quantity, values in (("force", force), ("moment", moment)):
            turned = values @ source.rotation.T
            for axis, column in enumerate(plate_columns(plate_number, quantity)):
                columns[column] = turned[:, axis]
                origins[column] = {**origin, "si_unit": unit_of(column)}
    return columns, origins


def triple(where: Section, plate: NexusPlate, kind: str) -> Array:
    """Force [N] or moment [N*m] of a plate, (samples, 3), with the sign of what acts on the foot."""
    quantity = {"Force": "N", "Moment": "N*m"}[kind]
    places = [where.place(f"{plate.device} - {kind}", f"{kind[0]}{axis}") for axis in AXES]
    factors = [si_factor(where.units[place], quantity) for place in places]
    return plate.sign * np.column_stack([where.values(place) for place in places]) * factors


def geometry(plate_number: int, plate: NexusPlate, rotation: Array) -> dict[str, Any]:
    """A plate's number and corners [m] in our axes, for the trial's provenance."""
    corners = np.array(plate.corners) @ rotation.T * MILLIMETRE
    return {"plate": plate_number, "type": 2, "corners": corners.tolist()}
