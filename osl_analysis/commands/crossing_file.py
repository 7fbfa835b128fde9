"""The file of an analysed crossing: a trial in Parquet whose provenance holds the events, or why there are none."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.trial import Trial
from osl_analysis.trial_file import NAME_KEY, PROVENANCE_KEY, read_trial, write_trial
from osl_analysis.walking.crossing import Crossing, Quality
from osl_analysis.walking.encoder import EncoderCheck
from osl_analysis.walking.events import Stance

SIGNALS = ("time", "phase", "theta", "torque", "platform")
PLATE_ERROR = "plate_error_"
REFUSED = "refused"


@dataclass(frozen=True)
class Refusal:
    """A crossing that could not be analysed: its name, whether the sheet says that it was perturbed, and why."""

    name: str
    perturbed: bool
    reason: str


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: its signals and `plate_error_0`, ...; the events in the provenance."""
    phase = (crossing.time - crossing.stance.heel_strike) / crossing.stance.duration
    signals = (crossing.time, phase, crossing.theta, crossing.torque, crossing.platform)
    errors = {f"{PLATE_ERROR}{i}": error for i, error in enumerate(crossing.plate_errors)}
    samples = pl.DataFrame(dict(zip(SIGNALS, signals, strict=True)) | errors)
    events = {
        "heel_strike_s": crossing.stance.heel_strike,
        "toe_off_s": crossing.stance.toe_off,
        "onset_s": crossing.onset,
        "bridged": crossing.bridged,
        "quality": asdict(crossing.quality),
    }
    write_trial(Trial(crossing.name, samples, events), path)


def write_refusal(refusal: Refusal, path: Path) -> None:
    """Write the same file without a row, its provenance holding the reason, so that the other crossings go on."""
    reason = {REFUSED: refusal.reason, "perturbed": refusal.perturbed}
    metadata = {NAME_KEY: refusal.name, PROVENANCE_KEY: json.dumps(reason)}
    with atomic_path(path) as temporary:
        pl.DataFrame(schema=dict.fromkeys(SIGNALS, pl.Float64)).write_parquet(temporary, metadata=metadata)


def read_outcome(path: Path) -> Crossing | Refusal:
    """Read what `write_crossing` or `write_refusal` wrote.

    Raises
    ------
    InputError
        The file is missing, or is neither.
    """
    refusal = refusal_in(path) if path.is_file() else None
    if refusal is not None:
        return refusal
    trial = read_trial(path)
    events = trial.provenance
    if "heel_strike_s" not in events:
        raise InputError(f"{path}: a trial without events; run the step 'analyse' and use its crossing")
    time, theta, torque, platform = trial.signals("theta", "torque", "platform")
    errors = trial.samples.select(pl.col(f"^{PLATE_ERROR}.*$")).to_numpy().T.reshape(-1, len(time))
    stance = Stance(events["heel_strike_s"], events["toe_off_s"])
    quality = quality_of(events["quality"])
    onset, bridged = events["onset_s"], events["bridged"]
    return Crossing(trial.name, time, theta, torque, platform, stance, onset, bridged, quality, errors)


def refusal_in(path: Path) -> Refusal | None:
    """The refusal that a Parquet file holds; None if it holds something else, or is none."""
    try:
        metadata = pl.read_parquet_metadata(path)
    except (pl.exceptions.PolarsError, OSError):
        return None
    facts = json.loads(metadata.get(PROVENANCE_KEY, "{}"))
    return Refusal(metadata[NAME_KEY], facts["perturbed"], facts[REFUSED]) if REFUSED in facts else None


def quality_of(facts: dict[str, Any]) -> Quality:
    """The quality that a crossing's provenance holds."""
    encoder = facts["encoder"]
    forward, left = facts["placement"]
    return Quality(facts["residuals"], facts["zero"], (forward, left), encoder and EncoderCheck(**encoder))


def read_crossing(path: Path) -> Crossing:
    """Read a crossing.

    Raises
    ------
    InputError
        As `read_outcome`, or the crossing was refused.
    """
    found = read_outcome(path)
    if isinstance(found, Refusal):
        raise InputError(f"{path}: the crossing was refused: {found.reason}")
    return found


def read_outcomes(paths: Sequence[Path]) -> tuple[list[Crossing], list[Refusal]]:
    """Crossings and refusals among files, in their order."""
    found = [read_outcome(path) for path in paths]
    return [c for c in found if isinstance(c, Crossing)], [c for c in found if isinstance(c, Refusal)]
