"""What a crossing would have done: the mean unperturbed gait, or its own behaviour before the
onset.

Run from the repository: `python benchmarks/gait_prediction.py [campaigns]` prints the last table of
`docs/walking.md`: error and interval of K with either baseline. Campaigns of ten perturbed and ten
unperturbed crossings; the same seeds give the same. About two seconds a campaign and row.
"""

import sys
from collections.abc import Callable

import numpy as np
from gait_of_phase import TRUTH, crossing
from impedance_over_stance import at_timing, laboratory
from study import StudyLaboratory

from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.unperturbed_gait import unperturbed_gait

CROSSINGS, RESAMPLES = 10, 300
Walked = tuple[list[Crossing], list[Crossing], float]
"""Unperturbed and perturbed crossings of a campaign, and the mean true stiffness."""


def at(timing: float) -> Callable[[int, StudyLaboratory], Walked]:
    """Campaigns of the simulator's gait whose platform turns at a phase of stance."""

    def campaign(number: int, shipped: StudyLaboratory) -> Walked:
        names, here = (
            [f"predicted_{number:04d}_{k}" for k in range(CROSSINGS)],
            at_timing(shipped, timing),
        )
        walked = [here.perturbed(f"{name}_p") for name in names]
        truth = float(np.mean([exact["K"] for _, exact, _ in walked]))
        return (
            [here.unperturbed(f"{name}_u") for name in names],
            [crossing for crossing, *_ in walked],
            truth,
        )

    return campaign


def formula(number: int, shipped: StudyLaboratory) -> Walked:
    """Campaigns of the gait of `gait_of_phase.py`."""
    low_pass, many = shipped.analysis.low_pass, range(CROSSINGS)
    unperturbed = [crossing((number, 0, k), low_pass, False) for k in many]
    return unperturbed, [crossing((number, 1, k), low_pass, True) for k in many], TRUTH["K"]


GAITS = {
    "simulator, onset at 18 % of stance": at(0.18),
    "simulator, 39 %": at(0.39),
    "simulator, 69 %": at(0.69),
    "formula, 40 %": formula,
}


def main(number: int) -> None:
    """Print the table."""
    shipped = laboratory()
    settings = shipped.analysis.model_copy(update={"bootstrap_samples": RESAMPLES})
    print(
        "| gait | baseline | error of K, N·m/rad | half the interval | covered, % | deviations"
        " predicted |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for label, make in GAITS.items():
        found: dict[str, list[tuple[float, ...]]] = {"mean": [], "predicted": []}
        shares = []
        for k in range(number):
            unperturbed, perturbed, truth = make(k, shipped)
            headline = group_headline(perturbed, unperturbed_gait(unperturbed, 3), settings)
            shares.append(headline.predicted_share)
            other = headline.other_baseline
            for name, K, draws in (
                ("mean", headline.ensemble.fit["K"], headline.resampled),
                ("predicted", other.estimates["K"], other.resampled),
            ):
                low, high = draws.interval("K")
                found[name].append((K - truth, (high - low) / 2, float(low <= truth <= high)))
        for name, rows in found.items():
            error, width, covered = np.array(rows).T
            share = f"{100 * np.mean(shares):.0f} %" if name == "predicted" else "–"
            cells = (
                f"{error.mean():.1f} ± {error.std(ddof=1):.1f} | {width.mean():.1f} |"
                f" {100 * covered.mean():.0f}"
            )
            print(f"| {label} | {name} | {cells} | {share} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
