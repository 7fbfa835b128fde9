"""The file of an analysed crossing: a trial in Parquet whose provenance holds the events."""

from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Trial
from osl_analysis.trial_file import read_trial, write_trial
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.events import Stance


def write_crossing(crossing: Crossing, path: Path) -> None:
    """Write a crossing as a trial: `theta`, `torque`, `platform`, `phase`, its events in the provenance."""
    phase = (crossing.time - crossing.stance.heel_strike) / crossing.stance.duration
    samples = pl.DataFrame(
        {
            "time": crossing.time,
            "phase": phase,
            "theta": crossing.theta,
            "torque": crossing.torque,
            "platform": crossing.platform,
        }
    )
    events = {
        "heel_strike_s": crossing.stance.heel_strike,
        "toe_off_s": crossing.stance.toe_off,
        "onset_s": crossing.onset,
        "bridged": crossing.bridged,
    }
    write_trial(Trial(crossing.name, samples, events), path)


def read_crossing(path: Path) -> Crossing:
    """Read what `write_crossing` wrote."""
    trial = read_trial(path)
    events = trial.provenance
    if "heel_strike_s" not in events:
        raise InputError(f"{path}: a trial without events; run the step 'analyse' and use its crossing")
    time, theta, torque, platform = trial.signals("theta", "torque", "platform")
    stance = Stance(events["heel_strike_s"], events["toe_off_s"])
    return Crossing(trial.name, time, theta, torque, platform, stance, events["onset_s"], events["bridged"])
