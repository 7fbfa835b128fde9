# SPDX-License-Identifier: Apache-2.0
"""What a reader is told of each finding (`words.yaml`), and how it bears on others. Words decide
nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from osl_analysis.base.files import own_yaml
from osl_analysis.stats.sources import Source

Texts = str | Sequence[str]  # of several the first counts of which all numbers are known

PROPERTIES_OF_DEVICE = frozenset({Source.FRICTION, Source.NONLINEAR_SPRING, Source.VISCOELASTIC})
"""Sources for which a device is not of second order: the fit is what it says, and not doubtful."""
SPOIL_ESTIMATES = frozenset(
    {
        Source.CLIPPED_SIGNAL,
        Source.SMOOTHED_MARKERS,
        Source.FROZEN_SIGNAL,
        Source.SIGNAL_JUMPS,
        Source.ANGLE_WRAPS,
    }
)
"""Faults of a recording that name the cause where an estimate is doubtful, and make one doubtful
whose half-width and half-range exceed what is needed."""


@dataclass(frozen=True)
class KnownFinding:
    """What a reader is told of a finding, and how it bears on others.

    Attributes
    ----------
    name
        Its source, such as `late_torque`.
    title
        What a reader calls it.
    says, remedy
        What is wrong, and what to do, with columns of the row in braces.
    brief
        The remedy in a few words, where it has many.
    unseen, unseen_remedy
        The same, where it could not be checked.
    """

    name: str
    title: str
    says: Texts
    remedy: Texts = ""
    brief: str = ""
    unseen: str = ""
    unseen_remedy: str = ""

    @property
    def is_result(self) -> bool:
        """Whether it is a property of the device."""
        return self.name in PROPERTIES_OF_DEVICE

    @property
    def spoils_estimates(self) -> bool:
        """Whether no estimate can be trusted beside it."""
        return self.name in SPOIL_ESTIMATES


@dataclass(frozen=True)
class WordsOfRule:
    """How large the finding of a rule is, or what could not be checked, and what to do; empty
    where the finding itself says it."""

    says: str = ""
    remedy: str = ""


CONTENT: dict[str, Any] = own_yaml(Path(__file__).with_name("words.yaml"))
FINDINGS: Mapping[str, KnownFinding] = {
    Source(name): KnownFinding(Source(name), **texts) for name, texts in CONTENT["findings"].items()
}
WORDS_OF_RULES = {name: WordsOfRule(**texts) for name, texts in CONTENT["rules"].items()}
MEANINGS_OF_CHECKS: Mapping[str, str] = CONTENT["checks"]


def known_finding(name: str) -> KnownFinding:
    """A finding with its words; of a column that has a limit in the configuration, and no rule of
    its own, one without words."""
    return FINDINGS.get(name) or KnownFinding(name, title=name, says="")
