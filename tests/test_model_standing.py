"""Models over trials: differences are paired, needless terms are not found, and what cannot be told apart is tied."""

import numpy as np
import polars as pl
import pytest
from scipy.stats import t as student

from osl_analysis.commands.bench import summarise_model_comparison
from osl_analysis.stats.comparison import mean_over_trials, rank_words
from osl_analysis.table import write_table


def test_paired_differences_tell_models_apart_that_their_own_scatter_hides():
    """Trials differ by 100, the models by 1 +- 0.1 in every trial."""
    rng = np.random.default_rng(1)
    trial = rng.normal(0, 100, 10)
    loss = np.column_stack([trial, trial - 1 + rng.normal(0, 0.1, 10), trial + 3])
    assert rank_words(loss) == ["worse", "preferred", "worse"]
    assert mean_over_trials(loss[:, 0]).low < mean_over_trials(loss[:, 1]).mean < mean_over_trials(loss[:, 0]).high


def test_of_models_that_tie_the_first_is_preferred_although_another_has_the_smaller_mean():
    loss = np.array([[1.0, 0.9, 5.0], [1.0, 1.2, 5.0], [1.0, 0.8, 5.0]])
    assert rank_words(loss) == ["preferred", "tied", "worse"]


def test_a_single_trial_tells_nothing_apart_and_has_no_interval():
    assert rank_words(np.array([[1.0, 0.0]])) == ["preferred", "tied"]
    assert rank_words(np.zeros((0, 2))) == [None, None]
    alone = mean_over_trials(np.array([4.0]))
    assert (alone.n, alone.mean) == (1, 4.0)
    assert np.isnan([alone.sd, alone.low, alone.high]).all()


def test_intervals_are_students_and_wider_where_trials_share_their_fits():
    """Own trials: s / sqrt(n), n - 1 degrees of freedom. Shared: s^2 (1/n + 1/(n - 1)) after Nadeau and Bengio.

    Both terms are of one scatter, which is worth n - 1 degrees of freedom and not the sum of two independent ones.
    """
    values = np.array([1.0, 2.0, 4.0, 7.0])
    own, shared = mean_over_trials(values), mean_over_trials(values, shared=True)
    assert own.high - own.mean == pytest.approx(student.ppf(0.975, 3) * np.std(values, ddof=1) / 2)
    assert shared.se**2 == pytest.approx(np.var(values, ddof=1) * (1 / 4 + 1 / 3))
    assert (shared.high - shared.mean) / shared.se == pytest.approx(student.ppf(0.975, 3))
    assert shared.mean == own.mean == 3.5


def gains_of_a_term(size, trials, rng):
    """Held-out gains of a term: own estimates e of each trial, of which the mean of the others predicts this one."""
    e = size + rng.standard_normal(trials)
    others = (e.sum() - e) / (trials - 1)
    return 2 * others * e - others**2


@pytest.mark.parametrize(("trials", "plain"), [(5, 0.89), (10, 0.905)])
def test_the_interval_of_a_held_out_gain_covers_its_mean_better_than_plain_student(trials, plain):
    """Leave-one-out gains are no independent draws: E = a^2 - 1/(n - 1), and `plain` is what Student covers for a = 1.

    2000 draws: a Monte Carlo error of 0.5 %. Over five trials 94 % remain, over ten 96 %.
    """
    for size, least in ((0.0, 0.95), (1.0, plain + 0.04), (3.0, 0.95)):
        rng, covered, better = np.random.default_rng(2), 0, 0
        for _ in range(2000):
            found = mean_over_trials(gains_of_a_term(size, trials, rng), shared=True)
            covered += found.low < size**2 - 1 / (trials - 1) < found.high
            better += found.low > 0
        assert covered / 2000 > least
        assert size or better / 2000 < 0.01, "a needless term is not found"


def score_table():
    """Three belts, of which a term takes 0.04, 0.03 and 0.05 of the variance; two trials of each controller."""
    rows = []
    for trial, vaf, gain in (("belt_1", 99.90, 0.04), ("belt_2", 99.92, 0.03), ("belt_3", 99.91, 0.05)):
        rows += [
            ("belt", trial, None, "M1", "K_s", 1, vaf, -100.0),
            ("belt", trial, None, "M2", "K_s + T_h", 2, vaf + gain, -300.0),
        ]
    for controller, vaf in (("compensated", 99.0), ("uncompensated", 90.0)):
        for k in (1, 2):
            name = f"{controller}_{k}"
            rows += [
                ("impedance", name, controller, "M1", "K + B + I", 3, vaf, 10.0 * k),
                ("impedance", name, controller, "M2", "Eq. 9", 0, vaf, 10.0 * k + 4),
            ]
    names = ("experiment", "trial", "controller", "model", "terms", "parameters", "VAF_held_out", "BIC")
    return pl.DataFrame(rows, schema=names, orient="row", infer_schema_length=None)


def test_the_summary_has_a_row_per_model_with_its_difference_to_the_drafts(tmp_path):
    write_table(score_table(), tmp_path / "scores.csv")
    summarise_model_comparison(tmp_path / "scores.csv", tmp_path / "summary.csv")
    rows = pl.read_csv(tmp_path / "summary.csv").to_dicts()
    assert [(r["experiment"], r["controller"], r["model"], r["trials"]) for r in rows] == [
        ("belt", None, "M1", 3),
        ("belt", None, "M2", 3),
        ("impedance", "compensated", "M1", 2),
        ("impedance", "compensated", "M2", 2),
        ("impedance", "uncompensated", "M1", 2),
        ("impedance", "uncompensated", "M2", 2),
    ]
    linear, hysteresis, *_ = rows
    half = student.ppf(0.975, 2) * np.sqrt(1e-4 / 3 + 1e-4 / 2)
    assert hysteresis["VAF_gain"] == pytest.approx(0.04)
    assert hysteresis["VAF_gain_high"] - 0.04 == pytest.approx(half)
    left = [0.06 / 0.10, 0.05 / 0.08, 0.04 / 0.09]
    assert hysteresis["unexplained_ratio"] == pytest.approx(np.prod(left) ** (1 / 3))
    assert (linear["VAF_gain"], linear["unexplained_ratio"]) == (0, 1)
    assert linear["VAF_behind"] == pytest.approx(0.04)
    assert (hysteresis["BIC_change"], linear["BIC_behind"]) == (-200, 200)
    assert [(r["by_VAF"], r["by_BIC"]) for r in rows[:2]] == [("worse", "worse"), ("preferred", "preferred")]
    assert [(r["by_VAF"], r["by_BIC"]) for r in rows[2:4]] == [("preferred", "preferred"), ("tied", "worse")]


def test_a_single_trial_is_summarised_without_intervals(tmp_path):
    alone = score_table().filter(pl.col("trial") == "belt_1").with_columns(VAF_held_out=pl.lit(float("nan")))
    write_table(alone, tmp_path / "scores.csv")
    summarise_model_comparison(tmp_path / "scores.csv", tmp_path / "summary.csv")
    rows = pl.read_csv(tmp_path / "summary.csv").to_dicts()
    assert [(r["VAF_held_out"], r["BIC_change"], r["BIC_change_low"]) for r in rows] == [
        (None, 0.0, None),
        (None, -200.0, None),
    ]
    assert [(r["by_VAF"], r["by_BIC"]) for r in rows] == [(None, "preferred"), (None, "tied")]
