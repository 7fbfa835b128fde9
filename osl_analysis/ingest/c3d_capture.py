"""A capture in C3D: the signals that its source file names, before conversion."""

from collections import Counter
from pathlib import Path

from osl_analysis.columns import AXES
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.formats.c3d_file import C3DRecording, read_c3d
from osl_analysis.ingest.c3d_plates import baseline_frames, plate_loads
from osl_analysis.ingest.c3d_source import C3dSource
from osl_analysis.ingest.capture import Capture, MarkerTrack, is_labelled, recording_of
from osl_analysis.ingest.recording import Recording
from osl_analysis.trial import Array


def read_c3d_capture(path: Path, source: C3dSource) -> Recording:
    """The columns that the source file asks for, in SI units; frame 0 and analog sample 0 are at 0 s.

    Raises
    ------
    InputError
        The file cannot be read, a marker, plate or channel is missing or named twice, a unit is unknown, or an
        analog value is not finite.
    """
    recording = read_c3d(path, source.counts)
    try:
        return recording_of(c3d_capture(recording, source), source)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def c3d_capture(recording: C3DRecording, source: C3dSource) -> Capture:
    """The signals that the source file names, before conversion to SI units."""
    header, plates = recording.header, plate_loads(recording, source)
    markers = [c3d_track(recording, label, source) for label in c3d_markers(recording, source)]
    analogs = {column: analog_channel(recording, analog.channel) for column, analog in source.analogs.items()}
    return Capture(
        frames=header.frames,
        frame_rate=header.rate,
        samples_per_frame=header.samples_per_frame,
        first_frame=header.first_frame,
        markers=markers,
        outputs={column: point(recording, o.label, o.component) for column, o in source.outputs.items()},
        analogs=analogs,
        plates=plates,
        facts={
            "plate_zero_frames": baseline_frames(recording, source) if plates else None,
            "body_mass_kg": next(iter(header.numbers("PROCESSING:BODYMASS").tolist()), None),
        },
        warnings=c3d_warnings(recording, source),
    )


def c3d_markers(recording: C3DRecording, source: C3dSource) -> tuple[str, ...]:
    """Labels of the markers to read; "all" excludes model outputs and what has no label.

    Raises
    ------
    InputError
        All are to be read, and no point has a label.
    """
    if source.markers != "all":
        return source.markers
    outputs, count = recording.model_outputs, recording.header.points
    if count and not any(recording.point_labels):
        how = "empty" if "POINT:LABELS" in recording.header.parameters else "missing"
        raise InputError(
            f"POINT:LABELS is {how}: none of its {count} points has a name; label them and export the trial again, or "
            f"leave them out with `markers: none`, as {source.place('markers')}"
        )
    return tuple(label for label in recording.point_labels if is_labelled(label) and label not in outputs)


def c3d_track(recording: C3DRecording, label: str, source: C3dSource) -> MarkerTrack:
    """One marker by its label."""
    place = place_of(label, recording.point_labels, "marker")
    return MarkerTrack(label, label, recording.points[:, place], source.unit_of_length(recording))


def point(recording: C3DRecording, label: str, component: str) -> Array:
    """One component of a model output, (frames,)."""
    place = place_of(label, recording.point_labels, "model output")
    return recording.points[:, place, AXES.index(component)]


def analog_channel(recording: C3DRecording, label: str) -> tuple[Array, str]:
    """One analog channel, (samples,), and the unit that the file states."""
    place = place_of(label, recording.analog_labels, "analog channel")
    return recording.analogs[:, place], recording.analog_unit(place)


def place_of(label: str, labels: list[str], what: str) -> int:
    """Index of a label that must occur exactly once."""
    count = Counter(labels)[label]
    if count == 0:
        raise InputError(
            f"no {what} '{label}'; the file has {listing(sorted(set(labels)))}"
            f"{nearest(label, labels) or '; correct the name in the source file'}"
        )
    if count > 1:
        raise InputError(f"{what} '{label}' occurs {count} times; rename them, or list others in the source file")
    return labels.index(label)


def c3d_warnings(recording: C3DRecording, source: C3dSource) -> list[str]:
    """Warnings about the recording."""
    found, name, header = [], printable(recording.path.name), recording.header
    if header.remark:
        found.append(f"{name}: {printable(header.remark)}")
    rate = header.numbers("ANALOG:RATE")
    actual = header.rate * header.samples_per_frame
    if header.channels and rate.size and abs(rate[0] - actual) > 1e-3 * actual:
        found.append(f"{name}: ANALOG:RATE is {rate[0]} Hz, the frames hold samples at {actual} Hz; the latter is used")
    upward = "".join(header.texts("POINT:Y_SCREEN")[:1]).upper()
    if source.axes == ("x", "y", "z") and upward not in ("", "+Z", "-Z", "Z"):
        found.append(f"{name}: its vertical axis seems to be {printable(upward)}; state `axes` in the source file")
    return found
