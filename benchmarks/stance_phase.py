"""Which duration of stance turns time into phase: bias and scatter of K, B and I by rule, on two
kinds of gait.

Run from the repository: `python benchmarks/stance_phase.py [campaigns] [gait]` prints the tables of
`docs/walking.md`; the gait is `simulator` or `formula`, without one both. Forty campaigns of ten
perturbed and ten unperturbed crossings take ten minutes. The same seeds give the same.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from gait_of_phase import TRUTH, Change, crossing
from impedance_over_stance import laboratory
from study import StudyLaboratory

from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.crossing import SimulatedCrossing, simulate_crossing
from osl_analysis.simulator.step import RENDERED_S, GaitTrial, Step, draw_step, smooth_step
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import Ensemble
from osl_analysis.walking.isolated_response import PerturbationResponse, isolate_response
from osl_analysis.walking.settings import TimingSettings
from osl_analysis.walking.stance import Stance
from osl_analysis.walking.unperturbed_gait import (
    BEFORE_ONSET_S,
    PHASES,
    UnperturbedGait,
    matched_scales,
    signal_at,
    stance_times,
    unperturbed_gait,
)

CROSSINGS, RESAMPLES = 10, 300
CHANGES = {
    "as usual": Change(),
    "stance 8 % shorter after the window": Change(after_window=0.92),
    "stance 8 % longer after the window": Change(after_window=1.08),
    "8 % slower throughout": Change(slower=1.08),
    "8 % faster throughout": Change(slower=0.92),
}
USUAL, SHORTER, _, SLOWER, _ = CHANGES
HALF = "every second stance 8 % shorter"
SETTINGS = ("own", "matched")
"""Rules whose intervals are computed."""
SHOWN = (1, 2, 3, 4, 5, 6)
"""Orders of the drift in the table of clocks."""
RULES = ("own", "unperturbed", "group", "matched")
QUANTITIES = ("K", "B", "I")


@dataclass(frozen=True)
class Perturbed:
    """Perturbed crossings of one campaign, and the mean truth (3,) of K, B, I."""

    crossings: Sequence[Crossing]
    truth: Array


@dataclass(frozen=True)
class Campaign:
    """The unperturbed gait of one campaign, and its perturbed crossings by what they do."""

    gait: UnperturbedGait
    perturbed: Mapping[str, Perturbed]


@dataclass(frozen=True)
class HurriedStep(Step):
    """A step whose stance is longer by what follows the window [s]."""

    hurry: float = 0.0

    @property
    def toe_off(self) -> float:
        return super().toe_off + self.hurry

    def stance_phase(self, time: Array) -> Array:
        elapsed, begins = time - self.heel_strike, self.onset + RENDERED_S - self.heel_strike
        later = smooth_step((elapsed - begins) / (self.stance + self.hurry - begins))
        return (elapsed - self.hurry * later) / self.stance


@dataclass(frozen=True)
class Hurrying(StudyLaboratory):
    """A laboratory whose perturbed crossings are longer by a share of the stance after the
    window."""

    hurry: float = 0.0

    def walk(self, name: str, perturbed: bool) -> SimulatedCrossing:
        step = draw_step(GaitTrial(name, self.settings.seed, self.gait))
        hurried = HurriedStep(**vars(step), hurry=self.hurry * step.stance if perturbed else 0.0)
        effects = drivetrain_effects(self.settings) | {"cancels_friction": True}
        return simulate_crossing(hurried, perturbed, effects, self.p)


def simulated(number: int, shipped: StudyLaboratory) -> Campaign:
    """A campaign of the simulator's gait. What is random is the same whatever the perturbed
    crossings do."""
    names = [f"phase_{number:04d}_{k}" for k in range(CROSSINGS)]
    perturbed, truths = {}, {}
    for label, change in CHANGES.items():
        usual = shipped.gait.gait
        slower = usual.model_copy(update={"stance_s": usual.stance_s * change.slower})
        gait = shipped.gait.model_copy(update={"gait": slower})
        own = Hurrying(
            shipped.settings, gait, shipped.p, shipped.analysis, hurry=change.after_window - 1
        )
        walked = [own.perturbed(f"{name}_p") for name in names]
        truths[label] = np.array([[exact[q] for q in QUANTITIES] for _, exact, _ in walked])
        perturbed[label] = [seen for seen, _, _ in walked]
    return with_half(
        unperturbed_gait([shipped.unperturbed(f"{name}_u") for name in names], 3), perturbed, truths
    )


def formula(number: int, shipped: StudyLaboratory) -> Campaign:
    """A campaign of the gait of `gait_of_phase.py`."""
    low_pass, many = shipped.analysis.low_pass, range(CROSSINGS)
    perturbed = {
        label: [crossing((number, 1, k), low_pass, True, c) for k in many]
        for label, c in CHANGES.items()
    }
    gait = unperturbed_gait([crossing((number, 0, k), low_pass, False) for k in many], 3)
    truth = np.tile([TRUTH[q] for q in QUANTITIES], (CROSSINGS, 1))
    return with_half(gait, perturbed, dict.fromkeys(CHANGES, truth))


def with_half(
    gait: UnperturbedGait, perturbed: Mapping[str, Sequence[Crossing]], truths: Mapping[str, Array]
) -> Campaign:
    """The campaign, with half of the crossings hurried as one more case."""
    mixed = [perturbed[SHORTER if k % 2 else USUAL][k] for k in range(CROSSINGS)]
    cases = {
        label: Perturbed(crossings, truths[label].mean(axis=0))
        for label, crossings in perturbed.items()
    }
    return Campaign(gait, cases | {HALF: Perturbed(mixed, truths[USUAL].mean(axis=0))})


def isolated(
    rule: str, crossings: Sequence[Crossing], gait: UnperturbedGait, timing: TimingSettings
) -> list[PerturbationResponse]:
    """Responses by a rule. `group`: own stances, all corrected by their mean change against the
    matched ones."""
    if rule != "group":
        return [isolate_response(c, gait, timing, rule) for c in crossings]  # type: ignore[arg-type]
    own = [isolate_response(c, gait, timing, "own") for c in crossings]
    change = float(np.mean([r.stance_change for r in own]))
    corrected = [
        replace(
            c,
            stance=Stance(
                c.stance.heel_strike, c.stance.heel_strike + c.stance.duration / (1 + change)
            ),
        )
        for c in crossings
    ]
    return [isolate_response(c, gait, timing, "own") for c in corrected]


def rule_table(campaigns: Sequence[Campaign], timing: TimingSettings) -> None:
    """Print bias ± scatter over campaigns by case and rule, and the coverage of the bootstrap's
    intervals."""
    print(
        "| perturbed crossings | rule | K, N·m/rad | B, N·m·s/rad | I, kg·m² | covered of K, B, I |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for label in (*CHANGES, HALF):
        for rule in RULES:
            errors, covered = [], []
            for campaign in campaigns:
                case = campaign.perturbed[label]
                responses = isolated(rule, case.crossings, campaign.gait, timing)
                fit = Ensemble(responses).fitted().fit
                errors.append(fit.estimates - case.truth)
                if rule in SETTINGS:
                    draws = Ensemble(responses).resampled(RESAMPLES)
                    intervals = np.array([draws.interval(q) for q in QUANTITIES])
                    covered.append(
                        (intervals[:, 0] <= case.truth) & (case.truth <= intervals[:, 1])
                    )
            bias, scatter = np.mean(errors, axis=0), np.std(errors, axis=0, ddof=1)
            cells = [
                f"{b:.{d}f} ± {s:.{d}f}" for b, s, d in zip(bias, scatter, (1, 2, 4), strict=True)
            ]
            shares = (
                ", ".join(f"{100 * c:.0f}" for c in np.mean(covered, axis=0)) if covered else "–"
            )
            print(f"| {label} | `{rule}` | {' | '.join(cells)} | {shares} |", flush=True)


def clock_table(campaigns: Sequence[Campaign]) -> None:
    """Print the scatter of single scales, and their mean error where crossings are 8 % slower, by
    signal and drift."""
    print("| clock | " + " | ".join(f"drift of order {order}" for order in SHOWN) + " |")
    print("| --- |" + " --- |" * len(SHOWN))
    signals: dict[str, Callable[[Crossing], Array]] = {
        "angle": lambda c: c.theta,
        "torque": lambda c: c.torque,
    }
    for name, signal in signals.items():
        cells = []
        every = [
            np.concatenate([scale_errors(c, label, signal) for c in campaigns])
            for label in (USUAL, SLOWER)
        ]
        for usual, slow in zip(*(errors.T for errors in every), strict=True):
            found = np.isfinite(usual) & np.isfinite(slow)
            few = found.mean() < 0.9
            cells.append(
                "–" if few else f"{100 * usual[found].std():.2f} ({100 * slow[found].mean():+.1f})"
            )
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def scale_errors(campaign: Campaign, label: str, signal: Callable[[Crossing], Array]) -> Array:
    """Errors (n, orders) of the matched stance of each crossing, as a share, by order of the
    drift."""
    gait, errors = campaign.gait, []
    for c in campaign.perturbed[label].crossings:
        end = ((c.onset or 0.0) - BEFORE_ONSET_S - c.stance.heel_strike) / c.stance.duration
        phase = PHASES[PHASES <= end]
        mean = (gait.theta if signal(c) is c.theta else gait.torque).mean(axis=0)
        curve = signal_at(c, signal(c), stance_times(c, phase))
        errors.append(
            1 / matched_scales(phase[::4], curve[None, ::4], mean)[np.array(SHOWN) - 1, 0] - 1
        )
    return np.array(errors)


GAITS = {"simulator": simulated, "formula": formula}


def main(number: int, *gaits: str) -> None:
    """Print both tables for some gaits, or for both."""
    shipped = laboratory()
    for title in gaits or GAITS:
        make = GAITS[title]
        campaigns = [make(k, shipped) for k in range(number)]
        print(f"\n{number} campaigns, gait: {title}\n")
        rule_table(campaigns, shipped.analysis)
        print()
        clock_table(campaigns)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40, *sys.argv[2:])
