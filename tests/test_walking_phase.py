"""Time becomes phase by the duration of stance that the gait before the onset leads to expect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_walking_response import TIMING, B, K, crossing
from walking_synthetic import SETTINGS

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import bootstrap, ensemble_response
from osl_analysis.walking.events import Stance
from osl_analysis.walking.gait import PHASES, UnperturbedGait, matched_scales, steadiest_scales, unperturbed_gait
from osl_analysis.walking.response import fit_response, isolate_response
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.yaml_settings import validated

EARLY = PHASES[PHASES <= 0.36]


def angle(phase: Array) -> Array:
    """Ankle angle [rad]: plantarflexion after heel strike, then slow dorsiflexion."""
    return 0.2 * np.sin(2.4 * phase) - 0.12 * np.exp(-(((phase - 0.09) / 0.06) ** 2))


def walked(name: str, scale: float = 1.0, slow: float = 0.0, onset: float | None = None) -> Crossing:
    """A crossing with that angle at a pace, and with slow deviations of angle and torque that its name determines.

    Deviations of the angle are of `slow` [rad] and below 4 Hz. Those of the torque are 300 N*m/rad of them.
    """
    random = np.random.default_rng(sum(map(ord, name)))
    plain = crossing(name, onset=onset, stance=0.72 * scale)
    waves = random.uniform(0.3, 4.0, 4)[:, None] * plain.time + random.random((4, 1))
    deviation = slow * random.standard_normal(4) @ np.sin(2 * np.pi * waves) / np.sqrt(2)
    phase = (plain.time - 0.3) / (0.72 * scale)
    turn = plain.theta - crossing(name, stance=0.72 * scale).theta
    return replace(plain, theta=angle(phase) + turn + deviation, torque=plain.torque + 300 * deviation)


def usual(slow: float = 0.0, n: int = 10) -> UnperturbedGait:
    return unperturbed_gait([walked(f"u{k}", 1 + 0.02 * np.sin(k), slow) for k in range(n)], 3)


def test_the_unperturbed_stance_stands_in_for_one_that_the_perturbation_lengthens() -> None:
    """Same crossing, but toe-off came 8 % late: its own duration puts it at the wrong phase of gait."""
    late = replace(crossing("p", onset=0.6), stance=Stance(0.3, 0.3 + 1.08 * 0.72))
    gaits = unperturbed_gait([crossing(f"u{k}") for k in range(3)], 3)
    own = fit_response(isolate_response(late, gaits, TIMING, "own"))
    mean = fit_response(isolate_response(late, gaits, TIMING, "unperturbed"))
    assert mean.K == pytest.approx(K, rel=1e-3)
    assert abs(own.K / K - 1) > 0.02


@pytest.mark.parametrize("slower", [0.85, 0.92, 1.0, 1.08, 1.15])
@pytest.mark.parametrize("lingers", [0.92, 1.0, 1.08])
def test_the_matched_stance_is_right_for_any_pace_and_any_end_of_stance(slower: float, lingers: float) -> None:
    """The crossing is slower throughout, its toe-off comes late, or both."""
    late = walked("p", slower, onset=0.3 + 0.42 * 0.72 * slower)
    late = replace(late, stance=Stance(0.3, 0.3 + lingers * 0.72 * slower))
    response = isolate_response(late, usual(), TIMING, "matched")
    assert response.stance == pytest.approx(0.72 * slower, rel=1e-4)
    assert response.stance_change == pytest.approx(lingers - 1, abs=1e-3)
    fit = fit_response(response)
    assert (fit.K, fit.B) == pytest.approx((K, B), rel=2e-3)


@pytest.mark.parametrize(("slower", "lingers"), [(1.0, 0.92), (1.08, 1.0)])
def test_matching_adds_little_scatter_and_no_bias_to_gait_that_varies(slower: float, lingers: float) -> None:
    """Deviations of 0.5 deg. Even a perfect stance leaves K a scatter of 3 %, and the wrong stance costs 10 % or more:
    `own` where the person hurries, `unperturbed` where the crossings are slower."""
    gait = usual(np.deg2rad(0.5))
    paces = [slower * (1 + 0.02 * np.cos(k)) for k in range(10)]
    crossings = [walked(f"p{k}", r, np.deg2rad(0.5), onset=0.3 + 0.42 * 0.72 * r) for k, r in enumerate(paces)]
    late = [replace(c, stance=Stance(0.3, 0.3 + lingers * 0.72 * r)) for c, r in zip(crossings, paces, strict=True)]
    perfect = [isolate_response(c, gait, TIMING, "own") for c in crossings]
    matched = [isolate_response(c, gait, TIMING, "matched") for c in late]
    wrong = [isolate_response(c, gait, TIMING, "own" if lingers != 1 else "unperturbed") for c in late]
    best, found, spoilt = (ensemble_response(r).fit.K for r in (perfect, matched, wrong))
    assert found == pytest.approx(best, rel=0.015)
    assert abs(spoilt / best - 1) > 0.05
    assert np.mean([r.stance_change for r in matched]) == pytest.approx(lingers - 1, abs=0.004)


def test_the_bootstrap_carries_the_error_of_the_pace() -> None:
    """The window of hurried crossings is known less well than that of usual ones whose stance needs no matching."""
    gait = usual(np.deg2rad(0.5))
    crossings = [walked(f"p{k}", 1.0, np.deg2rad(0.5), onset=0.6) for k in range(10)]
    own, matched = (
        bootstrap([isolate_response(c, gait, TIMING, source) for c in crossings], 300) for source in ("own", "matched")
    )
    assert matched.se("K") > own.se("K")


def test_an_unperturbed_crossing_whose_toe_off_came_late_is_matched_too() -> None:
    crossings = [walked(f"u{k}") for k in range(5)]
    late = replace(crossings[0], stance=Stance(0.3, 0.3 + 1.06 * 0.72))
    gait, one = unperturbed_gait([*crossings[1:], late], 3), walked("p", onset=0.6)
    errors = {s: abs(fit_response(isolate_response(one, gait, TIMING, s)).K / K - 1) for s in ("own", "matched")}
    assert errors["own"] > 0.01
    assert errors["matched"] < 0.3 * errors["own"]
    spread = {s: np.std(isolate_response(one, gait, TIMING, s).torques, axis=0).max() for s in ("own", "matched")}
    assert spread["matched"] < 0.3 * spread["own"]


@pytest.mark.parametrize("order", [1, 3, 5])
@pytest.mark.parametrize("scale", [0.8, 0.97, 1.0, 1.21])
def test_the_scale_is_found_beside_another_size_and_a_drift_up_to_its_order(scale: float, order: int) -> None:
    there, x = angle(scale * EARLY), EARLY / EARLY[-1]
    drifts = [0.01 * x**k for k in range(order + 1)]
    curves = np.array([size * there + drift for size in (1.0, 1.1, 0.8) for drift in drifts])
    assert matched_scales(EARLY, curves, angle(PHASES), [order])[0] == pytest.approx([scale] * len(curves), abs=2e-4)


def test_a_drift_beyond_the_order_spoils_the_scale_and_the_steadiest_order_allows_for_it() -> None:
    """Crossings of one pace whose angles differ by cubic drifts."""
    random = np.random.default_rng(3)
    x = PHASES[: len(EARLY)] / EARLY[-1]
    curves = np.tile(angle(PHASES), (9, 1))
    curves[:, : len(x)] += 0.01 * random.standard_normal((9, 4)) @ np.vander(x, 4).T
    straight = matched_scales(EARLY, curves[:, : len(x)], curves.mean(axis=0), [1])
    one, others = steadiest_scales(EARLY, curves[0, : len(x)], curves[1:])
    assert np.std(straight) > 0.005
    assert np.std(others) < 1e-3
    assert one == pytest.approx(1, abs=1e-3)


def test_a_pace_far_from_the_mean_has_no_scale_and_is_refused() -> None:
    assert np.isnan(matched_scales(EARLY, angle(1.6 * EARLY)[None], angle(PHASES))).all()
    gait, far = usual(), walked("p", onset=0.6)
    far = replace(far, stance=Stance(0.3, 0.3 + 0.45))
    assert np.isnan(isolate_response(far, gait, TIMING, "own").stance_change)
    with pytest.raises(InputError, match=r"trial p: its ankle angle before the onset .* at no pace .* own"):
        isolate_response(far, gait, TIMING, "matched")


def test_an_angle_that_stands_still_or_drifts_tells_no_pace() -> None:
    for mean in (0 * PHASES, 0 * PHASES + 0.2, 0.3 - 0.1 * PHASES):
        assert np.isnan(matched_scales(EARLY, np.array([mean[: len(EARLY)]] * 3), mean)).all()


def test_an_onset_at_heel_strike_tells_no_pace() -> None:
    gait = usual()
    early = replace(walked("p", onset=0.6), onset=0.33)
    with pytest.raises(InputError, match="at no pace"):
        isolate_response(early, gait, TIMING, "matched")


def test_the_old_word_for_the_unperturbed_stance_is_refused_with_the_new_one() -> None:
    with pytest.raises(
        InputError, match=r"perturbed_stance: 'normal' is not allowed: .*'own', 'unperturbed' or 'matched'"
    ):
        validated(SETTINGS | {"perturbed_stance": "normal"}, WalkingAnalysis, Path("config.yaml"))
