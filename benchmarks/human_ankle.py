"""Recordings of human ankles (REKLAB, GPL-2), after `snakemake` has made both campaigns
(docs/human_joint.md).

python benchmarks/human_ankle.py                the fits as a table, and K over the slow angle of
the pilot python benchmarks/human_ankle.py delays         the fits with one delay of the reflex
after another python benchmarks/human_ankle.py joints SEED    60 known joints, moved by the recorded
angles (a minute of a core) python benchmarks/human_ankle.py bands SEED     20 known joints whose K
changes with the slow angle of the pilot python benchmarks/human_ankle.py muscle SEED    48 known
joints, muscle of second or third order, moved by made angles
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
from scipy import signal
from scipy.interpolate import make_interp_spline

import osl_analysis as osl
from osl_analysis.commands.bench import fit_settings, fit_tables
from osl_analysis.trial import read_trial

CAMPAIGNS = [Path("results", name) for name in ("human_ankle", "human_ankle_pilot")]
RATE_HZ = 1000.0
PERSON = "parameters: null\ndynamometer: {cutoff_hz: 40, human: true}\n"


def recorded(campaign=CAMPAIGNS[0]):
    return [read_trial(path) for path in sorted((campaign / "trials").glob("*.parquet"))]


def table():
    head = [
        "trial",
        "K, N·m/rad",
        "B, N·m·s/rad",
        "I, kg·m²",
        "reflex, % of variance",
        "delay, ms",
        "VAF, %",
    ]
    head += ["held out, %", "late, ms", "K, B without it", "doubtful"]
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    tables = [campaign / "tables" for campaign in CAMPAIGNS]
    fits = [pl.read_csv(tables[0] / "human_joint.csv"), pl.read_csv(tables[1] / "human_joint.csv")]
    fits[1] = fits[1].with_columns(trial=pl.col("trial") + ", K over its slow angle")
    for row in pl.concat(fits, how="diagonal_relaxed").iter_rows(named=True):
        cells = [
            f"{row[k]:.{d}f} ± {row[f'{k}_high'] - row[k]:.{d}f}"
            for k, d in (("K", 0), ("B", 2), ("I", 4))
        ]
        ends = [f"{row[f'reflex_delay_{end}ms']:.0f}" for end in ("", "low_", "high_")]
        cells += [f"{row['reflex_share']:.1f}", f"{ends[0]} ({ends[1]} to {ends[2]})"]
        cells += [f"{row[k]:.1f}" for k in ("VAF", "VAF_held_out")]
        cells.append(
            ""
            if row["lag_s"] is None
            else f"{1e3 * row['lag_s']:.2f} ± {1e3 * row['lag_se_s']:.2f}"
        )
        cells.append(
            f"{row['K_without_lag']:.0f}, {row['B_without_lag']:.2f}" if row["lag_shift"] else ""
        )
        doubts = [one.partition(":")[0] for one in (row["doubtful"] or "").split("; ") if one]
        print(f"| {row['trial']} | {' | '.join(cells)} | {', '.join(doubts) or 'no'} |")
    print()
    for row in pl.read_csv(tables[1] / "impedance_over.csv")[::6].iter_rows(named=True):
        print(f"K at {row['at']:.0f}°: {row['K']:.0f} ± {row['K_high'] - row['K']:.0f} N·m/rad")


def known_joint(rng, theta, change=1.0, order=2, **further):
    """What is true of a joint moved by an angle (n,): K, B, I, and the delay of its reflex [ms];
    its trials without and with this reflex, whose muscle is of second or third order. K changes by
    a factor (n,)."""
    time = np.arange(len(theta)) / RATE_HZ
    omega, alpha = (make_interp_spline(time, theta, 5)(time, order) for order in (1, 2))
    true = {"K": rng.uniform(40, 160), "B": rng.uniform(0.6, 1.4), "I": 0.016}
    # s; rad/s of a low-pass of second order
    delay, w = rng.uniform(0.04, 0.055), rng.uniform(15, 25)
    late = np.maximum(np.concatenate([np.zeros(round(delay * RATE_HZ)), omega])[: len(omega)], 0)
    lag = np.polymul([1 / w**2, 1.8 / w, 1], [1 / w, 1][3 - order :])
    reflex = rng.uniform(2, 8) * signal.lfilter(*signal.bilinear([1.0], lag, RATE_HZ), late)
    will = signal.lfilter(*signal.butter(1, 2, fs=RATE_HZ), rng.standard_normal(len(theta)))
    torque = true["K"] * change * theta + true["B"] * omega + true["I"] * alpha
    torque += 0.5 * will / will.std() + 0.1 * rng.standard_normal(len(theta))
    samples = {"time": time, "theta": theta, **further}
    trials = [
        osl.Trial("joint", pl.DataFrame({**samples, "torque": one}))
        for one in (torque, torque + reflex)
    ]
    return true | {"delay": 1e3 * delay}, *trials


def bands(seed):
    rng, held, wide = np.random.default_rng(seed), [], []
    (pilot,) = recorded(CAMPAIGNS[1])
    _, theta, slow = pilot.arrays("theta", "theta_slow")
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "person.yaml")
        config.write_text(PERSON.replace("true", "{over: theta_slow}"))
        settings, _ = fit_settings("human_joint", config)
        for _ in range(20):
            low, rise, middle, width = rng.uniform([0.1, 0.2, -10, 3], [0.6, 1.2, 8, 8])
            factor = lambda deg: low + rise / (1 + np.exp((middle - deg) / width))  # noqa: B023, E731 - used at once
            true, _, trial = known_joint(rng, theta, factor(np.rad2deg(slow)), theta_slow=slow)
            found = fit_tables("human_joint", trial, None, settings)["impedance_over"]
            K = true["K"] * factor(found["at"].to_numpy())
            held.append((found["K_low"].to_numpy() < K) & (found["K_high"].to_numpy() > K))
            wide.append((found["K_high"] - found["K"]).to_numpy() / K)
    each = 100 * np.mean(held, axis=0)
    print(
        f"{100 * np.mean(held):.1f} % of the intervals hold K, at single angles {each.min():.0f} to"
        f" {each.max():.0f} %"
    )
    print(f"half an interval is {100 * np.median(wide):.0f} % of K")


def delays():
    print("K by the delay of the reflex, N·m/rad\n")
    tried = (10, 20, 30, 40, 50, 60)
    print(f"| trial |{'|'.join(f' {ms} ms ' for ms in tried)}|\n{'|---' * (len(tried) + 1)}|")
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "person.yaml")
        for trial in recorded():
            cells = []
            for ms in tried:
                config.write_text(PERSON.replace("true", f"{{delays_ms: [{ms}]}}"))
                cells.append(f"{osl.fit_impedance(trial, config=config).K:.0f}")
            print(f"| {trial.name} | {' | '.join(cells)} |")


def joints(seed):
    fits = {"a person's": [], "Eq. 15 alone": [], "Eq. 15 alone, without a reflex": []}
    delays, rng, trials = [], np.random.default_rng(seed), recorded()
    with tempfile.TemporaryDirectory() as folder:
        alone, person = Path(folder, "alone.yaml"), Path(folder, "person.yaml")
        alone.write_text("parameters: null\n")
        person.write_text(PERSON)
        for number in range(60):
            _, theta = trials[number % len(trials)].arrays("theta")
            true, without, trial = known_joint(rng, theta)
            cases = (trial, person), (trial, alone), (without, alone)
            for found, (which, config) in zip(fits.values(), cases, strict=True):
                found.append((true, osl.fit_impedance(which, config=config)))
            row, delay = fits["a person's"][-1][1].row, true["delay"]
            holds = row["reflex_delay_low_ms"] <= delay <= row["reflex_delay_high_ms"]
            delays.append([row["reflex_delay_ms"] - delay, holds])
    for name, found in fits.items():
        print(
            f"{name}: {sum('reflex:' in fit.doubtful for _, fit in found)} of {len(found)} are"
            " doubted for a reflex"
        )
        for one in "KBI":
            off = np.array([100 * abs(fit.row[one] / true[one] - 1) for true, fit in found])
            held = sum(
                fit.row[f"{one}_low"] < true[one] < fit.row[f"{one}_high"] for true, fit in found
            )
            print(
                f"  {one} errs by {np.median(off):.1f} % (worst {off.max():.1f} %), {held}"
                " intervals hold it"
            )
    off, held = np.array(delays).T
    print(
        f"the delay errs by {np.median(off):+.0f} ms ({off.min():+.0f} to {off.max():+.0f}), ",
        end="",
    )
    print(f"{held.sum():.0f} ranges of delays hold it")


def muscle(seed):
    rng, time = np.random.default_rng(seed), np.arange(90_000) / RATE_HZ
    random = signal.butter(2, [0.3, 8], "bandpass", fs=RATE_HZ, output="sos")
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "person.yaml")
        config.write_text(PERSON)
        for order in (2, 3):
            held, wide, K = [], [], []
            for number in range(24):
                steps = signal.sosfilt(
                    signal.butter(2, 20, fs=RATE_HZ, output="sos"),
                    0.04 * rng.integers(0, 2, 600).repeat(150),
                )
                noise = signal.sosfilt(random, rng.standard_normal(len(time)))
                true, _, trial = known_joint(
                    rng, steps if number % 2 else 0.03 * noise / noise.std(), order=order
                )
                row = osl.fit_impedance(trial, config=config).row
                low, high = row["reflex_delay_low_ms"], row["reflex_delay_high_ms"]
                held.append(low <= true["delay"] <= high)
                wide.append(high - low)
                K.append(row["K_low"] < true["K"] < row["K_high"])
            print(
                f"muscle of order {order}, of {len(held)}: {sum(held)} ranges hold the delay, ",
                end="",
            )
            print(f"{np.median(wide):.0f} ms wide; {sum(K)} intervals hold K")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["joints", seed]:
            joints(int(seed))
        case ["bands", seed]:
            bands(int(seed))
        case ["muscle", seed]:
            muscle(int(seed))
        case ["delays"]:
            delays()
        case _:
            table()
