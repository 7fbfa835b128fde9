"""Whether Eq. 15 is recovered where the support shifts in place of a turn (`walking.perturbed_by: belt`).

Run from the repository: `python benchmarks/belt_shift.py [campaigns]` prints the table of `docs/walking.md`: bias and
coverage of K, B and I of ten perturbed and ten unperturbed crossings, recorded by markers and plate. A campaign takes
about 15 s. The truth is what the leg rendered (K, B, I of its drivetrain), and the same estimator's for the
perturbations alone.
"""

import sys
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from impedance_over_stance import laboratory

from osl_analysis.study.walking import StudyLaboratory, campaign_rows, recording

CROSSINGS = 10


def shifting(mm: float | None, resting_plate: bool) -> StudyLaboratory:
    """A laboratory whose platform shifts, or turns (None); the plate below a belt rests, without own inertia."""
    one = laboratory()
    gait = one.gait.model_copy(update={"perturbation": one.gait.perturbation.model_copy(update={"shift_mm": mm})})
    if resting_plate:
        still = gait.effects.plate_inertia.model_copy(update={"enabled": False})
        gait = gait.model_copy(update={"effects": gait.effects.model_copy(update={"plate_inertia": still})})
    analysis = one.analysis.model_copy(update={"perturbed_by": "platform" if mm is None else "belt"})
    return StudyLaboratory(one.settings, gait, one.p, analysis)


def main(campaigns: int) -> None:
    print("| perturbation | quantity | truth of the leg | bias to it | bias to the estimator's | covered of both |")
    print("|---|---|---|---|---|---|")
    for said, mm in (("turn of 5 deg", None), ("shift of 80 mm", 80.0), ("shift of 50 mm", 50.0), ("shift of 30 mm", 30.0)):
        found: dict[str, list[tuple[float, ...]]] = {name: [] for name in "KBI"}
        for number in range(campaigns):
            base = shifting(mm, False)
            own = base.settings.model_copy(update={"seed": 100 + number})
            names = [f"belt_{number:03d}_{i}" for i in range(2 * CROSSINGS)]
            with TemporaryDirectory() as folder, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                one = StudyLaboratory(own, base.gait, base.p, base.analysis)
                session = recording(one, Path(folder), Path("config/sources"), names[1::2])
                for row in campaign_rows(number, names, session):
                    if row["estimator"] == "ensemble":
                        rendered = row["truth"] - row["model_error"]
                        numbers = (row["value"], rendered, row["truth"], row["low"], row["high"])
                        found[row["quantity"]].append(numbers)
        for name, rows in found.items():
            value, rendered, exact, low, high = np.array(rows).T
            held = [int(((low <= truth) & (truth <= high)).sum()) for truth in (rendered, exact)]
            to = [f"{(value - truth).mean():.4g} ± {(value - truth).std(ddof=1):.2g}" for truth in (rendered, exact)]
            print(f"| {said} | {name} | {rendered.mean():.4g} | {to[0]} | {to[1]} | {held[0]}, {held[1]} of {len(rows)} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
