"""How often the 95 % intervals of K, B and I hold the truth, by motion, without and with friction.

Run from the repository: `python benchmarks/interval_coverage.py [devices] [rows.csv]`, 150 devices
by default, ten minutes on two cores. Nine motions move each device, and each recording is fitted by
`osl.fit`. Every second device has friction, of which nothing is stated. A row per recording goes
into `build/coverage.csv`, the table by motion into `docs/bench_validation.md`.

The recordings are made here with NumPy and SciPy alone, apart from those of `planted.py`. A motion
is white steps, corners or sines behind a Gaussian window at 2 kHz, whose derivatives are those of
the window, so that velocity and acceleration are exact:

    torque = K theta + B omega + I alpha + T_C tanh(omega/width) + offset + drift + noise
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from causes import PAGE, ROOT, WITHOUT_FRICTION, findings_of, markdown, write_between
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import binom

import osl_analysis as osl
from osl_analysis.judge.finding import Grade

Array = NDArray[np.float64]
Draw = np.random.Generator
FINE_HZ = 2000  # rate at which a motion is made [Hz]
RATES_HZ = (100, 125, 200, 250, 400, 500, 1000)  # of recorders; each divides the fine one
WINDOW_LENGTHS = 8.0  # standard deviations of the Gaussian window that count
PROCESSES = 2
NEVER_CHECKED = {  # by a recording of angle and torque alone
    "fixture_inertia",
    "late_torque_unseen",
    "wrong_gain_unseen",
    "clock_rate_unseen",
}


def seconds_of(rng: Draw) -> Array:
    """Time [s] of 30 to 60 s."""
    return np.arange(int(rng.uniform(30, 60) * FINE_HZ)) / FINE_HZ


def stepped_sine(rng: Draw) -> Array:
    """One to three amplitudes, each at four to six frequencies between rests."""
    frequencies_hz = np.linspace(rng.uniform(0.7, 1.2), rng.uniform(4, 6), rng.integers(4, 7))
    cycles = rng.integers(6, 10)
    rest = np.zeros(FINE_HZ)
    parts = [rest]
    for size in (0.5, 1.0, 1.5)[: rng.integers(1, 4)]:
        for hz in frequencies_hz:
            x = np.arange(round(cycles * FINE_HZ / hz)) / FINE_HZ
            parts.append(size * np.sin(2 * np.pi * hz * x))
    return np.concatenate([*parts, rest])


def multisine(rng: Draw) -> Array:
    """Twelve sines from 0.3 to 6 Hz that share no period."""
    t = seconds_of(rng)
    sines = [
        np.sin(2 * np.pi * (hz * t + rng.random())) / hz**0.5 for hz in rng.uniform(0.3, 6, 12)
    ]
    return np.asarray(np.sum(sines, axis=0))


def chirp(rng: Draw) -> Array:
    """From 0.3 to 5 or 8 Hz, and smaller as it becomes faster."""
    t = seconds_of(rng)
    hz = 0.3 * (rng.uniform(5, 8) / 0.3) ** (t / t[-1])
    return np.asarray(np.sin(2 * np.pi * np.cumsum(hz) / FINE_HZ) / np.hypot(1, hz / 2.5))


def noise(rng: Draw) -> Array:
    """Noise between 0.3 and 4 to 7 Hz."""
    white = rng.normal(size=len(seconds_of(rng)))
    frequency_hz = np.fft.rfftfreq(len(white), 1 / FINE_HZ)
    highest = rng.uniform(4, 7)
    shape = (frequency_hz > 0.3) / (1 + (frequency_hz / highest) ** 8) / np.hypot(1, frequency_hz)
    return np.asarray(np.fft.irfft(np.fft.rfft(white) * shape, len(white)))


def steps_between(levels: Callable[[int], Array], holds_s: Array) -> Array:
    """Levels that are held for some times [s]."""
    return np.repeat(levels(len(holds_s)), (holds_s * FINE_HZ).astype(int))


def hand(rng: Draw) -> Array:
    """A hand that reaches for random angles and lingers at some."""
    return steps_between(lambda n: rng.normal(size=n), rng.uniform(0.12, 0.7, 110))


def ramps(rng: Draw) -> Array:
    """Straight ways between random levels, with holds."""
    t = seconds_of(rng)
    moves = np.cumsum(rng.uniform(0.1, 0.6, 400))
    return np.interp(t, moves, np.repeat(rng.uniform(-1, 1, len(moves)), 2)[: len(moves)])


def binary(rng: Draw) -> Array:
    """Random steps between two levels."""
    return steps_between(lambda n: rng.choice([-1.0, 1.0], n), rng.uniform(0.15, 0.6, 120))


def periods(rng: Draw) -> Array:
    """Periods of 5 to 8 s of the odd lines up to 6 Hz, of which one in four is left out."""
    period_s = rng.integers(5, 9)
    lines = np.arange(1, 6 * period_s, 2)
    lines = lines[rng.random(len(lines)) < 0.75]
    t = np.arange(period_s * FINE_HZ) / FINE_HZ
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    one = np.sum(np.sin(2 * np.pi / period_s * np.outer(t, lines) + phases), axis=1)
    return np.tile(one, int(48 // period_s))


# the motion, and the Gaussian window's standard deviation [s], from and to
MOTIONS: Mapping[str, tuple[Callable[[Draw], Array], float, float]] = {
    "stepped sine": (stepped_sine, 0.005, 0.008),
    "multisine": (multisine, 0.005, 0.008),
    "chirp": (chirp, 0.005, 0.008),
    "noise": (noise, 0.005, 0.008),
    "hand": (hand, 0.06, 0.1),
    "ramps": (ramps, 0.015, 0.03),
    "binary steps": (binary, 0.015, 0.03),
    "periods": (periods, 0.005, 0.008),
    "person who leans": (noise, 0.005, 0.008),
}


def recorded(motion: str, device: int) -> tuple[dict[str, Array], dict[str, float]]:
    """Columns of a recording, and the truth."""
    rng = np.random.default_rng([92, [*MOTIONS].index(motion), device])
    make, shortest_s, longest_s = MOTIONS[motion]
    raw = make(rng)
    raw *= np.deg2rad(rng.uniform(1.5, 5)) / np.std(raw)
    window = rng.uniform(shortest_s, longest_s) * FINE_HZ
    theta, omega, alpha = (
        gaussian_filter1d(raw, window, order=order, truncate=WINDOW_LENGTHS) * FINE_HZ**order
        for order in range(3)
    )

    K = float(np.exp(rng.uniform(np.log(5), np.log(3000))))
    I = K / (2 * np.pi * rng.uniform(3, 20)) ** 2
    B = 2 * rng.uniform(0.1, 1.0) * np.sqrt(K * I)
    torque = K * theta + B * omega + I * alpha
    size = float(np.std(torque))
    T_C = size * float(np.exp(rng.uniform(np.log(0.02), np.log(0.25)))) * (device % 2)
    torque = torque + T_C * np.tanh(omega / rng.uniform(2e-3, 20e-3))

    every = FINE_HZ // int(rng.choice(RATES_HZ))
    rows = slice(int(rng.integers(every)), None, every)
    n = len(theta[rows])
    time = np.arange(n) * every / FINE_HZ
    shares = np.exp(rng.uniform(np.log(1e-3), np.log(1e-2), 3))  # of the torque's size
    white = rng.normal(size=n)
    slow = gaussian_filter1d(rng.normal(size=n), rng.uniform(0.1, 0.5) * FINE_HZ / every)
    drift = time / time[-1]
    disturbances = [white, slow / np.std(slow), 3 * drift]
    if motion == "person who leans":
        leans = np.sin(2 * np.pi * time / rng.uniform(9, 25)) > rng.uniform(-0.5, 0.5)
        disturbances.append(30 * gaussian_filter1d(leans * 1.0, 0.5 * FINE_HZ / every))
        shares = np.append(shares, shares[1])
    measured = torque[rows] + size * (rng.normal() + shares @ np.array(disturbances))
    step = 2 * np.pi / 2 ** rng.integers(12, 19)
    zero = rng.uniform(0, step)
    angle = np.round((theta[rows] + zero) / step) * step
    columns = {"time": time, "theta": angle, "torque": measured}
    return columns, {"K": K, "B": B, "I": I, "T_C": T_C}


def row_of(job: tuple[str, int]) -> dict[str, Any]:
    """A recording's estimates, in half-widths of their intervals from the truth; where friction is
    said to be certain, those without friction."""
    motion, device = job
    columns, truth = recorded(motion, device)
    friction = "not found" if truth["T_C"] else "none"
    row: dict[str, Any] = {"motion": motion, "device": device, "friction": friction}
    trial = osl.Trial("device", pl.DataFrame(columns))
    try:
        fit = osl.fit(trial, config=ROOT / "config/config.yaml", parameters=None)
    except osl.OslAnalysisError as error:
        return {**row, "grade": "refused", "cause": str(error)}
    found = fit.table.row(-1, named=True)
    is_certain = found["B_viscous"] is not None
    if truth["T_C"] and is_certain:
        row["friction"] = "found"
    doubts = findings_of(fit, Grade.DOUBTS)
    unchecked = {
        finding.cause
        for finding in fit.findings[-1]
        if finding.grade is Grade.UNCHECKED and finding.name not in NEVER_CHECKED
    }
    row["grade"] = "doubtful" if doubts else "not checked" if unchecked else "clear"
    row["cause"] = ", ".join([*doubts, *sorted(unchecked)])
    for name, beside in WITHOUT_FRICTION.items():
        own = beside if is_certain else name
        half_width = (found[f"{own}_high"] - found[f"{own}_low"]) / 2
        row[name] = (found[f"{own}_low"] + half_width - truth[name]) / half_width
        row[f"{name}_width"] = half_width / truth[name]
    return row


def lines_of(rows: pl.DataFrame) -> Iterator[tuple[object, ...]]:
    """A line per motion: counts of intervals that hold the truth, the range of these for 95 %, by
    how much they are wider than 95 % needs, and what the user is told."""
    for (motion, friction), mine in rows.group_by("motion", "friction", maintain_order=True):
        fitted = mine.filter(pl.col("grade") != "refused")
        if fitted.is_empty():
            yield (motion, friction, f"0, {len(mine)} refused", *4 * ["–"])
            continue
        misses = fitted.select(*"KBI").to_numpy()
        held = (np.abs(misses) <= 1).sum(axis=0)
        within = (int(binom.ppf(p, len(fitted), 0.95)) for p in (0.025, 0.975))
        over_needed = 1 / np.quantile(np.abs(misses), 0.95, axis=0)
        yield (
            motion,
            friction,
            len(fitted),
            ", ".join(map(str, held)),
            "–".join(map(str, within)),
            ", ".join(f"{x:.2g}" for x in over_needed),
            ", ".join(str((mine["grade"] == grade).sum()) for grade in GRADES),
        )


GRADES = ("clear", "doubtful", "not checked", "refused")
HEADER = (
    "motion", "friction", "n", "K, B, I held", "95 %", "over what 95 % needs", ", ".join(GRADES),
)  # fmt: skip


def main() -> None:
    devices = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    rows_file = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "build/coverage.csv"
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(row_of, product(MOTIONS, range(devices)), chunksize=5))
    rows = pl.DataFrame(found, infer_schema_length=None).sort("friction", maintain_order=True)
    rows_file.parent.mkdir(parents=True, exist_ok=True)
    rows.write_csv(rows_file)
    table = markdown(HEADER, lines_of(rows))
    print(table)
    if len(sys.argv) == 1:
        write_between(PAGE, {"coverage": table})


if __name__ == "__main__":
    main()
