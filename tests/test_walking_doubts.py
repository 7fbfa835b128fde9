"""Whether the headline of a group can be believed: sound crossings pass, and each fault is named by its number."""

from dataclasses import replace

import numpy as np
import pytest
from test_walking_response import crossing
from walking_synthetic import settings

from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.events import Stance
from osl_analysis.walking.gait import UnperturbedGait, unperturbed_gait
from osl_analysis.walking.headline_doubts import Facts, group_facts, single_facts
from osl_analysis.walking.response import fit_response, isolate_response

SETTINGS = settings(bootstrap_samples=200, window_s=0.1)
ONSET = 0.6


def varied(one: Crossing, seed: int, pace: float = 0.72) -> Crossing:
    """A crossing with the plantarflexion after heel strike, which shows the pace, and with the slow wander of gait: 0.1
    deg and 0.3 N*m at 3 Hz, and white noise of 0.02 N*m."""
    random = np.random.default_rng(seed)
    sizes, phases = random.standard_normal(2), random.uniform(0, 2 * np.pi, 2)
    wave = np.sin(2 * np.pi * 3 * one.time + phases[:, None])
    heel_strike = -0.12 * np.exp(-((((one.time - 0.3) / pace - 0.09) / 0.06) ** 2))
    noise = 0.02 * random.standard_normal(one.time.size)
    return replace(
        one,
        theta=one.theta + heel_strike + np.deg2rad(0.1) * sizes[0] * wave[0],
        torque=one.torque + 0.3 * sizes[1] * wave[1] + noise,
    )


def gait(n: int = 8) -> UnperturbedGait:
    return unperturbed_gait([varied(crossing(f"u{k}"), 100 + k) for k in range(n)], 3)


def perturbed(n: int = 8, stiffnesses: tuple[float, ...] = (340.0,)) -> list[Crossing]:
    return [
        varied(crossing(f"p{k}", ONSET, impedance=(stiffnesses[k % len(stiffnesses)], 3.0, 0.02)), k) for k in range(n)
    ]


def facts(crossings: list[Crossing]) -> Facts:
    return group_facts(group_headline(crossings, gait(), SETTINGS))


def number(found: Facts, name: str) -> float:
    value = found[name]
    assert value is not None
    return value


def test_sound_crossings_are_far_from_every_limit() -> None:
    found = facts(perturbed())
    assert number(found, "coherence") > 0.95
    assert number(found, "VAF") > 99
    assert found["residual_over_gait"] is None
    assert abs(number(found, "offset_share")) < 0.1
    assert number(found, "outside_interval") == 0
    assert number(found, "estimator_difference") < 0.5
    assert number(found, "heterogeneity") < 3
    assert number(found, "K_se_share") < 0.1
    assert number(found, "B_high") > 2
    assert abs(number(found, "stance_change")) < 0.015
    assert found["uncorrected_stance_change"] is None


def test_turns_of_both_directions_that_nobody_told_apart_cancel() -> None:
    half = [replace(c, theta=2 * crossing("g").theta[: c.time.size] - c.theta) for c in perturbed()[::2]]
    assert number(facts([*half, *perturbed()[1::2]]), "coherence") < 0.3


def test_three_stiffnesses_in_one_group_are_seen() -> None:
    assert number(facts(perturbed(9, (200.0, 340.0, 480.0))), "heterogeneity") > 8


def test_a_clipped_torque_leaves_more_than_ordinary_gait_does() -> None:
    clipped = [replace(c, torque=np.minimum(c.torque, c.torque[at(c, ONSET + 0.02)] + 3)) for c in perturbed()]
    assert number(facts(clipped), "residual_over_gait") > 6


def test_a_stance_that_the_perturbation_shortens_is_seen_unless_phase_is_matched() -> None:
    short = [replace(c, stance=Stance(0.3, 0.3 + 0.92 * 0.72)) for c in perturbed()]
    found = facts(short)
    assert number(found, "uncorrected_stance_change") == pytest.approx(-0.08, abs=0.025)
    matched = settings(perturbed_stance="matched", bootstrap_samples=200)
    assert group_facts(group_headline(short, gait(), matched))["uncorrected_stance_change"] is None


def test_crossings_that_are_slower_throughout_do_not_count_as_changed() -> None:
    slow = [varied(crossing(f"p{k}", 0.3 + 0.3 * 1.08, stance=1.08 * 0.72), k, 1.08 * 0.72) for k in range(8)]
    assert facts(slow)["uncorrected_stance_change"] is None
    usual = settings(perturbed_stance="unperturbed", bootstrap_samples=200)
    found = group_facts(group_headline(slow, gait(), usual))
    assert number(found, "uncorrected_stance_change") == pytest.approx(1 / 1.08 - 1, abs=0.02)
    assert abs(number(found, "stance_change")) < 0.02


def test_a_single_fit_is_judged_by_what_ordinary_gait_leaves() -> None:
    usual, sound = gait(), isolate_response(perturbed(1)[0], gait(), SETTINGS.timing)
    found = single_facts(sound, fit_response(sound))
    assert abs(number(found, "stance_change")) < 0.03
    assert set(found.values()) == {None, found["stance_change"]}
    one = perturbed(1)[0]
    late: Array = np.where(one.time > ONSET + 0.05, one.torque - 20.0, one.torque)
    spoilt = isolate_response(replace(one, torque=late), usual, SETTINGS.timing)
    assert number(single_facts(spoilt, fit_response(spoilt)), "residual_over_gait") > 6
    hurried = isolate_response(replace(one, stance=Stance(0.3, 0.3 + 0.92 * 0.72)), usual, SETTINGS.timing)
    assert number(single_facts(hurried, fit_response(hurried)), "stance_change") == pytest.approx(-0.08, abs=0.03)


def at(one: Crossing, time: float) -> int:
    return int(np.argmin(np.abs(one.time - time)))
