"""Thresholds of quality control, and what a failed check does; they stand under `quality` in the configuration."""

from typing import Literal

from pydantic import model_validator

from osl_analysis.quality.names import CHECKS
from osl_analysis.yaml_settings import Settings


class Rule(Settings):
    """A threshold with its unit, as in `20 N`, and what happens to a trial beyond it.

    `flag` says so in the table, `exclude` leaves the trial out of every table and figure too.
    """

    threshold: str
    on_failure: Literal["flag", "exclude"]

    @property
    def limit(self) -> float:
        """The threshold without its unit."""
        return float(self.threshold.split(maxsplit=1)[0])


class QualityRules(Settings):
    """A rule per check of `names.CHECKS`."""

    rate: Rule
    jitter: Rule
    gap: Rule
    saturation: Rule
    stuck: Rule
    unzeroed_load_cell: Rule
    unzeroed_plate: Rule
    encoder_wrap: Rule
    marker_gap: Rule
    clock_residual: Rule
    damage: Rule
    unfinished: Rule
    protocol: Rule

    @model_validator(mode="after")
    def _units(self) -> "QualityRules":
        for name, check in CHECKS.items():
            threshold = self.rule(name).threshold
            number, _, unit = threshold.partition(" ")
            if unit.strip() != check.unit or not is_number(number):
                raise ValueError(
                    f"threshold '{threshold}' of {name} must be a number and its unit, as in '1 {check.unit}'"
                )
        return self

    def rule(self, name: str) -> Rule:
        """The rule of a check."""
        found: Rule = getattr(self, name)
        return found


def is_number(text: str) -> bool:
    """Whether the text is a number from 0 up."""
    try:
        return 0 <= float(text) < float("inf")
    except ValueError:
        return False
