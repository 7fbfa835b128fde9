"""The force plates that a C3D file declares, with their channels in SI units.

FORCE_PLATFORM:ZERO, the frames of a baseline to subtract, is applied only if the source file asks for it: most files
name their first ten frames there, whether the plates were empty or not.
"""

from collections.abc import Sequence

import numpy as np

from osl_analysis.errors import InputError, printable
from osl_analysis.formats.c3d_file import C3DRecording
from osl_analysis.ingest.c3d_source import C3dSource, PlateUnits
from osl_analysis.ingest.capture import PlateLoad
from osl_analysis.ingest.force_plate import CHANNELS, ForcePlate
from osl_analysis.ingest.raw_channels import channel_facts
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array

QUANTITIES = {1: ("N",) * 3 + ("m",) * 2 + ("N*m",), 2: ("N",) * 3 + ("N*m",) * 3, 3: ("N",) * 8}

MOST_PLATES = 99


def plate_count(recording: C3DRecording) -> int:
    """How many plates the file says are in use."""
    used = recording.header.numbers("FORCE_PLATFORM:USED")
    if used.size and not 0 <= used[0] <= MOST_PLATES:
        raise InputError(f"FORCE_PLATFORM:USED is {used[0]:g}; correct it, or write plates: none")
    return int(used[0]) if used.size else 0


def plates_of(recording: C3DRecording, source: C3dSource) -> list[tuple[ForcePlate, Array]]:
    """The plates that the source file asks for, each with its channels (samples, channels) for `ForcePlate.wrench`.

    Raises
    ------
    InputError
        The file has no such plate, the plate lacks channels or parameters, or a unit is unknown.
    """
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
