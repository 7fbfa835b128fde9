"""What a capture holds, in C3D, TRC or the CSV export of Nexus: markers, model outputs, channels and plates."""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.c3d import C3DRecording, CountsError, read_c3d
from osl_analysis.formats.gait_text import read_sections, read_trc
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
    header, outputs, unit = recording.header, recording.model_outputs, recording.point_unit()
    channels = [
        marker_channel(label, positions, "" if label in outputs else unit, header.rate, label in outputs)
        for label, positions in zip(recording.point_labels, recording.points.transpose(1, 0, 2), strict=False)
    ]
    for place, label in enumerate(recording.analog_labels):
        values, rate = recording.analogs[:, place], header.rate * header.samples_per_frame
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        own = recording.analog_unit(place)
        channels.append(RecordedChannel("analog", {"channel": label}, own, values.size, rate, note))
    plates = plate_count(recording)
    channels += [plate_channel(recording, number) for number in range(1, plates + 1)]
    facts = {
        "processor": header.processor,
        "frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz",
        "unit of length": unit or "none",
        "force plates": str(plates),
        "vertical on screen": "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said",
        "software": " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said",
    }
    settings["plates"] = "all" if plates else "none"
    return Overview("c3d", facts, channels, [*remarks, *c3d_oddities(recording)], settings)


def marker_channel(label: str, positions: Array, unit: str, rate: float, is_output: bool = False) -> RecordedChannel:
    """A marker or a model output by its positions, (frames, 3), NaN where it was not seen."""
    seen, kind = ~np.isnan(positions).any(axis=1), "model output" if is_output else "marker"
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    return RecordedChannel(kind, {"label": label}, unit, int(seen.sum()), rate, note, missing=missing, centre=centre)


def plate_channel(recording: C3DRecording, number: int) -> RecordedChannel:
    """A plate with its type and channels, the range of its force [N] and its middle, as far as they can be known."""
    load, centre = None, tuple[float, ...]()
    try:
        kind = int(plate_parameter(recording, "TYPE", number))
        own = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
        note = f"type {kind}, analog channels {own}"
    except InputError as error:
        note = str(error)
    with suppress(InputError):
        corners = plate_parameter(recording, "CORNERS", number, (3, 4)).mean(axis=1)
        source = model_of("c3d", KEYS["c3d"]).model_validate({"format": "c3d", "plates": [number]})
        (found,) = plate_loads(recording, source)
        load, centre = float(np.ptp(np.linalg.norm(found.force, axis=1))), tuple(corners.tolist())
        note += f", force changes by {load:.0f} N"
    return RecordedChannel("plate", {"plate": str(number)}, note=note, load=load, centre=centre)


def c3d_oddities(recording: C3DRecording) -> Iterator[str]:
    header, points, analogs = recording.header, recording.point_labels, recording.analog_labels
    if header.remark:
        yield header.remark
    for what, labels in (("marker", points), ("analog channel", analogs)):
        repeated = [f"'{label}' {count} times" for label, count in Counter(labels).items() if count > 1]
        yield from [f"{what}s of the same label: {listing(repeated)}"] * bool(repeated)
    rate, actual = header.numbers("ANALOG:RATE"), header.rate * header.samples_per_frame
    if header.channels and rate.size and abs(rate[0] - actual) > 1e-3 * actual:
        yield f"ANALOG:RATE is {rate[0]:g} Hz, the frames hold samples at {actual:g} Hz"
    for what, labels, count in (("points", points, header.points), ("analog channels", analogs, header.channels)):
        if len(labels) < count:
            yield f"{count - len(labels)} of {count} {what} have no label"


KINDS = {"Trajectories": "marker", "Model Outputs": "model output"}


def inspect_nexus(path: Path) -> Overview:
    """The sections' columns: one per trajectory, and per component of anything else."""
    facts, remarks, channels = {}, [], []
    for title, section in read_sections(path).items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        try:
            section.counts()
        except InputError as error:
            remarks.append(f"{title}: {error}")
        kind = KINDS.get(title, "device")
        for place, (name, component) in enumerate(zip(section.names, section.components, strict=True)):
            if not name or (kind == "marker" and component.casefold() != "x"):
                continue
            address = {"label": name} if kind == "marker" else {"device": name, "component": component}
            values, unit = section.values(place), section.units[place]
            missing = float(np.isnan(values).mean())
            note, seen = f"missing in {missing:.1%} of the rows" if missing else "", int((~np.isnan(values)).sum())
            channels.append(RecordedChannel(kind, address, unit, seen, section.rate, note, missing=missing))
    return Overview("nexus_csv", facts, channels, remarks)


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
