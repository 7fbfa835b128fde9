"""How often 95 % intervals hold the truth: K, B and I of an exact joint whose angle and torque are
rounded, as `impedance.csv` has them.

Run from the repository: `python benchmarks/interval_coverage.py [seeds]`. The recordings are those
of `planted.py`, none of them by the project; of each kind 150 with another zero of the encoder,
other noise, and where the motion is random another motion. Writes the table into
`docs/bench_validation.md`; six minutes on one core.
"""

import sys
from collections import defaultdict

import numpy as np
import planted
import polars as pl
from causes import ROOT, markdown, write_between
from planted import MOTIONS, Cause, nothing, recording

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.complex_estimate import polar_row
from osl_analysis.bench.impedance import impedance_table, rendered_impedance
from osl_analysis.bench.phasors import phasors_of_record
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import read_section
from osl_analysis.trial import Trial

TORQUE_STEP = 0.02  # N*m
KINDS = {f"{motion}, 14 bits": (motion, {}, 1) for motion in MOTIONS}
KINDS |= {"stepped sine, 14 bits, 250 Hz": ("stepped sine", {}, 4)}
KINDS |= {"stepped sine, 14 bits, 300 µs of true jitter": ("stepped sine", {"jitter": 300e-6}, 1)}
KINDS |= {
    f"{motion}, 18 bits": (motion, {"bits": 18}, 1) for motion in ("stepped sine", "binary steps")
}


def held(kind: str, seeds: int, settings: DynamometerAnalysis) -> dict[str, list[bool]]:
    """Whether the interval of each number holds the truth, by its name."""
    motion, recorder, every = KINDS[kind]
    cause, found = (
        Cause(kind, nothing, 0.0, (), recorder=recorder),
        defaultdict[str, list[bool]](list),
    )
    truth = {name: getattr(cause.joint, name) for name in "KBI"}
    for seed in range(seeds):
        planted.moved.cache_clear()
        samples = pl.DataFrame(recording(cause, 0.0, motion, seed)).gather_every(every)
        torque = (pl.col("torque") / TORQUE_STEP).round() * TORQUE_STEP
        record = record_of_trial(Trial("made", samples.with_columns(torque)), settings)
        for row in impedance_table(*rendered_impedance(record)).to_dicts():
            rows = "all" if row["amplitude_deg"] is None else "one amplitude"
            for name, true in truth.items():
                column = "B_viscous" if name == "B" and row["B_viscous"] is not None else name
                is_held = row[f"{column}_low"] <= true <= row[f"{column}_high"]
                found[f"{name}, {rows}"].append(is_held)
        for segment in phasors_of_record(record):
            hz = round(segment.frequency_hz)
            s = 2j * np.pi * segment.frequency_hz
            Y = 1 / (truth["K"] + truth["B"] * s + truth["I"] * s**2)
            row = polar_row(segment.admittance)
            found[f"abs Y, {hz} Hz"].append(row["magnitude_low"] <= abs(Y) <= row["magnitude_high"])
            found[f"phase, {hz} Hz"].append(
                row["phase_deg_low"] <= np.rad2deg(np.angle(Y)) <= row["phase_deg_high"]
            )
    return found


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    settings = read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis)
    lines = []
    for kind in KINDS:
        if any(word not in kind for word in sys.argv[2:]):
            continue
        found = {
            name: f"{100 * np.mean(values):.0f}"
            for name, values in held(kind, seeds, settings).items()
        }
        fits = [
            " ".join(found.get(f"{name}, {rows}", "–") for name in "KBI")
            for rows in ("all", "one amplitude")
        ]
        phasors = [
            " ".join(found.get(f"{of}, {hz} Hz", "–") for hz in range(1, 6))
            for of in ("abs Y", "phase")
        ]
        lines.append((kind, *fits))
        print(kind, *fits, "Y at 1 to 5 Hz:", *phasors, sep=" | ", flush=True)
    if len(sys.argv) < 2:
        table = markdown(("recording", "K B I, all", "K B I, one amplitude"), lines)
        write_between(ROOT / "docs/bench_validation.md", {"coverage": table})


if __name__ == "__main__":
    main()
