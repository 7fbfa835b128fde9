"""The findings that a trial can have, and the numbers that are evidence of them
(`findings.yaml`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from osl_analysis.dictionary import own_yaml


@dataclass(frozen=True)
class KnownFinding:
    """What a reader is told of a finding, and how it bears on others.

    Attributes
    ----------
    name
        The short name by which code and `findings.csv` identify it, such as `late_torque`.
    title
        What a reader calls it; `{about}` in it is a part of the device.
    says, remedy
        What is wrong, and what to do, with columns of the row in braces.
    of_amplitude, of_frequency, without_amplitudes, if_doubtful
        Other remedies (`finding.Remedy`); empty: `remedy`.
    brief
        The remedy in a few words.
    in_table
        `says` and `remedy` in a table where they differ.
    explains_misfit
        Whether it makes a fit worse, so that the misfit of the same trial is no finding of its own.
    of_recording
        Whether it is a fault of the recording, which does not depend on amplitude: the fit to all
        of a trial must show it, too.
    causes_others
        Whether it brings about other findings, as a wrong unit or sign does.
    is_result
        Whether it is a property of the device, which is then not of second order: the fit is what
        it says, and not doubtful.
    concerns
        Results that it is about; empty: all.
    spoils_estimates
        Whether no estimate can be told beside it: other causes of a misfit may be its effect.
    is_misfit
        Whether it is a misfit without a known cause.
    estimates_without
        Columns of the estimates by K, B and I, from the same fit with this cause as a column of the
        regression.
    """

    name: str
    title: str
    says: str
    remedy: str = ""
    of_amplitude: str = ""
    of_frequency: str = ""
    without_amplitudes: str = ""
    if_doubtful: str = ""
    brief: str = ""
    in_table: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    explains_misfit: bool = False
    of_recording: bool = False
    causes_others: bool = False
    is_result: bool = False
    concerns: Sequence[str] = ()
    spoils_estimates: bool = False
    is_misfit: bool = False
    estimates_without: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """A column of result tables whose numbers are evidence of a finding.

    Attributes
    ----------
    finding
        That of a number beyond its limit.
    decided_by
        What decides whether it is a doubt: a limit of the configuration; the accuracy that the
        estimate `share_of` needs; by how much the estimates with the cause in the model differ; or
        that it is certainly below zero.
    share_of
        The estimate (K, B, I) of which the number is a share; empty: none.
    in_unit
        Whether its words have the estimate in its unit, not as a share.
    is_misfit
        Whether a finding that explains the trial's misfit takes this column, too.
    tables
        In which it counts; empty: in all.
    signals
        Whose units scale this ratio to a known value.
    second_ratio
        Column of another ratio that tells a unit from another device; its own name: none is needed;
        empty: the number is no such ratio.
    says
        How large the finding is, by this number; empty: the number is not told.
    below
        `finding` and `says` of a number below its limit, where they differ.
    """

    column: str
    finding: str
    decided_by: Literal["configuration", "accuracy", "effect", "sign"] = "configuration"
    share_of: str = ""
    in_unit: bool = False
    is_misfit: bool = False
    tables: Sequence[str] = ()
    signals: Sequence[str] = ("torque", "angle")
    second_ratio: str = ""
    says: str = ""
    below: Mapping[str, str] = field(default_factory=dict)

    def on_side(self, side: str) -> "Evidence":
        """The same, of a number on this side of its limit."""
        if side != "below" or not self.below:
            return self
        fields: dict[str, Any] = {**self.below}
        return replace(self, **fields)


TOLERANCE = 1e-3  # of a threshold: clocks of 100 Hz that nobody set run at 99.99 Hz


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    finding: str
    meaning: str  # of its value
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which it fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than `TOLERANCE`; NaN fails, None (not
        applicable) does not."""
        if value is None:
            return False
        tolerance = TOLERANCE * limit
        if self.fails == "below":
            return not value >= limit - tolerance
        return not value <= limit + tolerance


CONTENT: dict[str, dict[str, Any]] = own_yaml(Path(__file__).with_name("findings.yaml"))
FINDINGS = {name: KnownFinding(name, **fields) for name, fields in CONTENT["findings"].items()}
EVIDENCE = {name: Evidence(name, **fields) for name, fields in CONTENT["columns"].items()}
"""By column. Any other column may have a limit, too: its finding then has the column's name."""
CHECKS = {name: Check(name, **fields) for name, fields in CONTENT["checks"].items()}
HYPOTHESES: dict[str, str] = CONTENT["hypotheses"]
"""Findings by family of the hypotheses of the inference."""


def check_names() -> None:
    """Raises LookupError: a number, check or hypothesis names a finding that is not described."""
    names = {column: evidence.finding for column, evidence in EVIDENCE.items()}
    names |= {name: check.finding for name, check in CHECKS.items()}
    names |= HYPOTHESES
    for place, name in names.items():
        if name not in FINDINGS:
            raise LookupError(f"findings.yaml, {place}: describe '{name}' under `findings`")


check_names()


def known_finding(name: str) -> KnownFinding:
    """A finding of `findings.yaml`; of a column that has a limit in the configuration, and no entry
    there, one without words."""
    return FINDINGS.get(name) or KnownFinding(name, title=name, says="")
