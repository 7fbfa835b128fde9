# SPDX-License-Identifier: Apache-2.0
"""The confusion matrix of the bench: which cause is planted, and which is named first.

Run from the repository: `python benchmarks/causes.py`. The recordings are those of `planted.py`, an
exact joint with one cause of error, at sizes that move K, B or I by 1, 3, 10 and 100 half-widths of
their interval in a sound recording and at the size at which it was reported. Each is fitted by
`osl.fit`, with and without gains. Writes the tables into `docs/bench_validation.md` and a
row per recording into `build/causes.csv`; half an hour on one core.

`--quick` makes a part of it in three minutes and writes nothing, `--only WORD` the causes that have
the word in their name. `--against FILE` says which cells are worse than those of another file of
rows.
"""

import argparse
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import planted
import polars as pl
from planted import CAUSES, MOTIONS, SOUND, Cause, recording, size_that_moves

import osl_analysis as osl
from osl_analysis import notebook
from osl_analysis.campaign.configuration import OF_CONFIG
from osl_analysis.judge.rules import Grade

ROOT = Path(__file__).resolve().parents[1]
PAGE, ROWS = ROOT / "docs/bench_validation.md", ROOT / "build/causes.csv"
# reading the configuration takes as long as a fit
notebook.config_for_trials = cache(notebook.config_for_trials)
GAINS = osl.DesiredImpedance("compensated", K_d=300.9, B_d=4.56)  # by linear theory K 300, B 5
LEG_K_S = 685.6  # N*m/rad, of the belt in the parameter file that the configuration names
HALF_WIDTHS = (1.0, 3.0, 10.0, 100.0)
REPORTED = "reported"
SIZES = (*(f"{k:g}" for k in HALF_WIDTHS), REPORTED)
ROW = {
    "cause": pl.String,
    "at": pl.String,
    "size": pl.Float64,
    "motion": pl.String,
    "gains": pl.Boolean,
}
ROW |= {
    "seed": pl.Int64,
    "outcome": pl.String,
    "named": pl.String,
    "worst": pl.String,
    "miss": pl.Float64,
}
KEY = ("cause", "at", "motion", "gains", "seed")
LARGEST = 3.0  # times the size that was met; larger ones are no recording of a laboratory
# half-widths of a 95 % interval; one of K, B, I is off by more in 1 of 110 sound recordings
OFF = 1.5
# share of K, B and I from which a change matters, as the shipped configuration has it
ACCURACY = {"K": 0.02, "B": 0.05, "I": 0.2}
WITHOUT_FRICTION = {"K": "K_without_friction", "B": "B_viscous", "I": "I_without_friction"}
BAD = ("silent", "not checked", "refused")


def findings_of(fit: Any, *grades: Grade) -> list[str]:
    """The causes of the findings of some grades about the fit to all of a recording, the first one
    first."""
    return [finding.cause for finding in fit.findings[-1] if finding.grade in grades]


def worst_miss(row: dict[str, Any], joint: planted.Joint) -> tuple[str, float]:
    """Which of K, B and I misses its truth by most of its half-widths, of those that miss it by
    more than the accuracy that the user needs; 0 if none does. Where friction is certain, B is
    B_viscous."""
    misses = {}
    for name, beside in WITHOUT_FRICTION.items():
        own = beside if name == "B" and row["B_viscous"] is not None else name
        low, high = row[f"{own}_low"], row[f"{own}_high"]
        value = (low + high) / 2 if row[own] is None else row[own]
        truth = getattr(joint, name)
        matters = abs(value - truth) > ACCURACY[name] * abs(truth)
        misses[name] = (value - truth) / ((high - low) / 2) if matters else 0.0
    worst = max(misses, key=lambda name: abs(misses[name]))
    return worst, misses[worst]


def fitted(cause: Cause, size: float, motion: str, seed: int, gains: bool) -> Any:
    """The fit of a recording, or its refusal."""
    trial = osl.Trial("planted", pl.DataFrame(recording(cause, size, motion, seed)))
    # a device that the leg's belt cannot render is another one, which a drafted campaign states by
    # `parameters: null`
    device = OF_CONFIG if cause.joint.K < LEG_K_S else None
    try:
        return osl.fit(
            trial,
            desired=GAINS if gains else None,
            config=ROOT / "benchmarks/nothing_stated.yaml",
            parameters=device,
        )
    except osl.OslAnalysisError as error:
        return error


@cache
def sound_half_widths(motion: str) -> planted.Array:
    """Half-widths (3,) of K, B and I of a sound recording."""
    row = fitted(SOUND[0], 0.0, motion, 1, False).table.row(-1, named=True)
    return np.array([(row[f"{name}_high"] - row[f"{name}_low"]) / 2 for name in "KBI"])


@cache
def usually_unchecked(motion: str, gains: bool) -> frozenset[str]:
    """What a sound recording of a motion is not checked for."""
    found = fitted(SOUND[0], 0.0, motion, 1, gains)
    return (
        frozenset()
        if isinstance(found, Exception)
        else frozenset(findings_of(found, Grade.UNCHECKED, Grade.NOTES))
    )


def judged(
    cause: Cause, at: str, size: float, motion: str, seed: int, gains: bool
) -> dict[str, Any]:
    """The row of one recording. Its outcome is `right` or `other`, by the first cause that is
    named; `refused`; and where nothing is named `silent` or `not checked` if an estimate is off,
    else `within`."""
    fit = fitted(cause, size, motion, seed, gains)
    of = {
        "cause": cause.name,
        "at": at,
        "size": float(f"{size:.3g}"),
        "motion": motion,
        "gains": gains,
        "seed": seed,
    }
    if isinstance(fit, Exception):
        outcome = "right" if "refused" in cause.right else "refused"
        return {**of, "outcome": outcome, "named": "refused", "worst": None, "miss": None}
    worst, miss = worst_miss(fit.table.row(-1, named=True), cause.joint)
    told = (finding for finding in fit.findings[-1] if finding.grade is not Grade.UNCHECKED)
    results = [finding.cause for finding in told if finding.is_result]
    named = next(iter([*findings_of(fit, Grade.DOUBTS), *results]), None)
    if named is not None:
        outcome = "right" if named in cause.right else "other"
    elif abs(miss) < OFF:
        outcome = "within"
    else:
        unchecked = {*findings_of(fit, Grade.UNCHECKED, Grade.NOTES)} - (
            usually_unchecked(motion, gains) - {cause.told}
        )
        is_weighed = not fit.budget.filter(source="unexplained_torque").is_empty()
        outcome = "not checked" if unchecked or not is_weighed else "silent"
    return {**of, "outcome": outcome, "named": named, "worst": worst, "miss": float(f"{miss:.3g}")}


def cases(
    cause: Cause, motion: str, quick: bool, large: bool
) -> Iterable[tuple[str, float, int, bool]]:
    """Size in words, size, seed and whether the gains are stated, of each recording of a cause and
    a motion, of the large sizes or of the small ones. Gains are stated at the size that was met, of
    which there are two seeds."""
    sound = cause in SOUND
    sizes: dict[str, float | None] = {"–" if sound else REPORTED: cause.reported} if large else {}
    if cause.sized and not sound:
        half, wanted = (
            sound_half_widths(motion),
            HALF_WIDTHS[3:] if large else () if quick else HALF_WIDTHS[:3],
        )
        sizes = {
            f"{times:g}": size_that_moves(cause, motion, half, times) for times in wanted
        } | sizes
    exact = cause.joint == planted.Joint()  # the joint that these gains render
    for at, size in sizes.items():
        if size is None or (at != "–" and size > LARGEST * cause.reported):
            continue
        several = at in ("–", REPORTED) and not quick
        for seed in (1, 2) if several else (1,):
            if not cause.needs_gains:
                yield at, size, seed, False
            if cause.needs_gains or (exact and at in ("–", REPORTED) and seed == 1):
                yield at, size, seed, True


def study(
    only: Sequence[str], quick: bool, done: pl.DataFrame, rows_file: Path | None
) -> pl.DataFrame:
    """A row per recording; those that are `done` are taken as they are. The sizes that were met
    come first, the small ones last; the rows are written after each cause."""
    known = {tuple(row[name] for name in KEY) for row in done.iter_rows(named=True)}
    rows = done.to_dicts()
    for large in (True, False):
        for cause in (*SOUND, *CAUSES):
            if only and not any(word in cause.name for word in only):
                continue
            began, mine = time.monotonic(), []
            for motion in cause.motions[:3] if quick else cause.motions:
                for at, size, seed, gains in cases(cause, motion, quick, large):
                    if (cause.name, at, motion, gains, seed) not in known:
                        mine.append(judged(cause, at, size, motion, seed, gains))
            if not mine:
                continue
            counts = ", ".join(
                f"{n} {name}" for name, n in Counter(row["outcome"] for row in mine).most_common()
            )
            print(
                f"{cause.name}: {counts} ({time.monotonic() - began:.0f} s)",
                file=sys.stderr,
                flush=True,
            )
            rows += mine
            if rows_file is not None:
                rows_file.parent.mkdir(parents=True, exist_ok=True)
                in_order(rows).write_csv(rows_file)
    return in_order(rows)


def in_order(rows: Sequence[dict[str, Any]]) -> pl.DataFrame:
    """Rows by cause, size and motion."""
    names, motions = [one.name for one in (*SOUND, *CAUSES)], [*MOTIONS, *planted.OTHER_MOTIONS]

    def place(row: dict[str, Any]) -> tuple[Any, ...]:
        sizes = ("–", *SIZES)
        return (
            names.index(row["cause"]),
            sizes.index(row["at"]),
            motions.index(row["motion"]),
            row["gains"],
            row["seed"],
        )

    return pl.DataFrame(sorted(rows, key=place), schema=ROW)


def named_in(rows: pl.DataFrame) -> str:
    """Causes that were named first, and how often."""
    counts = Counter(name for name in rows["named"].to_list() if name and name != "refused")
    return ", ".join(f"{name} {n}" for name, n in counts.most_common()) or "–"


def count_of(rows: pl.DataFrame, outcome: str) -> int:
    return len(rows.filter(pl.col("outcome") == outcome))


def markdown(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def matrix(rows: pl.DataFrame) -> str:
    """A row per planted cause, sizes and motions together, without the size of one half-width,
    which no recording shows."""
    header = ("planted", "n", "named", "first cause named", "not checked", "within", "silent")
    lines = []
    for (cause,), mine in rows.group_by("cause", maintain_order=True):
        if cause in {one.name for one in SOUND}:
            continue
        large = mine.filter(pl.col("at") != "1")
        counts = [count_of(large, outcome) for outcome in ("not checked", "within", "silent")]
        lines.append((cause, len(large), count_of(large, "right"), named_in(large), *counts))
    return markdown(header, lines)


def by_motion(rows: pl.DataFrame) -> str:
    """Per planted cause and motion: how many are named, and how many off without a doubt (silent or
    not checked), of how many; with stated gains after the stroke."""
    lines = []
    for (cause,), mine in rows.filter(pl.col("at") != "1").group_by("cause", maintain_order=True):
        if cause in {one.name for one in SOUND}:
            continue
        cells = []
        for motion in MOTIONS:
            parts = []
            for gains in (False, True):
                own = mine.filter((pl.col("motion") == motion) & (pl.col("gains") == gains))
                bad = count_of(own, "silent") + count_of(own, "not checked")
                parts.append(f"{count_of(own, 'right')}, {bad} of {len(own)}" if len(own) else "–")
            cells.append(" / ".join(parts))
        if any(cell != "– / –" for cell in cells):
            lines.append((cause, *cells))
    return markdown(("planted", *MOTIONS), lines)


def sound_table(rows: pl.DataFrame) -> str:
    """How many sound recordings are accused of what they do not have, refused, or off without a
    doubt: a row for the kinds that have the same wrong, and for all."""
    alike: dict[tuple[str, bool, bool], list[pl.DataFrame]] = {}
    for (cause,), mine in rows.group_by("cause", maintain_order=True):
        if cause in {one.name for one in SOUND}:
            wrongly = named_in(mine.filter(pl.col("outcome") == "other"))
            causes = "".join(letter for letter in wrongly if not letter.isdigit())
            wrong = causes, count_of(mine, "refused") > 0, off_of(mine) > 0
            alike.setdefault(wrong, []).append(mine)
    lines = [sound_row(pl.concat(kinds)) for kinds in alike.values()]
    every = sound_row(pl.concat([mine for kinds in alike.values() for mine in kinds]))
    lines.append(("all", *every[1:]))
    return markdown(
        ("sound recording", "n", "accused", "of", "refused", "off, nothing said"), lines
    )


def off_of(rows: pl.DataFrame) -> int:
    """How many are off, and not doubted."""
    return count_of(rows, "silent") + count_of(rows, "not checked")


def sound_row(rows: pl.DataFrame) -> tuple[object, ...]:
    """Kinds of sound recordings, and what is wrong with them."""
    names = [name.removeprefix("sound, ") for name in rows["cause"].unique(maintain_order=True)]
    accused = rows.filter(pl.col("outcome") == "other")
    return (
        "; ".join(names),
        len(rows),
        len(accused),
        named_in(accused),
        count_of(rows, "refused"),
        off_of(rows),
    )


def write_between(page: Path, tables: dict[str, str]) -> None:
    """Put tables between `<!-- NAME -->` and `<!-- end -->` of a page, headed by the commit."""
    text = page.read_text(encoding="utf-8")
    show_commit = ["git", "log", "-1", "--format=%h of %as"]
    commit = subprocess.check_output(show_commit, cwd=ROOT, text=True).strip()
    for name, plain in tables.items():
        table = plain.replace("| ", f"| commit {commit}: ", 1)
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        if not mark:
            raise SystemExit(f"{page}: no line <!-- {name} -->")
        text = f"{before}{mark}{table}\n{rest[rest.index('<!-- end -->') :]}"
    page.write_text(text, encoding="utf-8")


def worse(now: pl.DataFrame, before: pl.DataFrame) -> list[str]:
    """Cells (cause, size, motion, gains) with more silent, more unchecked, more refused or fewer
    rightly named recordings than before; of sound ones, more that are accused. Cells of both tables
    with the same seeds count."""
    both = now.join(before.select(*KEY, was="outcome", was_named="named"), on=KEY, how="inner")
    sound, lines = {one.name for one in SOUND}, []
    rank = {"silent": 3, "not checked": 2, "refused": 2, "other": 1, "right": 0, "within": 0}
    of_sound = {"within": 0, "right": 0, "silent": 1, "not checked": 1, "other": 2, "refused": 2}
    for cell, mine in both.group_by(KEY[:-1], maintain_order=True):
        order = of_sound if cell[0] in sound else rank
        was, is_now = (
            sum(order[one] for one in mine[column].to_list()) for column in ("was", "outcome")
        )
        if is_now > was:
            told = [
                f"{row['was']} ({row['was_named'] or '–'}) -> {row['outcome']}"
                f" ({row['named'] or '–'}, {row['miss']})"
                for row in mine.iter_rows(named=True)
                if order[row["outcome"]] > order[row["was"]]
            ]
            lines.append(f"{', '.join(map(str, cell))}: {'; '.join(told)}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--quick", action="store_true", help="one seed, three motions, nothing written"
    )
    parser.add_argument(
        "--only", nargs="*", default=(), metavar="WORD", help="causes with a word in their name"
    )
    parser.add_argument("--against", type=Path, metavar="FILE", help="rows to compare with")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="write the rows here")
    parser.add_argument(
        "--resume", action="store_true", help="keep what the file of rows has already"
    )
    parser.add_argument(
        "--table", action="store_true", help="with --resume: the tables of these rows, no recording"
    )
    options = parser.parse_args()
    before = pl.read_csv(options.against, schema=ROW) if options.against else None
    rows_file = options.rows or (None if options.quick or options.only else ROWS)
    keep = options.resume and rows_file is not None and rows_file.exists()
    done = pl.read_csv(rows_file, schema=ROW) if keep else pl.DataFrame(schema=ROW)
    rows = study(options.only, options.quick, done, rows_file) if not options.table else done
    tables = {"causes": matrix(rows), "sound": sound_table(rows)}
    print("\n\n".join([*tables.values(), by_motion(rows)]))
    if not (options.quick or options.only):
        write_between(PAGE, tables)
    if before is not None:
        lines = worse(rows, before)
        print("\n".join([f"\n{len(lines)} cells are worse than in {options.against}:", *lines]))
        sys.exit(1 if lines else 0)


if __name__ == "__main__":
    main()
