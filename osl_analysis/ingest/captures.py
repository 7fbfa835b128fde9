"""Captures of a motion-capture laboratory, in C3D, TRC or the CSV export of Nexus, as canonical
columns.

Force plates of types 1 to 4 become force and moment on the foot (C3D manual, Kistler), about the
centre of the plate's surface, without a centre of pressure, so that they are valid for an unloaded
plate. The baseline FORCE_PLATFORM:ZERO is applied only where the source file asks: most files name
their first ten frames, of empty plates or not."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError, listing, naming, nearest, printable
from osl_analysis.ingest import source as sources
from osl_analysis.ingest.conversion import origin_of, to_si
from osl_analysis.old_formats.c3d import C3DHeader, C3DRecording, read_c3d
from osl_analysis.old_formats.gait_text import (
    NexusSection,
    read_sections,
    read_trc,
    without_subject,
)
from osl_analysis.old_formats.table import Ledger, Table
from osl_analysis.signals import run_at_extreme, runs
from osl_analysis.trial import AXES, Array, marker_columns, own_axes, plate_columns, unit_of
from osl_analysis.units import si_factor

Origins = dict[str, dict[str, Any]]
PlateRecord = tuple[dict[str, Array], Origins, dict[str, Any]]


def plate_record(
    plate: Mapping[str, Any],
    wrench: tuple[Array, Array],
    origin: Mapping[str, Any],
    channels: tuple[Sequence[str], Array, float],
    rotation: Array,
) -> PlateRecord:
    """Columns of one plate in our axes, (samples,) each, where they come from, and what the
    provenance says of it. plate: number, type (2 where forces and moments were exported) and
    corners, (4, 3) [m]. wrench: force [N] on the foot and moment [N*m] about the corners' centre,
    (samples, 3) each, in the file's axes. channels: names, samples (samples, channels) in the
    file's units, and rate [Hz] of the raw ones, of each of which the longest run at an extreme
    (`clipped_...`) and of one value while the force changes (`stands_...`) is told: the rotation
    hides it."""
    columns, origins, facts = dict[str, Array](), Origins(), []
    for quantity, values in zip(("force", "moment"), wrench, strict=True):
        for axis, column in enumerate(plate_columns(plate["plate"], quantity)):
            columns[column] = (values @ rotation.T)[:, axis]
            origins[column] = {"plate": plate["plate"], **origin, "si_unit": unit_of(column)}
    labels, raw, rate = channels
    load = np.linalg.norm(wrench[0], axis=1)
    # where the force changes by a fifth of its range every channel should; below 50 N the plate was
    # not used
    least = max(0.2 * float(np.ptp(load)), 50.0) if load.size else 50.0
    for label, values in zip(labels, raw.T, strict=True):
        clipped = run_at_extreme(values)
        alike = [slice(run.start, run.stop + 1) for run in runs(np.diff(values) == 0)]
        standing = [run for run in alike if np.ptp(load[run]) > least]
        longest = max(standing, key=lambda run: run.stop - run.start, default=slice(0, 0))
        at = float(values[clipped.start]) if clipped.stop > clipped.start else None
        shown: dict[str, Any] = {"label": label, "clipped_at": at}
        for what, run in (("clipped", clipped), ("stands", longest)):
            ends = (
                (run.start / rate, (run.stop - 1) / rate) if run.stop > run.start else (None, None)
            )
            shown |= {
                f"{what}_samples": int(run.stop - run.start),
                f"{what}_from_s": ends[0],
                f"{what}_to_s": ends[1],
            }
        facts.append(shown)
    corners = (plate["corners"] @ rotation.T).tolist()
    return columns, origins, {**plate, "corners": corners, "channels": facts}


def captured(
    source: sources.MarkerSource,
    timing: tuple[int, float, int, int],
    markers: Sequence[tuple[str, str, Array, str]] = (),
    outputs: Mapping[str, Array] | None = None,
    analogs: Mapping[str, tuple[Array, str]] | None = None,
    plates: Sequence[PlateRecord] = (),
    facts: Mapping[str, Any] | None = None,
    warnings: Sequence[str] = (),
    damage: Ledger | None = None,
) -> sources.Recording:
    """The columns that the source file asks for, in SI units and our axes: a row per analog sample,
    null where a frame has none; a marker that was not seen is NaN. timing: number of frames (frame
    0 and analog sample 0 are at 0 s), frame rate [Hz], samples per frame, and the laboratory's
    number of the first frame. markers: label, name in the columns, positions (frames, 3) and their
    unit. outputs (frames,) and analogs (samples,), with the unit that the file states, by canonical
    column. All are in the axes of the file."""
    frames, rate, samples_per_frame, first_frame = timing
    slow, origins = dict[str, Array](), Origins()
    for label, name, positions, unit in markers:
        factor = si_factor(unit, "m")
        for axis, column in enumerate(marker_columns(printable(name))):
            if column in slow:
                raise InputError(
                    f"marker '{name}' occurs twice; list those to read under `markers`"
                )
            slow[column] = factor * positions @ source.rotation[axis]
            origin = {"label": label, "component": source.axes[axis], "unit": unit}
            origins[column] = {**origin, "factor": factor, "si_unit": unit_of(column)}
    named = (
        source
        if isinstance(source, sources.LaboratorySource)
        else sources.LaboratorySource(format=source.format)
    )
    # in the unit of the source file, never in that of the file
    for column, values in (outputs or {}).items():
        slow[column] = to_si(named.outputs[column], values, unit_of(column))
        origins[column] = origin_of(named.outputs[column], column)
    fast = dict[str, Array]()
    for values_of_plate, origins_of_plate, _ in plates:
        fast |= values_of_plate
        origins |= origins_of_plate
    for column, (values, unit) in (analogs or {}).items():
        with naming(column, f", as {source.place('analogs', column, 'unit')}"):
            fast[column] = to_si(named.analogs[column], values, unit_of(column), unit)
        origins[column] = origin_of(named.analogs[column], column, unit)
    if not fast and not slow:
        what = (
            "the source file names nothing that the file has: no marker, plate, analog channel or"
            " model output"
        )
        raise InputError(
            f"{what}; name what to read in the source file, or export the trial again with it"
        )
    ratio = samples_per_frame if fast else 1
    time = np.arange(frames * ratio) / (rate * ratio)
    for column, values in fast.items():
        sources.check_values(column, values, time)
    said: dict[str, Any] = {
        "frame_rate_hz": rate,
        "samples_per_frame": samples_per_frame,
        "first_frame": first_frame,
    }
    said |= {"axes": source.axes, "plates": [fact for _, _, fact in plates], **(facts or {})}
    hidden = f"none of the {len(markers)} markers was seen in any of the {frames} frames"
    seen = not markers or any(np.isfinite(positions).any() for _, _, positions, _ in markers)
    rows, index = pl.DataFrame({"time": time, **fast}), pl.Series("index", np.arange(time.size))
    of_frames = pl.DataFrame(
        [index.gather_every(ratio), *(pl.Series(name, values) for name, values in slow.items())]
    )
    samples = (
        rows.with_columns(index)
        .join(of_frames, on="index", how="left", maintain_order="left")
        .drop("index")
    )
    return sources.Recording(
        samples, origins, said, [*warnings, *[hidden] * (not seen)], damage or Ledger()
    )


def is_labelled(name: str) -> bool:
    """Whether a marker has a name of its own: Nexus calls those that it did not label `*1`, `*2`,
    ..."""
    return bool(name) and not name.startswith("*")


def checked_length(unit: str, what: str, source: sources.C3dSource | sources.TrcSource) -> str:
    """The source file's unit of length, or else the recording's."""
    unit = source.point_unit or unit
    with naming(what, f", as {source.place('point_unit')}"):
        si_factor(unit, "m")
    return unit


def place_of_label(label: str, labels: Sequence[str], what: str) -> int:
    """Index of a label that must occur exactly once."""
    count = Counter(labels)[label]
    if count == 0:
        near = nearest(label, labels) or "; correct the name in the source file"
        raise InputError(f"no {what} '{label}'; the file has {listing(sorted(set(labels)))}{near}")
    if count > 1:
        raise InputError(
            f"{what} '{label}' occurs {count} times; rename them, or list others in the source file"
        )
    return labels.index(label)


def read_c3d_capture(path: Path, source: sources.C3dSource) -> sources.Recording:
    """The columns that the source file asks for, in SI units; frame 0 and analog sample 0 are at 0
    s."""
    recording = read_c3d(path)
    count = plate_count(recording.header)
    used = [
        number
        for number in (range(1, count + 1) if source.plates == "all" else source.plates)
        if number <= count
    ]
    with suppress(InputError):  # told below
        own = [plate_parameter(recording, "CHANNEL", number, (0,)) for number in used]
        stated = np.concatenate(own or [np.zeros(0)])
        recording = recording.without_end(
            [int(one) - 1 for one in stated if 1 <= one <= recording.header.channels]
        )
    header, points, labels = recording.header, recording.points, recording.point_labels
    plates = plate_loads(recording, source)
    names = source.markers
    if names == "all":  # but for model outputs and what has no label
        if header.points and not any(labels):
            how = "empty" if "POINT:LABELS" in header.parameters else "missing"
            raise InputError(
                f"POINT:LABELS is {how}: none of its {header.points} points has a name; label them"
                " and export the trial again, or leave them out with `markers: none`, as"
                f" {source.place('markers')}"
            )
        names = tuple(
            label for label in labels if is_labelled(label) and label not in recording.model_outputs
        )
    length = checked_length(recording.point_unit(), "unit of length", source) if names else ""
    markers = [
        (one, one, points[:, place_of_label(one, labels, "marker")], length) for one in names
    ]
    outputs = dict[str, Array]()
    for column, output in source.outputs.items():
        place = place_of_label(output.label, labels, "model output")
        outputs[column] = points[:, place, AXES.index(output.component)]
    analogs = {}
    for column, one in source.analogs.items():
        place = place_of_label(one.channel, recording.analog_labels, "analog channel")
        analogs[column] = recording.analogs[:, place], recording.analog_unit(place)
    facts: dict[str, Any] = {
        "plate_zero_frames": baseline_frames(recording, source) if plates else None
    }
    facts["body_mass_kg"] = next(iter(header.numbers("PROCESSING:BODYMASS").tolist()), None)
    said = list[str]()
    upward = "".join(header.texts("POINT:Y_SCREEN")[:1]).upper()
    if source.axes == ("x", "y", "z") and upward not in ("", "+Z", "-Z", "Z"):
        said.append(
            f"its vertical axis seems to be {printable(upward)}; state `axes` in the source file"
        )
    timing = (header.frames, header.rate, header.samples_per_frame, header.first_frame)
    return captured(
        source, timing, markers, outputs, analogs, plates, facts, said, recording.damage
    )


MEASURED_BY_TYPE = {
    1: ("N",) * 3 + ("m",) * 2 + ("N*m",),
    2: ("N",) * 3 + ("N*m",) * 3,
    3: ("N",) * 8,
    4: ("",) * 6,
}
"""By type of plate, what its channels measure in SI units; those of type 4 in the units of its
calibration."""


def wrench(
    kind: int, corners: Array, origin: Array, channels: Array, calibration: Array | None = None
) -> tuple[Array, Array]:
    """Force [N] and moment [N*m] of one plate about its surface's centre, (n, 3) each, in
    laboratory axes, on the foot. kind: 1 to 4, as in the C3D manual. corners: (4, 3) [m], in the
    quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of the plate's axes, whose z points down, with
    a negative Fz under load. origin: FORCE_PLATFORM:ORIGIN, (3,) [m]. channels: (n, channels) in
    [N], [N*m] and for type 1 [m]; for type 4 in the units of its `calibration` (6, 6)."""
    axes = own_axes(corners)
    # from the plate's origin to the surface's centre: the origin lies under the surface and z
    # points down, so z is negative; a file with a positive z stores the opposite vector
    centre = -origin if origin[2] > 0 else origin
    if calibration is not None:
        channels = channels @ calibration.T
    force = channels[:, :3]
    # Kistler's four sensors, at distances a and b, in a depth that files write with either sign
    if kind == 3:
        a, b, depth = origin[0], origin[1], abs(origin[2])
        x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
        force = np.column_stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
        about_z = b * (-x12 + x34) + a * (y14 - y23)
        moment = np.column_stack([b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4), about_z])
        centre = np.array([0.0, 0.0, -depth])
    elif kind == 1:  # centre of pressure x and y, free moment: M = p x F + (0, 0, T)
        level = np.zeros((len(channels), 2))
        moment = np.cross(np.column_stack([channels[:, 3:5], level[:, 0]]), force)
        moment += np.column_stack([level, channels[:, 5]])
    else:  # moments about the plate's origin
        moment = channels[:, 3:6]
    return force @ axes.T, (moment - np.cross(centre, force)) @ axes.T


def plate_count(header: C3DHeader) -> int:
    used = header.numbers("FORCE_PLATFORM:USED")
    if used.size and not 0 <= used[0] <= 99:
        raise InputError(f"FORCE_PLATFORM:USED is {used[0]:g}; correct it, or write plates: none")
    return int(used[0]) if used.size else 0


def plate_loads(recording: C3DRecording, source: sources.C3dSource) -> list[PlateRecord]:
    """What the plates that the source file asks for recorded."""
    count, loads = plate_count(recording.header), []
    for number in range(1, count + 1) if source.plates == "all" else source.plates:
        if not 1 <= number <= count:
            said = f"no force plate {number}; the file has {count}, counted from 1"
            raise InputError(f"{said}; correct `plates` in the source file")
        try:
            loads.append(plate_load(recording, source, number))
        except InputError as error:
            others = [other for other in range(1, count + 1) if other != number] or "none"
            raise InputError(f"{error} (or leave this plate out: `plates: {others}`)") from error
    return loads


def plate_load(recording: C3DRecording, source: sources.C3dSource, number: int) -> PlateRecord:
    """What one plate recorded, and from which channels. A matrix of type 4 has N times the file's
    unit of length."""
    header, labels = recording.header, recording.analog_labels
    length = checked_length(recording.point_unit(), "unit of length", source)
    metre, kind, matrix = (
        si_factor(length, "m"),
        int(plate_parameter(recording, "TYPE", number)),
        None,
    )
    corners = plate_parameter(recording, "CORNERS", number, (3, 4)).T * metre
    origin = plate_parameter(recording, "ORIGIN", number, (3,)) * metre
    if kind == 4:
        matrix = plate_parameter(recording, "CAL_MATRIX", number, (6, 6))
        if header.texts("FORCE_PLATFORM:MATRIX_STORE") == ["BYROW"]:
            matrix = matrix.T
        stated_units = source.plate_units
        moment_unit, force_unit = (
            (stated_units.moment, stated_units.force) if stated_units else (f"N*{length}", "N")
        )
        matrix = np.asarray(
            matrix
            * np.repeat([si_factor(force_unit, "N"), si_factor(moment_unit, "N*m")], 3)[:, None]
        )
    if kind not in MEASURED_BY_TYPE:
        raise InputError(f"plate {number} is of type {kind}; types 1 to 4 are read")
    if not np.isfinite(own_axes(corners)).all():
        raise InputError(
            f"plate {number}: its corners span no plane; correct FORCE_PLATFORM:CORNERS"
        )
    if kind == 3 and not origin[:2].all():
        said = f"plate {number} of type 3 has ORIGIN {origin.tolist()}"
        raise InputError(
            f"{said}; without its sensors' distances there is no moment: correct"
            " FORCE_PLATFORM:ORIGIN"
        )
    needed = len(MEASURED_BY_TYPE[kind])
    stated = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int)[:needed]
    if stated.size < needed or (stated < 1).any() or (stated > header.channels).any():
        said = f"plate {number} of type {kind} needs {needed} channels"
        given = f"FORCE_PLATFORM:CHANNEL gives {stated.tolist()} of the file's {header.channels}"
        raise InputError(f"{said}, {given}; correct it")
    numbers = [int(one) - 1 for one in stated]
    on_foot = wrench(
        kind, corners, origin, channels_in_si(recording, source, number, kind, numbers), matrix
    )
    units = [recording.analog_unit(n) for n in numbers]
    provenance = {"type": kind, "analogs": [n + 1 for n in numbers], "units": units}
    shown = [
        (printable(labels[n]) if n < len(labels) else "") or f"analog {n + 1}" for n in numbers
    ]
    raw = shown, recording.analogs[:, numbers], header.rate * header.samples_per_frame
    plate = {"plate": number, "type": kind, "corners": corners}
    return plate_record(plate, on_foot, provenance, raw, source.rotation)


def channels_in_si(
    recording: C3DRecording, source: sources.C3dSource, number: int, kind: int, numbers: list[int]
) -> Array:
    """The samples (samples, channels) of a plate's channels, counted from 0, in SI units; for type
    4 as they are."""
    values = recording.analogs[:, numbers]
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        said = (
            f"plate {number}: {values[row, column]} in sample {row + 1} of analog channel"
            f" {numbers[column] + 1}"
        )
        raise InputError(f"{said}; correct ANALOG:SCALE and GEN_SCALE, or export the trial again")
    frames = baseline_frames(recording, source)
    if frames is not None:
        ratio = recording.header.samples_per_frame
        unloaded = values[(frames[0] - 1) * ratio : frames[1] * ratio].mean(axis=0)
        if kind == 1:
            unloaded[3:5] = 0.0  # an unloaded plate has no centre of pressure
        values = values - unloaded
    if kind == 4:
        return values
    factors, stated = [], source.plate_units
    for channel, quantity in zip(numbers, MEASURED_BY_TYPE[kind], strict=True):
        unit = recording.analog_unit(channel)
        if stated:
            unit = {"N": stated.force, "N*m": stated.moment, "m": stated.length}[quantity] or unit
        try:
            factors.append(si_factor(unit, quantity))
        except InputError as error:
            fields = (
                "{force: N, moment: N*mm, length: mm}" if kind == 1 else "{force: N, moment: N*mm}"
            )
            raise InputError(
                f"analog channel {channel + 1}: {error}; or state the units that hold for all"
                f" plates, as in `plate_units: {fields}`, in"
                f" {source.place('plate_units').partition(' in ')[2]}"
            ) from error
    return np.asarray(values * np.array(factors))


def baseline_frames(recording: C3DRecording, source: sources.C3dSource) -> tuple[int, int] | None:
    """First and last frame, counted from 1, in which the plates are assumed to be unloaded; None
    without a baseline."""
    if source.plate_zero == "none":
        return None
    given = (
        recording.header.numbers("FORCE_PLATFORM:ZERO")
        if source.plate_zero == "file"
        else source.plate_zero
    )
    first, last = (
        (int(given[0]), int(given[1]))
        if len(given) >= 2 and np.isfinite(given[:2]).all()
        else (0, 0)
    )
    if not 1 <= first <= last <= recording.header.frames:
        said = (
            f"the baseline of the plates is frames {first} to {last} of {recording.header.frames}"
        )
        raise InputError(
            f"{said}; state two frames in which the plates are unloaded as `plate_zero`, or none"
        )
    return first, last


def plate_parameter(
    recording: C3DRecording, name: str, number: int, shape: tuple[int, ...] = ()
) -> Array:
    """One plate's part, of the given shape (0: any), of a FORCE_PLATFORM parameter. The last
    dimension counts plates. Some writers omit it if there is a single plate."""
    table = recording.header.table(f"FORCE_PLATFORM:{name}")
    whole = table[..., None] if table.ndim == len(shape) else table
    alike = (want in (0, size) for want, size in zip(shape, whole.shape, strict=False))
    fits = whole.ndim == len(shape) + 1 and all(alike)
    if not np.isfinite(table).all():
        raise InputError(
            f"plate {number}: FORCE_PLATFORM:{name} holds a value that is not finite; correct it"
        )
    if not fits or whole.shape[-1] < number:
        raise InputError(
            f"plate {number}: FORCE_PLATFORM:{name} has dimensions {table.shape}; correct or"
            " remove it"
        )
    return np.asarray(whole[..., number - 1])


def read_nexus_capture(path: Path, source: sources.NexusSource) -> sources.Recording:
    """The columns that the source file asks for, in SI units; the first frame is at 0 s."""
    sections = read_sections(path, source.delimiter, source.decimal)
    labels = source.markers
    if labels == "all":  # but for `*1`, a subject alone (`Anna:`) and nothing
        names = sections["Trajectories"].names if "Trajectories" in sections else []
        labels = tuple(dict.fromkeys(name for name in names if is_labelled(without_subject(name))))
    markers = []
    for label in labels:  # a marker was not seen where the cells are empty, or at the exact origin
        columns = [section_of(sections, "Trajectories").column(label, axis) for axis in AXES]
        positions = np.column_stack([values for values, _ in columns])
        positions[(positions == 0).all(axis=1)] = np.nan
        markers.append((label, without_subject(label), positions, columns[0][1]))
    outputs, analogs = dict[str, Array](), dict[str, tuple[Array, str]]()
    for column, output in source.outputs.items():
        outputs[column] = section_of(sections, "Model Outputs").column(
            output.label, output.component
        )[0]
    for column, analog in source.analogs.items():
        analogs[column] = section_of(sections, "Devices").column(analog.device, analog.component)
    plates, millimetre = [], 1e-3
    # force and moment about the centre of the plate, on the foot
    for number, plate in source.plates.items():
        devices, exported, names = section_of(sections, "Devices"), [], []
        for kind, si_unit in (("Force", "N"), ("Moment", "N*m")):
            columns = [
                devices.column(f"{plate.device} - {kind}", f"{kind[0]}{axis}") for axis in AXES
            ]
            exported.append(
                np.column_stack(
                    [plate.sign * si_factor(unit, si_unit) * one for one, unit in columns]
                )
            )
            names += [f"{plate.device} {kind[0]}{axis}" for axis in AXES]
        corners, force = np.array(plate.corners) * millimetre, exported[0]
        about = (
            np.array(plate.corners if plate.moment_about is None else [plate.moment_about])
            * millimetre
        )
        moment = exported[1] + np.cross(about.mean(axis=0) - corners.mean(axis=0), force)
        origin = {"device": plate.device, "sign": plate.sign}
        raw = names, np.hstack(exported), devices.rate
        about_plate = {"plate": number, "type": 2, "corners": corners}
        plates.append(plate_record(about_plate, (force, moment), origin, raw, source.rotation))
    slow = [
        title
        for title in ("Trajectories", "Model Outputs")
        if (markers or outputs) and title in sections
    ]
    used = [sections[title] for title in [*slow, *["Devices"] * bool(analogs or plates)]]
    if not used:
        raise InputError(
            "nothing to read; name markers, outputs, analogs or plates in the source file"
        )
    spans = set()
    for section in used:
        first, ratio = section.counts()
        spans.add((first, len(section.rows) / ratio, round(section.rate / ratio, 6)))
    if len(spans) != 1:
        said = (
            f"its sections differ in first frame, number of frames or frame rate: {sorted(spans)}"
        )
        raise InputError(f"{said}; export all of the same frames")
    first, frames, rate = spans.pop()
    if frames != int(frames):
        raise InputError("the last frame lacks sub frames; export the trial again")
    samples_per_frame = sections["Devices"].counts()[1] if analogs or plates else 1
    damage = Ledger(end_unknown=len(used) == 1)  # two sections would differ
    timing = int(frames), rate, samples_per_frame, first
    return captured(source, timing, markers, outputs, analogs, plates, damage=damage)


def section_of(sections: Mapping[str, NexusSection], title: str) -> NexusSection:
    if title not in sections:
        raise InputError(f"no section {title}; the file has {', '.join(sections)}; export it too")
    return sections[title]


def read_trc_capture(path: Path, source: sources.TrcSource) -> sources.Recording:
    """The markers that the source file asks for [m]; the first frame is at 0 s."""
    file = read_trc(path)
    unit = checked_length(file.unit, "Units", source)
    labels = (
        [one for one in file.labels if is_labelled(one)]
        if source.markers == "all"
        else source.markers
    )
    upward = "its vertical axis seems to be y; state `axes: [x, -z, y]` in the source file"
    warnings = [upward] * (source.axes == ("x", "y", "z") and vertical_axis(file.positions) == "y")
    markers = [
        (one, one, file.positions[:, place_of_label(one, file.labels, "marker")], unit)
        for one in labels
    ]
    timing, facts = (
        (file.positions.shape[0], file.rate, 1, file.first_frame),
        {"time": {"start": file.start}},
    )
    return captured(source, timing, markers, facts=facts, warnings=warnings, damage=file.damage)


def vertical_axis(positions: Array) -> str:
    """The axis along which the markers, (frames, markers, 3), keep their order: up, for somebody
    who stands or walks. Empty where the file does not tell: there are few markers, or they stay
    where they are."""
    seen = positions[:, ~np.isnan(positions).any(axis=(0, 2))]
    if seen.shape[1] < 4:
        return ""
    apart = np.median(seen, axis=0).std(axis=0)
    moved = np.median(seen.std(axis=0), axis=0)
    # along a vertical axis the markers move by less than half of what lies between them
    candidates = np.flatnonzero((apart == apart.max()) & (moved < 0.5 * apart))
    return "xyz"[candidates[0]] if candidates.size and moved.max() > moved[candidates[0]] else ""


def exported_plates(
    table: Table, recording: sources.Recording, source: sources.OpenSimSource
) -> sources.Recording:
    """A recording of a table of OpenSim with the plates that the source file names. OpenSim's files
    of ground reactions have, per plate, the force on the foot, the point at which it acts, and the
    moment about this point."""
    time = recording.samples["time"].to_numpy()
    if time.size != table.rows:
        what = "rows that repeat a stamp were left out, but the plates need all"
        raise InputError(f"{what}; remove `repeated: drop`, as {source.place('time', 'repeated')}")
    columns, facts = dict(recording.columns), []
    samples, rate = recording.samples, float(1 / np.median(np.diff(time))) if time.size > 1 else 1.0
    for number, plate in source.plates.items():
        names = exported_columns(plate)
        values = np.column_stack([table.columns[name] for name in names])
        for name, one in zip(names, values.T, strict=True):
            sources.check_values(f"column '{name}'", one, time)
        force, point, moment = (
            plate.sign * values[:, :3],
            values[:, 3:6],
            plate.sign * values[:, 6:],
        )
        about = moment + np.cross(point - np.mean(plate.corners, axis=0), force)
        origin, own = (
            plate.model_dump(include={"force", "point", "moment", "sign"}),
            [0, 1, 2, 6, 7, 8],
        )
        raw = [names[k] for k in own], values[:, own], rate
        about_plate = {
            "plate": number,
            "type": 2,
            "corners": np.array(plate.corners),
            "foot": plate.foot,
        }
        signals, origins, said = plate_record(
            about_plate, (force, about), origin, raw, source.rotation
        )
        samples = samples.with_columns(**{name: pl.Series(one) for name, one in signals.items()})
        columns |= origins
        facts.append(said)
    return replace(
        recording, samples=samples, columns=columns, facts={**recording.facts, "plates": facts}
    )


def exported_columns(plate: sources.OpenSimPlate) -> list[str]:
    """Names of the columns of a plate in a table of OpenSim: force, point of application and
    moment."""
    return [f"{begin}{axis}" for begin in (plate.force, plate.point, plate.moment) for axis in AXES]
