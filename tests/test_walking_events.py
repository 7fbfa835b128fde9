"""Stance and onset: found to a fraction of a frame, and checked against what the sheet says."""

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.walking.events import Stance, check_onset, find_onset, find_stances, only_stance
from osl_analysis.walking.settings import Timing

TIME = np.arange(900) / 300
DEG = np.pi / 180
TIMING = Timing(window=0.1, baseline=0.06, guard=0.04)


def trapezoid(start: float, end: float, slope: float = 8000.0, top: float = 800.0) -> np.ndarray:
    """A vertical force [N] that rises and falls by `slope` [N/s] from and to zero at `start` and `end` [s]."""
    return np.clip(np.minimum(TIME - start, end - TIME) * slope, 0, top)


def test_heel_strike_and_toe_off_between_frames() -> None:
    """A rise of 8 N/ms passes 40 N 5 ms after contact, the fall passes 20 N 2.5 ms before it ends."""
    (stance,) = find_stances(TIME, trapezoid(0.9012, 1.6187), 40, 20, 0.3)
    assert stance.heel_strike == pytest.approx(0.9012 + 0.005, abs=1e-9)
    assert stance.toe_off == pytest.approx(1.6187 - 0.0025, abs=1e-9)
    assert stance.duration == pytest.approx(0.71, abs=1e-9)


def test_hysteresis_keeps_a_dip_and_drops_a_bump() -> None:
    force = trapezoid(0.9, 1.6)
    force[330] = 30.0  # below on, above off: the foot stays
    force[600:610] = 35.0  # above off, below on: nobody steps there
    assert len(find_stances(TIME, force, 40, 20, 0.3)) == 1


def test_short_contacts_are_not_stances() -> None:
    force = trapezoid(0.9, 1.6) + trapezoid(2.2, 2.3)
    assert len(find_stances(TIME, force, 40, 20, 0.3)) == 1
    assert len(find_stances(TIME, force, 40, 20, 0.05)) == 2


def test_nan_leaves_the_foot_where_it_was() -> None:
    force = trapezoid(0.9, 1.6)
    force[300:330] = np.nan
    force[600:620] = np.nan
    (stance,) = find_stances(TIME, force, 40, 20, 0.3)
    assert stance.duration == pytest.approx(0.6925, abs=1e-6)


def test_a_stance_that_the_record_cuts_does_not_count() -> None:
    early, late = trapezoid(-1.0, 0.6), trapezoid(2.5, 4.0)
    assert find_stances(TIME, early, 40, 20, 0.3) == find_stances(TIME, late, 40, 20, 0.3) == []
    assert len(find_stances(TIME, early + trapezoid(1.0, 1.7) + late, 40, 20, 0.3)) == 1
    assert find_stances(TIME, 0 * TIME, 40, 20, 0.3) == []


def test_several_or_no_stances_are_refused() -> None:
    with pytest.raises(InputError, match="found none"):
        only_stance([])
    with pytest.raises(InputError, match=r"found 0\.100-0\.800 s, 1\.500-2\.000 s"):
        only_stance([Stance(0.1, 0.8), Stance(1.5, 2.0)])


@pytest.mark.parametrize("onset", [1.2, 1.2011, 1.2033])
@pytest.mark.parametrize("noise", [0.0, 0.015])
def test_the_onset_of_a_straight_ramp_is_found_within_a_millisecond(onset: float, noise: float) -> None:
    ramp = 5 * np.clip((TIME - onset) / 0.075, 0, 1) + 0.3
    ramp = ramp + noise * np.random.default_rng(3).standard_normal(len(TIME))
    assert find_onset(TIME, ramp * DEG, 1 * DEG) == pytest.approx(onset, abs=1e-3 if noise else 3e-4)


def test_a_soft_start_is_found_within_a_thirtieth_of_the_ramp() -> None:
    """x^4 (35 - 84 x + 70 x^2 - 20 x^3): a line through its steep part would start 0.27 of the ramp late."""
    x = np.clip((TIME - 1.2) / 0.075, 0, 1)
    ramp = 5 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    assert find_onset(TIME, ramp * DEG, 1 * DEG) == pytest.approx(1.2, abs=0.075 / 30)


def test_noise_of_the_markers_moves_the_onset_of_a_soft_start_by_an_eighth_of_the_ramp_at_most() -> None:
    """0.04 deg is 0.2 mm at 0.28 m from the axis. RMS over 40 draws: a fit up to 5 times the noise instead of 25 sees
    so little of the start that its power is not determined, and errs by a sixth."""
    x = np.clip((TIME - 1.2) / 0.075, 0, 1)
    ramp = 5 * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    draws = [0.04 * np.random.default_rng(seed).standard_normal(len(TIME)) for seed in range(40)]
    onsets = np.array([find_onset(TIME, (ramp + noise) * DEG, DEG) for noise in draws], dtype=float)
    assert np.sqrt(np.mean((onsets - 1.2) ** 2)) < 0.075 / 8


def test_onset_shifts_with_time_and_does_not_depend_on_the_size_of_the_turn() -> None:
    x = np.clip((TIME - 1.2) / 0.075, 0, 1)
    soft = 5 * DEG * x**3 * (10 - 15 * x + 6 * x**2)
    onset = find_onset(TIME, soft, DEG)
    assert onset is not None
    assert find_onset(TIME + 7.5, soft, DEG) == pytest.approx(onset + 7.5, abs=1e-9)
    assert find_onset(TIME, 1.7 * soft, 1.7 * DEG) == pytest.approx(onset, abs=1e-9)


def test_hidden_frames_do_not_move_the_onset() -> None:
    ramp = 5 * DEG * np.clip((TIME - 1.2) / 0.075, 0, 1)
    gappy = ramp.copy()
    gappy[350:356] = np.nan
    assert find_onset(TIME, gappy, DEG) == pytest.approx(1.2, abs=5e-4)


def test_a_platform_that_rests_has_no_onset() -> None:
    assert find_onset(TIME, 0.02 * DEG * np.sin(9 * TIME), DEG) is None


def test_a_turn_at_the_start_of_the_record_is_refused() -> None:
    with pytest.raises(InputError, match="start to record earlier"):
        find_onset(TIME, 5 * DEG * np.clip((TIME - 0.02) / 0.075, 0, 1), DEG)


@pytest.mark.parametrize(
    ("onset", "perturbed", "message"),
    [
        pytest.param(None, True, "does not turn but the sheet says perturbed = true", id="sheet says perturbed"),
        pytest.param(1.2, False, r"turns at 1\.200 s but the sheet says perturbed = false", id="sheet says not"),
        pytest.param(1.7, True, "outside stance", id="after toe-off"),
        pytest.param(0.85, True, "outside stance", id="before heel strike"),
        pytest.param(1.55, True, r"leave stance 0\.900-1\.600 s", id="window leaves stance"),
        pytest.param(0.98, True, r"leave stance 0\.900-1\.600 s", id="baseline leaves stance"),
    ],
)
def test_an_onset_that_cannot_be_is_refused(onset: float | None, perturbed: bool, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_onset(onset, Stance(0.9, 1.6), perturbed, TIMING)


def test_an_onset_that_agrees_with_the_sheet_passes() -> None:
    check_onset(1.2, Stance(0.9, 1.6), True, TIMING)
    check_onset(None, Stance(0.9, 1.6), False, TIMING)
