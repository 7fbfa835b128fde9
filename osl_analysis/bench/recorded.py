"""What the recorders of a bench have of a trial: its signals on one time base, and the steps that they show."""

from dataclasses import dataclass

from osl_analysis.bench.settings import SteppedSineAnalysis
from osl_analysis.protocol.commanded import SteppedSineProtocol
from osl_analysis.protocol.likeness import Likeness, likeness
from osl_analysis.stats.rounding import visible_step
from osl_analysis.trial import Trial
from osl_analysis.uniform import UniformSignals, origin, uniform_signals


@dataclass(frozen=True)
class Recorded:
    """Angle and torque of a trial on one time base, and what the joint did."""

    signals: UniformSignals
    """Angle and torque, with the command if a log has it."""
    motion: Likeness
    """The motion of the bench's angle, which the bench controls."""

    def other(self) -> "Recorded | None":
        """The same if undecided stamps were taken the other way; None where all are decided."""
        signals = self.signals.other()
        return None if signals is None else recorded_motion(signals, self.motion.protocol)


def recorded(trial: Trial, settings: SteppedSineAnalysis) -> Recorded:
    """The signals of a trial, as every fit of a stepped sine, or of another motion, takes them.

    Raises
    ------
    InputError
        A signal is missing or has no time base; the message names the trial.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",))
    return recorded_motion(signals, settings.protocol)


def recorded_motion(signals: UniformSignals, protocol: SteppedSineProtocol) -> Recorded:
    """The signals with their motion, beside what was commanded."""
    return Recorded(signals, likeness(signals.time, signals["theta"], protocol))


def resolution_of(trial: Trial, column: str, known: Recorded) -> float | None:
    """The step to which a column was rounded, in its unit: what the source file states, else what the values show."""
    stated = origin(trial, column).get("resolution")
    return float(stated) if stated else visible_step(known.signals.as_recorded(column))
