"""The gain of the platform's plate, by body mass, other plates, standing and walking."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from walking_synthetic import settings, step

from osl_analysis.trial import Trial, plate_columns
from osl_analysis.walking.plate_gain import (
    KnownLoads,
    check_gain,
    stride_load,
    stride_load_beside,
    stride_time,
)
from osl_analysis.walking.stance import Stance

WEIGHT = 700.0  # [N]
SHARE = 0.47  # of a stride's impulse, under the foot on the platform
GAIN = 1.15  # of the platform's plate
EVERY = KnownLoads(
    weight=WEIGHT,
    standing=GAIN * WEIGHT,
    standing_beside=WEIGHT,
    stride=GAIN * SHARE * WEIGHT,
    stride_beside=(1 - SHARE) * WEIGHT,
)


def known(*names: str) -> KnownLoads:
    return replace(KnownLoads(), **{name: getattr(EVERY, name) for name in names})


@pytest.mark.parametrize(
    ("names", "error", "judged_by"),
    [
        (("weight", "standing"), 0.15, "the body mass of who stands on it"),
        (("standing", "stride", "stride_beside"), 0.13, "another plate, by strides"),
        (("standing_beside", "stride", "stride_beside"), 0.13, "another plate, by strides"),
        (("weight", "stride"), 2 * SHARE * GAIN - 1.06, "the body mass of who walks over it"),
        (("stride", "stride_beside"), 0.0, "another plate, by both feet"),
        (("weight", "standing_beside"), None, None),
    ],
)
def test_the_gain_is_told_by_what_is_known_beyond_what_gait_explains(
    names: tuple[str, ...], error: float | None, judged_by: str | None
) -> None:
    """One foot carries 47 %, so that its plate seems to read 11 % less than the other one."""
    found = check_gain(known(*names))

    assert found.load_error == (None if error is None else pytest.approx(error, abs=1e-9))
    assert found.load_judged_by == judged_by


def test_who_has_a_foot_on_the_floor_is_judged_by_strides() -> None:
    one_foot = replace(known("weight", "standing", "stride"), standing=0.5 * WEIGHT)

    assert check_gain(one_foot).load_judged_by == "the body mass of who walks over it"
    assert check_gain(one_foot).weight_change is None
    assert check_gain(replace(one_foot, stride=None)).load_error is None


@pytest.mark.parametrize("names", [("standing", "stride"), ("standing_beside", "stride_beside")])
def test_who_walks_with_a_fifth_more_is_not_who_stood_there(names: tuple[str, str]) -> None:
    standing, stride = names
    heavier = replace(EVERY, **{stride: 1.2 * getattr(EVERY, standing) / 2}, weight=None)
    other = {"standing", "standing_beside"} - {standing}
    heavier = replace(heavier, **dict.fromkeys(other))

    found = check_gain(heavier)

    assert found.weight_change == pytest.approx(0.2 - 0.06)
    assert found.load_judged_by == "another plate, by both feet"
    assert check_gain(EVERY).weight_change == 0.0


def test_a_plate_in_pounds_beside_one_in_newtons_is_named() -> None:
    in_pounds = replace(known("standing_beside", "stride", "stride_beside"), stride=74.0)

    found = check_gain(in_pounds)

    assert found.load_judged_by == "another plate, by strides (as of lbf in place of N)"
    assert found.load_error == pytest.approx(0.225 - 1 + 0.02, abs=0.01)


FRAMES = np.arange(0, 4, 0.005)
STANCE = Stance(1.5, 2.2)
# The foot's middle of swing lies at 1.2 and at 2.35 s
FOOT = np.stack([step(FRAMES, 1.0, 0.4)[0] + step(FRAMES, 2.15, 0.4)[0]] * 3, axis=1)


def test_a_stride_is_the_time_between_two_swings() -> None:
    assert stride_time(FRAMES, FOOT, STANCE) == pytest.approx(1.15, abs=1e-3)
    assert stride_time(FRAMES[200:], FOOT[200:], STANCE) is None  # begins in the swing
    hidden = np.where(((FRAMES > 1.1) & (FRAMES < 1.2))[:, None], np.nan, FOOT)
    assert stride_time(FRAMES, hidden, STANCE) is None


def test_the_load_beside_is_that_of_a_stance_half_a_stride_away() -> None:
    def steps(*starts: float) -> np.ndarray:
        return sum(500.0 * ((FRAMES >= start) & (FRAMES < start + 0.6)) for start in starts) + 3.0

    names = [plate_columns(plate, "force")[2] for plate in (1, 2, 3)]
    forces = [steps(1.5), steps(0.9), steps(2.6)]  # 3: the same foot, a stride later
    samples = pl.DataFrame({"time": FRAMES, **dict(zip(names, forces, strict=True))})
    trial = Trial("walk", samples, {"plates": [{"plate": plate} for plate in (1, 2, 3)]})

    assert stride_load_beside(trial, STANCE, 1.15, settings()) == pytest.approx(
        500 * 0.6 / 1.15, rel=0.02
    )
    assert stride_load(FRAMES, forces[0], STANCE, 1.15) == pytest.approx(
        (500 * 0.6 + 3 * 0.7) / 1.15, rel=0.02
    )
