"""Lines of a YAML file: where a field stands, for messages."""

from collections.abc import Sequence
from pathlib import Path

import yaml

Place = Sequence[int | str]
"""Keys and numbers of list entries that lead to a field, from the outermost."""


def line_of(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field or of the innermost field above it that stands in the file.

    None if not even its outermost key stands there, or if the file cannot be read.
    """
    try:
        node: yaml.Node | None = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return None
    line = None
    for name in place:
        key, node = child(node, name)
        if key is None:
            break
        line = key.start_mark.line + 1
    return line


def child(node: yaml.Node | None, name: int | str) -> tuple[yaml.Node | None, yaml.Node | None]:
    """The node that names an entry, and the entry; None where a node has no such entry."""
    if isinstance(node, yaml.MappingNode):
        return next(((key, value) for key, value in node.value if key.value == str(name)), (None, None))
    if isinstance(node, yaml.SequenceNode) and isinstance(name, int) and name < len(node.value):
        return node.value[name], node.value[name]
    return None, None


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several; empty if none."""
    for file in reversed(files):
        line = line_of(file, place)
        if line is not None:
            return f"line {line}: " if len(files) == 1 else f"line {line} of {file.name}: "
    return ""


def dotted(place: Sequence[int | str]) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))
