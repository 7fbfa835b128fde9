"""The one inference (`osl_analysis/inference`) beside today's witness, on the same recordings.

Run from the repository:

    python benchmarks/inference.py causes --seeds 1        planted causes of `planted.py`
    python benchmarks/inference.py coverage --seeds 100-109
    python benchmarks/inference.py legs /tmp/results/trials impedance trials of a campaign
    python benchmarks/inference.py ankles human_ankles.npz  six human ankles

Every part prints a table; `--rows FILE` keeps a row per recording, and `--resume` goes on with
them. The design was looked at with seed 1 alone; every other seed is unseen.
"""

import argparse
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import causes
import numpy as np
import planted
import polars as pl
from planted import CAUSES, SOUND, Cause, recording

import osl_analysis as osl
from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.record import actuator_turns, signals_of, with_actuator
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import read_section
from osl_analysis.inference import ImpedanceInference, infer_impedance
from osl_analysis.judge.finding import Grade
from osl_analysis.trial import Trial, read_trial

ROOT = Path(__file__).resolve().parents[1]
SYMBOLS = ("K", "B", "I")
WITHOUT_FRICTION = {"K": "K_without_friction", "B": "B_viscous", "I": "I_without_friction"}
OFF = causes.OFF  # half-widths beyond which an estimate is off
FAR_OFF = 3.0  # half-widths beyond which it is silently wrong
CERTAIN_FRICTION = 0.9  # probability above which the row says that friction is in the model
NAMED = {
    "path": ("torque path",),
    "time": ("change over time",),
    "damping by speed": ("damping that depends on speed",),
    "speed": ("backlash",),
    "dead zone": ("backlash", "spring that is not linear"),
    "size": ("spring that is not linear",),
    "direction": ("asymmetric torque",),
    "clipping": ("clipped signal",),
}
"""Causes of the judge that an explanation is, by its name, else by its family."""


PERSONS_WILL_HZ = 1.0  # below it 0.4.0 fits no torque of a person, and its VAF counts none
UNTOLD = ("gravity of a fixture", "torque of the wrong sign")
"""Causes that no model of the joint tells: the judge refuses a negative stiffness."""


@dataclass(frozen=True)
class Row:
    """One recording, by one of the two."""

    recording: str
    size: str
    motion: str
    seed: int
    by: str  # witness, or inference
    outcome: str  # right, other, within, off, silent, refused
    named: str | None
    K: float | None = None
    B: float | None = None
    I: float | None = None
    K_half: float | None = None
    B_half: float | None = None
    I_half: float | None = None
    K_miss: float | None = None  # half-widths by which the interval misses the truth
    B_miss: float | None = None
    I_miss: float | None = None
    # error of the offered estimate over that of the recorded one, where a fault is named
    error_ratio: float | None = None
    cpu_s: float | None = None


@cache
def settings() -> DynamometerAnalysis:
    return read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis)


# ---- planted causes


def outcome_of(named: Sequence[str], right: Sequence[str], misses: np.ndarray) -> str:
    """What a recording's judgement is worth: names come before misses."""
    if set(named) & set(right):
        return "right"
    # friction is a part of the fit, and no fault: what counts is whether the interval holds
    if named and tuple(named) != ("friction",):
        return "other"
    worst = float(np.abs(misses).max())
    if worst > FAR_OFF:
        return "silent"
    return "off" if worst > OFF else "within"


def by_witness(cause: Cause, size: float, at: str, motion: str, seed: int) -> Row:
    """Today's fit of a recording, and its first doubt."""
    began = time.process_time()
    fit = causes.fitted(cause, size, motion, seed, gains=False)
    cpu = time.process_time() - began
    place = (cause.name, at, motion, seed, "witness")
    if isinstance(fit, Exception):
        outcome = "right" if "refused" in cause.right else "refused"
        return Row(*place, outcome, "refused", cpu_s=cpu)
    row = fit.table.row(-1, named=True)
    values, halves = [], []
    for symbol in SYMBOLS:
        # friction that is certain, or may be what is heard, is not in the damping
        beside = symbol == "B" and row["B_viscous"] is not None
        column = WITHOUT_FRICTION[symbol] if beside else symbol
        low, high = row[f"{column}_low"], row[f"{column}_high"]
        values.append((low + high) / 2 if row[column] is None else row[column])
        halves.append((high - low) / 2)
    named = causes.findings_of(fit, Grade.DOUBTS)[:1]
    return filled(place, cause, named, np.array(values), np.array(halves), cpu)


def by_inference(cause: Cause, size: float, at: str, motion: str, seed: int) -> Row:
    """The one inference of a recording, and its doubt."""
    place = (cause.name, at, motion, seed, "inference")
    trial = Trial("planted", pl.DataFrame(recording(cause, size, motion, seed)))
    try:
        signals = signals_of(record_of_trial(trial, settings()))
    except osl.OslAnalysisError:
        outcome = "right" if "refused" in cause.right else "refused"
        return Row(*place, outcome, "refused")
    began = time.process_time()
    inferred = infer_impedance(signals)
    cpu = time.process_time() - began
    estimates = [getattr(inferred.impedance, symbol) for symbol in SYMBOLS]
    recorded = np.array([getattr(inferred.sound, symbol).value for symbol in SYMBOLS])
    values = np.array([estimate.value for estimate in estimates])
    halves = np.array([estimate.half_width for estimate in estimates])
    return filled(place, cause, causes_of(inferred), values, halves, cpu, recorded)


def causes_of(inferred: ImpedanceInference) -> tuple[str, ...]:
    """The judge's causes for what the inference names first; empty if it names nothing."""
    if inferred.reflex is not None and inferred.reflex_harm > 1:
        return ("reflex",)
    if inferred.doubt is not None:
        doubt = inferred.doubt
        return NAMED.get(doubt.name) or NAMED[doubt.family]
    if inferred.friction_probability > CERTAIN_FRICTION and inferred.friction_harm > 1:
        return ("friction",)
    return ()


def filled(
    place: tuple[str, str, str, int, str],
    cause: Cause,
    named: Sequence[str],
    values: np.ndarray,
    halves: np.ndarray,
    cpu: float,
    recorded: np.ndarray | None = None,
) -> Row:
    """A row with estimates; the truth is that of the planted joint."""
    true = np.array([getattr(cause.joint, symbol) for symbol in SYMBOLS])
    misses = (values - true) / halves
    ratio = None
    if recorded is not None and named and named != ("friction",):
        matters = np.abs(true) + np.array([2.0, 0.1, 1e-3])
        offered_error = float(np.max(np.abs(values - true) / matters))
        ratio = offered_error / float(np.max(np.abs(recorded - true) / matters))
    return Row(
        *place,
        outcome_of(named, cause.right, misses),
        " / ".join(named) or None,
        *values.tolist(),
        *halves.tolist(),
        *misses.tolist(),
        ratio,
        cpu,
    )


def planted_cases(
    seeds: Sequence[int], words: Sequence[str], sizes: Sequence[str]
) -> Iterator[tuple[Cause, str, float, str, int]]:
    """Recordings that hold what decides: no wrong gain or weight, which nothing in them tells."""
    for cause in (*SOUND, *CAUSES):
        if cause.needs_gains or cause.name in UNTOLD:
            continue
        if words and not any(word in cause.name for word in words):
            continue
        for motion in cause.motions:
            for seed in seeds:
                for at, size in sizes_of(cause, motion, sizes):
                    yield cause, at, size, motion, seed


def sizes_of(cause: Cause, motion: str, sizes: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Sizes of a cause: reported, or in half-widths of a sound recording."""
    if cause in SOUND:
        yield "–", cause.reported
        return
    for at in sizes:
        if at == causes.REPORTED:
            yield at, cause.reported
        elif cause.sized:
            half = causes.sound_half_widths(motion)
            size = planted.size_that_moves(cause, motion, half, float(at))
            if size is not None and size <= causes.LARGEST * cause.reported:
                yield at, size


def run_causes(options: argparse.Namespace) -> pl.DataFrame:
    rows = read_rows(options)
    known = {(row["recording"], row["size"], row["motion"], row["seed"], row["by"]) for row in rows}
    tried = {"witness": by_witness, "inference": by_inference}
    for cause, at, size, motion, seed in planted_cases(options.seeds, options.only, options.sizes):
        for name in options.by:
            if (cause.name, at, motion, seed, name) in known:
                continue
            rows.append(asdict(tried[name](cause, size, at, motion, seed)))
        keep_rows(rows, options)
    return table_of(rows)


def table_of(rows: Sequence[dict[str, Any]]) -> pl.DataFrame:
    return pl.DataFrame(rows, infer_schema_length=None)


def read_rows(options: argparse.Namespace) -> list[dict[str, Any]]:
    if options.resume and options.rows is not None and options.rows.exists():
        return pl.read_csv(options.rows, infer_schema_length=None).to_dicts()
    return []


def keep_rows(rows: Sequence[dict[str, Any]], options: argparse.Namespace) -> None:
    if options.rows is not None:
        table_of(rows).write_csv(options.rows)


def print_causes(table: pl.DataFrame) -> None:
    """Sound and planted recordings, by witness and inference."""
    sound_names = [cause.name for cause in SOUND]
    for is_sound, title in ((True, "sound"), (False, "planted")):
        lines: list[tuple[object, ...]] = []
        for (by,), rows in table.group_by("by", maintain_order=True):
            part = rows.filter(pl.col("recording").is_in(sound_names) == is_sound)
            if part.is_empty():
                continue
            lines.append((title, by, *counts_of(part, is_sound)))
        print(causes.markdown(("recordings", "by", *HEADER), lines), end="\n\n")
    print(causes.markdown(("planted", "n", "witness", "inference"), by_cause(table)))


HEADER = (
    "n",
    "right first",
    "wrong first",
    "refused",
    "silent (3 half-widths)",
    "off (1.5)",
    "K, B, I held, %",
    "offered worse than recorded",
    "CPU, median (95 %) s",
)


def counts_of(rows: pl.DataFrame, is_sound: bool) -> tuple[object, ...]:
    count = {
        name: len(rows.filter(pl.col("outcome") == name))
        for name in ("right", "other", "refused", "silent", "off")
    }
    misses = rows.select("K_miss", "B_miss", "I_miss").drop_nulls().to_numpy()
    held = " ".join(f"{100 * x:.0f}" for x in (np.abs(misses) <= 1).mean(axis=0)) or "–"
    ratios = rows["error_ratio"].drop_nulls()
    worse = f"{int((ratios > 1).sum())} of {len(ratios)}" if len(ratios) else "–"
    cpu = rows["cpu_s"].drop_nulls().to_numpy()
    times = f"{np.median(cpu):.2f} ({np.quantile(cpu, 0.95):.2f})" if len(cpu) else "–"
    accused = count["right"] + count["other"] if is_sound else count["other"]
    right = "–" if is_sound else count["right"]
    others = (count["refused"], count["silent"], count["off"])
    return (len(rows), right, accused, *others, held, worse, times)


def by_cause(table: pl.DataFrame) -> Iterable[tuple[object, ...]]:
    """Outcomes of each cause: right, other, silent, off, within."""
    for (cause,), rows in table.group_by("recording", maintain_order=True):
        cells = []
        for by in ("witness", "inference"):
            part = rows.filter(pl.col("by") == by)
            counts = part.group_by("outcome").len().sort("outcome").rows()
            cells.append(", ".join(f"{n} {name}" for name, n in counts))
        yield cause, len(rows.filter(pl.col("by") == rows["by"][0])), *cells


def print_widths(table: pl.DataFrame) -> None:
    """Widths of the inference over the witness's, of sound recordings."""
    sound_names = [cause.name for cause in SOUND]
    sound = table.filter(pl.col("recording").is_in(sound_names) & pl.col("named").is_null())
    keys = ["recording", "size", "motion", "seed"]
    halves = [f"{symbol}_half" for symbol in SYMBOLS]
    sides = [sound.filter(pl.col("by") == by) for by in ("inference", "witness")]
    both = sides[0].join(sides[1].select(*keys, *halves), on=keys, suffix="_witness")
    for name in halves:
        ratio = (both[name] / both[f"{name}_witness"]).drop_nulls().to_numpy()
        if len(ratio):
            print(
                f"{name}: width over the witness's, median {np.median(ratio):.2f}, "
                f"90 % {np.quantile(ratio, 0.9):.1f}, of {len(ratio)}"
            )


# ---- coverage


def run_coverage(options: argparse.Namespace) -> None:
    """How often the inference's intervals hold the truth, in the recordings of
    `interval_coverage.py`, with torque in steps of 0.02 N*m."""
    kinds = {motion: (motion, {}) for motion in planted.MOTIONS}
    kinds |= {"ramps": ("ramps", {})}
    kinds |= {f"{motion}, 12 bits": (motion, {"bits": 12.0}) for motion in ("hand", "noise")}
    kinds |= {"ramps, 13 bits": ("ramps", {"bits": 13.0})}
    lines = []
    for kind, (motion, recorder) in kinds.items():
        if options.only and not any(word in kind for word in options.only):
            continue
        cause = Cause(kind, planted.NOTHING, 0.0, (), recorder=recorder)
        true = [getattr(cause.joint, symbol) for symbol in SYMBOLS]
        held, accused = [], 0
        for seed in options.seeds:
            planted.moved.cache_clear()
            samples = pl.DataFrame(recording(cause, 0.0, motion, seed))
            torque = (pl.col("torque") / 0.02).round() * 0.02
            record = record_of_trial(Trial("made", samples.with_columns(torque)), settings())
            inferred = infer_impedance(signals_of(record))
            estimates = [getattr(inferred.impedance, symbol) for symbol in SYMBOLS]
            held.append([e.holds(x) for e, x in zip(estimates, true, strict=True)])
            accused += inferred.doubt is not None
        shares = " ".join(f"{100 * x:.0f}" for x in np.mean(held, axis=0))
        lines.append((kind, len(options.seeds), shares, accused))
        print(*lines[-1], sep=" | ", flush=True)
    print(causes.markdown(("recording", "n", "K B I held, %", "accused"), lines))


# ---- legs


def run_legs(options: argparse.Namespace) -> None:
    """Impedance trials of a campaign, beside what linear theory predicts.

    The truth of an uncompensated leg is the prediction where its controller has no delay and no
    filter of the velocity (`control_delay` and `velocity_filter` of the simulation off): those of
    the default campaign lower B by 0.03 to 0.22 N*m*s/rad, which the recording holds and the
    prediction does not.
    """
    folder, fits = Path(options.path), Path(options.path).parent / "fits/impedance"
    lines: list[list[str]] = []
    held: dict[str, list[list[bool]]] = {}
    for path in sorted(folder.glob("impedance_*.parquet")):
        trial = read_trial(path)
        record = with_actuator(record_of_trial(trial, settings()), trial)
        began = time.process_time()
        inferred = infer_impedance(signals_of(record, actuator_turns(record)))
        cpu = time.process_time() - began
        row = pl.read_csv(fits / f"{path.stem}.csv").row(-1, named=True)
        cells = [path.stem.removeprefix("impedance_")]
        estimates = [(getattr(inferred.impedance, symbol), symbol) for symbol in SYMBOLS]
        holds = [estimate.holds(row[f"{symbol}_predicted"]) for estimate, symbol in estimates]
        held.setdefault(path.stem.rpartition("_")[2], []).append(holds)
        for symbol in SYMBOLS:
            mine = getattr(inferred.impedance, symbol)
            column = WITHOUT_FRICTION[symbol]
            theirs = row[column]
            cells.append(
                f"{row[f'{symbol}_predicted']:.4g} | {mine.value:.4g} ± {mine.half_width:.2g}"
                f" | {theirs:.4g} ± {row[f'{column}_high'] - theirs:.2g}"
                if theirs is not None
                else f"{row[f'{symbol}_predicted']:.4g} | {mine.value:.4g} ± {mine.half_width:.2g}"
                f" | {row[symbol]:.4g} (with friction)"
            )
        doubt = inferred.doubt
        cells.append(f"{doubt.name} {doubt.probability:.2f}" if doubt else "–")
        cells.append(f"{inferred.friction_probability:.2f}")
        cells.append(f"{cpu:.2f}")
        lines.append(cells)
        print(*cells, sep=" | ", flush=True)
    for controller, of_trials in held.items():
        counts = ", ".join(str(n) for n in np.sum(of_trials, axis=0))
        print(f"{controller}: K, B, I predicted and held in {counts} of {len(of_trials)}")


# ---- human ankles


def run_ankles(options: argparse.Namespace) -> None:
    """Six human ankles: reflex, intervals, and held-out VAF beside 0.4.0's `human: true`."""
    arrays = np.load(options.path)
    names = [name for name in arrays if name != "sv"]
    header = ("ankle", "K", "B", "I", "reflex", "held out, %", "0.4.0: K, B, I, held out", "doubt")
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "person.yaml")
        config.write_text("parameters: null\ndynamometer: {cutoff_hz: 40}\n")
        for name in names:
            theta, torque = arrays[name].astype(float).T
            clock = np.arange(len(theta)) / 1000.0
            samples = {"time": clock, "theta": theta, "torque": -torque}
            trial = Trial(name, pl.DataFrame(samples))
            signals = signals_of(record_of_trial(trial, settings()))
            inferred = infer_impedance(signals, vaf_from_hz=PERSONS_WILL_HZ)
            cells = [name]
            for symbol in SYMBOLS:
                mine = getattr(inferred.impedance, symbol)
                cells.append(f"{mine.value:.4g} ± {mine.half_width:.2g}")
            reflex = inferred.reflex
            cells.append(
                f"{1e3 * reflex.delay_s:.0f} ms, {reflex.probability:.2f},"
                f" gains {reflex.rising.value:.1f} and {reflex.falling.value:.1f}"
                if reflex
                else "–"
            )
            cells.append(f"{inferred.VAF_held_out:.1f}")
            if "witness" in options.by:
                row = osl.fit_impedance(trial, config=config, parameters=None).row
                old = [f"{row[s]:.3g} ± {row[f'{s}_high'] - row[s]:.2g}" for s in SYMBOLS]
                cells.append(f"{', '.join(old)}, {row['VAF_held_out']:.1f}")
            else:
                cells.append("–")
            doubt = inferred.doubt
            cells.append(f"{doubt.name} {doubt.probability:.2f}" if doubt else "–")
            lines.append(cells)
    print(causes.markdown(header, lines))


def seeds_of(text: str) -> list[int]:
    """Seeds stated as `1` or `3-9`."""
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("causes", "coverage", "legs", "ankles"))
    parser.add_argument("path", nargs="?", help="folder of trials, or file of ankles")
    parser.add_argument("--seeds", type=seeds_of, default=[1], metavar="A-B")
    parser.add_argument("--only", nargs="*", default=(), metavar="WORD", help="causes by a word")
    parser.add_argument("--sizes", nargs="*", default=(causes.REPORTED,), choices=causes.SIZES)
    parser.add_argument("--by", nargs="*", default=("witness", "inference"))
    parser.add_argument("--rows", type=Path, metavar="FILE", help="keep the rows here")
    parser.add_argument("--resume", action="store_true", help="take rows of the file as they are")
    options = parser.parse_args()
    match options.part:
        case "causes":
            table = run_causes(options)
            print_causes(table)
            print_widths(table)
        case "coverage":
            run_coverage(options)
        case "legs":
            run_legs(options)
        case "ankles":
            run_ankles(options)


if __name__ == "__main__":
    main()
