"""The tables of docs/peers.md and its figure: python benchmarks/peers/page.py [FOLDER]

Without a folder recordings and answers are made anew in build/peers, which takes ten minutes of one
core.
"""

import sys
from pathlib import Path

import answers
import matplotlib.pyplot as plt
import polars as pl
import recordings
from matplotlib.lines import Line2D
from polars import col
from score import LARGEST_ERRORS, score_answers

from osl_analysis.table import read_table

ROOT = Path(__file__).resolve().parents[2]
PAGE, FIGURE = ROOT / "docs/peers.md", ROOT / "docs/peers.png"
OURS = "osl_analysis_fit"
NAMES = {
    OURS: "osl-analysis",
    "osl_analysis_without": "osl-analysis, as its doubt says",
    "filtered_least_squares": "usual script",
    "pandas_curve_fit": "pandas, curve_fit",
    "statsmodels_hac": "statsmodels HAC",
    "lmfit_simulated": "lmfit, simulated",
    "mujoco_sysid": "mujoco.sysid",
    "sysidentpy_nfir": "sysidentpy NFIR",
    "sippy_subspace": "sippy N4SID",
}


def line(cells):
    """A row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def rounded(value):
    """Two or three digits, with signs that are read; a dash where a method states nothing."""
    if value is None:
        return "–"
    text = f"{value:,.0f}" if abs(value) >= 100 else f"{value:.2g}" if abs(value) >= 0.005 else "0"
    return text.replace("-", "−")


def methods_of(scores):
    """Methods in the order of the page; one that is not known to it comes last, by its own name."""
    return sorted(
        scores["method"].unique(), key=lambda name: (name not in NAMES, [*NAMES, name].index(name))
    )


def overview(scores):
    """A row per method, over all cases."""
    head = [
        "",
        "silent",
        "announced",
        "false alarms",
        "not answered",
        "intervals that hold, %",
        "s",
        "MB",
    ]
    rows = [line(head), line(["---"] * len(head))]
    for method in methods_of(scores):
        row = scores.row(
            by_predicate=(col("method") == method) & (col("group") == "all"), named=True
        )
        n = [row["silent"], row["announced"], row["false_alarms"], row["trials"] - row["answered"]]
        cells = [f"{one} of {row['trials']}" if k == 0 else str(one) for k, one in enumerate(n)]
        cells += [rounded(row["coverage"]), f"{row['seconds']:.2g}", f"{row['megabytes']:.0f}"]
        rows.append(line([NAMES.get(method, method), *cells]))
    return "\n".join(rows)


def by_case(scores, cell):
    """A row per case, with a cell per method."""
    names, cases = methods_of(scores), sorted(set(scores["group"]) - {"all"})
    rows = [
        line(["", *(NAMES.get(name, name) for name in names)]),
        line(["---"] * (len(names) + 1)),
    ]
    for case in cases:
        found = {
            row["method"]: row for row in scores.filter(col("group") == case).iter_rows(named=True)
        }
        rows.append(
            line([f"{case} ({found[names[0]]['trials']})", *(cell(found[name]) for name in names)])
        )
    return "\n".join(rows)


def misses(row):
    """Silent misses, announced ones in brackets, false alarms after a plus."""
    return f"{row['silent']} ({row['announced']})" + f" + {row['false_alarms']}" * bool(
        row["false_alarms"]
    )


def better(scores, worst):
    """Sentences: where a peer misses less, doubts less without a cause, or is nearer or quicker,
    than we are."""
    nearest = worst.group_by("method", "group").agg(col("worst").median())
    joined = scores.filter(~col("method").str.starts_with("osl_") | (col("method") == OURS))
    joined = joined.join(nearest, on=["method", "group"], how="left")
    rows, said = {(row["group"], row["method"]): row for row in joined.iter_rows(named=True)}, {}
    for (case, method), row in sorted(
        rows.items(), key=lambda item: (item[0][0] == "all", item[0])
    ):
        ours = rows[case, OURS]
        missed, of_us = row["silent"] + row["announced"], ours["silent"] + ours["announced"]
        if case == "all":
            about = (
                f"less than half of our {ours['seconds']:.2g} s"
                if row["seconds"] < ours["seconds"] / 2
                else None
            )
        elif row["silent"] < ours["silent"]:
            about = (
                f"silently wrong on {row['silent']} of {row['trials']} recordings, we on"
                f" {ours['silent']}"
            )
        elif missed < of_us and row["answered"] >= ours["answered"]:
            about = (
                f"K, B or I off in {missed} of {row['trials']} recordings, ours in {of_us}"
                f" ({ours['silent']} silent)"
            )
        elif row["false_alarms"] < ours["false_alarms"]:
            about = f"{row['false_alarms']} false alarms, we {ours['false_alarms']}"
        elif (
            row["worst"] is not None and row["worst"] < 0.5 * ours["worst"] and ours["worst"] > 0.5
        ):
            about = "nearer, by half or more"
        else:
            about = None
        if about:
            said.setdefault((case.replace("all", "time"), about), []).append(
                NAMES.get(method, method)
            )
    return (
        "\n".join(
            f"* {case}: {'; '.join(names)}: {about}." for (case, about), names in said.items()
        )
        or "* Nowhere."
    )


def worst_errors(folder):
    """A row per answer: its largest error, as a multiple of what counts as a miss, and whether it
    is doubted."""
    given = read_table(folder / "answers.csv", [*LARGEST_ERRORS, "doubtful"])
    rows = given.join(
        read_table(folder / "truth.csv", [*LARGEST_ERRORS]), on="trial", suffix="_true"
    )
    errors = [
        100 * (col(name) / col(f"{name}_true") - 1).abs() / most
        for name, most in LARGEST_ERRORS.items()
    ]
    return rows.with_columns(worst=pl.max_horizontal(errors)).drop_nulls("worst")


def figure(scores, worst):
    """The worst error of each answer, by case and method."""
    names, cases = methods_of(scores), sorted(set(worst["group"]))
    drawn, axes = plt.subplots(
        3, 3, figsize=(9.5, 8), sharex=True, sharey=True, layout="constrained"
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
        axis.set_yticklabels([NAMES.get(name, name) for name in names])
        for level, name in enumerate(names):
            own = worst.filter((col("group") == case) & (col("method") == name))
            doubted = (own["doubtful"].fill_null("") != "").to_numpy()
            x = own["worst"].clip(1.2e-3, 8e2).to_numpy()
            y = level + 0.5 * ((own["seed"].to_numpy() - 2) / 4)
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


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build/peers"
    if len(sys.argv) == 1:
        recordings.write(folder)
        answers.write(folder, sorted(answers.METHODS.glob("*.py")))
    scores, worst = (
        score_answers(folder / "answers.csv", folder / "truth.csv"),
        worst_errors(folder),
    )
    tables = {
        "better": better(scores, worst),
        "overview": overview(scores),
        "misses": by_case(scores, misses),
    }
    text = PAGE.read_text(encoding="utf-8")
    for mark, made in tables.items():
        head, _, rest = text.partition(f"<!-- {mark} -->\n")
        text = f"{head}<!-- {mark} -->\n{made}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    PAGE.write_text(text, encoding="utf-8")
    figure(scores, worst).savefig(FIGURE, dpi=130)


if __name__ == "__main__":
    main()
