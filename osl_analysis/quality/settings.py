"""The section `quality` of the configuration: the threshold of each check, and what a failure does."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import ConfigDict, Field

from osl_analysis.yaml_settings import Settings


class Rule(Settings):
    """The threshold of one check, and what happens to a trial beyond it."""

    threshold: str
    """Number and unit, as in `20 N`."""
    on_failure: Literal["flag", "exclude"]
    """`flag` says so in the table of quality; `exclude` keeps the trial out of every other table and figure, too."""

    @property
    def limit(self) -> float:
        """The threshold without its unit."""
        return float(self.threshold.split(maxsplit=1)[0])


class QualityRules(Settings):
    """A rule per check, under the check's name; `verdict.validate_rules` compares them with the table of checks."""

    model_config = ConfigDict(extra="allow")
    RENAMED: ClassVar[Mapping[str, str]] = {"unfinished": "truncated"}
    __pydantic_extra__: dict[str, Rule] = Field(init=False)

    def rule(self, check: str) -> Rule:
        """The rule of a check."""
        return self.by_check[check]

    @property
    def by_check(self) -> dict[str, Rule]:
        """The rules by the name of their check."""
        return self.__pydantic_extra__
