# SPDX-License-Identifier: Apache-2.0
"""The findings that a trial can have, and the checks of recordings (`findings.yaml`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from osl_analysis.base.files import own_yaml

Texts = str | Sequence[str]  # of several the first counts of which all numbers are known


@dataclass(frozen=True)
class KnownFinding:
    """What a reader is told of a finding, and how it bears on others.

    Attributes
    ----------
    name
        The short name by which code and `findings.csv` identify it, such as `late_torque`.
    title
        What a reader calls it.
    says, remedy
        What is wrong, and what to do, with columns of the row in braces.
    brief
        The remedy in a few words, where it has many.
    unseen, unseen_remedy
        The same, where it could not be checked.
    is_result
        Whether it is a property of the device, which is then not of second order: the fit is what
        it says, and not doubtful.
    spoils_estimates
        Whether it names the cause where an estimate is doubtful, and makes one doubtful whose
        half-width and half-range exceed what is needed.
    """

    name: str
    title: str
    says: Texts
    remedy: Texts = ""
    brief: str = ""
    unseen: str = ""
    unseen_remedy: str = ""
    is_result: bool = False
    spoils_estimates: bool = False


TOLERANCE = 1e-3  # of a threshold: clocks of 100 Hz that nobody set run at 99.99 Hz


@dataclass(frozen=True)
class Check:
    """A check of recordings, whose threshold stands in the configuration."""

    name: str
    finding: str
    unit: str  # of its value and threshold
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


CONTENT: dict[str, Any] = own_yaml(Path(__file__).with_name("findings.yaml"))
FINDINGS = {name: KnownFinding(name, **fields) for name, fields in CONTENT["findings"].items()}
CHECKS = {name: Check(name, **fields) for name, fields in CONTENT["checks"].items()}


def known_finding(name: str) -> KnownFinding:
    """A finding of `findings.yaml`; of a column that has a limit in the configuration, and no entry
    there, one without words."""
    return FINDINGS.get(name) or KnownFinding(name, title=name, says="")
