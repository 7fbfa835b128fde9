"""What a CSV export of Vicon Nexus holds."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.nexus_csv import NexusSection, read_sections
from osl_analysis.ingest.overview import Overview, RecordedChannel

KINDS = {"Trajectories": "marker", "Model Outputs": "model output"}


def inspect_nexus(path: Path) -> Overview:
    """The sections of a Nexus export."""
    sections = read_sections(path)
    facts, remarks = {}, []
    for title, section in sections.items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        try:
            section.counts()
        except InputError as error:
            remarks.append(f"{title}: {error}")
    channels = [channel for section in sections.values() for channel in section_channels(section)]
    return Overview("nexus_csv", facts, channels, remarks)


def section_channels(section: NexusSection) -> Iterator[RecordedChannel]:
    """A section's columns: one per trajectory, and per component of anything else."""
    kind = KINDS.get(section.title, "device")
    for place, (name, component) in enumerate(zip(section.names, section.components, strict=True)):
        if not name or (kind == "marker" and component.casefold() != "x"):
            continue
        address = {"label": name} if kind == "marker" else {"device": name, "component": component}
        values = section.values(place)
        missing = float(np.isnan(values).mean())
        note = f"missing in {missing:.1%} of the rows" if missing else ""
        yield RecordedChannel(
            kind, address, section.units[place], int((~np.isnan(values)).sum()), section.rate, note, missing=missing
        )
