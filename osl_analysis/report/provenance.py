"""Where the signals of a trial come from, as the page tells it."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.report.shown_numbers import cell_text

USUAL_CONVERSION = {"sign": 1, "scale": 1, "offset": 0}  # is not told


def provenance_content(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance of a trial as `files`, `signals` (file, channel, conversion; the axes of a
    marker or plate are one signal) and further `facts`."""
    files = []
    for role, file in provenance.get("files", {}).items():
        cells = [cell_text(file.get(key)) for key in ("path", "bytes", "sha256", "source")]
        files.append([role, *cells])
    signals: dict[str, list[str]] = {}
    for name, origin in provenance.get("columns", {}).items():
        is_axis = "component" in origin or "plate" in origin
        signal = name.rpartition("_")[0] if is_axis else name
        conversion = {}
        for key, value in origin.items():
            is_usual = not value or value == USUAL_CONVERSION.get(key)
            if key not in ("file", "component") and not is_usual:
                conversion[key] = value
        row = [signal, cell_text(origin.get("file")), fact_text(conversion)]
        signals.setdefault(signal, row)
    further = {
        name: value for name, value in provenance.items() if name not in ("files", "columns")
    }
    return {"files": files, "signals": list(signals.values()), "facts": facts(further)}


def fact_text(value: Any) -> str:
    """A fact of the provenance, with all of its parts, as text."""
    if isinstance(value, dict):  # as JSON has it; to ask for a Mapping takes ten times as long
        return ", ".join(f"{name} {fact_text(part)}" for name, part in value.items())
    if isinstance(value, list):
        return "; ".join(map(fact_text, value))
    return cell_text(value)


def facts(content: Mapping[str, Any], place: str = "") -> list[list[str]]:
    """Every other fact with its path: clocks, stamps, rates, damage, versions, warnings."""
    rows: list[list[str]] = []
    for name, value in content.items():
        if isinstance(value, dict):
            rows += facts(value, f"{place}{name} ")
        elif value not in (None, "", []):
            rows.append([f"{place}{name}", fact_text(value)])
    return rows
