"""Exchanged labels and platforms that shift are named; the cause of too few crossings is in the error."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_walking_platform import CALIBRATION, RIG
from walking_platform import Ramp, standing, walked
from walking_synthetic import settings

from osl_analysis.columns import marker_columns
from osl_analysis.commands.walking import average_unperturbed
from osl_analysis.commands.walking_files import write_refusal
from osl_analysis.errors import InputError
from osl_analysis.table import write_table
from osl_analysis.trial import Trial
from osl_analysis.walking.bodies import static_calibration
from osl_analysis.walking.checks import exchanged_labels
from osl_analysis.walking.crossing import RefusedCrossing, analyse_crossing
from osl_analysis.walking.gait import most_frequent
from osl_analysis.walking.plate_model import NO_CORRECTION, identify_plate_model

WALK = walked("walk_1", None, RIG, 1)


def relabelled(trial: Trial, *pairs: tuple[str, str]) -> Trial:
    """The trial with the labels of each pair exchanged."""
    other = dict(pairs) | {b: a for a, b in pairs}
    names = {c: n for a, b in other.items() for c, n in zip(marker_columns(a), marker_columns(b), strict=True)}
    return Trial(trial.name, trial.samples.rename(names), trial.provenance)


FOOT_AND_SHANK = [(f"FOOT{k}", f"SHANK{k}") for k in range(1, 5)]


@pytest.mark.parametrize(
    ("pairs", "named"),
    [
        ([("FOOT1", "FOOT3")], "the labels FOOT1 and FOOT3"),
        ([("SHANK2", "SHANK4")], "the labels SHANK2 and SHANK4"),
        ([("FOOT4", "SHANK1")], "the labels FOOT4 and SHANK1"),
        ([("PLAT1", "PLAT3")], "the labels PLAT1 and PLAT3"),
        (FOOT_AND_SHANK, "the labels of foot and shank"),
    ],
)
def test_exchanged_labels_are_named_in_the_refusal(pairs: list[tuple[str, str]], named: str) -> None:
    with pytest.raises(InputError, match=f"trial walk_1: .*; {named} look exchanged in 900 frames: markers lie"):
        analyse_crossing(relabelled(WALK, *pairs), CALIBRATION, NO_CORRECTION, False, settings())


def test_exchanged_labels_of_the_platform_are_named_in_a_plate_trial_too() -> None:
    unloaded = relabelled(walked("plate_1", Ramp(), RIG, 1, loaded=False), ("PLAT2", "PLAT3"))
    with pytest.raises(InputError, match=r"seen together in 0 frames.*; the labels PLAT2 and PLAT3 look exchanged"):
        identify_plate_model([unloaded], CALIBRATION, settings())


def test_labels_exchanged_in_the_static_trial_are_found_in_the_crossing() -> None:
    static = static_calibration(relabelled(standing(), ("FOOT1", "FOOT2")), settings())
    with pytest.raises(InputError, match=r"FOOT1 and FOOT2 look exchanged .* or of its static trial"):
        analyse_crossing(WALK, static, NO_CORRECTION, False, settings())


def test_sound_labels_and_those_that_no_exchange_explains_say_nothing() -> None:
    assert exchanged_labels(WALK, CALIBRATION, settings()) == ""
    lost = WALK.samples.with_columns(marker_FOOT2_z=pl.col("marker_FOOT2_z") + 0.1)
    with pytest.raises(InputError, match=r"the foot markers cannot be followed [^;]*; [^;]*$"):
        analyse_crossing(Trial("w", lost, WALK.provenance), CALIBRATION, NO_CORRECTION, False, settings())


def test_clusters_exchanged_everywhere_are_seen_by_their_heights_in_the_static_trial() -> None:
    with pytest.raises(InputError, match=r"the foot markers FOOT1, .* stand 24 cm above the shank markers SHANK1"):
        static_calibration(relabelled(standing(), *FOOT_AND_SHANK), settings())


def shifted(trial: Trial, size: float) -> Trial:
    """The platform, and what stands on it, moved forward by `size` [m] within 0.1 s in mid-stance."""
    step = size * np.clip((trial.samples["time"].to_numpy() - 1.2) / 0.1, 0, 1)
    moved = [c for c in trial.samples.columns if c.startswith("marker_") and c.endswith("_x")]
    return Trial(trial.name, trial.samples.with_columns(pl.col(c) + pl.Series(step) for c in moved), trial.provenance)


@pytest.mark.parametrize("claimed", [False, True])
def test_a_translation_is_no_unperturbed_crossing_and_is_not_analysed_as_a_perturbed_one(claimed: bool) -> None:
    with pytest.raises(InputError, match=r"the platform shifts by (50|51) mm in stance without a turn, expected 10 mm"):
        analyse_crossing(shifted(WALK, 0.05), CALIBRATION, NO_CORRECTION, claimed, settings())


def test_a_platform_that_yields_under_the_person_and_one_that_turns_and_heaves_are_analysed() -> None:
    assert analyse_crossing(shifted(WALK, 0.005), CALIBRATION, NO_CORRECTION, False, settings()).onset is None
    light = replace(RIG, mass=1e-9)
    crossing = analyse_crossing(
        walked("w", Ramp(heave=0.015), light, 1), CALIBRATION, NO_CORRECTION, True, settings(largest_shift_mm=5)
    )
    assert crossing.onset is not None


def test_too_few_unperturbed_crossings_say_how_many_and_why(tmp_path: Path) -> None:
    why = "the shank moves {} cm backwards over the foot in stance: correct `side`"
    reasons = {f"u{k}": f"trial u{k}: {why.format(20 + k)}" for k in range(5)} | {"u5": "trial u5: hidden"}
    for name, reason in reasons.items():
        write_refusal(RefusedCrossing(name, False, reason), tmp_path / f"{name}.parquet")
    rows = [{"trial": n, "perturbed": False, "reason": r, "gait": "all", "group": None} for n, r in reasons.items()]
    rows.append({"trial": "p1", "perturbed": True, "reason": "another", "gait": "all", "group": None})
    write_table(pl.DataFrame(rows).with_columns(direction=None), tmp_path / "selection.csv")
    files = [tmp_path / f"{name}.parquet" for name in reasons]
    with pytest.raises(InputError) as caught:
        average_unperturbed(files, tmp_path / "selection.csv", settings(), tmp_path / "gait.parquet")
    assert str(caught.value) == (
        "0 of 6 unperturbed crossings can be used, expected 3 or more; 5 times (u0, u1, u2, u3, u4) "
        "beside 1 for other reasons, which walking_crossings.csv lists, as in u0: " + why.format(20)
    )


def test_reasons_that_differ_in_numbers_alone_are_one() -> None:
    reasons = {"a": "trial a: at 1.2 s", "b": "trial b: at 3 s", "c": "hidden"}
    assert (
        most_frequent(reasons)
        == "2 times (a, b) beside 1 for other reasons, which walking_crossings.csv lists, as in a: at 1.2 s"
    )
