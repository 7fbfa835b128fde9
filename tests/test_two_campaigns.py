"""Two campaigns side by side: differences, their intervals, and the verdicts of equivalence."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy
from click.testing import CliRunner

from osl_analysis.cli import main
from osl_analysis.figures.compared_campaigns import draw_comparison
from osl_analysis.judge.two_campaigns import comparison_table, label_of
from osl_analysis.report.numbers import headline_numbers, to_json
from osl_analysis.stats.repeats import difference, equivalence, of_intervals
from osl_analysis.table import ROW_KEYS, read_table, write_table


@pytest.mark.parametrize(("low", "high", "verdict"), [
    (324.0, 348.0, "equivalent"), (323.0, 357.0, "equivalent"), (322.9, 348.0, "undecided"),
    (357.1, 360.0, "different"), (300.0, 323.0, "undecided"), (None, 340.0, None),
    (340.0, None, None),
    (math.nan, 340.0, None), (-math.inf, 340.0, None),
])  # fmt: skip
def test_a_verdict_asks_where_the_whole_interval_lies(low, high, verdict):
    assert equivalence(low, high, 340.0, 17.0) == verdict
    mirrored = None if high is None else -high, None if low is None else -low
    assert equivalence(*mirrored, -340.0, 17.0) == verdict
    assert equivalence(low, high, 340.0, None) is None
    assert equivalence(340.0, 340.0, 340.0, 0.0) == "undecided", (
        "without a margin nothing is equivalent"
    )


def samples(rng, conditions=6, spread=100.0):
    """Two campaigns, B 2 above A with an SD of 1 within and of `spread` between conditions."""
    base = spread * rng.standard_normal(conditions)
    return [
        {k: [float(base[k] + mean + rng.standard_normal())] for k in range(conditions)}
        for mean in (0, 2)
    ]


def test_paired_and_welch_intervals_are_those_of_scipy():
    a, b = samples(np.random.default_rng(1))
    (x, y), paired, welch = (
        (np.ravel([*one.values()]) for one in (a, b)),
        scipy.stats.ttest_rel,
        scipy.stats.ttest_ind,
    )
    whole = [np.mean(y - x), *paired(y, x).confidence_interval()]
    assert difference(a, b) == (*map(pytest.approx, whole), "paired, Student")
    assert difference(a | {0: [x[0] - 1, x[0] + 1]}, b)[:3] == pytest.approx(whole)
    apart = {k: a[k] for k in range(1, 6)}, {k: b[k] for k in (0, 2, 3, 4, 5)}
    part = [np.mean((y - x)[2:]), *paired(y[2:], x[2:]).confidence_interval()]
    assert difference(*apart)[:3] == pytest.approx(part)
    trials = welch(y, x[:4], equal_var=False).confidence_interval()
    assert difference({0: x[:4]}, {0: y})[1:] == (*map(pytest.approx, trials), "Welch's t, trials")
    assert difference({0: [1.0]}, {1: [1.0]})[:3] == (None, None, None)
    assert difference({0: [1.0]}, {0: [3.0]})[:3] == (2.0, None, None)
    ends = of_intervals({None: (300, 297, 306)}, {None: (310, 306, 314)})
    assert ends[:3] == pytest.approx((10, 10 - math.hypot(4, 6), 10 + math.hypot(4, 3)))


WALK = {"mean of perturbations": 310.0, "ensemble": 300.0}


def tables(K=1.0, amplitude=2.0, conditions=8, seed=1):
    """Impedance trials with K a factor off K_d and an SD of 0.5 %, the first of them doubtful,
    belts, and a walk."""
    rng, rows = np.random.default_rng(seed), []
    for k in range(conditions):
        K_d = 100.0 * (1 + k % 4)
        found = {
            "K": K * K_d * (1 + 0.005 * rng.standard_normal()),
            "B": 5.0,
            "I": rng.normal(0, 0.01),
            "VAF": 99.0,
        }
        found |= {"B_viscous": 4.0 if k % 2 else None, "torque_error": 1.0}
        one = {
            "trial": f"{k}",
            "controller": "c",
            "K_d": K_d,
            "B_d": float(k // 4),
            "doubtful": "" if k else "x 1",
        }
        rows += [
            one | found | {"amplitude_deg": deg, "commanded_deg": deg} for deg in (amplitude, None)
        ]
    belt = pl.DataFrame({"K_s": rng.normal(685, 3, 4), "doubtful": [""] * 4})
    named = {"group": "all", "quantity": "K", "n": 30, "doubt": "", "commanded": 300.0 * K}
    walk = [
        named | {"estimator": e, "mean": m * K, "low": 290.0 * K, "high": 315.0 * K}
        for e, m in WALK.items()
    ]
    return {"impedance": pl.DataFrame(rows), "belt": belt, "walking_summary": pl.DataFrame(walk)}


def compared(a, b, *margin):
    """The rows of the comparison by their labels."""
    table = comparison_table(a, b, *margin)
    return {label_of(row): row for row in table.iter_rows(named=True)}


def of_impedance(*columns, seed=1, amplitude=2.0, **named):
    """A campaign of impedance trials alone, with columns changed."""
    table = tables(seed=seed, amplitude=amplitude)["impedance"]
    return {"impedance": table.with_columns(*columns, **named)}


def test_a_planted_difference_is_seen_with_its_interval():
    rows = compared(tables(), tables(K=1.08, seed=2, conditions=7))

    K, walk = rows["impedance K, c"], rows["walking K"]
    assert (K["verdict"], K["method"]) == ("different", "paired, Student")
    assert (K["mean_A"], K["remark"]) == (None, "7 of 8 conditions are shared")
    assert 7 < K["relative_percent_low"] < 8 < K["relative_percent_high"] < 9
    assert (walk["mean_A"], walk["remark"]) == (300, "commanded 300 in A and 324 in B")
    log_low = math.log(1.08) - math.hypot(math.log(300 / 290), math.log(315 / 300))
    assert walk["relative_percent_low"] == pytest.approx(100 * math.expm1(log_low))


def test_equal_campaigns_differ_by_their_scatter():
    a, b = tables(), tables(seed=2)

    rows = compared(a, b)

    K = rows["impedance K, c"]
    assert (K["verdict"], K["method"]) == ("undecided", "paired, Student")
    assert (K["n_A"], K["n_doubtful_B"]) == (8, 1)
    whole = pl.col("amplitude_deg").is_null()
    means = [scipy.stats.gmean(one["impedance"].filter(whole)["K"]) for one in (a, b)]
    assert K["relative_percent"] == pytest.approx(100 * (means[1] / means[0] - 1))
    assert rows["belt K_s"]["mean_A"] == pytest.approx(a["belt"]["K_s"].mean())
    assert rows["impedance I, c"]["relative_percent"] is None


def test_a_margin_makes_equal_campaigns_equivalent():
    belts = [{"belt": tables(seed=seed)["belt"]} for seed in (1, 2)]

    verdicts = [compared(*belts, *margin)["belt K_s"]["verdict"] for margin in ((), (0.02,))]

    assert verdicts == ["undecided", "equivalent"]


def test_a_bench_errs_alike_at_all_conditions():
    """Which no scatter shows: a difference of K is known to 2 % of either."""
    known = {"K_se_bench": 0.02 * pl.col("K"), "B_se_bench": pl.lit(0.3)}

    rows = compared(of_impedance(**known), of_impedance(1.08 * pl.col("K"), **known))

    K, B = rows["impedance K, c"], rows["impedance B_viscous, c"]
    percents = [K[name] for name in ("relative_percent", "relative_percent_low")]
    ratio, low = (math.log1p(percent / 100) for percent in percents)
    assert ratio - low == pytest.approx(1.96 * math.hypot(0.02, 0.02), rel=0.02)
    assert (K["verdict"], K["method"]) == ("undecided", "paired, Student + bench")
    assert B["difference_high"] == pytest.approx(1.96 * math.hypot(0.3, 0.3), rel=0.01)


def test_more_friction_is_no_more_viscous_damping():
    rows = compared(of_impedance(), of_impedance(pl.col("B") + 1.0))

    viscous = rows["impedance B_viscous, c"]
    assert rows["impedance B, c"]["difference"] == pytest.approx(1.0)
    assert viscous["difference"] == pytest.approx(0.0)
    assert viscous["n_A"] == 4, "of trials whose friction is certain"


def test_what_cannot_be_compared_says_why():
    belt = {"belt": tables()["belt"]}
    negative = {"belt": belt["belt"].with_columns(-pl.col("K_s"))}
    other_motion = comparison_table(of_impedance(), of_impedance(amplitude=6.0))

    assert compared(of_impedance(), belt)["impedance K, c"]["remark"] == "only in A"
    assert "not above 0" in compared(belt, negative)["belt K_s"]["remark"]
    assert other_motion["method"][0] == "none: no condition in common"
    drawn = draw_comparison.draw(other_motion).axes[0]
    assert "no ratio" in [text.get_text() for text in drawn.texts]


def test_trials_without_K_d_are_repeats_unless_their_names_are_equal():
    unnamed = {"K_d": pl.lit(None, pl.Float64)}
    a = of_impedance(**unnamed)
    b = of_impedance(seed=2, trial="other " + pl.col("trial"), **unnamed)

    assert "trials without K_d count as repeats" in comparison_table(a, b)["remark"][0]
    assert not comparison_table(a, a)["remark"].str.contains("repeats").any()


def test_a_change_at_one_of_two_conditions_is_seen_at_it():
    """The mean over two conditions has one degree of freedom, in which it is lost."""

    def day(change, repeats, seed):
        rng, rows = np.random.default_rng(seed), []
        for K_d, K in ((200.0, 190.0), (350.0, 332.0 * change)):
            found = K + 0.5 * rng.standard_normal(repeats)
            rows += [
                {"trial": f"{K_d:g} {k}", "K_d": K_d, "B_d": 2.0, "K": one}
                for k, one in enumerate(found)
            ]
        ends = {"K_low": pl.col("K") - 2.0, "K_high": pl.col("K") + 4.0, "doubtful": pl.lit("")}
        return {
            "impedance": (
                pl.DataFrame(rows).with_columns(**ends, **dict.fromkeys(("B", "I", "VAF"), 1.0))
            )
        }

    for repeats, method in ((3, "Welch's t, trials"), (1, "intervals of both")):
        a, b = (day(*one) for one in ((1.0, repeats, 1), (0.95, repeats, 2)))
        for one in (a, b):
            nothing = {
                name: pl.lit(None, pl.Float64)
                for name in ("B_viscous", "torque_error", "amplitude_deg")
            }
            one["impedance"] = one["impedance"].with_columns(**nothing)
        table = comparison_table(a, b).filter(quantity="K")
        assert table["condition", "verdict"].rows() == [
            (None, "undecided"), ("K_d 200", "undecided"), ("K_d 350", "different"),
        ]  # fmt: skip
        assert label_of(table.row(2, named=True)) == "impedance K (K_d 350)"
        assert set(table["method"][1:]) == {method}
        of = [one["impedance"].filter(K_d=350.0)["K"].mean() for one in (a, b)]
        assert table["mean_A", "mean_B"].row(2) == pytest.approx(of)
        if repeats == 1:
            half = math.hypot(2.0, 4.0)
            assert table["difference", "difference_low", "difference_high"].row(2) == pytest.approx(
                (of[1] - of[0], of[1] - of[0] - half, of[1] - of[0] + half)
            )
    one_condition = ({"impedance": one["impedance"].filter(K_d=350.0)} for one in (a, b))
    assert comparison_table(*one_condition).filter(quantity="K")["condition", "verdict"].rows() == [
        (None, "different")
    ]


def write_empty(name, table, outputs, **others):
    """Stand for `draw_figure`, where the figure is no part of the claim."""
    for path in outputs:
        path.touch()


def test_the_command_writes_table_and_figure_and_prints_every_verdict(tmp_path, monkeypatch):
    about = {"campaign": "a", "data": "simulated", "configuration": "c", "recorded": "r"}
    for name, made in (("a", tables()), ("b", tables(K=1.08, seed=2))):
        number, line = (
            next(
                headline_numbers(
                    {
                        "belt_summary": pl.DataFrame(
                            {"quantity": ["K_s"], "mean": [685.0], "low": [None], "high": [None]}
                        )
                    }
                )
            ),
            {
                "verdict": "doubtful",
                "cause": "<friction>",
                "of": "trials",
                "trials": [name],
                "n": 2,
            },
        )
        for table, frame in made.items():
            write_table(frame, tmp_path / name / f"tables/{table}.csv")
        # what the bench's calibration adds is known beside the table
        known = made["impedance"].with_columns(K_se_bench=0.002 * pl.col("K"))
        keys = [key for key in ROW_KEYS if key in known.columns]
        evidence = tmp_path / f"{name}/tables/impedance_evidence.csv"
        write_table(known.select(*keys, "K_se_bench"), evidence)
        summary = to_json(
            about | {"version": name}, [number], {"findings": [line], "trials": {}, "intervals": ""}
        )
        (tmp_path / name / "summary.json").write_text(summary)
    out = tmp_path / "out"

    def call(*arguments):
        monkeypatch.chdir(tmp_path)
        return CliRunner().invoke(main, ["compare", *arguments, "--output", "out"])

    with monkeypatch.context() as broken:
        broken.setattr("osl_analysis.commands.report.draw_figure", lambda *_, **named: 1 / 0)
        assert (call("a", "b").exit_code, list(out.iterdir())) == (1, [])
    monkeypatch.setattr("osl_analysis.commands.report.draw_figure", write_empty)
    done = call("a", "b", "--margin", "4%")
    assert {path.suffix for path in out.iterdir()} == {".csv", ".pdf", ".svg", ".png"}
    table = read_table(out / "comparison.csv")
    assert set(table["verdict"]) == {"different", "equivalent", "undecided", None}
    for row in table.drop_nulls("verdict").iter_rows(named=True):
        (line,) = [
            line for line in done.output.splitlines() if line.startswith(f"{label_of(row)}  ")
        ]
        assert row["verdict"] in line
    of_K = table.filter(pl.col("condition").is_null(), experiment="impedance", quantity="K")
    assert of_K["method"].to_list() == ["paired, Student + bench"]
    for said in ("A: ⚠ <friction>: 1 of 2 trials", "B: ⚠ <friction>", "version: a in A, b in B"):
        assert said in done.output
    assert "different: impedance K, c (±4 %)" in done.output
    assert done.output.startswith("quantity ")
    rows = json.loads(call("a", "b", "--json").output)
    assert [row["quantity"] for row in rows] == read_table(out / "comparison.csv")[
        "quantity"
    ].to_list()
    shutil.copytree("b", "d")
    shutil.rmtree("d/tables")
    write_table(
        tables()["impedance"].with_columns(pl.col("K_d") + 7), Path("d/tables/impedance.csv")
    )
    assert (
        "a and d: nothing to compare, no quantity is of one condition in both"
        in call("a", "d").stderr
    )
    shutil.copytree("a", "c")
    assert " is a copy of " in call("a", "c").output
    Path("b/summary.json").write_text(
        Path("b/summary.json").read_text().replace("N*m/rad", "N*m/deg")
    )
    for b, said in (
        ("a", "same folder"),
        ("none", "no such summary"),
        ("b", "'K_s' is in N*m/deg, but in N*m/rad"),
    ):
        assert said in call("a", b).stderr


def impedance_of_one_trial(trial, K):
    row = {"trial": trial, "doubtful": "", "K": K, "K_low": K - 1, "K_high": K + 1}
    row |= {"controller": None, "K_d": None, "B_d": None, "excitation": "stepped sine"}
    row |= {"B": 2.0, "B_viscous": None, "I": 0.02, "VAF": 99.0, "torque_error": None}
    kinds = dict.fromkeys(("K_d", "B_d", "B_viscous", "torque_error"), pl.Float64)
    rows = [row | {"amplitude_deg": amplitude} for amplitude in (2.0, None)]
    return {"impedance": pl.DataFrame(rows, schema_overrides=kinds | {"controller": pl.String})}


def test_one_trial_without_K_d_in_each_campaign_is_no_pool_of_repeats():
    a, b = impedance_of_one_trial("a", 100.0), impedance_of_one_trial("b", 101.0)

    of_K = comparison_table(a, b).row(0, named=True)

    assert (of_K["quantity"], of_K["method"]) == ("K", "intervals of both")
    assert of_K["remark"] is None
