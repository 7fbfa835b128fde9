"""What contributes to an estimate of the bench beside its own fit: what faults of the recording,
another motion, and what nobody has checked would change.

The sources have their words in `judge/findings.yaml`.
"""

from collections.abc import Collection, Mapping

import numpy as np

from osl_analysis.bench.impedance import Analysis
from osl_analysis.bench.record import Label, Record
from osl_analysis.inference import ImpedanceInference
from osl_analysis.measured import significant
from osl_analysis.stats.budget import LIKELY, Contribution

VISCOELASTIC = "viscoelastic branch"
# rivals that are properties of a joint, and no faults
PROPERTIES = ("hardening", "K by side", "damping by speed", VISCOELASTIC)
SOURCES = {
    "path": "torque_path",
    "time": "change_over_time",
    "speed": "play_or_speed",
    "size": "nonlinear_spring",
    "direction": "play_or_speed",
    "clipping": "clipped_signal",
}
"""By family of rivals, the source."""
LEAST_PROBABILITY = 0.005  # of a rival that has a row: 40 of them do not make a doubt
UNITS = {"K": "N*m/rad", "B": "N*m*s/rad", "I": "kg*m^2", "B_j": "N*m*s/rad", "J_j": "kg*m^2"}


def stated_rivals(record: Record) -> set[str]:
    """The rivals that what is stated of the bench rules out. A known spring shows the delay, the
    low-pass and the frame at once."""
    settings = record.settings
    stated = set[str]()
    if any(each["delay_s"] for each in record.streams):
        stated |= {"delay"}
    if settings.bench_stiffness is not None:
        stated |= {"spring in series"}
    if settings.calibration.delay:
        stated |= {"delay", "low-pass", "spring in series"}
    taken = record.signals.taken if record.signals else ()
    if any(part.stream.low_passes for part in taken):
        stated |= {"low-pass"}
    return stated


def alternatives(
    joint: ImpedanceInference | None, stated: Collection[str], k: int
) -> list[Contribution]:
    """What the rivals of Eq. 15 would make of K, B or I (k = 0, 1, 2), each with its probability,
    and what torque that none of them explains could, whose bound is a rectangular distribution's
    half-width (JCGM 100:2008, 4.3.7)."""
    if joint is None:
        return []
    found: list[Contribution] = []
    of_property: list[Contribution] = []
    for each in joint.alternatives:
        if each.name in stated or each.probability < LEAST_PROBABILITY:
            continue
        is_property = each.name in PROPERTIES
        rows = of_property if is_property else found
        rows.append(
            Contribution(
                source="viscoelastic" if each.name == VISCOELASTIC else SOURCES[each.family],
                standard=float(each.change[k] / (2 if is_property else 1)),  # half of a range
                basis="weighed",
                part="motion" if is_property else "fault",
                probability=each.probability,
                detail=each.name,
            )
        )
    if sum(each.probability for each in of_property) > LIKELY:
        found.append(of_property[0])
    bound = float(joint.unexplained[k] / np.sqrt(3))
    found.append(Contribution("unexplained_torque", bound, basis="bound", part="fault"))
    return found


def other_stamps(analysis: Analysis, label: Label, name: str) -> list[Contribution]:
    """What the other reading of undecided stamps makes of an estimate."""
    other = analysis.fits_with_other_stamps.get(label)
    if other is None or name not in other.names:
        return []
    moved = abs(other[name] - analysis.fits[label][name])
    return [Contribution("undecided_time_stamps", moved, basis="bound", part="fault")]


def unknown(
    source: str, per: Mapping[str, str | None], detail: str | None = None
) -> dict[str, Contribution]:
    """What nobody has measured, by the estimates that it would change; `per` says by how much."""
    return {
        name: Contribution(source, None, basis="assumed", part="fault", detail=detail, per=text)
        for name, text in per.items()
    }


def late_torque(K: float, B: float, names: tuple[str, str] = ("B", "I")) -> dict[str, str]:
    """What a millisecond of delay takes off the damping and the inertia of a joint."""
    changes = zip(names, (K, B), strict=True)
    return {
        name: f"{significant(1e-3 * abs(by))} {UNITS[name]} per ms" for name, by in changes if by
    }


def in_percent(row: Mapping[str, float], **shares: float) -> dict[str, str]:
    """What a percent of a gain or a clock is of some estimates, as a share per percent."""
    return {
        name: f"{significant(0.01 * share * abs(row[name]))} {UNITS[name]} per %"
        for name, share in shares.items()
    }
