"""The net under a rebuild: what this checkout says, beside what release 0.2.0 said of the same recordings.

`make net`, or `python benchmarks/net.py [--campaign NAME ...] [--no-laboratory]`. The reference is made once, in
build/net, from the commit of the release with the release's own lock. This checkout is copied without its results, so
that the same campaigns run from empty folders. Compared are all tables, `summary.json`, `numbers.tex` and what the run
says at its end: numbers to 1e-6 of their interval (of themselves where they have none), words exactly. Differences are
printed by cause: the same column, and the same words but for numbers, are one cause. `EXPLAINED` names those that are
meant. At the end the independent laboratory judges this checkout from outside, where its folder exists.
"""

import argparse
import csv
import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
RELEASE = "b17d8f08bef269cc8685677f25e0b2219435363d"
REFERENCE, NOW = ROOT / "build/net/release", ROOT / "build/net/now"
SHARED = ROOT.parent / "shared"
CAMPAIGNS = ("default", "excitations", "torque_angle", "desr")
DESR = SHARED / "real_data/mat/DESR_Characterization_Data.mat"
RELATIVE, FLOOR, FLOOR_PPM = 1e-6, 1e-12, 1e-8
"""Largest difference in units of the interval or the value; below the floor, in SI units or ppm, a number is zero."""
STICTION = (
    "B_d = 0: friction that starts and stops turns the last bit of B_1 into this, as another BLAS kernel does in 0.2.0"
)
NO_DAMPING = "impedance_K[234]00_B0.0_compensated"
ABOUT_MEAN = "columns are judged about their means: the zero of an angle changes no verdict"
ANY = float("inf")
EXPLAINED = [
    ("excitations/impedance.csv", "clock_drift_se_ppm", "*", 0.03, "ties between equal parts are not left to rounding"),
    ("results/model_comparison.csv", "*", NO_DAMPING, 0.2, STICTION),
    ("results/model_comparison_summary.csv", "*", "", 0.03, STICTION),
    ("*/summary.json", "numbers.drivetrain_VAF_gain_compensated.*", "", 0.01, STICTION),
    ("results/phasors.csv", "theta_degrees_of_freedom", "*", 1e-4, "degrees of freedom of an autocorrelation, rounded"),
    ("results/actuator.csv", "residual_autocorrelation", "*", 1e-5, "a correlation of 0.0018 is a difference of sums"),
    (
        "*.csv",
        "doubtful",
        "*",
        ANY,
        "a doubt begins with its cause; friction passes for no fault of the recording",
    ),
    ("*.csv", "doubt", "*", ANY, "a doubt begins with its cause"),
    ("*.csv", "not_checked", "*", ANY, "what could not be checked is said with its size in units of the result"),
    ("*.csv", "condition_number", "*", 1.0, ABOUT_MEAN),
    ("*.csv", "largest_correlation", "*", 1.0, ABOUT_MEAN),
    ("*.csv", "n_doubtful", "*", 0.5, "two default trials are no longer accused of a late torque and a changing K"),
    ("*/summary.json", "numbers.*.n_doubtful", "", 0.5, "as n_doubtful of the tables"),
    ("*/summary.json", "numbers.doubtful_*", "", ANY, "trials and causes are counted, not rows that inherit them"),
    ("*/summary.json", "findings.*", "", ANY, "new: what the end of a run and the page say of the results"),
    ("*/numbers.tex", "*Doubtful*", "", ANY, "trials are counted, not rows"),
    ("*/numbers.tex", "*doubtful*", "", ANY, "trials are counted, not rows"),
    ("*/said.txt", "doubtful*", "", ANY, "causes and trials are counted, not rows that inherit them"),
    ("*/said.txt", "not checked*", "", ANY, "each thing once, with the trials that it concerns and its size"),
]
"""File, column and trial, all with wildcards, the largest difference in units of interval or value, and its reason."""
OF_MOTIONS = "an interval is that of another motion of this kind: misfit that every cycle repeats is in it"
BESIDE = "a column beside K, B and I (`effects.py`), the same for every motion, in place of harmonics and phasors"
PARTS = "groups of rows, whole periods of a periodic motion, in place of all rows or lines"
MEASURED = "rows are named by what was measured"
EXPLAINED += [
    *(("*/impedance.csv", f"{name}{end}", "*", size, OF_MOTIONS) for name, size in (("K", 1e3), ("B", 2e3), ("I", 1e3))
      for end in ("_se", "_low", "_high")),
    *(("*/impedance.csv", f"offset{end}", "*", 200.0, OF_MOTIONS) for end in ("_se", "_low", "_high")),
    *(("*/transmission.csv", f"{name}{end}", "*", 2.0, OF_MOTIONS) for name in ("B_j", "J_j", "offset", "T_C")
      for end in ("", "_se", "_low", "_high")),
    *(("*/*.csv", name, "*", ANY, OF_MOTIONS) for name in ("interval_method", "*_repeat_se", "correlation_s")),
    *(("*/impedance.csv", name, "*", 2.0, OF_MOTIONS) for name in ("cov_*", "K_change", "B_change", "time_base_shift")),
    ("*/timebase.csv", "other_hypothesis", "*", ANY, PARTS),
    *(("*/impedance.csv", name, "*", 0.3, PARTS) for name in ("K", "B", "I", "offset", "[KBI]_amplitudes_*", "K_ratio",
      "K_over_K_s", "VAF", "R2", "fitted_s", "samples", "ljung_box_per_lag", "theta_rms_deg", "torque_at_peaks")),
    *(("*/impedance.csv", name, "*", 2.0, PARTS) for name in ("load_cell_drift", "residual_autocorrelation")),
    *(("*/impedance.csv", name, "*", ANY, BESIDE) for name in ("lag_*", "certain_lag_damping", "K_drift",
      "drift_inertia_share", "clock_drift_*", "coulomb_*", "B_viscous*", "f_C*", "explained_by", "stiffening",
      "backlash_*", "even_harmonics", "angle_noise_share", "VAF_held_out", "")),
    *(("results/impedance.csv", name, "*", ANY, "of a stepped sine, too") for name in ("fitted_s", "theta_rms_deg")),
    *(("*/transmission.csv", name, "*", ANY, BESIDE) for name in ("clock_drift_*", "coulomb_*", "f_C*", "VAF_held_out",
      "even_harmonics", "odd_harmonics", "VAF*", "R2", "B_j_*", "J_j_*", "cov_*", "load_cell_drift", "samples",
      "time_base_shift", "ljung_box_*", "residual_autocorrelation", "")),
    *(("*.csv", name, "*", ANY, MEASURED) for name in ("amplitude_deg", "commanded_deg")),
    *((f"*/{file}.csv", "*", "*", 0.2, "the rounding of a sensor is in no model of its own")
      for file in ("phasors", "frequency_response", "transmission_summary", "impedance_repeats")),
    ("*/phasors.csv", "*degrees_of_freedom", "*", 1.0, "the rounding of a sensor is in no model of its own"),
    *(("excitations/model_comparison.csv", name, "*", 0.4, PARTS) for name in ("BIC", "VAF*", "effective_samples")),
    ("excitations/response_models*.csv", "misfit_ratio", "*", 0.01, PARTS),
    ("excitations/model_comparison_summary.csv", "*", "*", 0.2, PARTS),
    *(("*/summary.json", f"numbers.{name}_{controller}*.value", "", 0.2, PARTS)
      for name in ("[KB]_e*", "VAF_*", "drivetrain_VAF_gain") for controller in ("compensated", "uncompensated")),
    *(("*/summary.json", f"numbers.{name}", "", 0.03, PARTS) for name in ("[KB]_error*", "VAF_*",
      "[KB]_example*.amplitudes_*", "drivetrain_VAF_gain*", "[BJ]_j.*", "transmission_VAF.*", "coulomb_VAF_gain.*")),
    *(("*/summary.json", f"numbers.[KB]_example_*.{end}", "", 600.0, OF_MOTIONS) for end in ("low", "high")),
    *(("*/summary.json", f"numbers.{name}.interval", "", ANY, OF_MOTIONS) for name in ("[KB]_example_*",)),
    *(("*/numbers.tex", f"*osl*{name}*", "", ANY, OF_MOTIONS) for name in ("ExampleStiffness", "ExampleDamping",
      "DrivetrainVAFGain", "VAFMedian")),
    *(("results/*.csv", f"doubtful: {what}", trial, ANY, why) for what, trial, why in (
      ("gone", "impedance_K400_B0.0_compensated", "friction is no changing K"),
      ("gone", "impedance_K200_B5.0_uncompensated", "friction is no late torque"),
      ("gone", "impedance_K[23]00_B0.0_compensated", "at 2 deg: the share of friction is that of its column"),
      ("gone", "impedance_K300_B7.5_uncompensated", "B falls by 9.6 % beyond its interval; the limit is a tenth"),
      ("new", "impedance_K400_B0.0_uncompensated", "at 6 deg: the share of friction is that of its column"))),
    ("*/summary.json", "numbers.VAF_*.n_doubtful", "", 0.8, "doubts by the columns of friction, see above"),
]  # fmt: skip
OF_UNITS = "an interval is that of units that are left out one at a time, as of every motion (docs/method.md)"
EXPLAINED += [
    *(("*/belt.csv", name, "*", size, OF_UNITS) for name, size in (("*_se", 0.5), ("*_low", 0.7), ("*_high", 0.7))),
    *(("*/actuator.csv", name, "*", 0.2, OF_UNITS) for name in ("*_se", "*_low", "*_high")),
    *((f"*/{part}.csv", name, "*", ANY, OF_UNITS) for part in ("belt", "actuator")
      for name in ("cov_*", "correlation_k_f_G", "time_base_shift")),
    *(("*/belt.csv", name, "*", 5e-5, "derivative by seven samples, as of every motion") for name in ("B_j", "offset",
      "residual_autocorrelation", "ljung_box_*")),
    ("*/actuator.csv", "residual_autocorrelation", "*", 1e-5, "a correlation of 0.001 is a difference of sums"),
    ("results/hinge.csv", "", "", ANY, "the ankle's axis is that of the malleoli alone; nothing is compared with it"),
    ("desr/summary.json", "recorded", "", ANY, "the day on which this run's copy of the file was made"),
    ("desr/numbers.tex", "*oslRecorded*", "", ANY, "the day on which this run's copy of the file was made"),
]  # fmt: skip
OF_THE_RELEASE = re.compile(r"osl(Version|Configuration)\}|^% Simulated data|^% Measured data")
"""Lines of `numbers.tex` that name the release."""
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
LABORATORY = ("bench_truth.py", "ros2_truth.py", "walking_truth.py")


class Difference(NamedTuple):
    """What one place says now beside what it said; `size` of a number in units of its interval or of itself."""

    kind: str
    file: str
    column: str = ""
    now: str = ""
    row: str = ""
    size: float = float("inf")


def results_of(campaign: str) -> str:
    """Folder of a campaign's results."""
    return "results" if campaign == "default" else f"results/{campaign}"


def run_campaign(tree: Path, python: Path, campaign: str) -> None:
    """Run a campaign in a tree, and keep what the run says at its end."""
    if campaign == "desr":
        (tree / "raw_data/desr").mkdir(parents=True, exist_ok=True)
        shutil.copy(DESR, tree / "raw_data/desr")
    chosen = [] if campaign == "default" else ["--configfile", f"config/campaigns/{campaign}/config.yaml"]
    environment = os.environ | {"PYTHONPATH": str(tree)}
    command = [python, "-m", "snakemake", "reproduce-all", *chosen]
    run = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if run.returncode:
        sys.exit(f"{tree}, campaign {campaign}:\n{run.stdout[-2000:]}{run.stderr[-4000:]}")
    said = re.sub(r"\A.*^open \S+report.html[^\n]*\n", "", run.stderr, flags=re.DOTALL | re.MULTILINE)
    (tree / results_of(campaign) / "said.txt").write_text(said)


def make_reference(campaigns: list[str]) -> None:
    """Check the release out and run the campaigns that it has not run yet."""
    if not (REFERENCE / ".git").exists():
        subprocess.run(["git", "clone", "--quiet", "--no-checkout", str(ROOT), str(REFERENCE)], check=True)
        subprocess.run(["git", "-C", str(REFERENCE), "checkout", "--quiet", RELEASE], check=True)
        subprocess.run(["make", "--quiet", "-C", str(REFERENCE), "setup"], check=True, stdout=subprocess.DEVNULL)
    for campaign in campaigns:
        if not (REFERENCE / results_of(campaign) / "said.txt").exists():
            print(f"the release runs {campaign}", flush=True)
            run_campaign(REFERENCE, REFERENCE / ".venv/bin/python", campaign)


def copy_checkout() -> None:
    """The files of this checkout as they are now, without recordings and results."""
    shutil.rmtree(NOW, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(lambda name: (ROOT / name).is_file(), listed.stdout.splitlines()):
        (NOW / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, NOW / name)


def number(text: Any) -> float | None:
    """The number that a cell is, if it is one."""
    try:
        return float(text)
    except (TypeError, ValueError):
        return None


def interval(row: dict[str, Any], column: str) -> float | None:
    """Width of the interval of a number, where its row has one."""
    base = re.sub(r"_(se|low|high)$", "", column)
    ends = [(f"{base}_low", f"{base}_high"), *([("low", "high")] if column in ("value", "mean", "low", "high") else [])]
    for low, high in ends:
        width = (number(row.get(high)) or 0.0) - (number(row.get(low)) or 0.0)
        if width > 0:
            return width
    error = number(row.get(f"{base}_se"))
    return 4 * error if error else None


def difference(then: Any, now: Any, row: dict[str, Any], column: str) -> float:
    """Size of the difference of two numbers in units of the interval or the value; infinite if a word is another."""
    was, is_ = number(then), number(now)
    if was is None or is_ is None:
        return 0.0 if then == now else float("inf")
    scale = interval(row, column) or max(abs(was), abs(is_))
    floor = FLOOR_PPM if column == "ppm" else FLOOR
    return 0.0 if abs(was - is_) <= max(RELATIVE * scale, floor) else abs(was - is_) / scale


def compare_rows(file: str, then: list[dict[str, Any]], now: list[dict[str, Any]]) -> Iterator[Difference]:
    """Differences of two tables with the same order of rows."""
    columns, columns_now = (list(rows[0]) if rows else [] for rows in (then, now))
    yield from (Difference("column is gone", file, name) for name in columns if name not in columns_now)
    yield from (Difference("new column", file, name) for name in columns_now if name not in columns)
    if [name for name in columns if name in columns_now] != [name for name in columns_now if name in columns]:
        yield Difference("order of columns", file)
    if len(then) != len(now):
        yield Difference("rows", file, now=f"{len(now)}, {len(then)} before")
        return
    for was, is_ in zip(then, now, strict=True):
        for column in filter(is_.__contains__, columns):
            if size := difference(was[column], is_[column], was, column):
                kind, trial = "words" if number(was[column]) is None else "number", was.get("trial", "")
                name = column
                if column in ("doubtful", "doubt") and not (was[column] and is_[column]):
                    name += ": gone" if was[column] else ": new"
                yield Difference(kind, file, name, f"{is_[column]!r}, before {was[column]!r}", trial, size)


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """(dotted name, value, the mapping that it stands in) for all that a JSON file says."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        place = f"{name}.{key}".strip(".")
        if isinstance(inner, dict | list):
            yield from leaves(inner, place)
        else:
            yield place, inner, value if isinstance(value, dict) else {}


def compare_json(file: str, then: Any, now: Any) -> Iterator[Difference]:
    """Differences of two summaries; the names of release and configuration are not compared."""
    was, is_ = ({name: (value, row) for name, value, row in leaves(tree)} for tree in (then, now))
    for name in sorted({*was, *is_} - {"version", "configuration"}):
        (before, row), (after, _) = was.get(name, (None, {})), is_.get(name, (None, {}))
        if size := difference(before, after, row, name.rsplit(".", 1)[-1]):
            yield Difference("summary", file, name, f"{after!r}, before {before!r}", size=size)


def compare_lines(file: str, then: str, now: str) -> Iterator[Difference]:
    """Lines that only one of two texts has."""
    was, is_ = ([line for line in text.splitlines() if not OF_THE_RELEASE.search(line)] for text in (then, now))
    yield from (Difference("line is gone", file, line) for line in was if line not in is_)
    yield from (Difference("new line", file, line) for line in is_ if line not in was)
    if sorted(was) == sorted(is_) and was != is_:
        yield Difference("order of lines", file)


def compare_campaign(release: Path, checkout: Path) -> Iterator[Difference]:
    """Differences of a campaign's results."""
    for then in sorted(release.glob("tables/*.csv")):
        file, now = f"{checkout.name}/{then.name}", checkout / "tables" / then.name
        if not now.is_file():
            yield Difference("table is gone", file)
        else:
            yield from compare_rows(file, *(list(csv.DictReader(one.open(newline=""))) for one in (then, now)))
    for new in sorted({one.name for one in checkout.glob("tables/*.csv")} - {t.name for t in release.glob("tables/*")}):
        yield Difference("new table", f"{checkout.name}/{new}")
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (release, checkout)]
    yield from compare_json(f"{checkout.name}/summary.json", *summaries)
    for text in ("numbers.tex", "said.txt"):
        texts = [(folder / text).read_text() for folder in (release, checkout)]
        yield from compare_lines(f"{checkout.name}/{text}", *texts)


def explained(one: Difference) -> str | None:
    """Why a difference is meant."""
    for files, columns, rows, largest, why in EXPLAINED:
        named = fnmatch(one.file, files) and fnmatch(one.column, columns) and fnmatch(one.row, rows)
        if named and one.size <= largest:
            return why
    return None


def print_by_cause(differences: list[Difference]) -> int:
    """Print a line per cause, with its largest difference; the number of causes that nothing explains."""
    causes: dict[tuple[str, ...], list[Difference]] = defaultdict(list)
    for one in differences:
        why = explained(one)
        masked = NUMBER.sub("#", one.now) if one.kind == "words" else ""
        causes[("meant: " + why,) if why else (one.kind, NUMBER.sub("#", one.column), masked)].append(one)
    for cause, members in sorted(causes.items(), key=lambda item: -len(item[1])):
        files = sorted({one.file for one in members})
        worst = max(members, key=lambda one: one.size)
        print(f"{len(members):6} x {cause[0]}: {worst.column} in {', '.join(files[:4])}{' ...' * (len(files) > 4)}")
        print(
            f"         {worst.file} {worst.row}: {worst.now[:240]}, {worst.size:.2g}" if worst.now else "",
            end="\n" * bool(worst.now),
        )
    return sum(not cause[0].startswith("meant: ") for cause in causes)


def main() -> None:
    """Exit code 1 where a difference is not explained, or the laboratory finds something silently wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaign", action="append", choices=CAMPAIGNS)
    parser.add_argument("--no-laboratory", action="store_true")
    asked = parser.parse_args()
    campaigns = [name for name in asked.campaign or CAMPAIGNS if name != "desr" or DESR.is_file()]
    make_reference(campaigns)
    copy_checkout()
    differences: list[Difference] = []
    for campaign in campaigns:
        run_campaign(NOW, Path(sys.executable), campaign)
        folder = results_of(campaign)
        differences += compare_campaign(REFERENCE / folder, NOW / folder)
        print(f"{campaign}: compared", flush=True)
    wrong = print_by_cause(differences)
    print(f"{len(differences)} differences, of which {wrong} causes are not explained")
    for truth in () if asked.no_laboratory else LABORATORY:
        if (SHARED / "net" / truth).is_file():
            print(f"the laboratory: {truth}", flush=True)
            wrong += subprocess.run([sys.executable, SHARED / "net" / truth], cwd=ROOT, check=False).returncode != 0
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
