"""JSON messages in which a wanted field is written twice: such a message contradicts itself.

RFC 8259 leaves the value of a repeated name open: polars would take the first, Python's parser takes the last.
"""

import json
import re
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.formats.messages.field_path import PART, name_in
from osl_analysis.formats.messages.leaves import Indices, byte_rows

QUOTE = ord('"')
MOST_PARSED = 3  # messages to look at for a first one that is sound


class RepeatedNameError(ValueError):
    """A wanted field is written twice in one object."""


def names_on_the_way(paths: Collection[str]) -> frozenset[str]:
    """All names of objects' fields that lead to the paths."""
    parts = [part for path in paths for part in PART.finditer(path)]
    return frozenset(name for part in parts for name in (name_in(part), part["names"]) if name is not None)


def load(text: bytes, names: Collection[str]) -> Any:
    """One message by Python's parser.

    Raises
    ------
    ValueError
        The text is not JSON, or an object has one of the names twice.
    """
    return json.loads(text, object_pairs_hook=unrepeated(names))


def unrepeated(names: Collection[str]) -> Callable[[Sequence[tuple[str, Any]]], dict[str, Any]]:
    """Makes an object of its fields, unless one of the names is among them twice."""

    def as_object(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            written = [name for name, _ in pairs]
            twice = [name for name in made if name in names and written.count(name) > 1]
            if twice:
                raise RepeatedNameError(f"field '{twice[0]}' is written twice")
        return made

    return as_object


def repeating(texts: Sequence[bytes], names: Collection[str]) -> dict[int, str]:
    """Which of the messages write a field twice, by place, and what is wrong with each.

    A message that writes every name as often as a sound one does is sound. The others, and those with escaped
    characters, which may spell a name in another way, are parsed.
    """
    sound = next((i for i, text in enumerate(texts[:MOST_PARSED]) if fault(text, names) == ""), None)
    if sound is not None and are_alike(texts, texts[sound]):
        return {}
    doubtful = np.arange(len(texts)) if sound is None else unlike(texts, texts[sound], names)
    faults = {int(i): fault(texts[i], names) for i in doubtful}
    return {i: text for i, text in faults.items() if text}


def fault(text: bytes, names: Collection[str]) -> str | None:
    """Which name a message repeats; empty if it repeats none, None if it is not JSON."""
    try:
        load(text, names)
    except RepeatedNameError as error:
        return str(error)
    except (ValueError, RecursionError):
        return None
    return ""


def are_alike(texts: Sequence[bytes], sound: bytes) -> bool:
    """Whether all messages have the strings of `sound` in its order, and directly after each the same character.

    A string is then a name in each of the messages or in none: what follows it is a colon, or is not. Messages with
    escaped characters, or with a blank after a string, are not compared.
    """
    joined = b"".join(texts)
    own = [i for i, character in enumerate(sound) if character == QUOTE]
    quotes = np.flatnonzero(np.frombuffer(joined, np.uint8) == QUOTE)
    if b"\\" in joined or len(own) % 2 or not own or quotes.size != len(own) * len(texts):
        return False
    places = quotes.reshape(len(texts), len(own))
    ends = np.cumsum(np.fromiter(map(len, texts), np.int64, len(texts)))
    if (places[:, -1] >= ends).any() or (places[1:, 0] < ends[:-1]).any():
        return False
    for k in range(0, len(own), 2):
        expected = sound[own[k] : own[k + 1] + 2]
        if expected[-1:] not in (b":", b",", b"}", b"]") or places[-1, k] + len(expected) > len(joined):
            return False
        if (byte_rows(joined, places[:, k], len(expected)) != np.frombuffer(expected, np.uint8)).any():
            return False
    return True


def unlike(texts: Sequence[bytes], sound: bytes, names: Collection[str]) -> Indices:
    """Places of the messages that do not write every name as often as `sound` does, or that have a backslash."""
    try:
        messages = pl.Series(texts).cast(pl.String)
    except pl.exceptions.PolarsError:  # not UTF-8
        return np.arange(len(texts))
    doubtful = messages.str.contains("\\", literal=True)
    for name in names:
        pattern = f"{re.escape(json.dumps(name, ensure_ascii=False))}[ \\t\\r\\n]*:"
        usual = len(re.findall(pattern.encode(), sound))
        doubtful |= messages.str.count_matches(pattern) != usual
    return np.flatnonzero(doubtful.to_numpy())
