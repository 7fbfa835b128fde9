# SPDX-License-Identifier: Apache-2.0
"""The answers of methods to all recordings of a folder, FOLDER/answers.csv:
python benchmarks/peers/answers.py FOLDER [METHOD.py ...]

A method is a file with `estimate(t, theta, torque, **known) -> K, B, I, intervals, doubts`. Arrays
are (n,), in s, rad and N*m; `intervals` has (low, high) of 95 % by name, as far as the method
states any; `doubts` are texts. What it cannot do it refuses by an exception; NotImplementedError is
"not applicable". PACKAGES are the distributions that it uses, whose installed versions are written.
Each answers in a process of its own. Seconds are the processor's, the first recording is done
twice, megabytes are the peak of the process with its imports.
"""

import contextlib
import csv
import importlib.util
import io
import multiprocessing
import os
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path

import numpy as np

METHODS = Path(__file__).with_name("methods")
ESTIMATES = [f"{name}{end}" for name in "KBI" for end in ("", "_low", "_high")]
COLUMNS = ["method", "trial", *ESTIMATES, "doubtful", "seconds", "megabytes", "version"]


def answered(estimate, data, known):
    """The columns of one answer."""
    try:
        *found, intervals, doubts = estimate(*data, **known)
    except NotImplementedError as error:
        return {"doubtful": f"not applicable: {error}"}
    except Exception as error:  # a peer's own errors are of any type
        return {"doubtful": f"refused: {error}"}
    ends = {
        f"{name}_{end}": x
        for name, both in intervals.items()
        for end, x in zip(("low", "high"), both, strict=True)
    }
    return {**dict(zip("KBI", found, strict=True)), **ends, "doubtful": "; ".join(doubts)}


def peak_megabytes():
    """The largest memory of this process, where the system is Linux. `getrusage` begins with that
    of the parent."""
    status = Path("/proc/self/status")
    said = status.read_text().partition("VmHWM:")[2].split() if status.is_file() else []
    return f"{int(said[0]) / 1024:.0f}" if said else ""


def versions(packages):
    """The packages with their installed versions."""
    return ", ".join(f"{package} {version(package)}" for package in packages)


def answers_of(method, folder):
    """The rows of one method."""
    spec = importlib.util.spec_from_file_location(method.stem, method)
    module, rows = importlib.util.module_from_spec(spec), []
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(io.StringIO()),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        spec.loader.exec_module(module)
        used = versions(getattr(module, "PACKAGES", ()))
        for row in csv.DictReader((folder / "truth.csv").open(newline="")):
            data = np.loadtxt(folder / f"{row['trial']}.csv", delimiter=",", skiprows=1).T
            known = {
                name: float(value)
                for name, value in (one.split("=") for one in row["known"].split())
            }
            if not rows:
                answered(module.estimate, data, known)
            began = time.process_time()
            found = answered(module.estimate, data, known)
            cost = {"seconds": f"{time.process_time() - began:.4f}", "megabytes": peak_megabytes()}
            told = {"method": method.stem, "trial": row["trial"], "version": used}
            rows.append({**told, **found, **cost})
    return rows


def write(folder, methods):
    """Let each method answer, one after the other."""
    with (folder / "answers.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        for method in methods:
            print(method.stem, file=sys.stderr, flush=True)
            with multiprocessing.get_context("spawn").Pool(1) as process:
                table.writerows(process.apply(answers_of, (method.resolve(), folder.resolve())))


if __name__ == "__main__":
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    write(Path(sys.argv[1]), [Path(one) for one in sys.argv[2:]] or sorted(METHODS.glob("*.py")))
