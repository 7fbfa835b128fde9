"""Compare a recording with those of its kind that were examined before."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from osl_analysis.commands.estimates import estimated
from osl_analysis.errors import OslAnalysisError, listing
from osl_analysis.files import write_text
from osl_analysis.trial import Trial

FEWEST_SIBLINGS = 3  # recordings of one kind with which another is compared
FAR = 4.0  # standard deviations from the siblings' median
LEAST_SHARE = 0.01  # standard deviation of an estimate, at least
LEAST_SHARE_OF_EXTENT = 0.05  # the same of duration, rate and range of the angle


def read_notes(path: Path) -> dict[str, Any]:
    """What was noted of recordings that were examined before, by name; nothing without notes, or
    with damaged ones."""
    with suppress(OSError, ValueError, TypeError):
        return dict(json.loads(path.read_text(encoding="utf-8")))
    return {}


def kind_of(row: Mapping[str, Any]) -> list[str]:
    """Experiment, joint, side, controller, K_d and B_d of a recording: of these equal ones are
    compared."""
    kind = [str(row.get(name) or "") for name in ("experiment", "joint", "side", "controller")]
    for name in ("K_d", "B_d"):
        kind.append("" if row.get(name) is None else f"{float(row[name]):g}")
    return kind


def compared_in(estimates: Mapping[str, Any]) -> list[str]:
    """The estimates that are told and compared: those of the joint, and none of the load cell."""
    return [name for name in estimated(estimates) if name not in ("offset", "drift")]


def comparable(
    trial: Trial, row: Mapping[str, Any], estimates: Mapping[str, Any]
) -> dict[str, tuple[float, float]]:
    """Numbers that are alike in recordings of one kind, each with the smallest standard deviation
    that it is granted: a share of an estimate or its standard error, a share of duration, rate and
    range; and the signs of channels. Of impedance trials without K_d nothing is compared: any two
    of these may have been asked for another."""
    numbers: dict[str, tuple[float, float]] = {}
    if row.get("experiment") == "impedance" and row.get("K_d") is None:
        return numbers
    for name in compared_in(estimates):
        value = float(estimates[name])
        se = float(estimates.get(f"{name}_se") or 0.0)
        numbers[name] = (value, max(se, LEAST_SHARE * abs(value)))
    time_s = trial.samples["time"].to_numpy()
    duration_s = time_s[-1] - time_s[0]
    extents = {"duration in s": duration_s, "rate in Hz": (len(time_s) - 1) / duration_s}
    if "theta" in trial.samples.columns:
        low, high = np.nanquantile(trial.samples["theta"].to_numpy(), (0.01, 0.99))
        extents["range of the angle in deg"] = np.rad2deg(high - low)
    for name, value in extents.items():
        numbers[name] = (float(value), LEAST_SHARE_OF_EXTENT * float(value))
    # a guessed sign makes any torque resist
    for name, channel in trial.provenance.get("columns", {}).items():
        numbers[f"sign of {name}"] = (float(channel["sign"]), 0.1)
    return numbers


def beside_siblings(
    name: str, kind: Sequence[str], numbers: Mapping[str, tuple[float, float]], notes: Path
) -> str:
    """Whether a recording is like those of its kind before it, joint, controller and what was asked
    for, by median and median absolute deviation of each number. What it has is added to the
    notes."""
    noted = read_notes(notes)
    siblings = [
        note["numbers"]
        for sibling_name, note in noted.items()
        if sibling_name != name and note["kind"] == list(kind)
    ]
    values = {key: value for key, (value, _) in numbers.items()}
    noted[name] = {"kind": list(kind), "numbers": values}
    with suppress(OslAnalysisError):  # the picture says why nothing is written there
        write_text(notes, json.dumps(noted, indent=1) + "\n")

    differences = []
    n_siblings = 0
    for key, (value, least_sd) in numbers.items():
        of_siblings = [sibling[key] for sibling in siblings if key in sibling]
        if len(of_siblings) < FEWEST_SIBLINGS:
            continue
        n_siblings = max(n_siblings, len(of_siblings))
        median = float(np.median(of_siblings))
        sd = max(scipy.stats.median_abs_deviation(of_siblings, scale="normal"), least_sd)
        if abs(value - median) > FAR * sd:
            differences.append(f"{key} is {value:.3g}, theirs {median:.3g} ± {sd:.1g}")
    if differences:
        return (
            f"DIFFERS from its {n_siblings} siblings: {listing(differences, 4)}: look for what"
            " changed on the bench"
        )
    if n_siblings:
        return f"like its {n_siblings} siblings"
    if not numbers:
        return "no siblings: no K_d is stated"
    return f"{len(siblings)} siblings to compare with, {FEWEST_SIBLINGS} are needed"
