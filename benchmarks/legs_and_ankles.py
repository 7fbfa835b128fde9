"""K, B and I of legs beside linear theory, and of six human ankles: what the evidence of
`osl_analysis/inference/constants.py` counts.

Run from the repository:

    python benchmarks/legs_and_ankles.py legs results         a folder of results
    python benchmarks/legs_and_ankles.py ankles human_ankles.npz
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
from causes import markdown

import osl_analysis as osl
from osl_analysis.table import with_evidence

SYMBOLS = ("K", "B", "I")
RATE_HZ = 1000.0  # of the ankles' recordings


def print_legs(results: Path) -> None:
    """How often intervals hold what linear theory predicts, by controller.

    That is the truth of an uncompensated leg where its controller has no delay and no filter of the
    velocity (`control_delay` and `velocity_filter` of the simulation off): those of the default
    campaign lower B by 0.03 to 0.22 N*m*s/rad, which the recording holds and the prediction does
    not.
    """
    fits = with_evidence(results / "tables/impedance.csv").filter(scope="all")
    lines = []
    for (controller,), rows in fits.group_by("controller", maintain_order=True):
        held = []
        for symbol in SYMBOLS:
            of_viscous = pl.col("B_viscous").is_not_null() & pl.lit(symbol == "B")
            low, high = (
                pl.when(of_viscous).then(pl.col(f"B_viscous{end}")).otherwise(f"{symbol}{end}")
                for end in ("_low", "_high")
            )
            is_held = rows.select(pl.col(f"{symbol}_predicted").is_between(low, high))
            held.append(int(is_held.to_series().sum()))
        lines.append((controller, len(rows), *held))
    print(markdown(("controller", "n", *(f"{symbol} held" for symbol in SYMBOLS)), lines))


def print_ankles(file: Path) -> None:
    """Estimates, reflex and held-out VAF of each ankle."""
    recordings = np.load(file)
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "person.yaml")
        config.write_text("parameters: null\ndynamometer: {cutoff_hz: 40}\n")
        for name in (name for name in recordings if name != "sv"):
            theta, torque = recordings[name].astype(float).T
            time = np.arange(len(theta)) / RATE_HZ
            samples = pl.DataFrame({"time": time, "theta": theta, "torque": -torque})
            fit = osl.fit_impedance(osl.Trial(name, samples), config=config, parameters=None)
            row = fit.row
            cells = [name]
            for symbol in SYMBOLS:
                half_width = (row[f"{symbol}_high"] - row[f"{symbol}_low"]) / 2
                cells.append(f"{row[symbol]:.4g} ± {half_width:.2g}")
            delay_ms = row["reflex_delay_ms"]
            cells.append("–" if delay_ms is None else f"{delay_ms:.0f} ms")
            cells.append(f"{row['VAF_in_band']:.1f}")
            cells.append(fit.doubtful.partition(":")[0] or "–")
            lines.append(cells)
    print(markdown(("ankle", *SYMBOLS, "reflex", "VAF in band, %", "doubt"), lines))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("legs", "ankles"))
    parser.add_argument("path", type=Path, help="folder of results, or file of ankles")
    options = parser.parse_args()
    if options.part == "legs":
        print_legs(options.path)
    else:
        print_ankles(options.path)


if __name__ == "__main__":
    main()
