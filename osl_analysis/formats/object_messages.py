"""JSON and protobuf messages, which a library makes objects of one by one; the paths of their fields.

A path is dotted: `variables.ankle_angle`, `position[0]`, `position[name=ankle]` (the element at the place of `ankle` in
the array `name` beside it). A name that has a dot or a bracket in it stands in brackets and double quotes, written as
JSON writes a text: `functions["loadcell.mz"]`.
"""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError, OslAnalysisError

PART = re.compile(
    r"(?P<name>[^.\[\]]+)|\[(?P<quoted>\"(?:[^\"\\]|\\.)*\")\]|\[(?P<index>\d+)\]|\[(?P<names>\w+)=(?P<one>[^\]]+)\]|\."
)
PLAIN = re.compile(r"[^.\[\]]+")  # a name that needs no quotes
MOST_SHOWN = 40  # characters of a value in a message to the user
AT_ONCE = 1 << 14  # messages that are held as objects at once

Indices = NDArray[np.int64]
Values = dict[str, NDArray[Any]]
Key = str | int | tuple[str, str]
"""Name of a field, index in an array, or the array of names beside it with the wanted name."""


class WholeArrayError(OslAnalysisError):
    """A path names a whole array. It does so in every message, so that no message is to blame."""


class NoNumberError(ValueError):
    """Something else than a number stands in a wanted field."""


@cache
def steps_of(path: str) -> tuple[tuple[Key, str], ...]:
    """The steps to a field, each with the way that leads to it."""
    steps: list[tuple[Key, str]] = []
    for part in PART.finditer(path):
        way = path[: part.start()].rstrip(".")
        if part["names"] is not None:
            steps.append(((part["names"], part["one"]), way))
        elif part["index"] is not None:
            steps.append((int(part["index"]), way))
        elif part[0] != ".":
            steps.append((part["name"] or unquoted(part["quoted"]), way))
    return tuple(steps)


def unquoted(text: str) -> str:
    """A quoted name as it is; one with an escape that JSON does not know stays as it was written."""
    try:
        return str(json.loads(text))
    except ValueError:
        return text[1:-1]


def path_to(above: str, name: str) -> str:
    """The path of the field `name` of the object at the path `above`; empty for the message itself."""
    if not PLAIN.fullmatch(name):
        return f"{above}[{json.dumps(name, ensure_ascii=False)}]"
    return f"{above}.{name}" if above else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    return next((key for key, _ in reversed(steps_of(path)) if isinstance(key, str)), path)


@dataclass(frozen=True)
class FieldDescription:
    """A number in a message, or an array of numbers, for a user who writes a source file."""

    path: str  # dotted path; of an array of messages it passes element 0
    type: str  # type of the number, such as float64 or bool
    length: int | None = None  # number of elements in the inspected message; None for a single number
    labels: tuple[str, ...] = ()
    """The array's elements by label, such as `name=ankle`; empty where no array of text beside it names them."""

    def addresses(self) -> list[str]:
        """The paths by which single numbers are asked for: every labelled element, or else element 0."""
        if self.length is None:
            return [self.path]
        return [f"{self.path}[{label}]" for label in self.labels] or [f"{self.path}[0]"]

    def in_words(self) -> str:
        return self.path if self.length is None else f"{self.path}[0..{self.length - 1}]"


def array_labels(path: str, length: int | None, texts: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Labels of an array's elements, from an array of as many different texts beside it in the message."""
    parent = path.rpartition(".")[0]
    for array, names in texts.items():
        beside, _, name = array.rpartition(".")
        is_beside = beside == parent and re.fullmatch(r"\w+", name)
        if is_beside and len(names) == length == len(set(names)) and all(one and "]" not in one for one in names):
            return tuple(f"{name}={one}" for one in names)
    return ()


@dataclass
class ObjectReader:
    """Reads messages one by one."""

    paths: Sequence[str]  # paths of the fields to read
    decode: Callable[[bytes], Any]
    """Makes an object of a message; raises ValueError (InputError) if it does not fit its type."""
    number_at: Callable[[Any, str], float | bool | None]
    """The number at a path of an object; None where it has none, NoNumberError where something else stands."""
    read_alone: int = 0  # messages that were read one by one
    misfits: int = 0  # messages that are not what their type says, write a field twice, or have no number in a field
    misfit: str = ""  # what is wrong with the first of these
    no_numbers: int = 0  # those of the misfits that have something else than a number
    before: int = 0  # messages before those that are read now

    def read(self, buffer: bytes, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Batches of messages: their places among `starts`, and their numbers by path; misfits are only counted."""
        for first in range(0, starts.size, AT_ONCE):
            places, messages = [], []
            for row in range(first, min(first + AT_ONCE, starts.size)):
                try:
                    message = self.decode(buffer[starts[row] : starts[row] + lengths[row]])
                    found = {path: self.number_at(message, path) for path in self.paths}
                except NoNumberError as error:
                    self.no_numbers += 1
                    self.note(f"{error} in message {self.before + row + 1}")
                except WholeArrayError:
                    raise
                except (ValueError, RecursionError) as error:
                    self.note(str(error))
                else:
                    places.append(row)
                    messages.append({path: value for path, value in found.items() if value is not None})
            self.read_alone += len(messages)
            yield from batches(places, messages)
        self.before += starts.size

    def note(self, misfit: str) -> None:
        self.misfits += 1
        self.misfit = self.misfit or misfit


def batches(places: Sequence[int], messages: Sequence[dict[str, Any]]) -> Iterator[tuple[Indices, Values]]:
    """The messages in batches with the same fields; `places` are theirs.

    Truth values and numbers stand in batches of their own: joined, `True` would become 1.
    """
    alike: dict[tuple[tuple[str, bool], ...], list[int]] = defaultdict(list)
    for row, message in enumerate(messages):
        alike[tuple((path, value.__class__ is bool) for path, value in message.items())].append(row)
    for kind, rows in alike.items():
        values = {path: as_array([messages[row][path] for row in rows]) for path, _ in kind}
        yield np.array([places[row] for row in rows], np.int64), values


def as_array(numbers: Sequence[float | bool]) -> NDArray[Any]:
    """Numbers in one type that holds them all; integers beyond 64 bits become floats."""
    if all(one.__class__ is int for one in numbers) and min(numbers) >= 0 and 2**63 <= max(numbers) < 2**64:
        return np.array(numbers, np.uint64)  # numpy would make floats of them
    values = np.array(numbers)
    return values.astype(np.float64) if values.dtype == object else values


def json_reader(paths: Sequence[str]) -> ObjectReader:
    """A reader of the fields at `paths` of JSON messages."""
    keys = {key for path in paths for key, _ in steps_of(path)}
    names = {name for key in keys if not isinstance(key, int) for name in (key if isinstance(key, tuple) else [key])}

    def as_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        """Refuses a wanted name that is written twice: RFC 8259 leaves open which of its values counts."""
        made = dict(pairs)
        if len(made) < len(pairs):
            written = [name for name, _ in pairs]
            twice = [name for name in made if name in names and written.count(name) > 1]
            if twice:
                raise InputError(f"field '{twice[0]}' is written twice")
        return made

    parser = json.JSONDecoder(object_pairs_hook=as_object)

    def decode(text: bytes) -> Any:
        """One message; raises InputError if it is not JSON."""
        try:
            return parser.decode(text.decode(json.detect_encoding(text), "surrogatepass"))
        except InputError:
            raise
        except (ValueError, RecursionError) as error:
            raise InputError(f"a message of {len(text)} bytes is not JSON: {error}") from error

    return ObjectReader(paths, decode, json_number)


def json_number(message: Any, path: str) -> float | bool | None:
    """The number at a path; None where a key is absent or `null`, or an array too short."""
    value, parent = message, None
    for key, way in steps_of(path):
        if value is None:
            return None
        if isinstance(key, str):
            if not isinstance(value, dict):
                raise no_number(value, way, "an object with fields")
            parent, value = value, value.get(key)
            continue
        if not isinstance(value, list):
            raise no_number(value, way, "an array")
        if isinstance(key, tuple):
            names = parent.get(key[0]) if isinstance(parent, dict) else None
            if names is not None and not isinstance(names, list):
                raise no_number(names, key[0], "an array of names")
            key = names.index(key[1]) if names and key[1] in names else len(value)
        value = value[key] if key < len(value) else None
    if value is None or isinstance(value, int | float):
        return value
    if isinstance(value, list):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number,")
    raise no_number(value, path, "a number")


def no_number(value: Any, way: str, expected: str) -> NoNumberError:
    shown = json.dumps(value, ensure_ascii=False)
    shown = shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}..."
    what = f"field '{way}'" if way else "the whole"
    return NoNumberError(f"{what} is {shown}, not {expected},")


def describe_json(text: bytes) -> list[FieldDescription]:
    return list(described_value(json.loads(text), "", {}))


def described_value(value: Any, path: str, texts: Mapping[str, Sequence[str]]) -> Iterator[FieldDescription]:
    """The fields of one JSON value; `texts` are the arrays of text beside it."""
    if isinstance(value, dict):
        inner = {path_to(path, name): one for name, one in value.items()}
        beside = {name: one for name, one in inner.items() if is_array_of(one, str)}
        for name, one in inner.items():
            yield from described_value(one, name, beside)
    elif is_array_of(value, int | float):
        yield FieldDescription(path, np.dtype(type(value[0])).name, len(value), array_labels(path, len(value), texts))
    elif isinstance(value, list):
        yield from described_value(value[0], f"{path}[0]", {}) if value else ()
    elif isinstance(value, int | float):
        yield FieldDescription(path, np.dtype(type(value)).name)


def is_array_of(value: Any, kind: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, kind) for one in value)


PROTOBUF_TYPES = ("", "int32", "int64", "uint32", "uint64", "float64", "float32", "bool", "int32")
"""Types of numbers by `FieldDescriptor.cpp_type`; the last one is an enumeration."""


def protobuf_decoder(schema: Schema) -> Callable[[bytes], Any]:
    """Makes a message of google.protobuf; refuses what does not fit the schema."""
    from google.protobuf.message import DecodeError  # these cost time to import, and few logs need them
    from mcap.exceptions import McapError
    from mcap_protobuf.decoder import DecoderFactory

    try:
        decode = DecoderFactory().decoder_for("protobuf", schema)
        if decode is None:
            raise TypeError(f"its encoding is '{schema.encoding}'")
        decode(b"")
    except (McapError, DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"schema {schema.name}: cannot be read: {' '.join(str(error).split())}") from error

    def checked(payload: bytes) -> Any:
        try:
            return decode(payload)
        except DecodeError:
            text = f"a message of {len(payload)} bytes is not what its schema says, or is damaged"
            raise InputError(text) from None

    return checked


def protobuf_number(message: Any, path: str) -> float | bool | None:
    """The number at a path; None where there is none, also where a field that is optional is not written."""
    value, parent = message, None
    for key, _ in steps_of(path):
        if isinstance(key, str):
            parent, value = value, protobuf_field(value, key)
            continue
        if isinstance(key, tuple):
            names = list(protobuf_field(parent, key[0]) or ())
            key = names.index(key[1]) if key[1] in names else -1
        is_array = hasattr(value, "__getitem__") and not isinstance(value, str | bytes | Mapping)
        value = value[key] if is_array and 0 <= key < len(value) else None
    if value is None or isinstance(value, int | float):
        return value
    if hasattr(value, "__len__") and not isinstance(value, str | bytes | Mapping) and len(value):
        raise WholeArrayError(f"field '{path}' is an array of {len(value)}, not one number")
    return None


def protobuf_field(message: Any, name: str) -> Any:
    descriptor = getattr(message, "DESCRIPTOR", None)
    item = descriptor.fields_by_name.get(name) if descriptor is not None else None
    if item is None or (item.has_presence and not message.HasField(name)):
        return None
    return getattr(message, name)


def describe_protobuf(schema: Schema, payload: bytes | None) -> list[FieldDescription]:
    return list(described_message(protobuf_decoder(schema)(payload or b""), ""))


def described_message(message: Any, prefix: str) -> Iterator[FieldDescription]:
    """The fields of one message: numbers that are always there first, then what is written."""
    fields = message.DESCRIPTOR.fields
    texts = {
        prefix + item.name: list(getattr(message, item.name)) for item in fields if item.is_repeated and item.type == 9
    }
    plain = [f for f in fields if not f.is_repeated and not f.has_presence and f.cpp_type < len(PROTOBUF_TYPES)]
    for item in [*plain, *sorted((one for one in fields if one not in plain), key=lambda one: one.number)]:
        path, value = prefix + item.name, protobuf_field(message, item.name)
        if item.message_type is not None and item.message_type.GetOptions().map_entry:
            continue
        if value is None or (item.is_repeated and not value):
            continue
        if item.message_type is not None:
            yield from described_message(value[0] if item.is_repeated else value, f"{path}{'[0]' * item.is_repeated}.")
        elif item.cpp_type < len(PROTOBUF_TYPES):
            length = len(value) if item.is_repeated else None
            labels = array_labels(path, length, texts) if item.is_repeated else ()
            yield FieldDescription(path, PROTOBUF_TYPES[item.cpp_type], length, labels)
