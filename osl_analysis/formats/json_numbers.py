"""The addresses of all numbers in lines of JSON, as a source file names them."""

import json
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from osl_analysis.formats.messages.description import array_labels, is_array_of
from osl_analysis.formats.messages.effort import check_text
from osl_analysis.formats.messages.field_path import path_to

MOST_ELEMENTS = 64
"""Elements of an array that are listed. Longer ones are images or whole recordings, and no signals of one sample."""


def addresses_in_line(text: bytes, most: int) -> tuple[list[str], dict[str, int]]:
    """The addresses of the first `most` numbers in a line, and the length of each array that is not listed whole.

    Raises
    ------
    ValueError
        The text is not JSON, or too long to be parsed.
    """
    check_text(len(text))
    cut: dict[str, int] = {}
    return list(islice(addresses_in(json.loads(text), "", {}, cut), most)), cut


def addresses_in(value: Any, path: str, beside: Mapping[str, Any], cut: dict[str, int]) -> Iterator[str]:
    """The addresses of the numbers in one value; `beside` are the arrays of text in the object that holds it.

    Elements have the labels of an array of text beside their own one, or else indices.
    """
    if isinstance(value, dict):
        inner = {path_to(path, name): one for name, one in value.items()}
        texts = {name: one for name, one in inner.items() if is_array_of(one, str)}
        for name, one in inner.items():
            yield from addresses_in(one, name, texts, cut)
    elif isinstance(value, list):
        labels = array_labels(path, len(value), beside) if all(is_number(one) for one in value) else ()
        yield from (f"{path}[{label}]" for label, one in zip(labels, value, strict=False) if one is not None)
        for index, one in enumerate([] if labels else value[:MOST_ELEMENTS]):
            yield from addresses_in(one, f"{path}[{index}]", {}, cut)
        if len(value) > MOST_ELEMENTS and not labels:
            cut[path] = len(value)
    elif is_number(value) and value is not None:
        yield path


def is_number(value: Any) -> bool:
    """Whether a value is a number, a truth value, or `null` in place of one."""
    return value is None or isinstance(value, int | float)
