"""What a capture holds, in C3D or a CSV export of Vicon Nexus: markers, plates, analog channels, model outputs."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.c3d_file import C3DRecording, read_c3d
from osl_analysis.formats.c3d_header import CountsError
from osl_analysis.formats.nexus_csv import NexusSection, read_sections
from osl_analysis.ingest.c3d_plates import plate_count, plate_loads, plate_parameter
from osl_analysis.ingest.c3d_source import C3dSource
from osl_analysis.ingest.draft_places import UNKNOWN
from osl_analysis.ingest.overview import Overview, RecordedChannel

KINDS = {"Trajectories": "marker", "Model Outputs": "model output"}


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates.

    Raises
    ------
    InputError
        The file cannot be read; the message says where it is damaged.
    """
    recording, remark = any_counts(path)
    try:
        overview = c3d_overview(recording)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if not remark:
        return overview
    settings = {"counts": UNKNOWN, **overview.settings}
    return replace(overview, remarks=[remark, *overview.remarks], settings=settings)


def any_counts(path: Path) -> tuple[C3DRecording, str]:
    """A file and a remark: where header and parameters contradict each other, it is read by the counts that fit."""
    try:
        return read_c3d(path), ""
    except CountsError as error:
        if not error.fitting:
            raise
        return read_c3d(path, error.fitting[0]), f"read here with the counts of the {error.fitting[0]}: {error}"


def c3d_overview(recording: C3DRecording) -> Overview:
    """A decoded file's markers, model outputs, analog channels and plates."""
    header = recording.header
    facts = {
        "processor": header.processor,
        "frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz",
        "unit of length": recording.point_unit() or "none",
        "force plates": str(plate_count(recording)),
        "vertical on screen": "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said",
        "software": " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said",
    }
    channels = [*recorded_points(recording), *recorded_analogs(recording), *recorded_plates(recording)]
    settings = {"plates": "all" if plate_count(recording) else "none"}
    return Overview("c3d", facts, channels, list(c3d_oddities(recording)), settings)


def recorded_points(recording: C3DRecording) -> Iterator[RecordedChannel]:
    """Markers, and the model outputs that are stored like them."""
    header, outputs = recording.header, recording.model_outputs
    for place, label in enumerate(recording.point_labels[: header.points]):
        seen = ~np.isnan(recording.points[:, place, 0])
        missing = 1.0 - float(seen.mean())
        note = f"missing in {missing:.1%} of the frames" if missing else ""
        kind = "model output" if label in outputs else "marker"
        unit = "" if kind == "model output" else recording.point_unit()
        centre = tuple(recording.points[seen, place].mean(axis=0).tolist()) if seen.any() else ()
        yield RecordedChannel(
            kind, {"label": label}, unit, int(seen.sum()), header.rate, note, missing=missing, centre=centre
        )


def recorded_analogs(recording: C3DRecording) -> Iterator[RecordedChannel]:
    """Analog channels with their range."""
    header = recording.header
    rate = header.rate * header.samples_per_frame
    for place, label in enumerate(recording.analog_labels):
        values = recording.analogs[:, place]
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        yield RecordedChannel("analog", {"channel": label}, recording.analog_unit(place), values.size, rate, note)


def recorded_plates(recording: C3DRecording) -> Iterator[RecordedChannel]:
    """Force plates with their type and analog channels."""
    for number in range(1, plate_count(recording) + 1):
        try:
            kind = int(plate_parameter(recording, "TYPE", number))
            own = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
            note = f"type {kind}, analog channels {own}"
        except InputError as error:
            note = str(error)
        load, centre = load_on(recording, number)
        note += f", force changes by {load:.0f} N" if load is not None else ""
        yield RecordedChannel("plate", {"plate": str(number)}, note=note, load=load, centre=centre)


def load_on(recording: C3DRecording, number: int) -> tuple[float | None, tuple[float, ...]]:
    """Range of the force on a plate [N], and the mean of its corners in the file's unit; None and () if unknown."""
    try:
        corners = plate_parameter(recording, "CORNERS", number, (3, 4)).mean(axis=1)
        (load,) = plate_loads(recording, C3dSource(format="c3d", plates=(number,)))
    except InputError:
        return None, ()
    return float(np.ptp(np.linalg.norm(load.force, axis=1))), tuple(corners.tolist())


def c3d_oddities(recording: C3DRecording) -> Iterator[str]:
    """Oddities that a source file may have to settle."""
    header = recording.header
    if header.remark:
        yield header.remark
    for what, labels in (("marker", recording.point_labels), ("analog channel", recording.analog_labels)):
        repeated = [f"'{label}' {count} times" for label, count in Counter(labels).items() if count > 1]
        yield from [f"{what}s of the same label: {listing(repeated)}"] * bool(repeated)
    rate, actual = header.numbers("ANALOG:RATE"), header.rate * header.samples_per_frame
    if header.channels and rate.size and abs(rate[0] - actual) > 1e-3 * actual:
        yield f"ANALOG:RATE is {rate[0]:g} Hz, the frames hold samples at {actual:g} Hz"
    for what, labels, count in (
        ("points", recording.point_labels, header.points),
        ("analog channels", recording.analog_labels, header.channels),
    ):
        if len(labels) < count:
            yield f"{count - len(labels)} of {count} {what} have no label"


def inspect_nexus(path: Path) -> Overview:
    """The sections of a Nexus export."""
    sections = read_sections(path)
    facts, remarks = {}, []
    for title, section in sections.items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        try:
            section.counts()
        except InputError as error:
            remarks.append(f"{title}: {error}")
    channels = [channel for section in sections.values() for channel in section_channels(section)]
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
