"""How far the stepped sine that was recorded is the one that the configuration commands."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.protocol.commanded import SteppedSineProtocol
from osl_analysis.protocol.likeness import Likeness, likeness
from osl_analysis.protocol.runs import FEWEST_CYCLES, Run, find_runs
from osl_analysis.quality.checks import Check, CheckResult, Examined, not_applicable
from osl_analysis.timebase.gaps import GapLimits
from osl_analysis.uniform import uniform_signals

SAME_COUNT = 0.05
"""Relative difference of numbers of cycles that are the same, but half a cycle at least: a ramp has no sharp end."""
CLOCK = 1e-3
"""Relative deviation of the frequencies from the commanded ones that is mentioned."""
MOST_REMARKS, MOST_RUNS = 20, 3
"""Largest numbers of differences, and of runs of one amplitude at one frequency, that are said one by one."""
NO_STEPPED_SINE = "no stepped sine"

Pair = tuple[float, float]
"""Commanded amplitude [rad] and frequency [Hz]."""


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of segments in which recording and command differ.

    A segment is one amplitude at one frequency for the commanded number of cycles. It counts if it is missing, if it
    has fewer or more cycles, and if it was recorded and not commanded. The fits use what was recorded. An impedance
    trial may have another motion in place of the stepped sine, which is said and does not count.
    """
    if "theta" not in examined.samples.columns:
        return not_applicable(NO_STEPPED_SINE)
    commanded = examined.commanded.protocol
    fewest = min(FEWEST_CYCLES, int(min(commanded.cycles_at, default=FEWEST_CYCLES)))
    try:
        angle = uniform_signals(examined.trial, ["theta"], GapLimits())
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    time, theta = angle.time, angle["theta"]
    del angle  # with the stamps and clocks behind it, as large again as the motion
    alike = likeness(time, theta, commanded) if is_judged(examined) else None
    other = other_motion(examined, alike)
    if other:
        return CheckResult(0.0, other)
    found = find_runs(time, theta, fewest) if alike is None else alike.runs
    remarks = [*differences(found, commanded), *(f"besides {run}" for run in found if not pair_of(run, commanded))]
    pairs = len(commanded.amplitudes) * len(commanded.frequencies_hz)
    more = [f"and {len(remarks) - MOST_REMARKS} differences more"] * (len(remarks) > MOST_REMARKS)
    words = [*remarks[:MOST_REMARKS], *more] or [f"{pairs} commanded pairs of amplitude and frequency found"]
    return CheckResult(float(len(remarks)), "; ".join([*words, *clock_remark(found, commanded)]))


def is_judged(examined: Examined) -> bool:
    """Whether the motion itself tells if it is a stepped sine."""
    return examined.experiment.any_motion and examined.commanded.excitation == "auto"


def other_motion(examined: Examined, alike: Likeness | None) -> str:
    """Why the motion of an impedance trial is not compared with the command; empty if it is."""
    if alike is not None:
        return "no stepped sine but another motion, which is fitted as such" if alike.kind == "other" else ""
    if examined.experiment.any_motion and examined.commanded.excitation == "any":
        return "not compared: the configuration says that any motion moves the joint"
    return ""


def differences(found: Sequence[Run], commanded: SteppedSineProtocol) -> list[str]:
    """A remark on every commanded pair of amplitude and frequency that is missing or has other numbers of cycles."""
    remarks = []
    followed = [pair_of(run, commanded) for run in found]
    for (amplitude, frequency), cycles in commanded_cycles(commanded).items():
        own = [run for run, pair in zip(found, followed, strict=True) if pair == (amplitude, frequency)]
        really = sum(run.cycles for run in own)
        if not own:
            remarks.append(f"missing {np.rad2deg(amplitude):g} deg at {frequency:g} Hz")
        elif abs(really - cycles) > max(SAME_COUNT * cycles, 0.5 * len(own)):
            more = f" and {len(own) - MOST_RUNS} times more" if len(own) > MOST_RUNS else ""
            remarks.append(f"{' and '.join(map(str, own[:MOST_RUNS]))}{more}, commanded are {cycles:g}")
    return remarks


def commanded_cycles(commanded: SteppedSineProtocol) -> dict[Pair, float]:
    """Number of cycles in all of each commanded pair; a protocol may have a pair more than once."""
    cycles: dict[Pair, float] = {}
    for amplitude in commanded.amplitudes:
        for frequency, count in zip(commanded.frequencies_hz, commanded.cycles_at, strict=True):
            cycles[amplitude, frequency] = cycles.get((amplitude, frequency), 0.0) + count
    return cycles


def pair_of(run: Run, commanded: SteppedSineProtocol) -> Pair | None:
    """The commanded pair that a run follows; None if there is none."""
    amplitude, frequency = commanded.amplitude_near(run.amplitude), commanded.frequency_near(run.frequency_hz)
    return None if amplitude is None or frequency is None else (amplitude, frequency)


def clock_remark(found: Sequence[Run], commanded: SteppedSineProtocol) -> list[str]:
    """Remark on the deviation of the recorded frequencies from the commanded ones, if it is large enough."""
    beside = [run.frequency_hz / f - 1 for run in found if (f := commanded.frequency_near(run.frequency_hz))]
    median = float(np.median(beside)) if beside else 0.0
    if abs(median) < CLOCK:
        return []
    return [f"frequencies are {100 * abs(median):.2g} % {'above' if median > 0 else 'below'} the commanded ones"]


PROTOCOL_CHECKS = (
    Check(
        "protocol",
        "segments",
        "above",
        "segments in which recording and command differ: missing, with fewer or more cycles, or not commanded",
        measure_protocol,
        applies_to=lambda experiment: experiment.stepped_sine,
        otherwise=NO_STEPPED_SINE,
    ),
)
