"""The table of docs/torque_angle.md, from the results of `config/campaigns/desr`.

python benchmarks/desr.py
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from osl_analysis.table import read_table

TABLE = Path("results/desr/tables/torque_angle.csv")
HEAD = (
    "trial", "angle, deg", "torque, N·m", "K, N·m/rad", "K by the bench's angle",
    "slope of the curve, N·m/rad",
    "stored, J", "returned, J", "lost, J", "returned", "hysteresis, N·m", "desired, RMS N·m",
)  # fmt: skip


def cells(row: Mapping[str, Any]) -> list[str]:
    """One trial of `torque_angle.csv` for the page."""
    desired = row["desired_rms"]
    return [
        row["trial"],
        f"{row['angle_min_deg']:.1f} to {row['angle_max_deg']:.1f}",
        f"{row['torque_min']:.1f} to {row['torque_max']:.1f}",
        f"{row['K']:.0f}",
        f"{row['K_uncorrected']:.0f}",
        f"{row['K_lowest']:.0f} to {row['K_highest']:.0f}",
        f"{row['energy_stored']:.2f}",
        f"{row['energy_returned']:.2f}",
        f"{row['energy_lost']:.2f}",
        f"{100 * row['returned_share']:.0f} %",
        f"{row['hysteresis_torque']:.1f}",
        "–" if desired is None else f"{row['desired']} {desired:.1f}",
    ]


def line(texts: list[str]) -> str:
    """One line of a Markdown table."""
    return f"| {' | '.join(texts)} |"


if __name__ == "__main__":
    print(line(list(HEAD)))
    print(f"|{'---|' * len(HEAD)}")
    for row in read_table(TABLE).to_dicts():
        print(line(cells(row)))
