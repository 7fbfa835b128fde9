"""What components predict of a leg that obeys Eqs. 1-7 and of legs that differ in one component;
torque accuracy in pairs; claims and their verdicts. The truth is the simulator's integrator, a
formula, or a planted fault."""

import importlib  # statsmodels takes half a second of each process that collects tests
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl
import pytest
from bench_synthetic import FIVE, LOW_PASS, RATE, component_tables, stepped_sine, true_motion
from conftest import ROOT
from polars.testing import assert_frame_equal
from scipy import stats
from scipy.signal import butter, sosfiltfilt

from osl_analysis.bench import prediction, prediction_causes
from osl_analysis.bench.bench_settings import FilterSettings
from osl_analysis.bench.condition_tables import compensation_table
from osl_analysis.bench.controller_law import LAW_COLUMNS
from osl_analysis.bench.impedance import DesiredImpedance, rendered_impedance, torque_error
from osl_analysis.bench.measured_components import COMPONENTS, components_of
from osl_analysis.bench.prediction import (
    MISSES,
    Misses,
    model_variance,
    prediction_table,
    prediction_terms,
)
from osl_analysis.bench.record import read_record, record_of, stored_record
from osl_analysis.bench.row_groups import stretches_of
from osl_analysis.commands.predictions import gather_predictions
from osl_analysis.errors import InputError
from osl_analysis.judge.campaign import campaign_findings, measured_over_predicted, misfits_of_joint
from osl_analysis.judge.claims import Claims, claims_table, limit_verdict
from osl_analysis.judge.finding import Beyond
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.compensator import PAPER_WEIGHT, select_gains
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.report.headlines import headline_numbers, to_tex
from osl_analysis.simulator.two_mass_drivetrain import IDEAL, simulate_drivetrain
from osl_analysis.table import read_table, write_table

P = read_parameters(ROOT / "config/parameters/default.yaml")
TRUE = {"k_tau_n_m": P.k_tau * P.n_m, **vars(P)}
HERE = {"joint": "ankle", "side": None}
PAIR, NONE = (
    ("compensated", "uncompensated"),
    pl.DataFrame(schema={"check": pl.String, "verdict": pl.String}),
)
ASKED = [(K, B, name) for name in PAIR for K, B in ((100, 5), (200, 2.5), (300, 5), (400, 7.5))]
FAULTS = {"K_s": 0.85, "f_C": 2.0, "k_tau_n_m": 0.92, "J_m": 1.3, "B_j": 1.5, "torque_gain": 1.05}
LINEAR = {"f_C": 0.25}  # relative error of a change that is taken for linear, where it is not
TYPES = {"side": pl.String, "amplitude_deg": pl.Float64}


def law_of(K_d, B_d, controller, **delays):
    return Controller(select_gains(controller, K_d, B_d, P), P, 0.05, **delays)


def recording(K_d, B_d, controller, p=P, seed=0, gain=1.0, **delays):
    """A stepped sine against a leg with parameters p, with noise of 0.05 N*m, by a load cell with
    this gain."""
    law = law_of(K_d, B_d, controller, **delays)

    def torque(m):
        return gain * (
            belt_responses(m.theta, RATE, [(law, p)])[0] + p.B_j * m.omega + p.J_j * m.alpha
        )

    return stepped_sine(torque, 0.05, FIVE, seed)


def fitted(record, **asked):
    """Its row of `impedance.csv` over all amplitudes, as far as a prediction reads it: no witness,
    which takes long."""
    return rendered_impedance(record)[0].row(None, "K", "B", "I") | asked | {"doubtful": ""}


def predictions(tables, p=P, **delays):
    """`prediction.csv` and its causes of the leg p, as the component tables predict it."""
    components, terms, fits = components_of(tables, ("ankle", None), P), {}, []
    for seed, (K_d, B_d, controller) in enumerate(ASKED):
        name, record = f"K{K_d}_{controller}", recording(K_d, B_d, controller, p, seed, **delays)
        terms[name], _ = prediction_terms(
            replace(record, name=name), law_of(K_d, B_d, controller), components
        )
        fits.append(
            fitted(
                record, trial=name, **HERE, controller=controller, K_d=float(K_d), B_d=float(B_d)
            )
        )
    return *prediction_table(terms, pl.DataFrame(fits, infer_schema_length=None), components), fits


def test_a_record_that_was_kept_is_predicted_as_that_of_the_fit_and_without_components_it_is_said(
    tmp_path,
):
    record, kept = (
        replace(recording(300, 5, "compensated", P, 0), name="t_1"),
        tmp_path / "t_1.parquet",
    )
    write_table(stored_record(record), kept)
    law, components = (
        law_of(300, 5, "compensated"),
        components_of(component_tables(TRUE), ("ankle", None), P),
    )
    made = (
        prediction_terms(one, law, components)
        for one in (record, read_record(kept, record.low_pass))
    )
    for of_record, of_kept in zip(*made, strict=True):
        assert_frame_equal(of_record, of_kept, rel_tol=1e-9)
    row = fitted(record, trial="t_1", **HERE, controller="compensated", K_d=300.0, B_d=5.0)
    write_table(pl.DataFrame([row]), table := tmp_path / "impedance.csv")
    settings, output = FilterSettings(cutoff_hz=15, order=4), tmp_path / "p.csv"
    causes, frequencies = tmp_path / "c.csv", tmp_path / "f.csv"
    device = ROOT / "config/parameters/default.yaml"
    write_table(pl.DataFrame(schema=LAW_COLUMNS), law := tmp_path / "law.csv")
    gather_predictions(
        [kept],
        table,
        law,
        {},
        {},
        PAPER_WEIGHT,
        0.05,
        settings,
        output,
        causes,
        frequencies,
        device,
    )
    assert "no actuator and no belt" in read_table(output)["missing_components"].item()
    assert read_table(causes).is_empty()
    assert {*MISSES} < {*read_table(frequencies).columns}


def test_what_a_prediction_misses_stands_at_the_frequency_at_which_it_misses_it():
    """Of an inertia more than predicted, I w^2 times the RMS of a sine; of a gain, an equal share
    at each frequency."""
    law, more = law_of(300, 5, "compensated"), 0.05
    components = components_of(component_tables(TRUE, 1e-6), ("ankle", None), P)
    _, found = prediction_terms(
        recording(300, 5, "compensated", replace(P, J_j=P.J_j + more)), law, components
    )
    assert found["frequency_hz"].to_list() == [1, 2, 3, 4, 5]
    size, w = np.sqrt(np.mean(np.square(FIVE.amplitudes)) / 2), 2 * np.pi * found["frequency_hz"]
    np.testing.assert_allclose(found["miss"], more * w**2 * size, rtol=0.01, atol=0.02)
    np.testing.assert_allclose(found["share"], 100 * found["miss"] / found["torque"])
    rng = np.random.default_rng(3)
    theta = sosfiltfilt(
        butter(4, (0.5, 6), "band", fs=RATE, output="sos"), rng.standard_normal(round(60 * RATE))
    )
    motion = true_motion(time := np.arange(len(theta)) / RATE, 0.05 * theta / theta.std())
    torque = 1.25 * (
        belt_responses(motion.theta, RATE, [(law, P)])[0]
        + P.B_j * motion.omega
        + P.J_j * motion.alpha
    )
    rows = stretches_of([slice(500, len(time) - 500)], RATE)
    _, found = prediction_terms(
        record_of("noise", time, motion.theta, torque, LOW_PASS, rows), law, components
    )
    assert found["frequency_hz"].is_between(0.4, 8.5).all()
    assert len(found) > 10
    np.testing.assert_allclose(found["share"], 20, atol=0.3)


def test_a_controller_that_acts_late_is_that_of_the_simulator_with_its_delay():
    t, w = np.arange(4000) / 1000.0, 2 * np.pi * 3.0
    theta, omega, gains = (
        0.05 * (1 - np.cos(w * t)),
        0.05 * w * np.sin(w * t),
        select_gains("compensated", 300, 5, P),
    )
    law = IDEAL | {
        "friction": True,
        "cancels_friction": True,
        "sign_width": 0.05,
        "control_updates": 20,
    }
    commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
    # 4 ms
    truth = simulate_drivetrain(1000.0, theta, omega, commands, law | {"control_delay": 80}, P)[
        "belt_torque"
    ]
    legs = [
        (law_of(300, 5, "compensated", angle_delay=one, velocity_delay=one), P) for one in (4e-3, 0)
    ]
    late, sharp = belt_responses(theta, 1000.0, legs)
    assert np.std(late - truth) < 0.25 * np.std(sharp - truth)


def test_components_are_means_with_the_scatter_of_their_trials_and_the_correlations_of_their_fits():
    tables = component_tables(TRUE)
    found, f_C = components_of(tables, ("ankle", None), P), tables["actuator"]["f_C"].to_numpy()
    assert found.values["f_C"] == pytest.approx(f_C.mean())
    of_fits = np.sqrt(np.mean(tables["actuator"]["f_C_se"].to_numpy() ** 2))
    assert found.se("f_C") == pytest.approx(max(f_C.std(ddof=1), of_fits) / 3**0.5)
    of = list(COMPONENTS).index
    assert found.covariance[of("f_C"), of("J_m")] == pytest.approx(
        0.5 * found.se("f_C") * found.se("J_m"), rel=2e-3
    )
    assert (found.covariance[of("f_C"), of("K_s")], found.freedom["K_s"]) == (0, 2)
    assert (found.p.k_tau * P.n_m, found.p.n_T) == (pytest.approx(found.values["k_tau_n_m"]), P.n_T)
    for wrong, side, said in (
        ({"actuator": tables["actuator"]}, None, "no belt and no transmission trials"),
        (tables, "left", "no actuator and no belt and no transmission"),
        (
            component_tables(TRUE | {"K_s": -TRUE["K_s"]}),
            None,
            r"belt.csv: K_s = -68\d.* is negative",
        ),
    ):
        with pytest.raises(InputError, match=said):
            components_of(wrong, ("ankle", side), P)
    doubtful = tables["actuator"].with_columns(B_m=pl.lit(-1e-5), B_m_se=pl.lit(1e-4))
    assert components_of({**tables, "actuator": doubtful}, ("ankle", None), P).p.B_m == 0


def test_the_components_of_a_leg_predict_its_torque_and_nothing_is_named():
    table, causes, fits = predictions(component_tables(TRUE))
    assert table["VAF"].min() > 99.9
    for symbol in "KB":
        assert table[f"{symbol}_measured"].to_list() == pytest.approx(
            [fit[symbol] for fit in fits], rel=2e-3
        )
        inside = table[f"{symbol}_measured"].is_between(
            table[f"{symbol}_low"], table[f"{symbol}_high"]
        )
        assert inside.sum() >= 7
    assert (table["K_high"] - table["K_low"]).max() < 0.02 * 400
    for K_d, B_d, outside in (
        (150, 0, "K_d"),
        (200, 9, "B_d"),
        (150, 9, "K_d and B_d"),
        (300, 5, None),
    ):
        trial = {"K_d": K_d, "B_d": B_d}
        others = [{"K_d": 200, "B_d": 0}, {"K_d": 400, "B_d": 5}]
        assert prediction.outside_of(trial, others) == outside
    assert not causes["named"].any()


def doubts_about(table, causes):
    tables = {"prediction": table, "prediction_causes": causes}
    return (
        campaign_findings(tables, NONE, DoubtfulFits())
        .filter(grade="doubts")
        .select("cause", "evidence")
        .rows()
    )


@pytest.mark.parametrize(("name", "factor"), FAULTS.items())
def test_a_component_that_is_not_as_its_trials_say_is_named_with_its_size(name, factor):
    changed = "k_tau" if name == "k_tau_n_m" else name
    of_leg = (
        {}
        if name == "torque_gain"
        else {"p": replace(P, **{changed: getattr(P, changed) * factor})}
    )
    table, causes, _ = predictions(component_tables(TRUE), **(of_leg or {"gain": factor}))
    assert causes.filter(pl.col("named"))["component"].to_list() == [name]
    row = causes.row(by_predicate=pl.col("component") == name, named=True)
    assert row["change"] / row["value"] == pytest.approx(factor - 1, rel=LINEAR.get(name, 0.1))
    assert doubts_about(table, causes) == [(f"component {name}", name)] * 8


def test_the_robust_regression_is_that_of_statsmodels():
    theirs = importlib.import_module("statsmodels.robust.robust_linear_model")
    rng = np.random.default_rng(1)
    A = 0.01 * rng.standard_normal((12, len(prediction_causes.TERMS), 3))
    A[:, 0] += 0.5 * A[:, 1]
    A[0, 0] += 3  # a trial that rings
    y, X = A[:, 0].ravel(), A[:, 1:4].transpose(0, 2, 1).reshape(-1, 3)
    expected = theirs.RLM(y, 1e2 * X, theirs.norms.HuberT(1.5)).fit().params * 1e2
    (found,), (left,) = prediction_causes.robust_fit(A, prediction_causes.TERMS[1:4])
    assert (found, left) == (
        pytest.approx(expected, rel=1e-9),
        pytest.approx(np.mean(np.abs(y - X @ expected))),
    )


def test_two_faults_at_once_are_said_and_none_of_them_is_named():
    table, causes, _ = predictions(
        component_tables(TRUE), replace(P, K_s=0.8 * P.K_s, f_C=1.6 * P.f_C)
    )
    assert not causes["named"].any()
    assert doubts_about(table, causes) == [("components that do not predict", "left")] * 8


def test_a_late_controller_is_named_with_its_delay_and_no_component_is():
    table, causes, _ = predictions(component_tables(TRUE), angle_delay=2e-3, velocity_delay=2e-3)
    assert causes.filter(pl.col("named"))["component"].to_list() == ["angle_delay"]
    assert causes["change"][-2:].to_list() == pytest.approx([2e-3, 2e-3], abs=3e-4)
    delays = ("angle_delay", "velocity_delay")
    assert doubts_about(table, causes) == [
        ("late controller", name) for _ in range(8) for name in delays
    ]


def test_the_standard_error_of_a_change_is_that_of_a_mean_where_the_change_is_a_mean():
    of_trials = np.array([0.04, 0.07, 0.05, 0.06])
    without_one = (of_trials.sum() - of_trials) / 3
    changes = {"torque_gain": np.array([of_trials.mean(), *without_one])}
    components = components_of(component_tables(TRUE), ("ankle", None), P)
    explained = prediction_causes.Explained(changes, 0.01)

    row = prediction_causes.cause_row("torque_gain", explained, 0.02, components, 4)

    assert row["change_se"] == pytest.approx(np.std(of_trials, ddof=1) / 2)


def test_an_interval_is_learnt_from_the_other_trials():
    """What a trial itself measured does not change its own interval, and changes that of the
    others."""
    tables = component_tables(TRUE)
    components, record = components_of(tables, ("ankle", None), P), recording(300, 5, "compensated")
    terms = {
        f"t{k}": prediction_terms(record, law_of(300, 5, "compensated"), components)[0]
        for k in range(6)
    }
    fit = fitted(record, **HERE, controller="c", K_d=1.0, B_d=1.0)
    fits = pl.DataFrame([fit | {"trial": trial} for trial in terms])
    wide = {
        **terms,
        "t0": (
            terms["t0"].with_columns(K=pl.when(pl.col("term") == "left").then(30.0).otherwise("K"))
        ),
    }
    before, after = (prediction_table(one, fits, components)[0] for one in (terms, wide))
    width = [(one["K_high"] - one["K_low"]).to_numpy() for one in (before, after)]
    assert width[0][0] == width[1][0]
    assert (width[1][1:] > 5 * width[0][1:]).all()
    alone, _ = prediction_table({"t0": terms["t0"]}, fits.head(1), components)
    assert alone.select("K_low", "K_high").row(0) == (None, None)


def test_the_interval_of_a_prediction_has_the_freedom_of_the_trials_that_teach_it():
    """Without other errors it is Student's, of the mean square of what the others miss."""
    missed = np.array([9.0, 1.0, -2.0, 1.5, -0.5])
    nothing = np.zeros(5)
    misses = Misses(
        predicted=np.full(5, 100.0),
        off=missed,
        size=np.ones(5),
        of_parts=np.zeros((5, 3)),
        of_trial=nothing,
    )
    components = components_of(component_tables(TRUE), ("ankle", None), P)

    found = misses.interval(0, np.arange(5) > 0, components)

    half_width = stats.t.ppf(0.975, 3) * np.sqrt(np.mean(missed[1:] ** 2))
    assert found.high - 100.0 == pytest.approx(half_width)
    assert 100.0 - found.low == pytest.approx(half_width)


def test_the_measured_torque_beside_a_prediction_is_that_of_the_recording():
    record = replace(recording(300, 5, "compensated", P, 0), name="t_1")
    components = components_of(component_tables(TRUE), ("ankle", None), P)

    terms, _ = prediction_terms(record, law_of(300, 5, "compensated"), components)

    predicted, left = terms["torque"].to_list()[:2]
    assert predicted + left == pytest.approx(np.std(record.part(record.filtered_torque)))


def test_what_the_equations_lack_has_the_variance_that_scatters_beyond_what_is_known():
    rng = np.random.default_rng(2)
    known = rng.uniform(0.5, 2.0, 40_000)
    assert model_variance(
        rng.standard_normal(40_000) * np.sqrt(known + 3.0), known
    ) == pytest.approx(3.0, rel=0.05)
    assert model_variance(np.array([3.0, -1.0]), np.zeros(2)) == pytest.approx(5.0)
    assert model_variance(np.array([0.1, -0.1]), np.ones(2)) == 0


def test_the_torque_error_is_what_an_offset_and_a_drift_leave_of_the_difference_to_what_was_asked():
    record = recording(300, 5, "compensated")
    s, motion = rendered_impedance(record)[0].sums, record.motion
    ends = zip(np.ceil(s.groups.first), np.floor(s.groups.stop), strict=True)
    rows = np.concatenate([np.arange(int(a), int(b)) for a, b in ends])
    left = (record.filtered_torque - 310 * motion.theta - 4 * motion.omega)[rows]
    X = np.column_stack([np.ones(len(rows)), record.time[rows]])
    left -= X @ np.linalg.lstsq(X, left, rcond=None)[0]
    assert torque_error(s, None, DesiredImpedance("x", 310, 4)) == pytest.approx(
        np.sqrt(np.mean(left**2)), rel=2e-3
    )
    assert torque_error(s, None, DesiredImpedance("x", None, 4)) is None


def test_components_that_do_not_predict_are_told_with_how_far_k_and_b_are_off():
    predicted = pl.DataFrame(
        {"K": [100.0, 200.0], "K_measured": [110.0, 220.0],
         "B": [4.0, 5.0], "B_measured": [3.0, 3.75]}
    )  # fmt: skip
    delays = {"component": ["angle_delay", "velocity_delay"], "named": [False, False],
              "change": [0.001, 0.002], "left": [3.0, 3.0]}  # fmt: skip

    (misfit,) = misfits_of_joint(pl.DataFrame(delays), predicted)

    assert misfit.cause == "components that do not predict"
    assert misfit.evidence == (Beyond("left", 3.0, 1.0, "above"),)
    assert measured_over_predicted(predicted, "K") == pytest.approx(10)
    assert measured_over_predicted(predicted, "B") == pytest.approx(-25)


def test_a_doubtful_trial_leaves_the_comparison_where_the_others_of_its_condition_are_sound():
    rows = []
    for controller, K_d, repeat in product(PAIR, (100.0, 200.0), (1, 2, 3)):
        asked = {"controller": controller, "K_d": K_d, "B_d": 5.0, "amplitude_deg": None}
        fit = {"K": 1.1 * K_d, "B": 5.5, "VAF": 99.0, "torque_error": 1.0, "doubtful": ""}
        rows.append({**HERE, "trial": f"{controller}_{K_d}_{repeat}", "commanded_deg": None,
                     **asked, **fit})  # fmt: skip
    sound = pl.DataFrame(rows, schema_overrides={"amplitude_deg": float, "side": pl.String})
    is_spoilt = pl.col("trial") == f"{PAIR[0]}_100.0_2"
    spoilt = sound.with_columns(
        K=pl.when(is_spoilt).then(900.0).otherwise("K"),
        doubtful=pl.when(is_spoilt).then(pl.lit("torque path")).otherwise("doubtful"),
    )

    compared = compensation_table(spoilt)

    assert compared.equals(compensation_table(sound))


def test_compensation_is_compared_in_pairs_and_its_interval_counts_trials(tmp_path):
    rng, rows = np.random.default_rng(3), []
    for K, B, name, deg in product((100.0, 200.0), (0.0, 5.0), PAIR, (2.0, 4.0, None)):
        row = {
            **HERE,
            "controller": name,
            "K_d": K,
            "B_d": B,
            "commanded_deg": deg,
            "K": K * rng.uniform(0.7, 1.3),
        }
        rows.append(
            row
            | {
                "B": B + rng.normal(),
                "VAF": rng.uniform(90, 99),
                "torque_error": rng.uniform(1, 2),
            }
        )
    table = pl.DataFrame(rows, schema_overrides={"side": pl.String})
    found, whole, condition = (
        compensation_table(table),
        pl.col("commanded_deg").is_null(),
        ["K_d", "B_d"],
    )
    wide = table.filter(whole).pivot("controller", index=condition, values=["K", "VAF"])
    off = [100 * (wide[f"K_{name}"] / wide["K_d"] - 1).abs().to_numpy() for name in PAIR]
    row = found.filter(by="trials", quantity="K_error").row(0, named=True)
    interval = stats.ttest_1samp(off[0] - off[1], 0).confidence_interval(0.95)
    assert (row["difference_low"], row["difference_high"]) == pytest.approx(tuple(interval))
    assert (row["pairs"], row["better"]) == (4, np.sum(off[0] < off[1]))
    assert row["compensated"] == pytest.approx(off[0].mean())
    (better,) = found.filter(by="trials", quantity="VAF")["better"]
    assert better == (wide["VAF_compensated"] > wide["VAF_uncompensated"]).sum()
    single = found.filter(by="amplitudes", quantity="VAF").row(0, named=True)
    by_trial = table.filter(~whole).pivot(
        "controller", index=condition, values="VAF", aggregate_function="mean"
    )
    interval = stats.ttest_1samp(
        by_trial["compensated"] - by_trial["uncompensated"], 0
    ).confidence_interval(0.95)
    assert (single["pairs"], single["difference_low"]) == (8, pytest.approx(interval.low))
    assert found.filter(pl.col("by") == "commanded_deg")["at"].unique().sort().to_list() == [
        2.0,
        4.0,
    ]
    rubs = table.with_columns(B=pl.col("B") + 3, B_viscous="B")
    assert compensation_table(rubs).equals(found), "friction is no damping that a gain asks for"
    write_table(
        compensation_table(table.filter(controller="compensated")), tmp_path / "compensation.csv"
    )
    assert claimed({"compensation": read_table(tmp_path / "compensation.csv")})[0].is_empty(), (
        "no pair, no claim"
    )


def claimed(tables, **settings):
    found = claims_table(tables, Claims(**settings), (1.0, 2.0, 5.0), 340.0, {"ankle": P.n_T})
    return found, {(row["name"], row["subject"]): row for row in found.to_dicts()}


def summary(se=0.01, **means):
    rows = [{**HERE, "quantity": q, "n": 5, "mean": m, "se": se * m} for q, m in means.items()]
    return pl.DataFrame(rows, schema_overrides={"side": pl.String})


def test_claims_hold_fail_or_are_undecided_by_their_interval():
    tables = {
        "transmission_summary": summary(B_j=0.452, J_j=0.005),
        "belt_summary": summary(K_s=685.6),
    }
    tables |= {"actuator_summary": summary(k_tau_n_m=1.02, f_C=0.377, f_G=0.0896)}
    row = {
        **HERE,
        "trial": "k",
        "controller": "compensated",
        "amplitude_deg": None,
        "K_d": 300.0,
        "B_d": 5.0,
    }
    row |= {
        "K": 300.0,
        "K_low": 291.0,
        "K_high": 309.0,
        "B": 5.0,
        "B_low": -4.0,
        "B_high": 14.0,
        "theta_rms_deg": 3.0,
    }
    tables["impedance"] = pl.DataFrame([row], schema_overrides=TYPES)
    table, by = claimed(tables, B=1.0)
    slow, fast = by["inertia_at_lowest_frequency", None], by["inertia_at_highest_frequency", None]
    shares = [100 * 2 * np.pi * f * 0.005 / 0.452 for f in (1, 5)]
    assert [slow["value"], fast["value"]] == pytest.approx(shares)
    assert (slow["verdict"], fast["verdict"]) == ("holds", "fails")
    half = slow["value"] * 0.01 * 2**0.5 * stats.t.ppf(0.975, 4)
    assert slow["high"] - slow["value"] == pytest.approx(half)
    load = 0.0896 * 300 * np.deg2rad(3) / (P.n_T * 1.02)
    assert by["load_friction_at_highest_K_d", None]["value"] == pytest.approx(
        100 * load / (0.377 + load)
    )
    assert by["belt_at_highest_K_d", None]["value"] == pytest.approx(100 * 300 / 685.6)
    assert (by["K", "k"]["verdict"], by["B", "k"]["verdict"]) == ("equivalent", "undecided")
    assert [by[f"{x}_equivalent", None][k] for x in "KB" for k in ("value", "verdict")] == [
        1,
        "holds",
        0,
        "undecided",
    ]
    rubs = {
        "B": 9.0,
        "B_low": 8.9,
        "B_high": 9.1,
        "B_viscous": 5.1,
        "B_viscous_low": 5.0,
        "B_viscous_high": 5.2,
    }
    without = claimed({"impedance": tables["impedance"].with_columns(**rubs)}, B=1.0)[1]["B", "k"]
    assert (without["quantity"], without["value"], without["verdict"]) == (
        "B_viscous",
        5.1,
        "equivalent",
    )
    numbers = headline_numbers({"claims": table})
    assert {"inertia_at_lowest_frequency", "K_equivalent"} <= {one.name for one in numbers}
    assert r"\newcommand{\oslInertiaAtHighestFrequencyVerdict}{fails}% verdict" in to_tex(
        {}, numbers
    )
    scatterless = tables | {
        "transmission_summary": tables["transmission_summary"].with_columns(se=None)
    }
    assert claimed(scatterless)[1]["inertia_at_lowest_frequency", None]["verdict"] is None
    verdicts = [
        limit_verdict(*ends, 10, "above") for ends in ((11, 12), (8, 9), (9, 11), (None, 1))
    ]
    assert verdicts == ["holds", "fails", "undecided", None]


@pytest.mark.parametrize(("high", "verdict"), [(0.5, "undecided"), (-0.01, "fails")])
def test_a_joint_is_passive_where_the_real_part_of_its_impedance_is_for_certain_not_negative(
    high, verdict
):
    row = {
        **HERE,
        "trial": "k",
        "controller": "compensated",
        "frequency_hz": [1.0, 5.0],
        "damping": [0.5, -0.05],
    }
    row |= {"damping_low": [0.4, -0.1], "damping_high": [0.6, high]}
    _, by = claimed({"frequency_response": pl.DataFrame(row, schema_overrides={"side": pl.String})})
    least = by["passive_compensated", None]
    assert (least["value"], least["verdict"], least["n"]) == (-0.05, verdict, 2)


@pytest.mark.parametrize(
    ("commanded", "verdict"), [(None, "equivalent"), (300.0, "different"), (320.0, "undecided")]
)
def test_the_stiffness_while_walking_is_held_against_what_was_commanded(commanded, verdict):
    row = {
        "joint": "ankle",
        "side": "left",
        "group": "all",
        "quantity": "K",
        "estimator": "ensemble",
    }
    row |= {
        "commanded": commanded,
        "mean": 337.0,
        "low": 324.0,
        "high": 348.0,
        "n": 30,
        "interval_method": "bootstrap",
    }
    _, by = claimed(
        {"walking_summary": pl.DataFrame([row], schema_overrides={"commanded": pl.Float64})}
    )
    assert by["walking_K_equivalent", None]["verdict"] == verdict
    assert claimed({"walking_summary": pl.DataFrame([row])}, K_percent=None)[0].is_empty()
