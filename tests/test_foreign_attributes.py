"""No attribute of Snakemake, of a plug-in or of any other package of it is replaced in a run."""

import subprocess
import sys

from conftest import ROOT

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
