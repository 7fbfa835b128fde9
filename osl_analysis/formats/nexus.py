"""The CSV export of Vicon Nexus: devices, trajectories and model outputs in sections.

Sections stand in any order. Each has a title, a rate, a row of names, each above the first of its
columns only, a header, a row of units, and samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt

from osl_analysis.errors import InputError, listing
from osl_analysis.formats._cells import decimal_of, is_number_cell
from osl_analysis.formats._text import (
    Decimal,
    Delimiter,
    Row,
    check_last_line,
    column_of,
    decoded,
    delimiter_of,
    is_text,
    numbered,
    read_text,
    split_rows,
    unpadded,
)
from osl_analysis.recording import (
    EXPORTED,
    Channel,
    End,
    Format,
    Kind,
    Loss,
    Plate,
    Recording,
    Rows,
)
from osl_analysis.source_file import Channel as ChannelSettings
from osl_analysis.source_file import Corner, ExportedPlate, LaboratorySource, Name
from osl_analysis.trial import AXES

HEAD_ROWS = 5  # title, rate, names, header, units
TRAJECTORIES = "Trajectories"
MODEL_OUTPUTS = "Model Outputs"


class DeviceChannel(ChannelSettings):
    """A column of a device."""

    ADDRESS = "component"
    BESIDE = ("device",)
    device: Name  # Name of the device's output, such as `EMG2000 - Voltage`.
    component: Name  # Name of the column under it.


class NexusPlate(ExportedPlate):
    """A force plate of the export."""

    device: str  # The plate's outputs are called `<device> - Force` and `<device> - Moment`.
    corners: tuple[Corner, Corner, Corner, Corner]  # Of the surface in the file's axes [mm].
    # About which the file takes the moment [mm]; without it the corners' centre.
    moment_about: Corner | None = None


class NexusSource(LaboratorySource):
    """The source file of exports of Nexus."""

    OF = " of format nexus_csv"
    analogs: Mapping[str, DeviceChannel] = Field(default={})
    plates: Mapping[PositiveInt, NexusPlate] = Field(default={})  # Force plates by number, from 1.
    delimiter: Delimiter = "auto"  # Sign between cells.
    # Decimal sign; `auto` takes the one that the numbers have.
    decimal: Decimal = "auto"


@dataclass(frozen=True)
class Section:
    """One section of an export."""

    title: str
    rate_hz: float  # of its rows
    names: list[str]  # of every column: `Anna:LTOE`, `EMG2000 - Voltage`
    components: list[str]  # of every column: X, Y, Z, Fx ..
    units: list[str]  # of every column, as Nexus spells it
    rows: list[Row]  # the first two cells are the numbers of frame and sub frame
    decimal: str

    def values(self, place: int) -> NDArray[np.float64]:
        """Read one column, (rows,); NaN where a cell is empty."""
        title = f"{self.names[place]} {self.components[place]}"
        return column_of(self.rows, place, ("",), title, self.decimal)

    def positions(self, places: Sequence[int]) -> NDArray[np.float64]:
        """Read three columns, (rows, 3); NaN where a marker was not seen: where cells are empty, or
        at the exact origin."""
        positions = np.column_stack([self.values(place) for place in places])
        positions[(positions == 0).all(axis=1)] = np.nan
        return positions

    def frames(self) -> tuple[int, int]:
        """First frame, and samples per frame.

        Raises
        ------
        InputError
            Frames do not follow one another.
        """
        frame = self.values(0)
        sub_frame = self.values(1)
        samples_per_frame = int(np.nanmax(sub_frame, initial=0.0)) + 1
        place = (frame - frame[0]) * samples_per_frame + sub_frame
        follows = place == np.arange(frame.size)
        if not follows.all():
            row = int(np.argmin(follows))
            raise InputError(
                f"line {self.rows[row].number}: frame {frame[row]:g}, sub frame"
                f" {sub_frame[row]:g} does not follow the line before; export the trial again with"
                " all its frames"
            )
        return int(frame[0]), samples_per_frame


def without_subject(name: str) -> str:
    """Write `Anna:LTOE` as `LTOE`."""
    return name.rpartition(":")[2]


def read_sections(path: Path, source: NexusSource | None) -> dict[str, Section]:
    """Read the sections by title.

    Raises
    ------
    InputError
        There is no section, one has no samples, or stands twice.
    """
    text = read_text(path)
    lines = numbered(text.data)
    headers = [line for line in lines if line.text.lstrip('"').casefold().startswith("frame")]
    source = source or NexusSource.model_construct()
    rows = split_rows(lines, delimiter_of(headers[:1], source.delimiter))
    starts = [place for place in range(len(rows) - 3) if _begins_section(rows, place)]
    if not starts:
        raise InputError(
            "no section of a Nexus export (Devices, Trajectories, ...); check the source's format"
        )
    check_last_line(text.is_ended, rows[starts[-1] + HEAD_ROWS :] or rows[-1:])
    sections: dict[str, Section] = {}
    decimal = source.decimal
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=True):
        section = _section_of(rows[start:end], decimal)
        if section.title in sections:
            raise InputError(
                f"line {rows[start].number}: section {section.title} stands twice; export one of"
                " each"
            )
        sections[section.title] = section
    if decimal == "auto" and any(section.decimal == "," for section in sections.values()):
        # a file has one sign, which a section at rest at both ends does not show
        sections = {title: replace(each, decimal=",") for title, each in sections.items()}
    return sections


def _begins_section(rows: Sequence[Row], place: int) -> bool:
    """Tell whether a title alone stands in a row, a rate alone in the next, and two rows below
    that a header."""
    title = rows[place].cells
    rate = rows[place + 1].cells
    header = [cell.casefold() for cell in rows[place + 3].cells[:2]]
    are_alone = bool(title[0]) and not any(title[1:]) and not any(rate[1:])
    return are_alone and header == ["frame", "sub frame"]


def _section_of(rows: Sequence[Row], decimal: str) -> Section:
    title = rows[0].cells[0]
    rate = rows[1].cells[0].replace(",", ".")
    if not is_number_cell(rate):
        raise InputError(
            f"line {rows[1].number}: '{rate[:40]}' is not a rate; export the trial again"
        )
    samples = list(rows[HEAD_ROWS:])
    if not samples or float(rate) <= 0:
        raise InputError(
            f"section {title[:40]} at {float(rate):g} Hz has no samples; export without it"
        )
    components = unpadded(rows[3].cells)
    width = len(components)
    names: list[str] = []  # of every column: the one above it, or else the nearest to the left
    name = ""
    for above in _padded(rows[2].cells, width):
        name = above or name
        names.append(name)
    if decimal == "auto":
        decimal = decimal_of([row.cells for row in samples])
    units = _padded(rows[4].cells, width)
    return Section(title, float(rate), names, components, units, samples, decimal)


def _padded(cells: Sequence[str], width: int) -> list[str]:
    return [*cells, *[""] * width][:width]


def read(path: Path, source: NexusSource | None) -> Recording:
    """Read an export. Its first frame is at 0 s."""
    sections = read_sections(path, source)
    channels: list[Channel] = []
    facts: dict[str, object] = {}
    for section in sections.values():
        rows = Rows(len(section.rows), section.title, section.rate_hz, noun="row")
        if section.title in (TRAJECTORIES, MODEL_OUTPUTS):
            channels += _points_of(section, rows)
        else:
            for place, component in enumerate(section.components):
                if place < 2 or not section.names[place]:
                    continue
                channels.append(
                    Channel(
                        address={"device": section.names[place], "component": component},
                        rows=rows,
                        read=partial(section.values, place),
                        name=component,
                        unit=section.units[place],
                    )
                )
        facts[section.title] = f"{len(section.rows)} rows at {section.rate_hz:g} Hz"
    used = _used_sections(sections, source)
    end = End.WHOLE if len(used) > 1 else End.UNKNOWN  # two sections would differ
    if source is not None:
        facts |= _timing_of(used)
    count = max(len(section.rows) for section in sections.values())
    recording = Recording(
        format="nexus_csv",
        channels=channels,
        loss=Loss(count, count, end),
        facts=facts,
        find_unlisted=partial(_find_column, sections, channels),
    )
    described = {} if source is None else source.plates
    plates = [_plate_of(recording, number, settings) for number, settings in described.items()]
    return replace(recording, plates=plates)


def _plate_of(recording: Recording, number: int, settings: NexusPlate) -> Plate:
    """Describe a plate whose force and moment were exported."""
    channels = [
        recording.find(
            {"device": f"{settings.device} - {quantity}", "component": f"{quantity[0]}{axis}"}
        )
        for quantity in ("Force", "Moment")
        for axis in AXES
    ]
    corners = np.array(settings.corners)
    about = corners.mean(axis=0)
    if settings.moment_about is not None:
        about = np.array(settings.moment_about)
    return Plate(
        number=number,
        type=EXPORTED,
        corners=corners,
        origin=about,
        channels=channels,
        length_unit="mm",
        sign=settings.sign,
        facts={"device": settings.device, "sign": settings.sign},
    )


def _points_of(section: Section, rows: Rows) -> list[Channel]:
    """The markers or model outputs of a section, with three components each."""
    is_marker = section.title == TRAJECTORIES
    channels: list[Channel] = []
    for place in range(2, len(section.components) - 2):
        components = [component.casefold() for component in section.components[place : place + 3]]
        name = section.names[place]
        if tuple(components) != AXES or not name:
            continue
        places = (place, place + 1, place + 2)
        channels.append(
            Channel(
                address={"label": name},
                rows=rows,
                read=partial(section.positions, places),
                name=without_subject(name),
                # the unit of an output is that of the source file: files misstate it
                unit=section.units[place] if is_marker else "",
                kind=Kind.MARKER if is_marker else Kind.MODEL_OUTPUT,
            )
        )
    return channels


def _find_column(
    sections: Mapping[str, Section], channels: Sequence[Channel], address: Mapping[str, str]
) -> Channel | None:
    """Find a device's column without its subject, in any case."""
    device = address.get("device")
    if device is None:
        if TRAJECTORIES in sections:
            return None
        raise InputError(
            f"no section {TRAJECTORIES}; the file has {', '.join(sections)}; export it too"
        )
    columns = [channel for channel in channels if "device" in channel.address]
    if not columns:
        raise InputError(f"no section Devices; the file has {', '.join(sections)}; export it too")
    component = address["component"].casefold()
    alike = [channel for channel in columns if channel.address["component"].casefold() == component]
    exact = [channel for channel in alike if channel.address["device"] == device]
    matches = exact or [
        channel for channel in alike if without_subject(channel.address["device"]) == device
    ]
    if len(matches) == 1:
        return matches[0]
    count = f"occurs {len(matches)} times" if matches else "is missing"
    names = sorted({channel.key for channel in columns})
    raise InputError(
        f"'{device}' {address['component']} {count} under Devices; there are {listing(names)};"
        " correct the name in the source file"
    )


def _used_sections(
    sections: Mapping[str, Section], source: NexusSource | None
) -> dict[str, Section]:
    """The sections that a source file asks for."""
    if source is None:
        return dict(sections)
    titles: list[str] = []
    if source.markers or source.outputs:
        titles += [TRAJECTORIES, MODEL_OUTPUTS]
    if source.analogs or source.plates:
        titles += [title for title in sections if title not in (TRAJECTORIES, MODEL_OUTPUTS)]
    used = {title: sections[title] for title in titles if title in sections}
    if not used:
        raise InputError(
            "nothing to read; name markers, outputs, analogs or plates in the source file"
        )
    return used


def _timing_of(sections: Mapping[str, Section]) -> dict[str, object]:
    """Frames and rates, which all sections must share."""
    spans: set[tuple[int, float, float]] = set()
    most_samples = 1
    for section in sections.values():
        first, samples_per_frame = section.frames()
        most_samples = max(most_samples, samples_per_frame)
        frames = len(section.rows) / samples_per_frame
        spans.add((first, frames, round(section.rate_hz / samples_per_frame, 6)))
    if len(spans) != 1:
        raise InputError(
            "its sections differ in first frame, number of frames or frame rate:"
            f" {sorted(spans)}; export all of the same frames"
        )
    first, frames, frame_rate_hz = spans.pop()
    if frames != int(frames):
        raise InputError("the last frame lacks sub frames; export the trial again")
    return {
        "frames": int(frames),
        "first_frame": first,
        "frame_rate_hz": frame_rate_hz,
        "samples_per_frame": most_samples,
    }


def _begins(begin: bytes) -> bool:
    """Tell whether the header of a section stands in the beginning."""
    if not is_text(begin):
        return False
    text = decoded(begin).casefold().replace('"', "")
    return any(line.startswith("frame") and "sub frame" in line for line in text.splitlines())


FORMAT = Format(
    name="nexus_csv", suffixes=(), begins=_begins, source=NexusSource, read=read, priority=1
)
