"""Addresses of numbers in a MATLAB file, in MATLAB's own notation: `Test.Slow(2).data(:,3)`, `runs{2}.torque`.

An element of an array of structs is chosen by its number, counted from 1, or by the value of a field:
`runs(name=slow).torque`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats.mat.values import Value, real_numbers
from osl_analysis.trial import Array

STEP = re.compile(
    r"\.?(?P<name>[A-Za-z]\w*)"
    r"|\((?P<field>[A-Za-z]\w*)=(?P<value>[^()]*)\)"
    r"|\((?P<number>[1-9]\d{0,8})\)|\{(?P<cell>[1-9]\d{0,8})\}"
    r"|\(:,(?P<column>[1-9]\d{0,8})\)|\((?P<row>[1-9]\d{0,8}),:\)"
)
LISTED = 12
"""Largest number of names in a message."""


@dataclass(frozen=True)
class Address:
    """An address, in the steps of `STEP`."""

    text: str
    """As it was written."""
    steps: tuple[Mapping[str, str], ...]
    """The groups of `STEP` that each step has."""

    @property
    def variable(self) -> str:
        """The variable of the file that it leads into."""
        return self.steps[0]["name"]

    def below(self, part: "Address | None") -> "Address":
        """The same address within a part of the file; that itself if it begins with `/`, or without a part."""
        if part is None or self.text.startswith("/"):
            return self
        joint = "" if "name" not in self.steps[0] else "."
        return Address(f"{part.text}{joint}{self.text}", (*part.steps, *self.steps))


def parsed(text: str, inside: bool = False) -> Address:
    """An address; `inside`: it is one within a part, which may also begin with a choice of a column, as `(:,2)`.

    Raises
    ------
    InputError
        It is none.
    """
    plain, at = re.sub(r"\s*([(){}.,:=])\s*", r"\1", text.strip()).removeprefix("/"), 0
    steps: list[Mapping[str, str]] = []
    while at < len(plain):
        found = STEP.match(plain, at)
        named = found is not None and found["name"] is not None
        if found is None or (named and (found[0][0] == ".") != (at > 0)):
            break
        steps.append({key: value for key, value in found.groupdict().items() if value is not None})
        at = found.end()
    if at < len(plain) or not steps or not ("name" in steps[0] or inside):
        raise InputError(
            f"'{text}' is no address in a MATLAB file; write it as in MATLAB, such as `Test.run(2).torque`, "
            "`Test.data(:,3)`, `runs{2}.torque`, or `runs(name=slow).torque`"
        )
    return Address(text.strip(), tuple(steps))


def find(variables: Mapping[str, Value], names: Sequence[str], address: Address) -> Value:
    """What stands at an address. `names` are those of all variables of the file, for messages.

    Raises
    ------
    InputError
        Nothing does; the message names the step that fails, and what is there.
    """
    first, *steps = address.steps
    value = variables.get(first["name"])
    if value is None:
        raise InputError(no_such(address, "the file", first["name"], "variable", names))
    so_far = first["name"]
    for step in steps:
        value = one_step(value, step, so_far, address)
        so_far += written(step)
    return value


def written(step: Mapping[str, str]) -> str:
    """A step as it stands in an address."""
    forms = {"name": ".{}", "number": "({})", "cell": "{{{}}}", "column": "(:,{})", "row": "({},:)"}
    if "field" in step:
        return f"({step['field']}={step['value']})"
    ((key, value),) = step.items()
    return forms[key].format(value)


def no_such(address: Address, place: str, name: str, what: str, known: Sequence[str]) -> str:
    """A message about an unknown name."""
    return f"{address.text}: {place} has no {what} '{name}'; it has {listing(known, LISTED)}{nearest(name, known)}"


def one_step(value: Value, step: Mapping[str, str], place: str, address: Address) -> Value:
    """What one step leads to from the value at a place; raises as `find`."""
    if "name" in step:
        return field_of(value, step["name"], place, address)
    if "column" in step or "row" in step:
        return line_of(value, step, place, address)
    if "cell" in step:
        if value.kind != "cell":
            raise InputError(f"{address.text}: {place} is a {value.described()}, no cell; leave out {written(step)}")
        cell: Value = element(value.cells, int(step["cell"]), place, address)
        return cell
    if "field" in step:
        return chosen(value, step, place, address)
    if value.kind == "struct":
        fields = element(value.elements, int(step["number"]), place, address)
        return Value("struct", fields=value.fields, elements=[fields])
    if value.kind == "cell":
        raise InputError(f"{address.text}: {place} is a cell; write {{{step['number']}}} for ({step['number']})")
    raise InputError(f"{address.text}: {place} is a {value.described()}; write (:,{step['number']}) for its column")


def field_of(value: Value, name: str, place: str, address: Address) -> Value:
    """A field of a struct; raises as `find`."""
    if value.kind != "struct":
        remedy = f"; {value.remedy()}" if value.load is None and value.kind != "cell" else ""
        raise InputError(f"{address.text}: {place} is a {value.described()}, no struct with fields{remedy}")
    if name not in value.fields:
        raise InputError(no_such(address, place, name, "field", value.fields))
    if len(value.elements) != 1:
        raise InputError(
            f"{address.text}: {place} is an array of {len(value.elements)} structs; choose one, as {place}(1), or "
            f"{place}(field=value)"
        )
    return value.elements[0][name]


def element(elements: Sequence[Any], number: int, place: str, address: Address) -> Any:
    """One element, counted from 1; raises as `find`."""
    if number > len(elements):
        raise InputError(f"{address.text}: {place} has {len(elements)} elements; choose one of 1 to {len(elements)}")
    return elements[number - 1]


def chosen(value: Value, step: Mapping[str, str], place: str, address: Address) -> Value:
    """The one element of an array of structs whose field has a value; raises as `find`."""
    if value.kind != "struct" or step["field"] not in value.fields:
        raise InputError(no_such(address, place, step["field"], "field", value.fields))
    labels = [label_of(fields[step["field"]]) for fields in value.elements]
    fitting = [fields for fields, label in zip(value.elements, labels, strict=True) if label == step["value"].strip()]
    if len(fitting) != 1:
        raise InputError(
            f"{address.text}: {len(fitting)} elements of {place} have {step['field']} = {step['value']}; they are "
            f"{listing(labels, LISTED)}"
        )
    return Value("struct", fields=value.fields, elements=fitting)


def label_of(value: Value) -> str:
    """Text or single number, by which an element is chosen; empty for anything else."""
    if value.kind == "char":
        return value.text.strip()
    return f"{value.load().item():g}" if value.load is not None and value.size == 1 else ""


def line_of(value: Value, step: Mapping[str, str], place: str, address: Address) -> Value:
    """One column or row of a matrix; raises as `find`."""
    numbers = real_numbers(f"{address.text}: {place}", value)
    axis, number = (1, int(step["column"])) if "column" in step else (0, int(step["row"]))
    if numbers.ndim != 2 or number > numbers.shape[axis]:
        raise InputError(f"{address.text}: {place} is a {value.described()}; it has no {written(step)}")
    line: Array = np.take(numbers, number - 1, axis=axis)
    return Value(value.kind, (line.size, 1), load=lambda: line[:, np.newaxis])


def vector(address: Address, value: Value) -> Array:
    """The numbers (n,) of a signal.

    Raises
    ------
    InputError
        They are no real numbers, none, or a matrix.
    """
    numbers = real_numbers(address.text, value)
    if numbers.ndim > 2:
        raise InputError(f"{address.text} is a {value.described()}; save each of its matrices as a variable of its own")
    if max(numbers.shape) != numbers.size:
        raise InputError(
            f"{address.text} is a {value.described()}; choose one column, as {address.text}(:,1), or one row, as "
            f"{address.text}(1,:)"
        )
    return numbers.ravel()
