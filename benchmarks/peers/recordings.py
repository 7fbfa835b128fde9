# SPDX-License-Identifier: Apache-2.0
"""Recordings whose truth is known, as a CSV file each (t [s], theta [rad], torque [N*m]) and
`truth.csv` about them: python benchmarks/peers/recordings.py FOLDER [SEED ...]

`known` is what a laboratory would know of a recording, NAME=NUMBER: the rate [Hz], bits per turn of
the encoder, and whether the joint is a person's. `cause` is what a method should announce; where it
is empty nothing is wrong. No method was tuned on the recordings of `closed_form`.
"""

import csv
import sys
from pathlib import Path

import closed_form
import generator
import laboratory
import numpy as np

COLUMNS = ["trial", "group", "motion", "made_by", "seed", "K", "B", "I", "known", "cause"]
SEEDS = tuple(range(1, 25))
FEWER = (
    8  # first seeds, of what takes a simulation; of eight joints drawn at random a median is chance
)


def write(
    folder,
    seeds=SEEDS,
    generated=generator.CASES,
    simulated=laboratory.CASES,
    unseen=closed_form.CASES,
    seconds=24.0,
):
    """Write the recordings of some cases for each seed, and the table of their truth."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in seeds:
        made = [("closed_form", *found) for found in closed_form.recordings(seed, seconds, unseen)]
        if seed <= FEWER:
            made += [
                ("generator", case, generator.RATE, case.true, data)
                for case, data in generator.recordings(seed, seconds, generated)
            ]
            made += [
                ("simulator", case, generator.RATE, true, data)
                for case, true, data in laboratory.recordings(seed, simulated)
            ]
        for made_by, case, rate, true, data in made:
            trial = f"{case.case}_{case.motion}_{made_by}_{seed}".replace(" ", "_")
            known = {"rate_hz": rate, "bits": case.bits, **case.known}
            of_case = {
                "group": case.case,
                "motion": case.motion,
                "cause": case.announce,
                "made_by": made_by,
            }
            said = " ".join(f"{name}={value:g}" for name, value in known.items())
            rows.append({"trial": trial, "seed": seed, "known": said, **of_case, **true})
            head = {"delimiter": ",", "header": "t,theta,torque", "comments": ""}
            np.savetxt(
                folder / f"{trial}.csv", np.column_stack(data), fmt=["%.6f", "%.9f", "%.6f"], **head
            )
    with (folder / "truth.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(sorted(rows, key=lambda row: (row["group"], row["trial"])))


if __name__ == "__main__":
    write(Path(sys.argv[1]), [int(one) for one in sys.argv[2:]] or SEEDS)
