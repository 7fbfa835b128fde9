"""Are the stamps true, or does the device sample evenly? The signal itself decides.

With delta the residual of the stamps to their line, a signal x sampled at its true stamps is x(line) + x' delta: sixth
differences D6 take the smooth motion away and leave D6(x' delta). Of a device that samples evenly they leave nothing.
The slope g of D6 x on D6(x' delta) is therefore 1 or 0. How one-sided or slow the residual is does not decide: a loop
that waits for absolute targets is late, never early, and its stamps are true.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from osl_analysis.timebase.device_clock import DeviceClock
from osl_analysis.timebase.evidence import NO_MATTER, Evidence, evidence_of
from osl_analysis.timebase.stream import Stream

WANDERS = 0.1
"""Slow wander of the residual, in steps, from which an undecided stream keeps its stamps."""


@dataclass(frozen=True)
class Decision:
    """How the stamps of some signals of a stream are taken.

    signals: their names.
    even: the device samples evenly (else the stamps are true).
    firm: stated, or seen in the signals; else the other hypothesis may be right.
    matters: the two hypotheses differ.
    why: one sentence for provenance.
    evidence: g and its error per signal; empty where none was sought.
    """

    signals: tuple[str, ...]
    even: bool
    firm: bool
    matters: bool
    why: str
    evidence: Mapping[str, Evidence]


def decide(stream: Stream, clock: DeviceClock) -> list[Decision]:
    """One decision for all signals of a stream; one for each kind where one signal is firmly true and one firmly even.

    A stated choice stands. A residual that does not matter, below a thousandth of a step, leaves the device even.
    """
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [Decision(names, stream.choice == "even", True, True, f"stated: {stream.choice}", {})]
    if clock.sd < NO_MATTER * clock.step:
        return [Decision(names, True, True, False, "even: the stamps lie on their line", {})]
    evidence = {n: evidence_of(values, clock) for n, values in stream.signals.items() if n not in stream.silent}
    true = [name for name in evidence if evidence[name].true]
    even = [name for name in evidence if evidence[name].even]
    if true and even:
        return split(names, even, evidence)
    return [firm_decision(names, bool(even), evidence) if true or even else open_decision(names, clock, evidence)]


def split(names: tuple[str, ...], even: list[str], evidence: Mapping[str, Evidence]) -> list[Decision]:
    """Two decisions: the signals that are firmly even were held by their own device, all others take the stamps."""
    others = tuple(name for name in names if name not in even)
    return [firm_decision(group, taken, evidence) for group, taken in ((others, False), (tuple(even), True))]


def firm_decision(names: tuple[str, ...], even: bool, evidence: Mapping[str, Evidence]) -> Decision:
    """The decision that the signals themselves bear."""
    said = {name: evidence[name] for name in names if name in evidence}
    seen = ", ".join(f"{name} g = {e.g:.3f} +- {e.se:.3f}" for name, e in said.items())
    return Decision(names, even, True, True, f"{'even' if even else 'true'}: {seen}", said)


def open_decision(names: tuple[str, ...], clock: DeviceClock, evidence: Mapping[str, Evidence]) -> Decision:
    """Where no signal moves enough to tell: stamps that wander slowly are kept, stamps that only scatter are not."""
    wanders = clock.wander > WANDERS * clock.step
    why = f"undecided, {'true' if wanders else 'even'}: the residual wanders by {clock.wander / clock.step:.3f} steps"
    return Decision(names, not wanders, False, True, why, evidence)
