"""Fingerprints of the code of jobs: of a step's command and of everything of the package that it
uses, name by name.

A module is a list of statements, each with the names that it binds and the names that it uses, own
and imported. From the command, all used statements are followed through the modules of the package.
So a job runs again if a function changes that it may call. Another function, a comment, a docstring
or an empty line does not matter."""

import ast
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from osl_analysis.files import PACKAGE, write_text

TEXT = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Statement(NamedTuple):
    """A statement of a module, without docstrings and comments."""

    code: str  # first digits of its SHA-256
    binds: Sequence[str]  # names; empty for a statement that runs whenever the module is imported
    uses: Sequence[str]  # dotted names below `osl_analysis.`
    data: Sequence[str]  # texts that may name files beside the module


class Module(NamedTuple):
    statements: Sequence[Statement]
    imports: Mapping[str, str]  # dotted names below `osl_analysis.`, by their names in the module


class Sources:
    """The modules of the package as they are now, by dotted name. Results of parsing are cached in
    a file: parsing all modules takes a second."""

    def __init__(self, kept: Path | None = None) -> None:
        self.kept, self.used = kept, set[str]()
        try:
            self.known = json.loads(kept.read_text(encoding="utf-8")) if kept else {}
        except (OSError, ValueError):
            self.known = {}
        self.before = {*self.known}

    def write(self) -> None:
        """Write the cache, with the results for present texts only."""
        if self.kept is not None and self.used - self.before:
            write_text(self.kept, json.dumps({key: self.known[key] for key in sorted(self.used)}))

    def of_text(self, text: str, parse: Callable[[], Any]) -> Any:
        """The result of parsing a text, from the cache if it is there."""
        self.used.add(key := fingerprint(text))
        if key not in self.known:
            self.known[key] = parse()
        return self.known[key]

    @cache  # noqa: B019 (there is one for each run)
    def module(self, name: str) -> Module:
        text = text_of(module_file(name))
        statements, imports = self.of_text(name + text, lambda: parsed(text, name))
        return Module([Statement(*one) for one in statements], imports)

    @cache  # noqa: B019
    def data(self, path: Path) -> str:
        """Fingerprint of a file beside a module; of YAML without comments."""
        text, is_yaml = text_of(path), path.suffix == ".yaml"
        said = self.of_text(
            text, lambda: fingerprint(repr(yaml.load(text, yaml.CSafeLoader)) if is_yaml else text)
        )
        return str(said)

    def code(self, *roots: str) -> str:
        """Fingerprint of commands or modules, named below `osl_analysis`, and of all code of the
        package they use."""
        found, seen, new = set[str](), set[str](), [*roots]
        while new:
            if (dotted := new.pop()) in seen:
                continue
            seen.add(dotted)
            parts = dotted.split(".")
            ends = (end for end in range(len(parts), 0, -1) if module_file(".".join(parts[:end])))
            if not (end := next(ends, 0)):
                continue
            # no name: the whole module is used
            module, name = ".".join(parts[:end]), "".join(parts[end : end + 1])
            of = self.module(module)
            if name in of.imports:
                new.append(of.imports[name])
            for one in of.statements:
                if not name or not one.binds or name in one.binds:
                    found.add(f"{module} {one.code}")
                    found |= {self.data(path) for path in data_of(module, one)}
                    new += one.uses
        return fingerprint("".join(sorted(found)))


def fingerprint(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def text_of(file: Path | None) -> str:
    assert file is not None
    return file.read_text(encoding="utf-8")


def parsed(text: str, name: str) -> tuple[list[Statement], dict[str, str]]:
    """The content of `Module` for the text of a module."""
    body = [node for node in ast.parse(text).body if not is_docstring(node)]
    imports = dict(pair for node in body for pair in imported(node))
    binds = [sorted(names_bound(node)) for node in body]
    known = {bound: f"{name}.{bound}" for names in binds for bound in names} | imports
    statements = []
    for node, names in zip(body, binds, strict=True):
        if isinstance(node, ast.Import | ast.ImportFrom):
            continue
        said, named, texts, inner_imports = content_of(node)
        here, used = known | inner_imports, (one.partition(".") for one in named)
        uses = sorted({here[first] + dot + rest for first, dot, rest in used if first in here})
        data = sorted(text for text in texts if re.fullmatch(r"[\w./]*\.[a-z]+", text))
        statements.append(Statement(fingerprint(said), names, uses, data))
    return statements, imports


def content_of(statement: ast.stmt) -> tuple[str, set[str], set[str], dict[str, str]]:
    """The code of a statement without docstrings, comments and layout; the names that it uses, with
    attributes, as `components.belt_trial`; its texts; its imports from the package."""
    said, names, texts, imports, left = (
        list[str](),
        set[str](),
        set[str](),
        dict[str, str](),
        list[Any]([statement]),
    )
    while left:
        node, attributes = left.pop(), ""
        while (kind := type(node)) is ast.Attribute:
            attributes, node = f".{node.attr}{attributes}", node.value
        said += attributes, kind.__name__ if isinstance(node, ast.AST) else repr(node)
        if kind is ast.Name:
            names.add(node.id + attributes)
        elif kind is ast.Constant and type(node.value) is str:
            texts.add(node.value)
        elif kind in (ast.Import, ast.ImportFrom):
            imports |= imported(node)
        elif kind in TEXT:
            node.body = [one for one in node.body if not is_docstring(one)] or [ast.Pass()]
        for name in getattr(kind, "_fields", ()):
            if type(value := getattr(node, name)) is list:
                said.append(f"{name} {len(value)}")
                left += value
            elif not isinstance(value, ast.AST):
                said.append(f"{name} {value!r}")
            elif name != "ctx":
                left.append(value)
    return "\n".join(said), names, texts, imports


def is_docstring(node: ast.stmt) -> bool:
    """Whether a statement is a docstring, or a text behind the field that it describes."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def imported(node: ast.AST) -> Iterator[tuple[str, str]]:
    """The names that an import from the package binds, and their dotted names below
    `osl_analysis.`."""
    if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("osl_analysis."):
        above = f"{node.module}.".removeprefix("osl_analysis.")
        yield from ((one.asname or one.name, above + one.name) for one in node.names)
    elif isinstance(node, ast.Import):
        ours = (one for one in node.names if one.name.startswith("osl_analysis."))
        yield from (
            (one.asname or one.name, one.name.removeprefix("osl_analysis.")) for one in ours
        )


def names_bound(node: ast.stmt) -> Iterator[str]:
    """The names that a statement binds in its module; none for one that acts, such as a loop or a
    call."""
    if isinstance(node, TEXT):
        yield node.name
    elif isinstance(node, ast.Assign | ast.AnnAssign | ast.If | ast.Try):
        yield from (
            one.id
            for one in ast.walk(node)
            if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
        )


@cache
def module_file(name: str) -> Path | None:
    """File of a module, by its dotted name below `osl_analysis`; None if the name is not a
    module."""
    path = PACKAGE.joinpath(*name.split("."))
    return next(
        (one for one in (path.with_suffix(".py"), path / "__init__.py") if one.is_file()), None
    )


def data_of(module: str, statement: Statement) -> Iterator[Path]:
    """The files beside a module that a statement names: `table.yaml`, or `.yaml` for a file with
    the module's name."""
    file = module_file(module) or PACKAGE
    for text in statement.data:
        path = (
            file.with_suffix(text)
            if re.fullmatch(r"\.\w+", text)
            else (file.parent / text).resolve()
        )
        if path.suffix != ".py" and path.is_file():
            yield path
