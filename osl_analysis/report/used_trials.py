"""The trials behind the numbers, and those that are missing."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.report.left_out import LeftOut


def used_and_missing(
    sheet: Mapping[str, Mapping[str, Any]], left_out: Mapping[str, LeftOut]
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials in the sheet, number `used`, and why others are
    `missing`."""
    by_experiment: dict[str, dict[str, Any]] = {}
    for experiment in EXPERIMENTS:
        trials = [trial for trial, row in sheet.items() if row["experiment"] == experiment]
        missing = {trial: left_out[trial].reasons[0] for trial in trials if trial in left_out}
        used = len(trials) - len(missing)
        if trials:
            by_experiment[experiment] = {"used": used, "of": len(trials), "missing": missing}
    return by_experiment


def missing_lines(content: Mapping[str, Any]) -> list[str]:
    """A line per experiment with missing trials and their reasons, and per missing result."""
    lines = []
    for experiment, counts in content["trials"].items():
        trials = [f"{trial} ({reason})" for trial, reason in counts["missing"].items()]
        if trials:
            used = f"{counts['used']} of {counts['of']} {experiment} trials"
            lines.append(f"{used}; without {', '.join(trials)}")
    for file, reason in content["missing_results"].items():
        lines.append(f"no {file}: {reason}")
    return lines
