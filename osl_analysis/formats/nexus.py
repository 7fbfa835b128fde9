# SPDX-License-Identifier: Apache-2.0
"""The CSV export of Vicon Nexus: devices, trajectories and model outputs in sections.

Sections stand in any order. Each has a title, a rate, a row of names, each above the first of its
columns only, a header, a row of units, and samples.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate
from pathlib import Path

import numpy as np
from pydantic import Field, PositiveInt

from osl_analysis.base.errors import InputError, shortened
from osl_analysis.base.recording import End, Format, Loss, Recording
from osl_analysis.base.source_file import Channel as ChannelSettings
from osl_analysis.base.source_file import Corner, ExportedPlate, LaboratorySource, Name
from osl_analysis.formats.marker_text import KINDS, Section, exported_plate
from osl_analysis.formats.text_cells import (
    TextRow,
    begins_with_text,
    check_last_line,
    decimal_of,
    delimiter_of,
    is_number_cell,
    numbered,
    padded_to,
    read_text,
    split_rows,
    unpadded,
)

HEAD_ROWS = 5  # title, rate, names, header, units
FRAME_HEADER = r'(?i)(?:^|[\r\n])"*frame[^\r\n]*sub frame'


class DeviceChannel(ChannelSettings):
    """A column of a device."""

    ADDRESS = "component"
    BESIDE = ("device",)
    device: Name  # Name of the device's output, such as `EMG2000 - Voltage`.
    component: Name  # Name of the column under it.


class NexusPlate(ExportedPlate):
    """A force plate of the export."""

    device: str  # The plate's outputs are called `<device> - Force` and `<device> - Moment`.
    # About which the file takes the moment [mm]; without it the corners' centre.
    moment_about: Corner | None = None


class NexusSource(LaboratorySource):
    """The source file of exports of Nexus."""

    analogs: Mapping[str, DeviceChannel] = Field(default={})
    plates: Mapping[PositiveInt, NexusPlate] = Field(default={})  # Force plates by number, from 1.


def read_sections(path: Path) -> list[Section]:
    """Read the sections; refused if there is none, or one has no samples."""
    text = read_text(path)
    lines = numbered(text.data)
    headers = [line for line in lines if re.search(FRAME_HEADER, line.text)]
    rows = split_rows(lines, delimiter_of(headers[:1]))
    numbers = {line.number for line in headers}
    starts = [place - 3 for place, row in enumerate(rows) if place > 2 and row.number in numbers]
    if not starts:
        raise InputError(
            "no section of a Nexus export (Devices, Trajectories, ...)", "check the source's format"
        )
    check_last_line(text.is_ended, rows[starts[-1] + HEAD_ROWS :] or rows[-1:])
    parts = [rows[start:end] for start, end in zip(starts, [*starts[1:], None], strict=True)]
    # a section at rest at both ends does not show it
    signs = [decimal_of([row.cells for row in part[HEAD_ROWS:]]) for part in parts]
    decimal = "," if "," in signs else "."
    return [_section_of(part, decimal) for part in parts]


def _section_of(rows: Sequence[TextRow], decimal: str) -> Section:
    title, rate = rows[0].cells[0], rows[1].cells[0].replace(",", ".")
    samples = rows[HEAD_ROWS:]
    if not samples or not is_number_cell(rate) or float(rate) <= 0:
        raise InputError(
            f"line {rows[1].number}: section {shortened(title)} at '{shortened(rate)}' Hz has no"
            " samples or no rate",
            "export the trial again, or without it",
        )
    components = unpadded(rows[3].cells)
    above, units = (padded_to(len(components), row.cells, "") for row in (rows[2], rows[4]))
    # of every column: the one above it, or else the nearest to the left
    names: list[str] = [*accumulate(above, lambda left, name: name or left)]
    return Section(title, float(rate), samples, names, components, units, decimal)


def read(path: Path, source: NexusSource | None) -> Recording:
    """Read an export. Its first frame is at 0 s."""
    used = read_sections(path)
    facts: dict[str, object] = {
        section.title: f"{len(section.rows)} rows at {section.rate_hz:g} Hz" for section in used
    }
    count = max(len(section.rows) for section in used)
    channels = [channel for section in used for channel in section.channels()]
    if source is not None:
        has_points = bool(source.markers or source.outputs)
        has_devices = bool(source.analogs or source.plates)
        used = [part for part in used if (has_points if part.title in KINDS else has_devices)]
        if used:  # else ingest refuses it
            facts.update(_timing_of(used))
    # two sections would differ in an export that was cut
    loss = Loss(count, count, End.WHOLE if len(used) > 1 else End.UNKNOWN)
    outputs = dict.fromkeys(name for section in used for name in section.names)
    like_plates = [
        f"{{device: {name.removesuffix(' - Force')}, corners: UNKNOWN}}"
        for name in outputs
        if name.endswith(" - Force")
    ]
    question = f"state under `plates`, by number, which are force plates: {', '.join(like_plates)}"
    questions = [question] if like_plates else []
    recording = Recording("nexus_csv", channels, loss, facts=facts, questions=questions)
    plates = []
    for number, plate in (source.plates if source is not None else {}).items():
        columns = [
            ({"device": f"{plate.device} - {quantity}", "component": quantity[0]}, "")
            for quantity in ("Force", "Moment")
        ]
        about = plate.moment_about
        plates.append(exported_plate(recording, number, plate, columns, "mm", about=about))
    return replace(recording, plates=plates)


def _timing_of(sections: Sequence[Section]) -> dict[str, object]:
    """Frames and rates, which all sections must share."""
    spans = set()
    samples_per_frame = 1
    for section in sections:
        sub_frame = section.values(1)
        samples = int(np.nanmax(sub_frame)) + 1
        samples_per_frame = max(samples_per_frame, samples)
        frame_rate_hz = round(section.rate_hz / samples, 6)
        spans.add((section.first_frame(sub_frame), len(section.rows) / samples, frame_rate_hz))
    first, frames, frame_rate_hz = spans.pop()
    if spans or frames % 1:
        raise InputError(
            "its sections differ in first frame, number of frames or frame rate, or a last frame"
            " lacks sub frames",
            "export all of the same frames",
        )
    return {
        "frames": int(frames),
        "first_frame": first,
        "frame_rate_hz": frame_rate_hz,
        "samples_per_frame": samples_per_frame,
    }


FORMAT = Format(
    name="nexus_csv",
    suffixes=(),
    begins=partial(begins_with_text, FRAME_HEADER),
    source=NexusSource,
    read=read,
)
