"""Plates that cannot be trusted during a stance: a raw channel at its limit or dead, or a force that nobody causes."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.events import Stance

CLIPPED_S = 0.02
"""A raw channel that keeps an extreme for this time [s] in a stance has reached its limit. Gait never does so."""
STANDS_S = 0.1
"""A raw channel that repeats one value for this time [s] while the force changes is dead."""
LARGEST_FORCE = 8000.0
"""Vertical force [N] that no walking person causes: ten times the weight of 80 kg."""


def check_plate(trial: Trial, plate: int, stance: Stance, vertical: Array) -> None:
    """Refuse a plate whose raw channels fail in a stance, or whose vertical force (n,) [N] is not one of a person.

    Raises
    ------
    InputError
        Names the channel, the value, the time and the remedy.
    """
    for facts in recorded_plate(trial, plate).get("channels", []):
        check_channel(plate, facts, stance)
    peak = float(vertical.max())
    if peak > LARGEST_FORCE:
        raise InputError(
            f"force plate {plate} reads up to {peak:.3g} N, expected less than {LARGEST_FORCE:g} N under a person; "
            "correct the unit of its forces (`plate_units` in the source file)"
        )


def check_channel(plate: int, facts: Mapping[str, Any], stance: Stance) -> None:
    """Refuse a raw channel of a plate, with the facts that ingest found, that is clipped in the stance or dead."""
    name = f"channel {facts['label']} of force plate {plate}"
    if shared_time(facts, "clipped", stance) >= CLIPPED_S:
        raise InputError(
            f"{name} stays at {facts['clipped_at']:.4g} from {facts['clipped_from_s']:.3f} s to "
            f"{facts['clipped_to_s']:.3f} s: it has reached its limit; choose a larger range and record again, or "
            "exclude the trial"
        )
    if shared_time(facts, "stands", stance) >= STANDS_S:
        raise InputError(
            f"{name} repeats one value from {facts['stands_from_s']:.3f} s to {facts['stands_to_s']:.3f} s while the "
            "force on the plate changes: it is dead; mend the channel and record again, or exclude the trial"
        )


def shared_time(facts: Mapping[str, Any], run: str, stance: Stance) -> float:
    """Time [s] that a run of a channel's facts, `clipped` or `stands`, shares with the stance."""
    if not facts[f"{run}_samples"]:
        return 0.0
    first, last = facts[f"{run}_from_s"], facts[f"{run}_to_s"]
    return float(min(last, stance.toe_off) - max(first, stance.heel_strike))


def check_type_on_platform(trial: Trial, plate: int) -> None:
    """Refuse a plate of type 1 on a platform that moves.

    It records the centre of pressure instead of the moment, and the plate's own inertia cannot be taken from it.

    Raises
    ------
    InputError
        The plate is of type 1.
    """
    if recorded_plate(trial, plate).get("type") == 1:
        raise InputError(
            f"trial {trial.name}: force plate {plate} is of type 1 (centre of pressure) on a moving platform: "
            "without its moments the plate's own inertia cannot be taken away; export it as type 2, 3 or 4"
        )


def recorded_plate(trial: Trial, plate: int) -> Mapping[str, Any]:
    """What the recording states of a plate; empty where it describes no such plate."""
    found = [facts for facts in trial.provenance.get("plates", []) if facts["plate"] == plate]
    return found[0] if found else {}
