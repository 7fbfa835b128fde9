"""A campaign with names of its own: a knee with three made-up controllers, a second joint, and no parameter file."""

import json
import re

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT
from snakemake_runs import run_snakemake

K, B, INERTIA, HOSTILE = 60.0, 1.5, 0.04, "PD $K_{p}$ 50 % & \\alpha_é 脚 – a very long name of a controller indeed"
SHEET = (
    ("k_hostile", HOSTILE, 60, 1.5, "knee", "left", 1.0), ("k_pd", "pd", 60, 1.5, "knee", "left", 1.2),
    ("k_none", "", "", 1.5, "knee", "right", 0.8), ("exo", "_spring", "", "", "exoskeleton hip", "", 2.0),
)  # fmt: skip
"""Trial, controller, K_d, B_d, joint, side, and by how much its impedance exceeds K, B and I."""


def recording(share, seed):
    """A stepped sine of 1 to 3 Hz at 2 and 4 deg against an exact second-order joint, in the columns of `bench_csv`."""
    rate, pieces = 250, []
    for amplitude in np.deg2rad([2, 4]):
        for f in (1, 2, 3):
            t, w = np.arange(round(8 / f * rate)) / rate, 2 * np.pi * f
            theta = amplitude * np.sin(w * t)
            pieces.append((theta, share * ((K - INERTIA * w**2) * theta + B * w * amplitude * np.cos(w * t))))
        pieces.append((np.zeros(rate), np.zeros(rate)))
    theta, torque = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    noise = np.random.default_rng(seed).standard_normal((2, theta.size))
    return pl.DataFrame({
        "time [s]": np.arange(theta.size) / rate, "joint angle [deg]": np.rad2deg(theta) + 1e-3 * noise[0],
        "actuator angle [deg]": 0 * theta, "load cell torque [N*m]": -torque + 0.005 * noise[1],
        "motor current [A]": 0 * theta,
    })  # fmt: skip


def options_of(folder, rows):
    """Write the sheet and the configuration of a campaign, and name what Snakemake runs it with."""
    (folder / "trials.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    protocol = {"amplitudes_deg": [2, 4], "frequencies_hz": [1, 2, 3], "cycles": 8, "time_base": {"highest_hz": 3}}
    ours = {
        "campaign": "knee", "raw_data": str(folder), "sheet": str(folder / "trials.csv"), "simulation": None,
        "results": str(folder / "out"), "parameters": None, "data": "simulated", "recorded": "2026-03-14",
        "dynamometer": protocol,
    }  # fmt: skip
    (folder / "ours.yaml").write_text(yaml.safe_dump(ours))
    options = {"configfile": folder / "ours.yaml", "snakefile": ROOT / "Snakefile", "directory": ROOT}
    return [word for name, path in options.items() for word in (f"--{name}", str(path))]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The results of one run of the workflow."""
    folder = tmp_path_factory.mktemp("free")
    rows = ["trial,experiment,controller,K_d,B_d,joint,side,log,log_source"]
    for seed, (trial, controller, K_d, B_d, joint, side, share) in enumerate(SHEET):
        recording(share, seed).write_csv(folder / f"{trial}.csv")
        rows.append(f'{trial},impedance,"{controller}",{K_d},{B_d},{joint},{side},{trial}.csv,bench_csv')
    done = run_snakemake(options_of(folder, rows), folder)
    assert done.returncode == 0, done.stdout
    return folder / "out"


def test_every_trial_is_analysed_nothing_is_predicted_and_figures_say_what_is_simulated(results):
    """K and B are those of the exact joint, times the share of each."""
    table = pl.read_csv(results / "tables/impedance.csv").filter(pl.col("amplitude_deg").is_null())
    found = dict(table.select("trial", pl.struct("K", "B", "controller")).iter_rows())
    for trial, *_, share in SHEET:
        assert (found[trial]["K"], found[trial]["B"]) == pytest.approx((share * K, share * B), rel=0.01), trial
    assert found["k_hostile"]["controller"] == HOSTILE
    assert table["K_predicted"].null_count() == len(SHEET)
    assert not table["not_checked"].str.contains("gains|belt").any()
    places = {("knee", "left"), ("knee", "right"), ("exoskeleton hip", None)}
    assert set(table.select("joint", "side").iter_rows()) == places
    drawn = {path.stem: path.read_text(encoding="utf-8") for path in (results / "figures").glob("*.svg")}
    assert {"fig4", "fig5", "fig6", "fig7"} <= set(drawn)
    assert all("Simulated data: campaign knee, osl-analysis" in text for text in drawn.values())
    assert pl.read_csv(results / "figures/fig4.csv")["chosen"][0].startswith("the first impedance trial of the sheet")


def test_headline_numbers_and_their_macros_are_told_apart(results):
    summary = json.loads((results / "summary.json").read_text(encoding="utf-8"))
    numbers = summary["numbers"]
    assert (summary["data"], summary["recorded"]) == ("simulated", "recorded 2026-03-14")
    assert numbers["K_example_pd (knee, left)"]["value"] == pytest.approx(1.2 * K, rel=0.01)
    assert "K_bias_no_controller (knee, right)" not in numbers
    assert numbers["B_error_no_controller (knee, right)"]["value"] == pytest.approx(0.2 * B, rel=0.05)
    tex = (results / "numbers.tex").read_text(encoding="utf-8")
    names = re.findall(r"newcommand\{\\(\w+)\}", tex)
    assert len(names) == len(set(names)) > 20
    assert all(re.fullmatch("[A-Za-z]+", name) for name in names)
    assert r"\newcommand{\oslData}{simulated}" in tex
    assert tex.startswith("% Simulated data: campaign knee")


def test_every_table_is_plain_csv_that_says_what_its_data_are(results):
    for path in (*(results / "tables").glob("*.csv"), *(results / "figures").glob("*.csv")):
        table = pl.read_csv(path, infer_schema_length=None)
        assert table.columns[-1] == "data", path
        assert set(table["data"]) <= {"simulated"}
