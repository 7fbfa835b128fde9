"""What a run found, in ten lines: `report/brief.py`."""

import pytest

from osl_analysis.judge.known_findings import FINDINGS
from osl_analysis.judge.summary_findings import findings_in_summary
from osl_analysis.report.brief import WIDTH, brief_lines, finding_line, largest_size_text


def number(value, low, high, unit="%"):
    return {
        "value": value, "low": low, "high": high, "unit": unit, "interval": "lowest to highest",
        "n": 16, "sd": None,
    }  # fmt: skip


BRIEF = {known.title: known.brief for known in FINDINGS.values() if known.brief}


def finding(verdict="doubtful", cause="friction", trials=("a", "b"), **more):
    told = {"verdict": verdict, "of": "impedance trials", "cause": cause, "trials": list(trials)}
    return told | {"n": 3, "brief": BRIEF.get(cause, "")} | more


def line_of(told):
    """The line on a finding of a summary."""
    (read,) = findings_in_summary({"findings": [told]})
    return finding_line(read)


def summary(*findings, missing=()):
    counts = {"used": 3 - len(missing), "of": 3, "missing": dict.fromkeys(missing, "no theta")}
    numbers = {
        "K_bias_compensated": number(-0.88, -4.46, 1.31),
        "B_error_compensated": number(0.763, 0.0696, 1.32, "N*m*s/rad"),
    }
    return {"trials": {"impedance": counts}, "numbers": numbers, "findings": findings}


def test_trials_are_counted_once_by_their_worst_verdict():
    doubts = finding(trials=["a"])
    in_part = finding("doubtful in part", trials=["a", "b"])

    first = brief_lines(summary(doubts, in_part, missing=["c"]))[0]

    assert first == "3 trials: 0 clear, 1 doubtful, 1 doubtful in part, 1 refused or excluded"


def test_recordings_that_are_only_ingested_are_not_called_clear():
    ingested = {"used": 1, "of": 1, "missing": {}}
    of_both = {"impedance": {"used": 2, "of": 2, "missing": {}}, "ingest_only": ingested}

    alone = brief_lines(summary() | {"trials": {"ingest_only": ingested}, "numbers": {}})
    beside = brief_lines(summary() | {"trials": of_both})

    assert alone == ["1 trial: 1 ingested and not judged"]
    assert beside[0] == "3 trials: 2 clear, 1 ingested and not judged"


def test_a_refused_trial_that_is_flagged_counts_as_refused():
    flagged = finding("flagged", trials=["c"])
    first = brief_lines(summary(flagged, missing=["c"]))[0]
    assert first == "3 trials: 2 clear, 1 refused or excluded"


def test_a_campaign_of_actuators_alone_has_its_number():
    of_actuator = {"k_tau_n_m": number(0.82, 0.81, 0.83, "N*m/A")}
    line = brief_lines(summary() | {"numbers": of_actuator})[1]
    assert line.startswith("actuator: k_tau n_m = 0.820 N*m/A (0.810 to 0.830)")


def test_a_finding_on_groups_counts_no_trial():
    of_groups = finding(trials=["all"], table="walking_groups")
    assert brief_lines(summary(of_groups))[0] == "3 trials: 3 clear"


def test_errors_of_a_controller_have_their_intervals():
    line = brief_lines(summary())[1]
    assert line == (
        "compensated: K/K_d - 1 = -0.88 % (-4.5 to 1.3), |B - B_d| = 0.763 N*m*s/rad (0.07 to 1.32)"
        " by trial"
    )


def test_a_line_that_would_be_too_long_ends_with_its_last_interval():
    numbers = {
        "K_bias_uncompensated": number(-20.9, -25.8, -16.01),
        "B_error_uncompensated": number(1.04, 0.612, 1.47, "N*m*s/rad"),
    }
    (_, line) = brief_lines(summary() | {"numbers": numbers})
    assert line.endswith("= 1.04 N*m*s/rad (0.61 to 1.47)")


def test_a_bench_without_controllers_or_without_K_d_has_its_line():
    of_bench = {"K_bias_no_controller": number(-7.02, -7.04, -6.98)}
    of_spring = {"K_example": number(92.96, 92.83, 93.27, "N*m/rad")}
    assert brief_lines(summary() | {"numbers": of_bench})[1:] == [
        "bench: K/K_d - 1 = -7.02 % (-7.04 to -6.98) by trial"
    ]
    assert brief_lines(summary() | {"numbers": of_spring})[1:] == [
        "bench: K = 93.0 N*m/rad (92.8 to 93.3) by trial"
    ]


def test_a_finding_has_its_size_and_what_to_do():
    line = line_of(finding(B_size=1.676))
    assert line == (
        "⚠ friction: 2 of 3 impedance trials, B by up to 1.7 N*m*s/rad → report the viscous damping"
    )


def test_rows_that_are_doubtful_in_part_are_to_be_left_out():
    line = line_of(finding("doubtful in part", B_size=1.7))
    assert line.endswith(" → leave out rows marked doubtful")


def test_the_size_is_of_the_estimate_that_is_moved_most():
    sizes = {"K_size": 9.4, "K_without": 157.5, "B_size": 1.68, "B_without": 0.503}
    assert largest_size_text(sizes) == "B by up to 1.7 N*m*s/rad"
    assert largest_size_text({"K_size": 9.4}) == "K by up to 9.4 N*m/rad"
    assert largest_size_text({}) == ""


@pytest.mark.parametrize("cause", BRIEF)
def test_every_cause_fits_its_line_and_says_what_to_do(cause):
    trials = [str(k) for k in range(117)]
    line = line_of(finding(cause=cause, trials=trials, n=117, B_size=0.123))
    assert len(line) <= WIDTH
    assert line.endswith(f" → {BRIEF[cause]}")


def test_many_findings_end_in_a_count_and_all_lines_are_ten_at_most():
    many = [finding(cause=cause) for cause in list(BRIEF)[:20]]
    unchecked = [finding("not checked", cause=f"whether {what} is true") for what in "ab"]

    lines = brief_lines(summary(*many, *unchecked))

    assert len(lines) <= 9, "the page's line is the tenth"
    assert lines[-2] == "⚠ and 15 more, which the page lists"
    assert lines[-1] == "not checked: whether a is true; and 1 more on the page"
