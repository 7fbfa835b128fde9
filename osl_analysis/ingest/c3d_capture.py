"""A capture in C3D: its source file, its signals, its force plates, and what it holds.

FORCE_PLATFORM:ZERO, the frames of a baseline to subtract, is applied only if the source file asks for it: most files
name their first ten frames there, whether the plates were empty or not.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, PositiveInt

from osl_analysis.columns import AXES
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.formats.c3d import C3DRecording, Counts, CountsError, read_c3d
from osl_analysis.ingest.capture import Capture, MarkerTrack, PlateLoad, is_labelled, recording_of
from osl_analysis.ingest.overview import UNKNOWN, Overview, RecordedChannel
from osl_analysis.ingest.plates import CHANNELS, ForcePlate, channel_facts
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, Conversion, all_none_or_list
from osl_analysis.ingest.units import ForceUnit, LengthUnit, MomentUnit, si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings


class PlateUnits(Settings):
    """Units of the plates' channels where the file's ANALOG:UNITS are absent or wrong."""

    force: ForceUnit
    """Unit of the force channels."""
    moment: MomentUnit
    """Unit of the moment channels."""
    length: LengthUnit | None = None
    """Unit of the centre of pressure of a type 1 plate; null: the file's."""


class C3dAnalog(Conversion):
    """One analog channel of a C3D file. Without `unit`, the unit in the file's ANALOG:UNITS is used."""

    channel: str
    """Label of the channel in the file."""


class C3dSource(CaptureSource):
    """A capture in C3D."""

    format: Literal["c3d"]
    """Format of the file."""
    analogs: dict[str, C3dAnalog] = Field(default={})
    """The analog channel of each canonical column."""
    counts: Counts = "refuse"
    """Which counts of points and analog channels hold where the file's header and its parameters contradict each other:
    header, parameters, or refuse."""
    point_unit: LengthUnit | None = None
    """Unit of length, where the file's POINT:UNITS is absent or wrong."""
    plates: Annotated[Literal["all"] | tuple[int, ...], BeforeValidator(all_none_or_list)] = "all"
    """The force plates to read: all, none or a list counted from 1."""
    plate_units: PlateUnits | None = None
    """Units of the plates' channels, where the file's ANALOG:UNITS are absent or wrong."""
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"
    """Baseline to subtract from the plates' channels: none, file (the frames of FORCE_PLATFORM:ZERO) or two frames,
    counted from 1, between which the plates were unloaded."""

    def unit_of_length(self, recording: C3DRecording) -> str:
        """The source file's unit of length, or else the recording's."""
        unit = self.point_unit or recording.point_unit()
        try:
            si_factor(unit, "m")
        except InputError as error:
            raise InputError(f"unit of length: {error}, as {self.place('point_unit')}") from error
        return unit


def read_c3d_capture(path: Path, source: C3dSource) -> Recording:
    """The columns that the source file asks for, in SI units; frame 0 and analog sample 0 are at 0 s."""
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
    """Labels of the markers to read; "all" excludes model outputs and what has no label."""
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


QUANTITIES = {1: ("N",) * 3 + ("m",) * 2 + ("N*m",), 2: ("N",) * 3 + ("N*m",) * 3, 3: ("N",) * 8}

MOST_PLATES = 99


def plate_count(recording: C3DRecording) -> int:
    used = recording.header.numbers("FORCE_PLATFORM:USED")
    if used.size and not 0 <= used[0] <= MOST_PLATES:
        raise InputError(f"FORCE_PLATFORM:USED is {used[0]:g}; correct it, or write plates: none")
    return int(used[0]) if used.size else 0


def plates_of(recording: C3DRecording, source: C3dSource) -> list[tuple[ForcePlate, Array]]:
    """The plates that the source file asks for, each with its channels (samples, channels) for `ForcePlate.wrench`."""
    count = plate_count(recording)
    wanted = range(1, count + 1) if source.plates == "all" else source.plates
    plates = []
    for number in wanted:
        if not 1 <= number <= count:
            raise InputError(
                f"no force plate {number}; the file has {count}, counted from 1; correct `plates` in the source file"
            )
        try:
            plate = c3d_plate(recording, source, number)
            plates.append((plate, channels_in_si(recording, source, plate)))
        except InputError as error:
            others = [other for other in range(1, count + 1) if other != number] or "none"
            raise InputError(f"{error} (or leave this plate out: `plates: {others}`)") from error
    return plates


def plate_loads(recording: C3DRecording, source: C3dSource) -> list[PlateLoad]:
    """What the plates that the source file asks for recorded, and from which channels."""
    loads = []
    for plate, channels in plates_of(recording, source):
        numbers = channel_numbers(recording, plate)
        units = [recording.analog_unit(number) for number in numbers]
        origin = {"type": plate.type, "analogs": [n + 1 for n in numbers], "units": units}
        force, moment = plate.wrench(channels)
        rate = recording.header.rate * recording.header.samples_per_frame
        raw = channel_facts(channel_labels(recording, numbers), recording.analogs[:, numbers], force, rate)
        loads.append(PlateLoad(plate.number, plate.type, plate.corners, force, moment, origin, raw))
    return loads


def channel_labels(recording: C3DRecording, numbers: Sequence[int]) -> list[str]:
    """Labels of analog channels counted from 0; the number from 1 of a channel without a label."""
    labels = recording.analog_labels
    named = {number: printable(labels[number]) for number in numbers if number < len(labels)}
    return [named.get(number) or f"analog {number + 1}" for number in numbers]


def c3d_plate(recording: C3DRecording, source: C3dSource, number: int) -> ForcePlate:
    """Geometry of one plate in SI units, in the axes of the file."""
    metre = si_factor(source.unit_of_length(recording), "m")
    kind = int(plate_parameter(recording, "TYPE", number))
    return ForcePlate(
        number,
        kind,
        plate_parameter(recording, "CORNERS", number, (3, 4)).T * metre,
        plate_parameter(recording, "ORIGIN", number, (3,)) * metre,
        calibration(recording, source, number) if kind == 4 else None,
    )


def calibration(recording: C3DRecording, source: C3dSource, number: int) -> Array:
    """Matrix of a type 4 plate; its moments are in N times the file's unit of length unless overridden."""
    matrix = plate_parameter(recording, "CAL_MATRIX", number, (6, 6))
    if recording.header.texts("FORCE_PLATFORM:MATRIX_STORE") == ["BYROW"]:
        matrix = matrix.T
    units = source.plate_units
    moment = units.moment if units else f"N*{source.unit_of_length(recording)}"
    force_factor = si_factor(units.force, "N") if units else 1.0
    return np.asarray(matrix * np.repeat([force_factor, si_factor(moment, "N*m")], 3)[:, None])


def channel_numbers(recording: C3DRecording, plate: ForcePlate) -> list[int]:
    """The plate's analog channels, counted from 0."""
    needed = CHANNELS[plate.type]
    numbers = plate_parameter(recording, "CHANNEL", plate.number, (0,)).astype(int)[:needed]
    if numbers.size < needed or (numbers < 1).any() or (numbers > recording.header.channels).any():
        raise InputError(
            f"plate {plate.number} of type {plate.type} needs {needed} channels, FORCE_PLATFORM:CHANNEL gives "
            f"{numbers.tolist()} of the file's {recording.header.channels}; correct it"
        )
    return [int(number) - 1 for number in numbers]


def channels_in_si(recording: C3DRecording, source: C3dSource, plate: ForcePlate) -> Array:
    """The plate's samples (samples, channels) in SI units; for type 4 as they are, for the calibration."""
    numbers = channel_numbers(recording, plate)
    values = recording.analogs[:, numbers]
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise InputError(
            f"plate {plate.number}: {values[row, column]} in sample {row + 1} of analog channel {numbers[column] + 1}; "
            "correct ANALOG:SCALE and GEN_SCALE, or export the trial again"
        )
    unloaded = baseline(values, recording, source)
    if plate.type == 1:
        unloaded[3:5] = 0.0  # an unloaded plate has no centre of pressure
    values = values - unloaded
    if plate.type == 4:
        return values
    units = [
        plate_factor(recording, source, n, quantity, plate.type)
        for n, quantity in zip(numbers, QUANTITIES[plate.type], strict=True)
    ]
    return np.asarray(values * np.array(units))


def baseline(values: Array, recording: C3DRecording, source: C3dSource) -> Array:
    """Mean of the channels (samples, channels) over the frames of the baseline, (channels,); zero without one."""
    frames = baseline_frames(recording, source)
    if frames is None:
        return np.zeros(values.shape[1])
    ratio = recording.header.samples_per_frame
    return np.asarray(values[(frames[0] - 1) * ratio : frames[1] * ratio].mean(axis=0))


def baseline_frames(recording: C3DRecording, source: C3dSource) -> tuple[int, int] | None:
    """First and last frame, counted from 1, in which the plates are assumed to be unloaded; None without a baseline."""
    if source.plate_zero == "none":
        return None
    given = recording.header.numbers("FORCE_PLATFORM:ZERO") if source.plate_zero == "file" else source.plate_zero
    first, last = (int(given[0]), int(given[1])) if len(given) >= 2 and np.isfinite(given[:2]).all() else (0, 0)
    if not 1 <= first <= last <= recording.header.frames:
        raise InputError(
            f"the baseline of the plates is frames {first} to {last} of {recording.header.frames}; state two frames "
            "in which the plates are unloaded as `plate_zero`, or none"
        )
    return first, last


def plate_factor(recording: C3DRecording, source: C3dSource, channel: int, quantity: str, kind: int) -> float:
    """Factor of a channel, counted from 0, of a plate of type `kind` to the SI unit of its quantity."""
    unit = recording.analog_unit(channel)
    if source.plate_units:
        unit = stated_unit(source.plate_units, quantity) or unit
    try:
        return si_factor(unit, quantity)
    except InputError as error:
        fields = "{force: N, moment: N*mm, length: mm}" if kind == 1 else "{force: N, moment: N*mm}"
        raise InputError(
            f"analog channel {channel + 1}: {error}; or state the units that hold for all plates, as in "
            f"`plate_units: {fields}`, in {source.place('plate_units').partition(' in ')[2]}"
        ) from error


def stated_unit(units: PlateUnits, quantity: str) -> str | None:
    """The unit that the source file states for channels of a quantity, given by its SI unit."""
    return {"N": units.force, "N*m": units.moment, "m": units.length}[quantity]


def plate_parameter(recording: C3DRecording, name: str, number: int, shape: tuple[int, ...] = ()) -> Array:
    """One plate's part, of the given shape (0: any), of a FORCE_PLATFORM parameter.

    The last dimension counts plates. Some writers omit it if there is a single plate.
    """
    table = recording.header.table(f"FORCE_PLATFORM:{name}")
    whole = table[..., None] if table.ndim == len(shape) else table
    fits = whole.ndim == len(shape) + 1 and all(
        want in (0, size) for want, size in zip(shape, whole.shape, strict=False)
    )
    if not np.isfinite(table).all():
        raise InputError(f"plate {number}: FORCE_PLATFORM:{name} holds a value that is not finite; correct it")
    if not fits or whole.shape[-1] < number:
        raise InputError(f"plate {number}: FORCE_PLATFORM:{name} has dimensions {table.shape}; correct or remove it")
    return np.asarray(whole[..., number - 1])


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates."""
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
        (load,) = plate_loads(recording, C3dSource(format="c3d", plates=(number,)))
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
