"""Fingerprints of source code. They decide which jobs run again after a change of the program.

Snakemake does not see a change in an imported module. Each rule therefore has the fingerprint of its job's code as a
parameter. A change of an estimator runs only the jobs that use it again.
"""

import ast
import hashlib
import re
from functools import cache
from pathlib import Path

from osl_analysis.files import PACKAGE

FROM = re.compile(r"from(?<!\wfrom)[ \t]+(?P<module>osl_analysis[\w.]*)[ \t]+import[ \t]*(?P<names>\([^)]*\)|[^\n;]*)")
IMPORT = re.compile(r"import(?<![\w.]import)[ \t]+(?P<names>[^\n;]*\bosl_analysis\.[^\n;]*)")
"""Both begin with their word: `re` looks for it twenty times as fast as for what may stand before it."""
COMMENT = re.compile(r"#[^\n]*")


@cache
def code(command: str, *modules: str) -> str:
    """Fingerprint of a command, `module.function` under `osl_analysis.commands`, and of the modules that it uses.

    It covers the module's file and the imports that this function uses, because a module has jobs of several
    experiments; and `modules` under `osl_analysis` that it imports by name, with all that they import.
    """
    module, _, function = command.partition(".")
    files = job_sources(f"osl_analysis.commands.{module}", function)
    files |= {path for one in modules for path in sources(f"osl_analysis.{one}")}
    return hashlib.sha256(b"".join(map(content, sorted(files)))).hexdigest()[:16]


@cache
def content(path: Path) -> bytes:
    """Content of a source file, as it was when it was asked for first."""
    return path.read_bytes()


@cache
def statements(path: Path) -> list[ast.stmt]:
    """The statements of a module."""
    return ast.parse(content(path)).body


def job_sources(module: str, function: str) -> set[Path]:
    """The file of a module, and the files behind the imported names that one of its functions uses."""
    path = module_file(module)
    top = statements(path) if path else []
    defined = {getattr(node, "name", ""): node for node in top}
    if path is None or function not in defined:
        raise ValueError(f"no function {function} in {module}; correct the name of the job in the rules")
    used, waiting = set[str](), {function}
    while waiting:
        used |= waiting
        inside = [ast.walk(defined[name]) for name in waiting if name in defined]
        waiting = {node.id for nodes in inside for node in nodes if isinstance(node, ast.Name)} - used
    imports = [(node.module, alias.name) for node in top if isinstance(node, ast.ImportFrom) for alias in node.names]
    names = [f"{source}{end}" for source, name in imports if name in used for end in ("", f".{name}")]
    return {path, *(file for name in names if name.startswith("osl_analysis.") for file in sources(name))}


def sources(module: str) -> list[Path]:
    """Files of a module and of all modules of the package that it imports, sorted."""
    files: set[Path] = set()
    waiting = [module_file(module)]
    while waiting:
        path = waiting.pop()
        if path is not None and path not in files:
            files.add(path)
            waiting += [module_file(name) for name in imported_names(path)]
    return sorted(files)


@cache
def imported_names(path: Path) -> tuple[str, ...]:
    """Dotted names of the package that a source file imports, at any place in it.

    They are found by their text: parsing every module takes 0.8 s, and Snakemake does it anew in each run. A text in a
    string that reads like an import counts too; it can only make a result again that need not be.
    """
    names: list[str] = []
    text = content(path).decode().replace("\\\n", " ")
    for match in (*FROM.finditer(text), *IMPORT.finditer(text)):
        module, imported = match.groupdict().get("module", ""), COMMENT.sub("", match["names"])
        found = [name.split()[0] for name in imported.strip("() \t").split(",") if name.strip()]
        names += [module, *(f"{module}.{name}" for name in found)] if module else found
    return tuple(name for name in names if name.startswith("osl_analysis."))


@cache
def module_file(name: str) -> Path | None:
    """File of a dotted module name of the package; None if the name is not a module."""
    path = PACKAGE.joinpath(*name.split(".")[1:])
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)
