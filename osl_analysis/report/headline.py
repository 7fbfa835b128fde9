"""A headline number, and the labels of all that a campaign can have (`headlines.yaml`)."""

import math
import re
import unicodedata
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.yaml_settings import read_mapping

LONGEST_CONTROLLER = 32  # letters of its name in a macro


@dataclass(frozen=True)
class Headline:
    """A number with its label; in `LABELS` only the label. The summary has the fields in this
    order.

    Attributes
    ----------
    name
        Its key in the summary.
    draft
        The value that the paper's draft prints; None if it prints none.
    macro
        Its LaTeX macro without the prefix, letters only.
    value, low, high
        In `unit`; None where there is no interval.
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
    of
        Controller, group or joint, with which `meaning` ends; empty: all.
    begins
        Begin of the page's first sentence with this number; empty: there is none.
    is_macro_only
        Whether it stands in `numbers.tex` alone, as one of many conditions, which are in a table.
    """

    name: str
    unit: str
    draft: float | None
    macro: str
    meaning: str
    value: float = math.nan
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
    of: str = ""
    begins: str = ""
    is_macro_only: bool = False


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
    table: {quantity: Headline(**fields) for quantity, fields in labels.items()}
    for table, labels in ENTRIES.items()
}
"""The labels by table and quantity, in the order of the summary."""


def with_controller(
    label: Headline, controller: str | None, example: Example, is_only: bool = False
) -> Headline:
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


def of_group(number: Headline, group: str) -> Headline:
    """The number with the name of its group, such as of crossings; unchanged if the campaign has
    one group only."""
    if group == "all":
        return number
    named = replace(
        number, name=f"{number.name} ({group})", draft=None, macro=number.macro + letters(group)
    )
    return with_end(named, group)


def with_end(number: Headline, end: str) -> Headline:
    """The number with an addition to its meaning."""
    of = f"{number.of}, {end}" if number.of else end
    return replace(number, meaning=f"{number.meaning}, {end}", of=of)


DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def letters(text: str) -> str:
    """Text as Latin letters only, for a macro: `K_d 200, timing 41 %` gives
    `KdTwoZeroZeroTimingFourOne`."""
    plain = unicodedata.normalize("NFKD", text.replace("_", "")).encode("ascii", "ignore").decode()
    macro = ""
    for word in re.findall(r"[A-Za-z]+|[0-9]", plain):
        macro += DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:]
    return macro or "Unnamed"


def all_labels() -> list[Headline]:
    """Every number that the summary of the draft's campaign can have, and those of a trial of
    torque against angle."""
    labels: list[Headline] = []
    for table, by_quantity in LABELS.items():
        for label in by_quantity.values():
            if table == "impedance":
                labels += [with_controller(label, name, Example()) for name in CONTROLLERS]
            else:
                labels.append(label)
    return labels
