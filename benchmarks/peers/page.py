# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/peers.md and its figure: python benchmarks/peers/page.py [FOLDER]

Without a folder recordings and answers are made anew in build/peers, which takes half an hour of
one core. The answers that laboratories have sent, `sent/*.csv`, are scored beside them.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import answers
import closed_form
import generator
import laboratory
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
import recordings
from matplotlib.lines import Line2D
from polars import col
from score import LARGEST_ERRORS, score_answers

from osl_analysis.base.errors import InputError
from osl_analysis.base.table import read_table

ROOT = Path(__file__).resolve().parents[2]
PAGE, FIGURE = ROOT / "docs/peers.md", ROOT / "docs/peers.png"
SENT = Path(__file__).with_name("sent")
OURS = "osl_analysis_fit"
NAMES = {
    OURS: "osl-impedance",
    "filtered_least_squares": "usual script",
    "pandas_curve_fit": "curve_fit",
    "statsmodels_hac": "statsmodels",
    "lmfit_simulated": "lmfit",
    "mujoco_sysid": "mujoco.sysid",
    "sysidentpy_nfir": "sysidentpy",
    "sippy_subspace": "sippy",
}
UNSEEN = [case.case for case in closed_form.CASES]
SEEN = ["generator", "simulator"]  # on whose recordings limits of osl-impedance were chosen
CASES = [*sorted({case.case for case in generator.CASES + laboratory.CASES}), *UNSEEN]
NEARER = 0.5  # times our median error or seconds, from which a peer is called better
HOLDS_MORE = 10.0  # percent more intervals that hold, from which a peer is called better


@dataclass(frozen=True)
class Quantity:
    """What a peer may be better in."""

    text: str
    column: str
    is_better: Callable[[float, float], bool]  # of the peer's value and ours
    where: str = ""  # "all": over all recordings alone


QUANTITIES = [
    Quantity("K, B or I off", "missed", lambda theirs, ours: theirs < ours),
    Quantity("false alarms", "false_alarms", lambda theirs, ours: theirs < ours),
    Quantity("worst error", "worst", lambda theirs, ours: theirs < NEARER * ours),
    Quantity(
        "intervals that hold, %", "coverage", lambda theirs, ours: theirs >= ours + HOLDS_MORE
    ),
    Quantity("s", "seconds", lambda theirs, ours: theirs < NEARER * ours, "all"),
]


def line(cells):
    """A row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def table(head, rows):
    """A Markdown table."""
    return "\n".join([line(head), "|---" * len(head) + "|", *map(line, rows)])


def rounded(value):
    """Two or three digits, with signs that are read; a dash where a method states nothing."""
    if value is None:
        return "–"
    text = f"{value:,.0f}" if abs(value) >= 100 else f"{value:.2g}" if abs(value) >= 0.001 else "0"
    return text.replace("-", "−")


def methods_of(scores):
    """Methods in the order of the page; one that is not known to it comes last, by its own name."""
    return sorted(
        scores["method"].unique(), key=lambda name: (name not in NAMES, [*NAMES, name].index(name))
    )


def name_of(method):
    return NAMES.get(method, method)


def name_of_case(case, trials):
    """In italics where no method was tuned on it."""
    return f"*{case}* ({trials})" if case in UNSEEN else f"{case} ({trials})"


def overview(scores, of):
    """A row per method, over all recordings of some cases."""
    trials = scores.filter(group="all")["trials"][0]
    head = [of, "version", f"silent, of {trials}", "announced", "false alarms", "not answered"]
    head += ["intervals that hold, %", "half-width", "s"]
    rows = []
    for method in methods_of(scores):
        is_row = (col("method") == method) & (col("group") == "all")
        row = scores.row(by_predicate=is_row, named=True)
        counts = [row[name] for name in ("silent", "announced", "false_alarms")]
        counts.append(row["trials"] - row["answered"])
        sizes = [row[name] for name in ("coverage", "half_width", "seconds")]
        named_version = [name_of(method), row["version"] or "–"]
        rows.append([*named_version, *map(str, counts), *map(rounded, sizes)])
    return table(head, rows)


def better(scores, worst):
    """A table of what peers are better in than we are, by case, with the size of both."""
    nearest = worst.group_by("method", "group").agg(col("worst").median())
    joined = scores.join(nearest, on=["method", "group"], how="left")
    joined = joined.with_columns(missed=col("silent") + col("announced"))
    peers = [method for method in methods_of(scores) if not method.startswith("osl_")]
    rows = []
    for case in [*CASES, "all"]:
        of_case = joined.filter(col("group") == case).iter_rows(named=True)
        row_of = {row["method"]: row for row in of_case}
        ours = row_of[OURS]
        for quantity in QUANTITIES:
            if (quantity.where == "all") == (case == "all"):
                found = those_better(quantity, row_of, peers)
                if found:
                    text = quantity.text
                    of_us = rounded(ours[quantity.column])
                    if quantity.column == "missed":
                        of_us += f", {ours['silent']} silent"
                    theirs = [row_of[method][quantity.column] for method in found]
                    size = " to ".join(dict.fromkeys(map(rounded, (min(theirs), max(theirs)))))
                    where = name_of_case(case, ours["trials"])
                    rows.append([where, text, named(found, peers), size, of_us])
    head = ["recordings", "in", "better", "theirs", f"osl-impedance, {row_of[OURS]['version']}"]
    return table(head, rows) if rows else "Nowhere."


def those_better(quantity, row_of, peers):
    """The peers that are better in a quantity, of those that answer as much as we do."""
    ours = row_of[OURS]
    found = []
    for method in peers:
        theirs = row_of[method]
        both = theirs[quantity.column], ours[quantity.column]
        if (
            None not in both
            and theirs["answered"] >= ours["answered"]
            and quantity.is_better(*both)
        ):
            found.append(method)
    return found


def named(methods, peers):
    """Methods by name; of many those that are missing."""
    missing = [name_of(method) for method in peers if method not in methods]
    if not missing:
        return "all"
    if len(missing) < len(methods):
        return f"all but {', '.join(missing)}"
    return ", ".join(map(name_of, methods))


def worst_errors(files, truth):
    """A row per answer: its largest error, as a multiple of what counts as a miss, and whether it
    is doubted."""
    columns = ["method", "trial", "doubtful", *LARGEST_ERRORS]
    given = pl.concat(
        [read_table(file).select(columns).cast(dict.fromkeys(LARGEST_ERRORS, pl.Float64))
         for file in files]
    )  # fmt: skip
    rows = given.join(read_table(truth, [*LARGEST_ERRORS]), on="trial", suffix="_true")
    errors = [
        100 * (col(name).fill_nan(None) / col(f"{name}_true") - 1).abs() / most
        for name, most in LARGEST_ERRORS.items()
    ]
    return rows.with_columns(worst=pl.max_horizontal(errors)).drop_nulls("worst")


def figure(scores, worst):
    """The worst error of each answer, by case and method."""
    names, cases = methods_of(scores), CASES
    drawn, axes = plt.subplots(
        6, 3, figsize=(9.5, 14), sharex=True, sharey=True, layout="constrained"
    )
    for axis, case in zip(axes.flat, cases, strict=False):
        axis.axvspan(1, 1e4, color="0.93")
        axis.set(
            title=case,
            xscale="log",
            xlim=(1e-3, 1e3),
            yticks=range(len(names)),
            ylim=(len(names) - 0.5, -0.5),
        )
        axis.set_yticklabels(map(name_of, names))
        for level, name in enumerate(names):
            own = worst.filter((col("group") == case) & (col("method") == name))
            doubted = (own["doubtful"].fill_null("") != "").to_numpy()
            x = own["worst"].clip(1.2e-3, 8e2).to_numpy()
            y = level + np.linspace(-0.35, 0.35, len(x))
            axis.plot(x[doubted], y[doubted], "o", mfc="none", mec="C0", ms=4.5)
            axis.plot(x[~doubted], y[~doubted], "x", color="C3", ms=4.5)
    marks = {
        "no doubt": {"marker": "x", "color": "C3"},
        "doubted": {"marker": "o", "mfc": "none", "color": "C0"},
    }
    shown = [
        Line2D([], [], linestyle="none", label=label, **style) for label, style in marks.items()
    ]
    drawn.legend(handles=shown, loc="outside upper right", ncols=2, frameon=False)
    drawn.supxlabel("worst error of K, B and I, as a multiple of 1, 2 and 10 %; grey: off")
    return drawn


def scores_of(files, truth, made_by=()):
    """The scores of all files of answers, each method of one file; ours with the commit of its
    code in place of a version."""
    found = [score_answers(file, truth, made_by) for file in files]
    scores = pl.concat(found, how="vertical_relaxed")
    show_commit = ["git", "log", "-1", "--format=commit %h of %as", "--", "osl_analysis"]
    commit = subprocess.check_output(show_commit, cwd=ROOT, text=True).strip()
    is_ours = col("method") == OURS
    version = pl.when(is_ours).then(pl.lit(commit)).otherwise("version")
    scores = scores.with_columns(version=version)
    twice = scores.filter(scores.select("method", "group").is_duplicated())["method"]
    if len(twice):
        raise InputError(f"{files[-1]}: method '{twice[0]}' stands in two files", "rename it")
    return scores


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build/peers"
    if len(sys.argv) == 1:
        recordings.write(folder)
        answers.write(folder, sorted(answers.METHODS.glob("*.py")))
    files, truth = [folder / "answers.csv", *sorted(SENT.glob("*.csv"))], folder / "truth.csv"
    scores, worst = scores_of(files, truth), worst_errors(files, truth)
    tables = {
        "better": better(scores, worst),
        "unseen": overview(scores_of(files, truth, ["closed_form"]), "unseen"),
        "overview": overview(scores_of(files, truth, SEEN), "seen"),
    }
    text = PAGE.read_text(encoding="utf-8")
    for mark, made in tables.items():
        head, _, rest = text.partition(f"<!-- {mark} -->\n")
        text = f"{head}<!-- {mark} -->\n{made}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    PAGE.write_text(text, encoding="utf-8")
    figure(scores, worst).savefig(FIGURE, dpi=130)


if __name__ == "__main__":
    main()
