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
NUMBERS = (int, float, bool)
NO_TEXTS: Mapping[str, Any] = {}

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
                    found = {path: number_at(message, path) for path in self.paths}
                except NoNumberError as error:
                    self.no_numbers += 1
                    self.note(f"{error} in message {self.before + row + 1}")
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

    return ObjectReader(paths, decode)


def number_at(message: Any, path: str) -> float | bool | None:
    """The number at a path of an object; None where a field is absent, `null` or not written, or an array too short.

    Raises NoNumberError where something else stands.
    """
    value, parent = message, None
    for key, way in steps_of(path):
        if value is None:
            return None
        if isinstance(key, str):
            parent, value = value, member(value, key, way)
            continue
        if not is_array(value):
            raise no_number(value, way, "an array")
        if isinstance(key, tuple):
            names = None if parent is None else member(parent, key[0])
            if names is not None and not is_array(names):
                raise no_number(names, key[0], "an array of names")
            key = names.index(key[1]) if names and key[1] in names else len(value)
        value = value[key] if key < len(value) else None
    if value is None or value.__class__ in NUMBERS:
        return value
    if not is_array(value):
        raise no_number(value, path, "a number")
    if len(value):
        raise NoNumberError(f"field '{path}' is an array of {len(value)}, not one number,")
    return None


def no_number(value: Any, way: str, expected: str) -> NoNumberError:
    shown = json.dumps(value, ensure_ascii=False, default=lambda one: " ".join(str(one).split()))
    shown = shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}..."
    what = f"field '{way}'" if way else "the whole"
    return NoNumberError(f"{what} is {shown}, not {expected},")


def is_record(value: Any) -> bool:
    return isinstance(value, dict) or hasattr(value, "DESCRIPTOR")


def is_array(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def is_array_of(value: Any, kind: Any) -> bool:
    return is_array(value) and len(value) > 0 and all(isinstance(one, kind) for one in value)


def member(record: Any, name: str, way: str = "") -> Any:
    """A field of an object of JSON or a message of protobuf, which stands at the path `way`.

    None where it is absent, or optional and not written; raises NoNumberError where there is no object.
    """
    if record.__class__ is dict:
        return record.get(name)
    descriptor = getattr(record, "DESCRIPTOR", None)
    if descriptor is None:
        raise no_number(record, way, "an object with fields")
    item = descriptor.fields_by_name.get(name)
    if item is None or (item.has_presence and not record.HasField(name)):
        return None
    return getattr(record, name)


def described(value: Any, path: str, kind: str = "", texts: Mapping[str, Any] = NO_TEXTS) -> Iterator[FieldDescription]:
    """The numbers of one value, of the type `kind` if its schema names one; `texts` are arrays of text beside it."""
    if is_record(value):
        inner = {path_to(path, name): (member(value, name), of) for name, of in types_of(value).items()}
        beside = {name: list(one) for name, (one, _) in inner.items() if is_array_of(one, str)}
        for name, (one, of) in inner.items():
            yield from described(one, name, of, beside)
    elif is_array_of(value, int | float):
        labels = array_labels(path, len(value), texts)
        yield FieldDescription(path, kind or np.dtype(type(value[0])).name, len(value), labels)
    elif is_array(value):
        yield from described(value[0], f"{path}[0]") if value else ()
    elif isinstance(value, int | float):
        yield FieldDescription(path, kind or np.dtype(type(value)).name)


PROTOBUF_TYPES = ("", "int32", "int64", "uint32", "uint64", "float64", "float32", "bool", "int32")
"""Types of numbers by `FieldDescriptor.cpp_type`; the last one is an enumeration."""


def types_of(record: Any) -> dict[str, str]:
    """The fields of an object with their types, as far as a schema names these; maps of protobuf are none."""
    if isinstance(record, dict):
        return dict.fromkeys(record, "")
    fields = [f for f in record.DESCRIPTOR.fields if not f.message_type or not f.message_type.GetOptions().map_entry]
    return {one.name: PROTOBUF_TYPES[one.cpp_type] if one.cpp_type < len(PROTOBUF_TYPES) else "" for one in fields}


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
