"""The trials behind the numbers, and those that are missing."""

from collections.abc import Mapping, Sequence
from typing import Any

import polars as pl

from osl_analysis.judge.exclusions import exclusion_text


def used_and_missing(
    trials: Mapping[str, Sequence[str]], excluded: pl.DataFrame
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials, number `used`, and why others are `missing`, unless
    excluded in the sheet."""
    reasons: dict[str, str] = {}
    for row in excluded.filter(pl.col("check") != "sample sheet").iter_rows(named=True):
        reasons.setdefault(row["trial"], exclusion_text(row))
    by_experiment: dict[str, dict[str, Any]] = {}
    for experiment, names in trials.items():
        missing = {name: reasons[name] for name in names if name in reasons}
        used = len(names) - len(missing)
        by_experiment[experiment] = {"used": used, "of": len(names), "missing": missing}
    return by_experiment


def missing_lines(content: Mapping[str, Any], reasons: bool) -> list[str]:
    """A line per experiment with missing trials, with their `reasons` or without, and per missing
    result."""
    lines = []
    for experiment, counts in content.get("trials", {}).items():
        if not counts["missing"]:
            continue
        trials = list(counts["missing"])
        if reasons:
            trials = [f"{trial} ({reason})" for trial, reason in counts["missing"].items()]
        used = f"{counts['used']} of {counts['of']} {experiment} trials"
        lines.append(f"{used}; without {', '.join(trials)}")
    for file, reason in content.get("missing_results", {}).items():
        lines.append(f"no {file}: {reason}")
    return lines
