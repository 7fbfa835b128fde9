"""How sure the plate's model and the shared onset may be: error over stated standard error, over simulated campaigns.

Run from the repository: `python benchmarks/plate_model.py [sets] [words of a case's name]`. Each set is one static
trial and unloaded trials of the platform, recorded as C3D and ingested. `identify_plate_model` weighs the plate; the
same motions, as if they were crossings, show what `platform_template` says of their onsets. The truth is the
simulator's.
Prints, for each case, bias and scatter of an estimate, its stated standard error (root mean square over sets), and the
root mean square of error over standard error, which is 1 where the standard error is right. Half a second a set. The
same seeds give the same numbers.
"""

import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from walking_campaigns import load, merged

from osl_analysis.config import read_section
from osl_analysis.parameters import DrivetrainParameters, read_parameters
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking import simulate_walking_trial
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.study.walking import ingested
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.bodies import StaticCalibration, static_calibration
from osl_analysis.walking.plate_model import PARAMETERS, PlateModel, identify_plate_model
from osl_analysis.walking.platform import platform_template, turning_track
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.yaml_settings import read_yaml

SIMULATION, CONFIG, SOURCES = Path("config/simulation"), Path("config/config.yaml"), Path("config/sources")
SETS = 40
FIRST_SEED = 401
OFF = {"enabled": False}
LARGE = {"perturbation": {"angle_deg": 5, "rise_s": 0.08}, "effects": {"marker_noise": {"size": 0.1}}}
SMALL = {"perturbation": {"angle_deg": 2.5, "rise_s": 0.1}, "effects": {"marker_noise": {"size": 0.3}}}
HEAVY = {"effects": {"plate_inertia": {"size": 25}}, "perturbation": {"axis_depth_m": 0.12, "same_unloaded": True}}
TURNS = merged(HEAVY, {"plate": {"full_motion_every": 0}})
ALL_AXES = merged(HEAVY, {"plate": {"full_motion_every": 1}})


@dataclass(frozen=True)
class Case:
    """A laboratory: what differs from the shipped one, and its number of unloaded trials."""

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    trials: int = 6


CASES = (
    Case("as shipped: 12 kg, 5 deg, 0.15 mm, every third trial about every axis"),
    Case("25 kg, 5 deg in 80 ms, 0.1 mm, turns only", merged(TURNS, LARGE)),
    Case("25 kg, 2.5 deg in 100 ms, 0.3 mm, turns only", merged(TURNS, SMALL)),
    Case("25 kg, 5 deg in 80 ms, 0.1 mm, every trial about every axis", merged(ALL_AXES, LARGE)),
    Case("25 kg, 2.5 deg in 100 ms, 0.3 mm, every trial about every axis", merged(ALL_AXES, SMALL)),
    Case("25 kg, 2.5 deg in 100 ms, 0.3 mm, ramps 5 % slower or faster",
         merged(merged(TURNS, SMALL), {"effects": {"rise_scatter": {"enabled": True, "size": 5}}}), 8),
)  # fmt: skip


@dataclass(frozen=True)
class Bench:
    """A simulated laboratory and the analysis of its recordings."""

    settings: SimulationSettings
    gait: WalkingSettings
    p: DrivetrainParameters
    analysis: WalkingAnalysis

    def recorded(self, seed: int, trials: int, folder: Path) -> tuple[StaticCalibration, list[Trial], Array]:
        """The static trial's calibration, the unloaded trials, and their true onsets (trials,) [s]."""
        rows = [{"trial": "static_1", "experiment": "static"}]
        rows += [{"trial": f"plate_{k + 1:02d}", "experiment": "plate"} for k in range(trials)]
        settings = self.settings.model_copy(update={"seed": seed})
        for row in rows:
            simulate_walking_trial(row, settings, self.gait, self.p, folder)
        standing, *unloaded = (ingested(row["trial"], folder, SOURCES) for row in rows)
        onsets = [json.loads((folder / f"truth/{t.name}.json").read_text())["onset_s"] for t in unloaded]
        return static_calibration(standing, self.analysis), unloaded, np.array(onsets)

    def true_parameters(self) -> Array:
        """The plate's inertial parameters (10,), in the order of `PARAMETERS`."""
        mass, plate = self.gait.effects.plate_inertia.value, self.gait.plate
        c = np.array(plate.centre_of_mass_m)
        inertia = np.diag(np.square(plate.gyration_m)) + c @ c * np.eye(3) - np.outer(c, c)
        return np.asarray(mass * np.r_[1.0, c, np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]])


def bench(case: Case) -> Bench:
    """The laboratory of a case."""
    gait = WalkingSettings.model_validate(merged(load(SIMULATION / "walking.yaml"), case.changes))
    settings = read_yaml(SIMULATION / "default.yaml", SimulationSettings)
    analysis = read_section(CONFIG, "walking", WalkingAnalysis)
    return Bench(settings, gait, read_parameters(settings.parameters), analysis)


def jackknife_errors(model: PlateModel) -> Array:
    """Standard errors (10,) from the models without each trial in turn."""
    left = np.array([one.inertia.parameters for one in model.leave_one_out])
    k = len(left)
    return np.asarray(np.sqrt((k - 1) / k * np.sum((left - left.mean(axis=0)) ** 2, axis=0)))


def found_onsets(
    trials: Sequence[Trial], calibration: StaticCalibration, analysis: WalkingAnalysis
) -> tuple[Array, Array, float, float]:
    """Onsets and their own standard errors (trials,) [s] by the shape that all share, the standard error of its start,
    and what its kind leaves open [s]."""
    tracks = [turning_track(trial, calibration, analysis) for trial in trials]
    template, found = platform_template(tracks, analysis.window_s)
    own = np.array([a.start_se for a in found])
    return np.array([a.start for a in found]), own, template.start_se, template.start_shape


def study(case: Case, sets: int) -> None:
    """Print the lines of a case."""
    lab, found = bench(case), {name: [] for name in ("error", "stated", "jackknife", "late", "own", "shared", "open")}
    true = lab.true_parameters()
    for seed in range(FIRST_SEED, FIRST_SEED + sets):
        with tempfile.TemporaryDirectory() as name:
            calibration, trials, onsets = lab.recorded(seed, case.trials, Path(name))
        model = identify_plate_model(trials, calibration, lab.analysis)
        known = np.where(model.inertia.standard_errors > 0, 1.0, np.nan)
        start, own, shared, kinds = found_onsets(trials, calibration, lab.analysis)
        new = (model.inertia.parameters - true, model.inertia.standard_errors, jackknife_errors(model))
        new = (*(known * one for one in new), 1e3 * (start - onsets), 1e3 * own, 1e3 * shared, 1e3 * kinds)
        for rows, row in zip(found.values(), new, strict=True):
            rows.append(row)
    error, stated, jackknife, late, own, shared, kinds = map(np.array, found.values())
    print(f"\n{case.name} ({sets} sets of {case.trials} trials)\n")
    print(
        "| | bias ± its error | scatter | stated | jackknife | error / stated |\n| --- | --- | --- | --- | --- | --- |"
    )
    for k, name in enumerate(PARAMETERS):
        if np.isfinite(error[:, k]).all():
            line(name, error[:, k], stated[:, k], jackknife[:, k])
    mean = late.mean(axis=1)
    line("mean onset, ms", mean, np.sqrt(shared**2 + np.mean(own**2, axis=1) / case.trials))
    line("onset, ms", late.ravel(), np.sqrt(shared[:, None] ** 2 + own**2).ravel())
    line("onset from the set's mean, ms", (late - mean[:, None]).ravel(), own.ravel())
    print(
        f"Onset with another smooth start, ms: {np.median(kinds):.1f} (median), {kinds.max():.1f} (largest).",
        flush=True,
    )


def line(name: str, error: Array, stated: Array, jackknife: Array | None = None) -> None:
    """Print one row: errors, standard errors and jackknife's of an estimate (sets,)."""
    n, z = len(error), np.sqrt(np.mean((error / stated) ** 2))
    sizes = (rms(stated), float("nan") if jackknife is None else rms(jackknife))
    said = [f"{size:.3g}" if np.isfinite(size) else "–" for size in sizes]
    scatter = error.std(ddof=1)
    bias = f"{error.mean():.2g} ± {scatter / np.sqrt(n):.1g}"
    print(f"| {name} | {bias} | {scatter:.3g} | {said[0]} | {said[1]} | {z:.2f} |", flush=True)


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """The cases whose names have all words, or all."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    words = [word for word in sys.argv[1:] if not word.isdigit()]
    for case in CASES:
        if all(word in case.name for word in words):
            study(case, numbers[0] if numbers else SETS)


if __name__ == "__main__":
    main()
