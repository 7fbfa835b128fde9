"""Inspect: what a file of any laboratory holds, as lines for a terminal.

What files say of themselves is untrusted: it is escaped where it is printed.
"""

from pathlib import Path

from osl_analysis.errors import printable
from osl_analysis.ingest.known_formats import FORMATS, recognise
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import check_file

LONGEST = 60  # characters of a name that are printed


def inspect_file(path: Path) -> Overview:
    """What a file holds.

    Raises
    ------
    InputError
        The file is missing, empty, damaged beyond reading, or of no format that is read.
    """
    check_file(path)
    return FORMATS[recognise(path)].inspect(path)


def overview_text(overview: Overview) -> str:
    """The overview as lines for a terminal."""
    lines = [f"format: {overview.format}", *(f"{name}: {shortened(fact)}" for name, fact in overview.facts.items()), ""]
    lines += [channel_text(channel) for channel in overview.channels]
    lines += ["", *(f"! {printable(remark)}" for remark in overview.remarks)]
    return "\n".join(lines).rstrip()


def channel_text(channel: RecordedChannel) -> str:
    """One channel on one line: kind, name, unit, samples, rate, note, type."""
    name = " ".join(shortened(part) for part in channel.address.values())
    rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
    unit = f" [{shortened(channel.unit)}]" if channel.unit else ""
    notes = "".join(f"; {printable(note)}" for note in (channel.note, channel.type) if note)
    return f"{shortened(channel.kind):<14} {name}{unit}  {channel.count} samples{rate}{notes}"


def shortened(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe = printable(text)
    return safe if len(safe) <= LONGEST else f"{safe[:LONGEST]}..."
