"""Whether Eq. 15 is recovered where the support shifts in place of a turn (`walking.perturbed_by:
belt`).

Run from the repository: `python benchmarks/belt_shift.py [campaigns]` prints the table of
`docs/walking.md`: bias and coverage of K, B and I of ten perturbed and ten unperturbed crossings,
recorded by markers and plate. A campaign takes about 15 s. The truth is what the leg rendered (K,
B, I of its drivetrain), and the same estimator's for the perturbations alone.
"""

import sys
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from impedance_over_stance import laboratory
from study import StudyLaboratory, campaign_rows, recording

CROSSINGS = 10
CASES = (
    ("shift of 50 mm in 85 ms", 50.0, 0.085),
    ("shift of 50 mm in 150 ms", 50.0, 0.15),
    ("shift of 100 mm in 300 ms", 100.0, 0.3),
    ("turn of 5° in 85 ms", None, 0.085),
)
"""Perturbation, shift [mm] and its duration [s]."""


def shifting(mm: float | None, rise_s: float) -> StudyLaboratory:
    """A laboratory whose platform shifts so far and in that time, or turns (None)."""
    one = laboratory()
    ramp = one.gait.perturbation.model_copy(update={"shift_mm": mm, "rise_s": rise_s})
    gait = one.gait.model_copy(update={"perturbation": ramp})
    analysis = one.analysis.model_copy(
        update={"perturbed_by": "platform" if mm is None else "belt"}
    )
    return StudyLaboratory(one.settings, gait, one.p, analysis)


def main(campaigns: int) -> None:
    print(
        "| perturbation | quantity | truth of the leg | bias to it | bias to the estimator's |"
        " covered of both |"
    )
    print("|---|---|---|---|---|---|")
    for said, mm, rise_s in CASES:
        found: dict[str, list[tuple[float, ...]]] = {name: [] for name in "KBI"}
        for number in range(campaigns):
            base = shifting(mm, rise_s)
            own = base.settings.model_copy(update={"seed": 100 + number})
            names = [f"belt_{number:03d}_{i}" for i in range(2 * CROSSINGS)]
            with TemporaryDirectory() as folder, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                one = StudyLaboratory(own, base.gait, base.p, base.analysis)
                session = recording(one, Path(folder), names[1::2])
                for row in campaign_rows(names, session):
                    if row["estimator"] == "ensemble":
                        rendered = row["truth"] - row["model_error"]
                        numbers = (row["value"], rendered, row["truth"], row["low"], row["high"])
                        found[row["quantity"]].append(numbers)
        for name, rows in found.items():
            value, rendered, exact, low, high = np.array(rows).T
            held = [int(((low <= truth) & (truth <= high)).sum()) for truth in (rendered, exact)]
            to = [
                f"{(value - truth).mean():.4g} ± {(value - truth).std(ddof=1):.2g}"
                for truth in (rendered, exact)
            ]
            print(
                f"| {said} | {name} | {rendered.mean():.4g} | {to[0]} | {to[1]} | {held[0]},"
                f" {held[1]} of {len(rows)} |"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
