"""What a C3D file holds."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d_file import C3DRecording, read_c3d
from osl_analysis.ingest.c3d_plates import parameter, plate_count
from osl_analysis.ingest.overview import Channel, Overview


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates.

    Raises
    ------
    InputError
        The file cannot be read; the message says where it is damaged.
    """
    recording = read_c3d(path)
    header = recording.header
    facts = {
        "processor": header.processor,
        "frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz",
        "unit of length": recording.point_unit() or "none",
        "force plates": str(plate_count(recording)),
        "vertical on screen": "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said",
        "software": " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said",
    }
    channels = [*points(recording), *analogs(recording), *plates(recording)]
    return Overview("c3d", facts, channels, list(remarks(recording)))


def points(recording: C3DRecording) -> Iterator[Channel]:
    """Markers, and the model outputs that are stored like them."""
    header, outputs = recording.header, recording.model_outputs
    for place, label in enumerate(recording.point_labels[: header.points]):
        seen = ~np.isnan(recording.points[:, place, 0])
        note = "" if seen.all() else f"missing in {1 - seen.mean():.1%} of the frames"
        kind = "model output" if label in outputs else "marker"
        unit = "" if kind == "model output" else recording.point_unit()
        yield Channel(kind, {"label": label}, unit, int(seen.sum()), header.rate, note)


def analogs(recording: C3DRecording) -> Iterator[Channel]:
    """Analog channels with their range."""
    header = recording.header
    rate = header.rate * header.samples_per_frame
    for place, label in enumerate(recording.analog_labels):
        values = recording.analogs[:, place]
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        yield Channel("analog", {"channel": label}, recording.analog_unit(place), values.size, rate, note)


def plates(recording: C3DRecording) -> Iterator[Channel]:
    """Force plates with their type and analog channels."""
    for number in range(1, plate_count(recording) + 1):
        try:
            kind = int(parameter(recording, "TYPE", number))
            own = parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
            note = f"type {kind}, analog channels {own}"
        except InputError as error:
            note = str(error)
        yield Channel("plate", {"plate": str(number)}, note=note)


def remarks(recording: C3DRecording) -> Iterator[str]:
    """Oddities that a source file may have to settle."""
    header = recording.header
    for what, labels in (("marker", recording.point_labels), ("analog channel", recording.analog_labels)):
        yield from (f"{what} '{label}' stands {n} times" for label, n in Counter(labels).items() if n > 1)
    rate, actual = header.numbers("ANALOG:RATE"), header.rate * header.samples_per_frame
    if header.channels and rate.size and abs(rate[0] - actual) > 1e-3 * actual:
        yield f"ANALOG:RATE is {rate[0]:g} Hz, the frames hold samples at {actual:g} Hz"
    for what, labels, count in (
        ("points", recording.point_labels, header.points),
        ("analog channels", recording.analog_labels, header.channels),
    ):
        if len(labels) < count:
            yield f"{count - len(labels)} of {count} {what} have no label"
