"""Inspect: what a file of any laboratory holds, and a draft of the source file that would describe it.

What files say of themselves is untrusted: it is escaped where it is printed, and quoted where it is drafted.
"""

import json
from pathlib import Path

from osl_analysis.columns import COLUMNS
from osl_analysis.commands.ingest import check_file
from osl_analysis.errors import InputError, printable
from osl_analysis.ingest.c3d_overview import inspect_c3d
from osl_analysis.ingest.csv_overview import inspect_csv
from osl_analysis.ingest.mcap_overview import MAGIC, inspect_mcap
from osl_analysis.ingest.overview import Channel, Overview

LONGEST = 60  # characters of a name that are printed
HINT = "# give each signal that you need its canonical name instead of NAME_n, state what is UNKNOWN, delete the rest"


def inspect_file(path: Path) -> Overview:
    """What a file holds; its first bytes say of which format it is.

    Raises
    ------
    InputError
        The file is missing, empty, or of no format that is read.
    """
    check_file(path)
    with path.open("rb") as file:
        begin = file.read(512)
    if begin[:8] == MAGIC:
        return inspect_mcap(path)
    if begin[1:2] == b"\x50" and b"\0" in begin:
        return inspect_c3d(path)
    if b"\0" in begin and begin[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}: neither MCAP, C3D nor text (it begins with {begin[:8]!r}); convert it")
    return inspect_csv(path)


def overview_text(overview: Overview) -> str:
    """The overview as lines for a terminal."""
    lines = [f"format: {overview.format}", *(f"{name}: {shown(fact)}" for name, fact in overview.facts.items()), ""]
    lines += [row_of(channel) for channel in overview.channels]
    lines += ["", *(f"! {printable(remark)}" for remark in overview.remarks)]
    return "\n".join(lines).rstrip()


def row_of(channel: Channel) -> str:
    """One channel on one line: kind, name, unit, samples, rate, note."""
    name = " ".join(shown(part) for part in channel.address.values())
    rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
    unit = f" [{shown(channel.unit)}]" if channel.unit else ""
    note = f"; {printable(channel.note)}" if channel.note else ""
    return f"{shown(channel.kind):<14} {name}{unit}  {channel.count} samples{rate}{note}"


def shown(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe = printable(text)
    return safe if len(safe) <= LONGEST else f"{safe[:LONGEST]}..."


def draft(overview: Overview, name: str) -> str:
    """A source file for the file `name`, in which the user has yet to name the channels.

    JSON's strings are YAML's, with every control character as an escape.
    """
    lines = [
        f"format: {overview.format}",
        f"description: {quoted(f'Drafted from {name}; complete it.')}",
        *(f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()),
    ]
    if overview.format in ("c3d", "nexus_csv"):
        return "\n".join([*lines, *capture_lines(overview)]) + "\n"
    known = ", ".join(column for column in COLUMNS if column != "time")
    lines += [HINT, f"# canonical names: {known}", "channels:"]
    clock = overview.settings.get("time")
    clock_column = clock.get("column") if isinstance(clock, dict) else None
    channels = [c for c in overview.channels if c.address.get("column", "") != clock_column or overview.format != "csv"]
    lines += [channel_line(number, channel) for number, channel in enumerate(channels, start=1)]
    return "\n".join(lines) + "\n"


def channel_line(number: int, channel: Channel) -> str:
    """One entry under `channels`."""
    address = {**channel.address, "unit": channel.unit or "UNKNOWN"}
    return f"  NAME_{number}: {{{', '.join(f'{key}: {quoted(value)}' for key, value in address.items())}}}"


def capture_lines(overview: Overview) -> list[str]:
    """Markers and plates as they are; analogs and outputs as comments, for the user to name."""
    labels = [quoted(c.address["label"]) for c in overview.channels if c.kind == "marker"]
    lines = ["markers: all", f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"]
    if overview.format == "c3d":
        lines.append("plates: all" if any(c.kind == "plate" for c in overview.channels) else "plates: none")
    for key, kinds in (("analogs", ("analog", "device")), ("outputs", ("model output",))):
        channels = [c for c in overview.channels if c.kind in kinds]
        lines += [f"# {key}:"] if channels else []
        for number, channel in enumerate(channels, start=1):
            lines.append(f"# {channel_line(number, channel)}")
    return lines


def quoted(text: str) -> str:
    """Text of a file as a YAML string on one line."""
    return json.dumps(text)
