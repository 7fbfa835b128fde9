"""`osl-analysis doctor --upgrade`: make a campaign of an earlier release one of this."""

import re
import shutil
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.reference import write_schemas
from osl_analysis.errors import InputError, Removal, RemovedFieldError
from osl_analysis.files import atomic_path, root
from osl_analysis.renamed import RenamedWarning
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.yaml_settings import dotted, parsed_yaml, read_yaml


def upgraded_campaign(config_path: Path) -> Iterator[str]:
    """Upgrade a configuration, the files of the simulator that it names and that are the campaign's
    own, and the schemas of all these for editors.

    Yields and raises what `upgraded_fields` does, each line with the name of its file.
    """
    yield from upgraded_fields(config_path, read_config)
    schemas = config_path.parent / "schemas"
    if schemas.is_dir():
        write_schemas(schemas)
    simulation = read_config(config_path).simulation
    if simulation is None or is_shipped(simulation):
        return
    yield from upgraded_fields(simulation, lambda path: read_yaml(path, SimulationSettings))
    laboratory = read_yaml(simulation, SimulationSettings).walking
    if laboratory is not None and not is_shipped(laboratory):
        yield from upgraded_fields(laboratory, lambda path: read_yaml(path, WalkingSettings))


def is_shipped(path: Path) -> bool:
    """Whether a file is one of the package."""
    return path.resolve().is_relative_to(root().resolve())


def upgraded_fields(path: Path, read: Callable[[Path], Any]) -> Iterator[str]:
    """Rename the fields of a file that have another name in this release, and remove those that are
    gone, until there is none. All else in the file stays as it is, and the file of before stays
    beside it.

    Parameters
    ----------
    path : Path
        A file of the campaign.
    read : callable
        Reads and validates it.

    Yields
    ------
    str
        What was written for each field, and what to use instead of one that is gone.

    Raises
    ------
    InputError
        The file has another mistake, such as a field with both its old and its new name, which only
        its author can correct.
    """
    before = path.with_name(f"{path.name}.before-{version('osl-analysis')}")
    while True:
        problem = field_of_earlier_release(path, read)
        if problem is None:
            return
        removal = problem.removal
        text = path.read_bytes().decode("utf-8-sig")
        sections = sections_to(text, removal)
        if not sections:  # it stands in a list, or in an alias
            raise InputError(str(problem)) from problem
        if not before.exists():
            shutil.copy2(path, before)
            yield f"{path.name}: what it was stays as {before.name}"
        field = f"{path.name}: {dotted(removal.place)}"
        if removal.new_name:
            text = with_key(text, sections[-1].key, removal.new_name)
            change = f"{field}: renamed to {removal.new_name}"
        else:
            text = without_field(text, sections)
            change = f"{field}: removed; {removal.instead}"
        with atomic_path(path) as temporary:
            temporary.write_bytes(text.encode())
        yield change


def field_of_earlier_release(
    path: Path, read: Callable[[Path], Any]
) -> RemovedFieldError | RenamedWarning | None:
    """What reading a file says of its first field of an earlier release; None without one."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RenamedWarning)
        try:
            read(path)
        except (RemovedFieldError, RenamedWarning) as problem:
            return problem
    return None


@dataclass(frozen=True)
class Field:
    """A field of a file, as nodes with their places in its text."""

    section: yaml.MappingNode  # that it stands in
    key: yaml.Node
    value: yaml.Node


def sections_to(text: str, removal: Removal) -> list[Field]:
    """The sections on the way to a field, from the outermost, and last the field itself; none if it
    is not written there."""
    node, _ = parsed_yaml(text)
    sections = []
    for name in removal.place:
        if not isinstance(node, yaml.MappingNode):
            return []
        pair = next((pair for pair in node.value if pair[0].value == name), None)
        if pair is None:
            return []
        sections.append(Field(node, *pair))
        node = pair[1]
    return sections


def with_key(text: str, key: yaml.Node, new_name: str) -> str:
    """A text in which a key has another name."""
    return text[: key.start_mark.index] + new_name + text[key.end_mark.index :]


def without_field(text: str, sections: Sequence[Field]) -> str:
    """A text without a field, or without the outermost section that would be empty without it.
    Lines of comments stay."""
    *above, field = sections
    while above and len(field.section.value) == 1:
        field = above.pop()
    before = text[: field.key.start_mark.index]
    behind = text[end_of(field.value, text) :]
    if field.section.flow_style:  # as in {a: 1, b: 2}
        if not behind.lstrip().startswith(","):
            return re.sub(r",\s*$", "", before) + behind
        return before + re.sub(r"^\s*,[ \t]*", "", behind)
    return before[: before.rfind("\n") + 1] + behind.partition("\n")[2]


def end_of(node: yaml.Node, text: str) -> int:
    """Where a value ends in the text. The mark of one that stands in lines is at the next field."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style:
        last = node.value[-1]
        node = last[1] if isinstance(node, yaml.MappingNode) else last
    return len(text[: node.end_mark.index].rstrip())
