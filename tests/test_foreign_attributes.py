"""No attribute of Snakemake, of a plug-in or of any other package is replaced, neither in the source nor in a run."""

import ast
import re
import subprocess
import sys

import pytest
from conftest import ROOT

SOURCES = [*(ROOT / "osl_analysis").rglob("*.py"), *(ROOT / "snakemake_logger_plugin_osl").rglob("*.py")]
WORKFLOW = [ROOT / "Snakefile", *(ROOT / "rules").glob("*.smk")]


def root_name(target: ast.expr) -> str:
    """The name in front of all dots and brackets."""
    while isinstance(target, ast.Attribute | ast.Subscript):
        target = target.value
    return target.id if isinstance(target, ast.Name) else ""


def replaced(text: str) -> list[str]:
    """Assignments to attributes of what a module imports, of a private attribute of another object, and `setattr`."""
    tree, imported = ast.parse(text), {"workflow", "persistence", "dag", "executor", "scheduler"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imported |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
    found = []
    for node in ast.walk(tree):
        targets = node.targets if isinstance(node, ast.Assign | ast.Delete) else [getattr(node, "target", None)]
        for target in targets if isinstance(node, ast.Assign | ast.Delete | ast.AugAssign | ast.AnnAssign) else []:
            is_private = isinstance(target, ast.Attribute) and target.attr.startswith("_")
            foreign = root_name(target) in imported and not ast.unparse(target).startswith("os.environ[")
            if isinstance(target, ast.Attribute | ast.Subscript) and (foreign or is_private):
                found += [ast.unparse(target)] * (foreign or root_name(target) not in ("self", "cls"))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setattr":
            found += [ast.unparse(node)] * (root_name(node.args[0]) in imported)
    return found


@pytest.mark.parametrize(
    "line",
    [
        "import numpy as np\nnp.add = 1",
        "import sys\nsys.modules['__main__'] = 1",
        "def f(workflow):\n    workflow.execute = 1",
        "def f(fast):\n    fast._cache = 1",
        "from snakemake import dag\nsetattr(dag, 'DAG', 1)",
        "import logging\ndel logging.info",
    ],
)
def test_the_search_finds_what_is_replaced(line):
    assert len(replaced(line)) == 1


ALLOWED = {
    "warnings.showwarning",  # the standard library's own way to show warnings otherwise
    "sys.path[0]",  # of a script's own process
    "os.environ",
    "figure.__class__",  # our figure, made for drawing on screen
}


def test_no_module_replaces_an_attribute_of_another_package():
    found = {str(path.relative_to(ROOT)): {*replaced(path.read_text())} - ALLOWED for path in SOURCES}
    assert {path: names for path, names in found.items() if names} == {}


def test_no_rule_replaces_an_attribute():
    replacing = re.compile(r"^\s*(workflow|rules|config|shell|snakemake)(\.\w+)+\s*[-+|]?=[^=]", re.MULTILINE)
    assert [path.name for path in WORKFLOW if replacing.search(path.read_text())] == []


RUN = """
import gc, sys, types
import snakemake.cli, snakemake.dag, snakemake.jobs, snakemake.scheduling.job_scheduler, snakemake.persistence
import snakemake_executor_plugin_slurm

def foreign():
    return {n: m for n, m in sys.modules.items() if n.startswith(("snakemake", "concurrent", "multiprocessing"))
            and not n.startswith("snakemake_logger_plugin_osl")}

def callables():
    found = {}
    for name, module in foreign().items():
        for key, value in list(vars(module).items()):
            if isinstance(value, type) and value.__module__ == name:
                found |= {(name, key, k): v for k, v in vars(value).items() if callable(v) or isinstance(v, property)}
            elif isinstance(value, types.FunctionType):
                found[name, key] = value
    return found

before = callables()
try:
    snakemake.cli.main(sys.argv[1:])
except SystemExit as ended:
    assert ended.code == 0, ended
after = callables()
changed = [key for key in before if after.get(key) is not before[key]]
ours = [key for key, value in after.items()  # Snakemake runs a Snakefile among the names of its own module
        if len(key) == 3 and str(getattr(value, "__module__", "")).startswith("osl_analysis")]
shadowed = []
for thing in gc.get_objects():
    kind = type(thing)
    if not str(kind.__module__).startswith(("snakemake.", "snakemake_executor", "snakemake_interface")):
        continue
    own = getattr(thing, "__dict__", None)
    if type(own) is dict:
        shadowed += [(kind.__name__, key) for key, value in list(own.items()) if isinstance(value, types.FunctionType)
                     and isinstance(getattr(kind, key, None), types.FunctionType)]
heavy = [name for name in sys.modules if name in ("scipy.signal", "scipy.optimize", "scipy.special", "matplotlib")]
print("REPLACED", changed + ours + shadowed, "IMPORTED", heavy)
"""


def test_a_run_leaves_every_function_of_snakemake_and_its_plug_ins_as_it_was(tmp_path):
    """Functions of modules, methods of classes, and methods of single objects, before and after a run of two jobs.

    Nor does it import what jobs alone use, a second of each start.
    """
    (tmp_path / "own.yaml").write_text("results: own\n")
    options = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", "own.yaml", "--cores", "2"]
    command = [sys.executable, "-c", RUN, "own/tables/gains.csv", *options]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "REPLACED [] IMPORTED []\n" in done.stdout, done.stdout + done.stderr
    assert (tmp_path / "own/tables/gains.csv").is_file()
