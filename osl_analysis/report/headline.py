"""A headline number, and the labels of all that a campaign can have (`headlines.yaml`)."""

import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.report.decimal_places import Bounds, Places, places_between
from osl_analysis.yaml_settings import read_mapping

LONGEST_CONTROLLER = 32  # letters of its name in a macro


@dataclass(frozen=True)
class HeadlineLabel:
    """What a headline number is called.

    Attributes
    ----------
    name
        Its key in the summary.
    draft
        The value that the paper's draft prints; None if it prints none.
    macro
        Its LaTeX macro without the prefix, letters only.
    subject
        Controller, group or joint, with which `meaning` ends; empty: all.
    sentence_begin
        Begin of the page's first sentence with this number; empty: there is none.
    """

    name: str
    unit: str
    draft: float | None
    macro: str
    meaning: str
    subject: str = ""
    sentence_begin: str = ""


@dataclass(frozen=True)
class HeadlineValue:
    """The value of a headline number. The summary has the fields in this order.

    Attributes
    ----------
    value, low, high
        In the unit of the label; None where there is no interval.
    interval
        Kind of the interval; None if there is none.
    n
        Number of trials or fits behind the number.
    sd
        Standard deviation between the trials; None if unknown.
    n_doubtful, n_left_out
        Numbers of doubtful trials or fits among the candidates, and of those that are left out.
    doubt
        Why the number itself is doubtful; None if it is not, or not judged.
    verdict
        On the paper's claim about this number; None without a claim.
    amplitudes_low, amplitudes_high
        Lowest and highest result of the fits to single amplitudes; None if there are none.
    """

    value: float
    low: float | None = None
    high: float | None = None
    interval: str | None = None
    n: int = 0
    sd: float | None = None
    n_doubtful: int = 0
    n_left_out: int = 0
    doubt: str | None = None
    verdict: str | None = None
    amplitudes_low: float | None = None
    amplitudes_high: float | None = None

    def with_interval(
        self, low: float | None, high: float | None, kind: str | None
    ) -> "HeadlineValue":
        """This estimate with its interval, or without one where a bound is missing (a single trial
        has no scatter)."""
        if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
            return self
        return replace(self, low=low, high=high, interval=kind)

    @property
    def places(self) -> Places:
        """Its decimal places: it is rounded by the range over single amplitudes if this is wider
        than the interval, else by the interval."""
        low, high = self.low, self.high
        lowest, highest = self.amplitudes_low, self.amplitudes_high
        bounds = Bounds(low, high, self.interval, self.sd)
        if lowest is None or highest is None:
            return places_between(self.value, low, high, bounds)
        if low is None or high is None or high - low <= highest - lowest:
            bounds = Bounds(lowest, highest, None, self.sd)
        return places_between(self.value, low, high, bounds)


@dataclass(frozen=True)
class Headline:
    """A headline number with its label."""

    label: HeadlineLabel
    estimate: HeadlineValue
    is_macro_only: bool = False
    """Whether it stands in `numbers.tex` alone, as one of many conditions, which are in a table."""

    def to_json(self) -> dict[str, Any]:
        """Its object under `numbers` of `summary.json`."""
        return {
            "unit": self.label.unit,
            "draft": self.label.draft,
            "meaning": self.label.meaning,
            **asdict(self.estimate),
            "of": self.label.subject,
            "begins": self.label.sentence_begin,
        }


def headlines_in_summary(summary: Mapping[str, Any]) -> dict[str, Headline]:
    """The numbers of a `summary.json` by name; those of an older one lack some fields."""
    headlines = {}
    for name, number in summary.get("numbers", {}).items():
        label = HeadlineLabel(
            name=name,
            unit=number["unit"],
            draft=number.get("draft"),
            macro="",
            meaning=number.get("meaning", ""),
            subject=number.get("of", ""),
            sentence_begin=number.get("begins", ""),
        )
        names = [field.name for field in fields(HeadlineValue) if field.name in number]
        headlines[name] = Headline(label, HeadlineValue(**{key: number[key] for key in names}))
    return headlines


@dataclass(frozen=True)
class Example:
    """The desired impedance of Fig. 4, whose estimates are headline numbers; by default that of the
    draft."""

    K_d: float | None = 300.0  # desired stiffness [N*m/rad]; None: not stated
    B_d: float | None = 5.0  # desired damping [N*m*s/rad]; None: not stated
    chosen: str = ""  # why this one, if the configuration does not name it

    def stated(self) -> dict[str, float]:
        """K_d and B_d, as far as they are stated."""
        desired = {"K_d": self.K_d, "B_d": self.B_d}
        return {name: value for name, value in desired.items() if value is not None}

    def meaning(self) -> str:
        stated = [f"{name} = {value:g}" for name, value in self.stated().items()]
        if not stated:
            return "as measured"
        meaning = f"for {', '.join(stated)}"
        return f"{meaning} (that of {self.chosen})" if self.chosen else meaning


ENTRIES: dict[str, Any] = read_mapping(Path(__file__).with_name("headlines.yaml"))

LABELS = {
    table: {quantity: HeadlineLabel(**facts) for quantity, facts in labels.items()}
    for table, labels in ENTRIES.items()
}
"""The labels by table and quantity, in the order of the summary."""


def with_controller(
    label: HeadlineLabel, controller: str | None, example: Example, is_only: bool = False
) -> HeadlineLabel:
    """The label of one controller, which is not named if it is the only one and no trial states
    it."""
    controller_name = controller or "no controller"
    named = replace(
        label,
        name=f"{label.name}_{controller_name.replace(' ', '_')}",
        macro=letters(controller_name)[:LONGEST_CONTROLLER] + label.macro,
        meaning=label.meaning.format(example=example.meaning()),
    )
    if controller is None and is_only:
        return named
    return with_end(named, controller or "controller not stated")


def of_group(label: HeadlineLabel, group: str) -> HeadlineLabel:
    """The label of a group, such as of crossings; unchanged if the campaign has one group only."""
    if group == "all":
        return label
    named = replace(
        label, name=f"{label.name} ({group})", draft=None, macro=label.macro + letters(group)
    )
    return with_end(named, group)


def with_end(label: HeadlineLabel, end: str) -> HeadlineLabel:
    """The label with an addition to its meaning."""
    subject = f"{label.subject}, {end}" if label.subject else end
    return replace(label, meaning=f"{label.meaning}, {end}", subject=subject)


DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def letters(text: str) -> str:
    """Text as Latin letters only, for a macro: `K_d 200, timing 41 %` gives
    `KdTwoZeroZeroTimingFourOne`."""
    plain = unicodedata.normalize("NFKD", text.replace("_", "")).encode("ascii", "ignore").decode()
    macro = ""
    for word in re.findall(r"[A-Za-z]+|[0-9]", plain):
        macro += DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:]
    return macro or "Unnamed"


def all_labels() -> list[HeadlineLabel]:
    """Every number that the summary of the draft's campaign can have, and those of a trial of
    torque against angle."""
    labels: list[HeadlineLabel] = []
    for table, by_quantity in LABELS.items():
        for label in by_quantity.values():
            if table == "impedance":
                labels += [with_controller(label, name, Example()) for name in CONTROLLERS]
            else:
                labels.append(label)
    return labels
