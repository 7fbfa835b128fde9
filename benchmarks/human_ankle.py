"""Recordings of human ankles (REKLAB, GPL-2): `convert FILE` writes the CSV files of the campaign, `table` its fits.

FILE is an .npz with an array (n, 2) of angle [rad] and torque [N*m] at 1 kHz per record (docs/human_joint.md).
"""

import sys
from pathlib import Path

import numpy as np
import polars as pl

RAW, TABLE = Path("raw_data/human_ankle"), Path("results/human_ankle/tables/impedance.csv")
RATE_HZ = 1000.0


def convert(path):
    RAW.mkdir(parents=True, exist_ok=True)
    with np.load(path) as found:
        for name in (name for name in found.files if found[name].ndim == 2 and found[name].shape[1] == 2):
            samples = found[name]
            columns = {"time": np.arange(len(samples)) / RATE_HZ, "theta": samples[:, 0], "torque": samples[:, 1]}
            pl.DataFrame(columns).write_csv(RAW / f"{name}.csv")
            print(RAW / f"{name}.csv", f"{len(samples) / RATE_HZ:.1f} s")


def table():
    head = ["trial", "K, N·m/rad", "B, N·m·s/rad", "I, kg·m²", "reflex, % of variance", "delay, ms", "VAF, %"]
    print(f"| {' | '.join([*head, 'held out, %', 'doubtful'])} |\n{'|---' * (len(head) + 2)}|")
    for row in pl.read_csv(TABLE).iter_rows(named=True):
        cells = [f"{row[k]:.{d}f} ± {row[f'{k}_high'] - row[k]:.{d}f}" for k, d in (("K", 0), ("B", 2), ("I", 4))]
        digits = {"reflex_share": 1, "reflex_delay_ms": 0, "VAF": 1, "VAF_held_out": 1}
        cells += [f"{row[k]:.{d}f}" for k, d in digits.items()]
        doubts = [one.partition(":")[0] for one in (row["doubtful"] or "").split("; ") if one]
        print(f"| {row['trial']} | {' | '.join(cells)} | {', '.join(doubts) or 'no'} |")


if __name__ == "__main__":
    convert(sys.argv[2]) if sys.argv[1:2] == ["convert"] else table()
