# SPDX-License-Identifier: Apache-2.0
"""The words for each source of findings (`words.yaml`), and its two typed properties.

The properties, `is_result` and `spoils_estimates`, decide; the words do not.

Example: `known_finding(Source.FRICTION).title`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from osl_analysis.base.files import package_yaml
from osl_analysis.stats.sources import Source

Texts = str | Sequence[str]  # of several, the first whose numbers are all known counts

PROPERTIES_OF_DEVICE = frozenset({Source.FRICTION, Source.NONLINEAR_SPRING, Source.VISCOELASTIC})
"""Sources that are properties of a device that is not of second order: they doubt no fit."""
SPOIL_ESTIMATES = frozenset(
    {
        Source.CLIPPED_SIGNAL,
        Source.SMOOTHED_MARKERS,
        Source.FROZEN_SIGNAL,
        Source.SIGNAL_JUMPS,
        Source.ANGLE_WRAPS,
    }
)
"""Faults of a recording that name the cause of a doubtful estimate. They also make an estimate
doubtful whose half-width and half-range exceed the needed accuracy."""


@dataclass(frozen=True)
class KnownFinding:
    """The words for a source, and its properties.

    Attributes
    ----------
    name
        The source, such as `late_torque`.
    title
        Its name for readers.
    says, remedy
        What is wrong, and what to do, with columns of the row in braces.
    brief
        The remedy in a few words, where it has many.
    unseen, unseen_remedy
        What could not be checked, and what to do about it.
    """

    name: Source
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
        """Whether it spoils every estimate of the recording."""
        return self.name in SPOIL_ESTIMATES


@dataclass(frozen=True)
class WordsOfRule:
    """The words of a rule: the size of its finding or what could not be checked, and the remedy.
    Empty where the finding itself has them."""

    says: str = ""
    remedy: str = ""


CONTENT: dict[str, Any] = package_yaml(Path(__file__).with_name("words.yaml"))
FINDINGS: Mapping[str, KnownFinding] = {
    Source(name): KnownFinding(Source(name), **texts) for name, texts in CONTENT["findings"].items()
}
WORDS_OF_RULES = {name: WordsOfRule(**texts) for name, texts in CONTENT["rules"].items()}
MEANINGS_OF_CHECKS: Mapping[str, str] = CONTENT["checks"]


def known_finding(source: str) -> KnownFinding:
    """A finding with its words, by the value of its source. A source of intervals alone has its
    name as title, and no words."""
    return FINDINGS.get(source) or KnownFinding(Source(source), title=source, says="")
