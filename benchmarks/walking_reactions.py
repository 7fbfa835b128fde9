"""How often each finder of a walking headline accuses a sound campaign, and how often it names what
was planted.

Run from the repository: `python benchmarks/walking_reactions.py [campaigns]` prints the table of
`docs/walking.md`. A campaign is ten perturbed and ten unperturbed crossings of `gait_of_phase.py`;
a hundred of each row take ten minutes.
"""

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import polars as pl
from gait_of_phase import ONSET, STANCE, crossing, ramp, smooth

from osl_analysis.campaign.configuration import read_config
from osl_analysis.judge.finding import Grade, Limits
from osl_analysis.judge.judging import judged
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.group_checks import check_group
from osl_analysis.walking.unperturbed_gait import unperturbed_gait

CONFIG = read_config(Path(__file__).parents[1] / "config/config.yaml")
PLANTED = {
    "nothing": lambda since: 0 * since,
    "a reflex of 4 N*m*s/rad after 45 ms": lambda since: 4.0 * ramp(since - 0.045).omega,
    "stiffness × 1.4 from 50 ms": lambda since: (
        136.0 * ramp(since).theta * smooth((since - 0.05) / 0.03)
    ),
    "6 N*m from 50 ms": lambda since: 6.0 * smooth((since - 0.05) / 0.05),
    "K that rises by 1500 over stance": lambda since: 1500.0 / STANCE * since * ramp(since).theta,
}
"""What is added to the torque [N*m], at times [s] from the onset."""


def causes_of(number: int, planted: str) -> set[str]:
    """The causes for which the headline of a campaign is doubted."""
    settings, crossings = CONFIG.walking, list[Crossing]()
    for k in range(20):
        one = crossing((number, k), settings.low_pass, perturbed=k < 10)
        if one.onset is not None:
            more = settings.low_pass(PLANTED[planted](one.time - one.onset), 300.0)
            one = replace(one, torque=one.torque + more, turn=0.083)
        crossings.append(one)
    headline = group_headline(crossings[:10], unperturbed_gait(crossings[10:], 3), settings)
    facts = {**check_group(headline).columns(), "group": "all", "onset_phase": ONSET}
    limits = CONFIG.doubtful.walking_groups
    known = {
        way: {k: v for k, v in getattr(limits, way).items() if k in facts}
        for way in ("above", "below")
    }
    (found,) = judged(
        pl.DataFrame([facts], infer_schema_length=None), Limits(**known), "walking_groups"
    )
    return {one.cause for one in found if one.grade is Grade.DOUBTS}


if __name__ == "__main__":
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for planted in PLANTED:
        count = Counter(
            cause for number in range(campaigns) for cause in causes_of(number, planted)
        )
        print(
            f"| {planted} |"
            f" {', '.join(f'{cause} {n}' for cause, n in count.most_common()) or '–'} |"
        )
