"""Recordings of human ankles (REKLAB, GPL-2): prints the fits of their campaign as a table (docs/human_joint.md)."""

from pathlib import Path

import polars as pl

TABLE = Path("results/human_ankle/tables/impedance.csv")


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
    table()
