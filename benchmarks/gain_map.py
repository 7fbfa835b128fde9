"""Prove the number of minima of Eq. 14 with the paper's W for each request, and draw the map of docs/gain_selection.md.

    python benchmarks/gain_map.py [docs/gain_map.png]

Takes about two minutes on one core.
"""

import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.figure import draw_table
from osl_analysis.model.admittance_error import Weight
from osl_analysis.model.certificate import certify
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.gain_selection import optimal_damping
from osl_analysis.parameters import read_parameters

DEVICES = ("default", "table1-as-printed", "osl-v2-published")


def proved_map(device: str, stiffnesses: int, dampings: int, weight: Weight, with_inertia: bool) -> pl.DataFrame:
    """A row per request on a grid over K_d from 1 to 0.99 K_s and B_d from 0 to 20."""
    p = read_parameters(Path(f"config/parameters/{device}.yaml"))
    J_j = p.J_j if with_inertia else 0.0
    grid = np.meshgrid(np.linspace(1, 0.99 * p.K_s, stiffnesses), np.linspace(0, 20, dampings), indexing="ij")
    K_d, B_d = (v.ravel() for v in grid)
    proofs = [certify(k, b, p, weight, J_j) for k, b in zip(K_d, B_d, strict=True)]
    gains = optimal_damping(K_d, B_d, p, weight, J_j).B_1 * p.n_T**2
    return pl.DataFrame({"K_d": K_d, "B_d": B_d, "minima": [len(q.minima) for q in proofs], "B_1_joint": gains})


def main() -> None:
    warnings.simplefilter("ignore")  # the printed table's own
    print(f"{'device':<20}{'W':<14}{'J_j':<6}requests by number of minima")
    for device in DEVICES:
        for weight, with_inertia in ((PAPER_WEIGHT, False), (PAPER_WEIGHT, True), (Weight(1, 1), True)):
            counts = Counter(proved_map(device, 17, 11, weight, with_inertia)["minima"])
            said = ", ".join(f"{n}: {counts[n]}" for n in sorted(counts))
            name = f"{weight.cutoff_hz:g} Hz, {weight.order}"
            print(f"{device:<20}{name:<14}{'yes' if with_inertia else 'no':<6}{said}")
    if len(sys.argv) > 1:
        draw_table("gain_map", proved_map("default", 45, 41, PAPER_WEIGHT, False), [Path(sys.argv[1])])


if __name__ == "__main__":
    main()
