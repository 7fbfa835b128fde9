"""The process from which jobs are forked: it has done all imports, so that a job begins with its work."""

import multiprocessing
import multiprocessing.util
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from types import ModuleType
from typing import Any

from osl_analysis.errors import InputError

PRELOADED = [
    "osl_analysis.undisturbed",  # the first: Ctrl-C does not end the imports
    "scipy.signal",  # our modules name these at their use: the workflow is read without them
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.linalg",
    "scipy.fft",
    "osl_analysis.commands.trials",
    "osl_analysis.commands.bench",
    "osl_analysis.commands.simulate",
    "osl_analysis.commands.crossing",
    "osl_analysis.commands.walking",
    "osl_analysis.commands.tables",
    "osl_analysis.commands.figure",
    "osl_analysis.simulator.bench",
    "osl_analysis.simulator.walking",
    "osl_analysis.simulator.preloaded",
    "osl_analysis.figures.names",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "matplotlib.backends.backend_agg",
    "fontTools.subset",
    "osl_analysis.frozen",  # the last: it keeps what the others have made
]
OF_SIMULATOR = {"osl_analysis.commands.simulate"} | {name for name in PRELOADED if ".simulator." in name}
"""What only simulating jobs use. In a new clone it compiles for 2 s."""
OF_DRAWINGS = {"osl_analysis.figures.names", "fontTools.subset"} | {name for name in PRELOADED if "matplotlib" in name}
"""What only jobs use that draw: half a second."""
NO_JOBS = {"--lint", "--dag", "--rulegraph", "--filegraph", "--d3dag", "--summary", "--unlock", "--report", "--list"}
NO_JOBS |= {"-n", "--dry-run", "--dryrun", "--touch", "--delete-all-output", "--archive", "--print-compilation"}
"""Options of Snakemake with which it runs no job."""
STUDY = {"study", "validate"}
"""Targets that simulate in every campaign."""
TABLES = {".csv", ".parquet", ".zip"}
"""Suffixes of targets for which nothing is drawn."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS", "NUMBA_NUM_THREADS")
LONGEST_PLACE = 70
"""Largest length [bytes] of the folder for temporary files: a socket's path has 107, of which our part takes 32."""


@cache
def fork_server(
    spared: frozenset[str] = frozenset(),
) -> multiprocessing.context.ForkServerContext | multiprocessing.context.SpawnContext:
    """The process from which jobs are forked. Each job uses one thread, because Snakemake counts one core per job.

    It runs from its first use on, without the modules that are `spared` then. Where a system cannot fork, as Windows,
    each job starts Python anew.
    """
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([name for name in PRELOADED if name not in spared])
    make_folder_of_sockets()
    return context


def rarely_used(config: Mapping[str, Any], arguments: Sequence[str]) -> frozenset[str]:
    """Modules that no job, or hardly one, uses in a run; each job that does so imports them itself.

    `config` are the fields that override the default, which simulates with a parameter file; `arguments` are those of
    Snakemake. Who asks for a table has none drawn.
    """
    simulates = config.get("simulation", True) is not None or not STUDY.isdisjoint(arguments)
    draws = not any(Path(one).suffix in TABLES and "=" not in one for one in arguments)
    unused = [(simulates, OF_SIMULATOR), (draws, OF_DRAWINGS)]
    return frozenset(name for used, names in unused if not used for name in names)


def start_early(config: Mapping[str, Any]) -> None:
    """Start that process while the workflow is still read: its imports take another core as long as that.

    Not where Snakemake runs no job. What keeps it from starting is said by the first job. `config` are the fields that
    override the default.
    """
    if NO_JOBS.isdisjoint(sys.argv):
        with suppress(InputError, OSError):
            if fork_server(rarely_used(config, sys.argv)).get_start_method() == "forkserver":
                forkserver.ensure_running()


@contextmanager
def without_main() -> Iterator[None]:
    """While a process is started: let it not import the script of Snakemake, of which no job needs anything.

    `multiprocessing` imports the main module into each process. Snakemake's takes half a second.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def make_folder_of_sockets() -> None:
    """Make the folder in which `multiprocessing` puts its sockets, in a short place if TMPDIR is too long for them.

    Raises
    ------
    InputError
        There is no short place to write to.
    """
    stated, places = tempfile.gettempdir(), (*filter(None, [tempfile.gettempdir()]), "/tmp", "/var/tmp", "/dev/shm")
    for place in places:
        if len(os.fsencode(place)) <= LONGEST_PLACE and os.access(place, os.W_OK):
            try:
                tempfile.tempdir = place
                multiprocessing.util.get_temp_dir()
            finally:
                tempfile.tempdir = stated
            return
    raise InputError(
        f"TMPDIR {stated}: {len(os.fsencode(stated))} characters are too long for the sockets of the jobs, which allow "
        f"{LONGEST_PLACE}; set TMPDIR to a shorter folder that can be written to"
    )
