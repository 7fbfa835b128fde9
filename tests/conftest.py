# SPDX-License-Identifier: Apache-2.0
"""What several tests share: the shipped parameters, and motions with derivatives written by
hand."""

import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

# One thread per process, as in the jobs of a campaign, before numpy is imported: the tests
# themselves take all cores.
os.environ.update(
    {
        f"{one}_THREADS": "1"
        for one in ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "NUMBA_NUM", "POLARS_MAX")
    }
)
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else each process compiles what it imports anew

import numpy as np
import polars as pl
import pytest
from hypothesis import settings
from kernels import is_numerical
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Trial
from osl_analysis.judge import judging
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.joining import RowFindings, findings_of_rows, with_texts
from osl_analysis.judge.limits import Limits

sys.dont_write_bytecode = False
gc.disable()  # until all is imported
ROOT = Path(__file__).parents[1]
RECORDINGS = os.environ.get("OSL_RECORDINGS")
"""The folder of recordings that others published, if it is here: tests/recordings.md."""
RUNNING = (
    "test_workflow",
    "test_small_campaigns",
    "test_bundle",
)
"""Modules that run campaigns: in one worker, for which `snakemake_runs.py` imports once."""
# without a deadline: a busy machine is no fault of the code; other seeds: pytest
# --hypothesis-profile default
settings.register_profile("seeded", derandomize=True, database=None, deadline=None)
settings.load_profile("seeded")


class ByModule(LoadScopeScheduling):
    """Gives each process whole modules, and those of `RUNNING` to one."""

    def _split_scope(self, nodeid: str) -> str:
        module = Path(nodeid.split("::")[0]).stem
        return "campaigns" if module in RUNNING else module


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> ByModule:
    gc.enable()  # this process collects no tests
    return ByModule(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests of numerical modules `numerics`; campaigns first, so that no process is busy alone
    at the end."""
    items.sort(key=lambda item: item.path.stem not in RUNNING)
    for item in items:
        if RECORDINGS is None and item.get_closest_marker("recordings"):
            item.add_marker(pytest.mark.skip("OSL_RECORDINGS names no folder"))
    numerical = {path for path in {item.path for item in items} if is_numerical(path)}
    for item in items:
        if item.path in numerical:
            item.add_marker(pytest.mark.numerics)
    # what collecting has made stays, and looking through it again and again takes a tenth of a run
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say that tests of real recordings did not run."""
    skipped = terminalreporter.stats.get("skipped", [])
    absent = sum("recordings" in report.keywords for report in skipped)
    if absent:
        terminalreporter.write_line(
            f"{absent} tests of real recordings did not run: tests/recordings.md says which and how"
        )


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of recordings that others published."""
    return Path(str(RECORDINGS))


@pytest.fixture
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.fixture
def without_inference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a test of least squares alone: the inference takes nine tenths of a fit."""
    monkeypatch.setattr("osl_analysis.bench.evidence.inferred_of_joint", lambda *_: None)
    monkeypatch.setattr("osl_analysis.bench.evidence.actuator_of_leg", lambda *_: None)
    monkeypatch.setattr("osl_analysis.bench.parts_alone.inferred_of_joint", lambda *_: None)


least_squares_alone = pytest.mark.usefixtures("without_inference")


@pytest.fixture(scope="session")
def schemas_of_files() -> dict[str, dict[str, object]]:
    from osl_analysis.commands.new_campaign import schemas

    return schemas()


@pytest.fixture
def schemas_made_once(
    schemas_of_files: dict[str, dict[str, object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a test of new campaigns: to make the schemas of their files takes half the time."""
    monkeypatch.setattr("osl_analysis.commands.new_campaign.schemas", lambda: schemas_of_files)


@contextmanager
def refused_with(said: str) -> Iterator[pytest.ExceptionInfo[InputError]]:
    """The block refuses its input in one printable line, in which this pattern is found."""
    with pytest.raises(InputError, match=said) as caught:
        yield caught
    assert str(caught.value).isprintable()


def said_in_refusal(call: Callable[..., object], *given: object, **stated: object) -> str:
    """The one printable line in which a call refuses what it is given."""
    with pytest.raises(InputError) as caught:
        call(*given, **stated)
    assert str(caught.value).isprintable()
    return str(caught.value)


def joint_trial(time: np.ndarray, theta: np.ndarray, torque: np.ndarray) -> Trial:
    """A trial of an angle [rad] and a torque [N*m]."""
    return Trial("made", pl.DataFrame({"time": time, "theta": theta, "torque": torque}))


def white_noise(size: int | tuple[int, ...], seed: int) -> np.ndarray:
    """Normal numbers of standard deviation 1."""
    return np.random.default_rng(seed).standard_normal(size)


def half_width(row: dict[str, Any], name: str) -> float:
    """Half of the interval of an estimate."""
    return (row[f"{name}_high"] - row[f"{name}_low"]) / 2


def marked(table: pl.DataFrame, limits: Limits, name: str) -> pl.DataFrame:
    """A table with the names of the causes of doubt about its rows, and of what could not be
    checked."""
    return marked_by(judging.judged(table, limits, name), table, name)


def marked_by(findings: RowFindings, table: pl.DataFrame, name: str) -> pl.DataFrame:
    """A table with the texts of findings on its rows."""
    return with_texts(table, findings_of_rows(table, chain(*findings)), name)


def doubt(source: str, *estimates: str) -> dict[str, object]:
    """A cell of the column `doubts`: a doubt about some estimates, or about all of the fit."""
    return {"source": source, "estimates": list(estimates)}


def findings_of(row: dict[str, object], limits: Limits, name: str) -> list[Finding]:
    """The findings about one row of a table."""
    return judging.judged(pl.DataFrame([row], infer_schema_length=None), limits, name)[0]


def findings_on(tables: dict[str, pl.DataFrame], limits: Limits) -> list[Finding]:
    """The findings about the last row of an impedance trial, by its tables."""
    table, budget = tables["impedance"], tables["budget"]
    return judging.judged(table, limits, "impedance", budget=budget)[-1]


def beyond_in(findings: list[Finding]) -> dict[str, str]:
    """The side of its limit on which each number of evidence is, by column."""
    return {one.column: one.side for finding in findings for one in finding.evidence}
