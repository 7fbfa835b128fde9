"""What a successor has to hold in the head, kept by the machine: `python tools/weight.py` compares
it with weight.json beside it, and fails where a measure is more than 2 % above the value kept
there. `--keep` writes what it is now.

A measure that fell is kept with the change that made it fall. Raising one is a commit of its own:
CONTRIBUTING.md."""

import ast
import json
import sys
from collections import Counter
from pathlib import Path

from radon.complexity import cc_rank, cc_visit

ROOT = Path(__file__).parents[1]
KEPT = Path(__file__).with_suffix(".json")
ALLOWED = 1.02


def named(module: ast.Module) -> set[str]:
    """The functions, classes and constants of a module."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    bound = [node for node in module.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    targets = [
        target for node in bound for target in getattr(node, "targets", None) or [node.target]
    ]
    constants = {
        name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
    }
    return {node.name for node in module.body if isinstance(node, kinds)} | {
        name for name in constants if not name.startswith("__")
    }


def definitions(module: ast.Module) -> int:
    """How many names a module defines: its own, and the methods and fields of its classes."""
    classes = [node for node in ast.walk(module) if isinstance(node, ast.ClassDef)]
    members = [
        part
        for each in classes
        for part in each.body
        if isinstance(part, ast.FunctionDef | ast.AnnAssign)
    ]
    nested = [each for each in classes if each not in module.body]
    return len(named(module)) + len(members) + len(nested)


def measures() -> tuple[dict[str, int], list[str]]:
    """By name, of this checkout; and the names that stand in two modules or more."""
    texts = [path.read_text() for path in sorted((ROOT / "osl_analysis").rglob("*.py"))]
    modules = [ast.parse(text) for text in texts]
    rules = [ROOT / "Snakefile", *(ROOT / "rules").rglob("*.smk")]
    uses = Counter(name for module in modules for name in named(module))
    twice = sorted(name for name, count in uses.items() if count > 1)
    return {
        "package lines": sum(text.count("\n") for text in texts),
        "test lines": sum(path.read_text().count("\n") for path in (ROOT / "tests").rglob("*.py")),
        "lines of rules and Snakefile": sum(path.read_text().count("\n") for path in rules),
        "modules": len(modules),
        "definitions": sum(map(definitions, modules)),
        "names in two or more modules": len(twice),
        "blocks of complexity D or worse": sum(
            cc_rank(block.complexity) >= "D" for text in texts for block in cc_visit(text)
        ),
    }, twice


def main() -> int:
    now, twice = measures()
    if "--keep" in sys.argv[1:]:
        KEPT.write_text(json.dumps(now, indent=2) + "\n")
    kept = json.loads(KEPT.read_text())
    above = [name for name, value in now.items() if value > ALLOWED * kept[name]]
    for name, value in now.items():
        too_much = (
            ": more than 2 % above. Delete, or raise it in a commit of its own that says what was"
            " bought"
        )
        print(f"{name}: {value}, kept {kept[name]}" + too_much * (name in above))
    if above:
        print(f"in two or more modules: {', '.join(twice)}")
    return len(above)


if __name__ == "__main__":
    sys.exit(main())
