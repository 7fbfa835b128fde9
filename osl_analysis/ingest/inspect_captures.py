"""What a capture holds, in C3D, TRC or the CSV export of Nexus: markers, model outputs, channels and plates."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.c3d import C3DRecording, CountsError, read_c3d
from osl_analysis.formats.gait_text import NexusSection, read_sections, read_trc
from osl_analysis.ingest.captures import plate_count, plate_loads, plate_parameter, vertical_axis
from osl_analysis.ingest.overview import UNKNOWN, Overview, RecordedChannel
from osl_analysis.ingest.source import KEYS, model_of
from osl_analysis.trial import Array


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates.

    Where header and parameters contradict each other, the file is read by the counts that fit its size.
    """
    settings, remarks = dict[str, object](), list[str]()
    try:
        recording = read_c3d(path)
    except CountsError as error:
        if not error.fitting:
            raise
        recording = read_c3d(path, error.fitting[0])
        settings, remarks = {"counts": UNKNOWN}, [f"read here with the counts of the {error.fitting[0]}: {error}"]
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
    settings["plates"] = "all" if plate_count(recording) else "none"
    return Overview("c3d", facts, channels, [*remarks, *c3d_oddities(recording)], settings)


def marker_channel(label: str, positions: Array, unit: str, rate: float, kind: str = "marker") -> RecordedChannel:
    """A marker by its positions, (frames, 3), NaN where it was not seen."""
    seen = ~np.isnan(positions).any(axis=1)
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    return RecordedChannel(kind, {"label": label}, unit, int(seen.sum()), rate, note, missing=missing, centre=centre)


def recorded_points(recording: C3DRecording) -> Iterator[RecordedChannel]:
    for label, positions in zip(recording.point_labels, recording.points.transpose(1, 0, 2), strict=False):
        kind, unit = ("model output", "") if label in recording.model_outputs else ("marker", recording.point_unit())
        yield marker_channel(label, positions, unit, recording.header.rate, kind)


def recorded_analogs(recording: C3DRecording) -> Iterator[RecordedChannel]:
    header = recording.header
    rate = header.rate * header.samples_per_frame
    for place, label in enumerate(recording.analog_labels):
        values = recording.analogs[:, place]
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        yield RecordedChannel("analog", {"channel": label}, recording.analog_unit(place), values.size, rate, note)


def recorded_plates(recording: C3DRecording) -> Iterator[RecordedChannel]:
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
        (load,) = plate_loads(
            recording, model_of("c3d", KEYS["c3d"]).model_validate({"format": "c3d", "plates": [number]})
        )
    except InputError:
        return None, ()
    return float(np.ptp(np.linalg.norm(load.force, axis=1))), tuple(corners.tolist())


def c3d_oddities(recording: C3DRecording) -> Iterator[str]:
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


KINDS = {"Trajectories": "marker", "Model Outputs": "model output"}


def inspect_nexus(path: Path) -> Overview:
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
    channels = [
        marker_channel(label, file.positions[:, place], file.unit, file.rate) for place, label in enumerate(file.labels)
    ]
    twice = sorted({label for label in file.labels if file.labels.count(label) > 1})
    remarks = [*file.notes, *[f"markers of the same label: {', '.join(twice)}"] * bool(twice)]
    axes = {"axes": ["x", "-z", "y"]} if vertical_axis(file.positions) == "y" else {}
    return Overview("trc", facts, channels, remarks, axes)
