"""Bias of K, B and I of walking, by what is not quiet in a laboratory, for `docs/study.md`.

Run from the repository: `python benchmarks/walking_bias.py [pairs]`, 5 by default, ten minutes on
one core. The crossings are those of `planted_gait.py`. Each campaign is walked twice, with scatter
of either sign: the mean of both has no error that is linear in the scatter, so that bias is left.
"""

import sys
from dataclasses import dataclass

import numpy as np
from causes import ROOT
from osl_analysis.walking.shared_motion import identify_platform
from planted_gait import Array, Campaign, Laboratory, Walkway

from osl_analysis.campaign.configuration import read_section
from osl_analysis.errors import OslAnalysisError
from osl_analysis.walking.crossing import Crossing, RefusedCrossing, analyse_crossing
from osl_analysis.walking.ensemble import ESTIMATED, GroupHeadline, group_headline
from osl_analysis.walking.groups import STATED
from osl_analysis.walking.plate_model import identify_plate_model
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.selection import selection_rows
from osl_analysis.walking.unperturbed_gait import unperturbed_gait
from osl_analysis.walking.walking_settings import WalkingAnalysis

BOOTSTRAP_SAMPLES = 300

MARKERS = {"marker_m": 0.3e-3}
PACE_AND_PLACE = {"stance": 0.03, "onset_scatter": 0.01, "place_m": 0.02, "yaw_deg": 3.0}
TORQUE = {"torque_nm": 3.0, "torque_share": 0.05}
ANGLE = {"angle_deg": 0.4}
ALL = (
    MARKERS | PACE_AND_PLACE | TORQUE | ANGLE | {"force_n": 1.0, "reaction": 0.15, "to_and_fro": 1}
)

# What each row changes in the quiet campaign
QUIET: dict[str, dict[str, float]] = {
    "nothing": {},
    "plate of 60 kg, ramp of 0.12 s, to and fro": {"plate_kg": 60, "ramp_s": 0.12, "to_and_fro": 1},
}
SCATTERED: dict[str, dict[str, float]] = {
    "markers 0.3 mm": MARKERS,
    "plate 3 N": {"force_n": 3.0},
    "stance 3 %, onset 1 %, place 20 mm, 3°": PACE_AND_PLACE,
    "torque 3 N·m and 5 %": TORQUE,
    "angle 0.4°": ANGLE,
    "angle 0.4°, turn of 2°": ANGLE | {"turn_deg": 2.0},
    "all": ALL,
    "all, up and down": ALL | {"both_directions": 1},
    "all, 80 crossings": ALL | {"perturbed": 40, "unperturbed": 40},
}


@dataclass(frozen=True)
class Errors:
    """Relative errors (3,) of K, B and I [%] of one campaign, and whether the intervals hold."""

    error: Array
    held: Array


def headline_of(campaign: Campaign, settings: WalkingAnalysis) -> GroupHeadline:
    """Analyse a campaign as the workflow does."""
    calibration = static_calibration(campaign.static, settings)
    plate = identify_plate_model([(trial, calibration) for trial in campaign.plates], settings)
    turned = [(trial, calibration) for trial, is_perturbed in campaign.crossings if is_perturbed]
    platform = identify_platform(turned, settings)

    analysed: list[Crossing] = []
    refused: list[RefusedCrossing] = []
    sheet = {}
    for trial, is_perturbed in campaign.crossings:
        sheet[trial.name] = {**dict.fromkeys(STATED), "perturbed": is_perturbed}
        try:
            crossing = analyse_crossing(trial, calibration, plate, is_perturbed, settings, platform)
        except OslAnalysisError as error:
            refused.append(RefusedCrossing(trial.name, is_perturbed, str(error)))
        else:
            analysed.append(crossing)

    rows = selection_rows(analysed, refused, settings, sheet)
    used = [crossing for crossing in analysed if rows[crossing.name]["reason"] is None]
    unperturbed = [crossing for crossing in used if crossing.onset is None]
    perturbed = [crossing for crossing in used if crossing.onset is not None]
    gait = unperturbed_gait(unperturbed, settings.fewest_unperturbed)
    return group_headline(perturbed, gait, settings)


def errors_of(walkway: Walkway, seed: int, mirrored: bool, settings: WalkingAnalysis) -> Errors:
    """Walk and analyse one campaign."""
    headline = headline_of(Laboratory(walkway, seed, mirrored).campaign(), settings)
    errors = []
    held = []
    for name in ESTIMATED:
        true = getattr(walkway, name)
        low, high = headline.resampled.interval(name)
        errors.append(100 * (headline.ensemble.fit[name] / true - 1))
        held.append(low <= true <= high)
    return Errors(np.array(errors), np.array(held, float))


def numbers(values: Array, decimals: int = 2) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def print_row(label: str, campaigns: list[Errors]) -> None:
    """Print the bias, and where crossings scatter its standard error, scatter and coverage."""
    errors = np.array([campaign.error for campaign in campaigns])
    of_pairs = (errors[0::2] + errors[1::2]) / 2
    bias = of_pairs.mean(axis=0)
    cells = [label, str(len(campaigns)), numbers(bias)]
    if len(of_pairs) > 1:
        of_one = np.sqrt(np.mean((errors - bias) ** 2, axis=0))
        held = np.mean([campaign.held for campaign in campaigns], axis=0)
        cells.append(numbers(of_pairs.std(axis=0, ddof=1) / np.sqrt(len(of_pairs))))
        cells += [numbers(of_one, 1), numbers(100 * held, 0)]
    print("|", " | ".join(cells), "|", flush=True)


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    shipped = read_section(ROOT / "config/config.yaml", "walking", WalkingAnalysis)
    settings = shipped.model_copy(update={"bootstrap_samples": BOOTSTRAP_SAMPLES})
    print("changed, campaigns, bias of K, B, I [%], its error, scatter of one [%], coverage [%]")
    for label, changes in {**QUIET, **SCATTERED}.items():
        walkway = Walkway(**changes)  # type: ignore[arg-type]
        campaigns = []
        for seed in range(pairs if label in SCATTERED else 1):
            for is_mirrored in (False, True):
                campaigns.append(errors_of(walkway, seed, is_mirrored, settings))
        print_row(label, campaigns)


if __name__ == "__main__":
    main()
