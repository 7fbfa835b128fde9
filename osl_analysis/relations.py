"""Relations between settings, checked where these are read. Each is a line of its model, a breach a wrong field."""

import re
from collections.abc import Callable, Collection
from itertools import pairwise
from operator import attrgetter
from typing import Any

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from osl_analysis.errors import InputError, listing, nearest


def misplaced(reason: str, *place: str) -> PydanticCustomError:
    """An error of a check that sees several fields; `place` is the field below them that is wrong."""
    return PydanticCustomError("misplaced", "{reason}", {"reason": reason, "place": place})


def refused(wrong: Callable[[Any], Any], reason: str, field: str = "") -> Any:
    """A check of settings, which are refused for a reason, whose `{s.field}` are theirs, where they are wrong. `field`
    is the one to be corrected, if there is one, by its dotted name."""

    def check(settings: Any) -> Any:
        if wrong(settings):
            raise misplaced(reason.format(s=settings), *filter(None, field.split(".")))
        return settings

    return model_validator(mode="after")(check)


def below(low: str, high: str, why: str, or_equal: bool = False) -> Any:
    """A check that a field, or a sum as `guard_s + window_s`, is below another, or equal; `why` says what else were."""

    def check(settings: Any) -> Any:
        least, most = (sum(attrgetter(one)(settings) for one in side.split(" + ")) for side in (low, high))
        if least - most > (1e-9 if or_equal else -1e-9):
            said = f"{low} = {least:g} is not below {high} = {most:g}, {why}; lower {low}, or raise {high}"
            raise misplaced(said, *low.split(" + ")[0].split("."))
        return settings

    return model_validator(mode="after")(check)


def rising(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """A check of a list, as of two bounds, each of which is below the next."""
    if fallen := [(one, other) for one, other in pairwise(values) if one >= other]:
        raise ValueError(f"{fallen[0][1]} stands behind {fallen[0][0]}; write each once, from low to high")
    return values


def distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    names = [getattr(one, "name", one) for one in values]
    if twice := [one for one in names if names.count(one) > 1]:
        raise ValueError(f"'{twice[0]}' stands twice; name each once")
    return values


def one_of(known: Collection[str], what: str, name: str) -> str:
    """A check of a name, which is one of the known ones; `what` says of what."""
    if name in known:
        return name
    raise InputError(f"'{name}' is no {what}; write one of {listing([*known], 14)}{nearest(name, known)}")


def stretches(text: str) -> list[tuple[float, float]]:
    """Stretches [s] of a recording, as `2-30 40-62`; InputError if they are not that, or not in the order of time."""
    parts = [re.fullmatch(r"(\d+\.?\d*)-(\d+\.?\d*)", word) for word in text.split()]
    found = [(float(part[1]), float(part[2])) for part in parts if part]
    if not found or len(found) < len(parts) or any(start >= stop for start, stop in found):
        raise InputError(f"windows '{text}' are not from-to in s; write them as 2-30 40-62")
    if any(start < stop for (_, stop), (start, _) in pairwise(found)):
        raise InputError(f"windows '{text}' overlap, or are not in the order of time; write them as 2-30 40-62")
    return found
