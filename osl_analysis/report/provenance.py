"""Where a trial's samples come from: files and hashes, which channel became which signal, clocks, software."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.report.numbers import shown

Lines = list[list[str]]
"""Rows of text."""


def provenance_of(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What ingest wrote about a trial (`Trial.provenance`), as `files`, `signals` and further `facts`."""
    return {
        "files": [
            [
                role,
                str(file.get("path", "")),
                shown(file.get("bytes")),
                str(file.get("sha256", "")),
                str(file.get("source")),
            ]
            for role, file in provenance.get("files", {}).items()
        ],
        "signals": signals(provenance.get("columns", {})),
        "facts": facts({name: provenance[name] for name in provenance if name not in ("files", "columns")}),
    }


def signals(columns: Mapping[str, Mapping[str, Any]]) -> Lines:
    """Each signal with its channel in the file, and how it was converted; the axes of a marker or plate in one row."""
    found: dict[str, list[str]] = {}
    for name, origin in columns.items():
        vector = name.rpartition("_")[0] if "component" in origin or "plate" in origin else name
        found.setdefault(vector, [vector, str(origin.get("file", "")), channel(origin), conversion(origin)])
    return list(found.values())


def channel(origin: Mapping[str, Any]) -> str:
    """The name of a signal in its file."""
    if "plate" in origin:
        return f"force plate {origin['plate']}, type {origin.get('type')}, analogue channels {origin.get('analogs')}"
    named = (origin.get(key) for key in ("topic", "field", "label", "channel", "column"))
    return " ".join(str(part) for part in named if part)


def conversion(origin: Mapping[str, Any]) -> str:
    """From the unit of the file to that of the trial, with sign, scale, offset and what else was taken off."""
    unit = origin.get("unit") or ", ".join(dict.fromkeys(origin.get("units", ())))
    steps = [f"{unit} → {origin.get('si_unit', '')}"]
    usual = {"sign": 1, "scale": 1, "offset": 0}
    steps += [f"{key} {shown(origin[key])}" for key in usual if origin.get(key, usual[key]) != usual[key]]
    steps += [f"{key} {origin[key]}" for key in ("delay", "low_pass", "resolution", "counter") if origin.get(key)]
    return ", ".join(steps)


def facts(content: Mapping[str, Any], place: str = "") -> Lines:
    """Every other fact with its place: clocks, stamps, rates, damage, versions, warnings."""
    found: Lines = []
    for name, value in content.items():
        if isinstance(value, Mapping):
            found += facts(value, f"{place}{name} ")
        elif value not in (None, "", []):
            found.append([f"{place}{name}", listed(value)])
    return found


def listed(value: Any) -> str:
    """A fact as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {listed(part)}" for name, part in value.items())
    return "; ".join(map(listed, value)) if isinstance(value, list) else shown(value)
