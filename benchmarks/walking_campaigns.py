"""Runs one simulated walking campaign through the workflow, and judges its headline against what the leg rendered."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import yaml
from walking_cases import Case, Remedy

from osl_analysis.commands.simulate import NOTHING, laboratory_of, record_trial
from osl_analysis.sheet import COLUMNS
from osl_analysis.simulator.plan import plan_trials
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

ROOT = Path(__file__).parents[1]
SEED = 7
CROSSINGS, PLATE_TRIALS = 12, 6
"""Crossings of a campaign of one group, of which every second one is perturbed, and trials of the unloaded plate."""
ACCEPTED = {"K": 5.0, "B": 15.0, "I": 0.015}
"""Error that a reader accepts: of K and B in %, of I in kg*m^2. A larger one is wrong if no interval covers it."""
WANTED = ("walking_summary", "walking", "walking_excluded", "quality")
FOOT = {"mass_kg": 1.0, "centre_of_mass_m": [0.045, 0.0, -0.045], "inertia_kg_m2": 0.007225}
"""The simulated foot, as a laboratory would weigh it. Otherwise its inertia would be part of the ankle's."""
NO_LEG_LOG = {"log": pd.NA, "log_source": pd.NA}


@dataclass(frozen=True)
class Group:
    """The headline of one group: error and error in standard errors, by quantity."""

    name: str
    errors: Mapping[str, tuple[float, float]]
    wrong: bool
    doubts: str


@dataclass(frozen=True)
class Verdict:
    """What became of a campaign."""

    groups: tuple[Group, ...] = ()
    excluded: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    """Checks of quality control that did not pass, with the number of trials."""
    refused: str = ""
    used: int = 0
    """Perturbations that were used."""

    @property
    def says(self) -> tuple[str, ...]:
        """Everything that is said, with a sentence each."""
        doubts = tuple(dict.fromkeys(f"doubtful: {g.doubts}" for g in self.groups if g.doubts))
        excluded = (f"excluded: {'; '.join(self.excluded)}",) if self.excluded else ()
        failed = (f"quality: {', '.join(self.failed)}",) if self.failed else ()
        return (*doubts, *excluded, *failed)


@dataclass
class Campaign:
    """A simulated campaign in a folder. It is recorded once, and analysed without and with its remedy."""

    case: Case
    folder: Path
    rows: list[dict[str, Any]] = field(default_factory=list)

    def record(self) -> None:
        """Simulate all trials, without logs of the leg."""
        self.folder.mkdir(parents=True)
        lab = merged(load(ROOT / "config/simulation/walking.yaml"), self.case.walking)
        content = load(ROOT / "config/simulation/default.yaml")
        none = {"belt": 0, "transmission": 0, "actuator": 0, "K_d": []}
        counts = {"static": 1, "plate": PLATE_TRIALS, "walking": CROSSINGS}
        wanted = merged(content["experiments"], none | counts)
        content |= {"experiments": merged(wanted, self.case.experiments), "seed": SEED}
        content["walking"] = str(dump(self.folder / "walking.yaml", lab))
        settings = read_yaml(dump(self.folder / "simulation.yaml", content), SimulationSettings)
        every = ("K_d", "B_d", "direction", "subject", "session")
        conditions = settings.experiments.conditions.model_copy(update={"stated": every})
        planned = settings.experiments.model_copy(update={"conditions": conditions})
        self.rows = plan_trials(settings.model_copy(update={"experiments": planned})).to_dict("records")  # type: ignore[assignment]
        for k, row in enumerate(r for r in self.rows if r["experiment"] == "walking"):
            row["perturbed"] = k % 2 == 0
        for row in self.rows:
            record_trial(row, settings, laboratory_of(settings, NOTHING), self.folder / "raw")

    def analyse(self, remedy: Remedy) -> Verdict:
        """The verdict on the headline, with what the user states in this analysis."""
        hidden = ({"K_d", "B_d", "direction", "subject", "session"} & set(COLUMNS)) - set(remedy.stated)
        sheet = pd.DataFrame([row | NO_LEG_LOG | dict.fromkeys(hidden, pd.NA) | remedy.sheet for row in self.rows])
        sheet.loc[sheet["experiment"] == "static", "static"] = pd.NA  # names the static trial of the others
        sheet[list(COLUMNS)].to_csv(self.folder / "raw/trials.csv", index=False)
        sources = self.folder / "sources"
        sources.mkdir(exist_ok=True)
        dump(sources / "vicon.yaml", merged(load(ROOT / "config/sources/vicon.yaml"), remedy.source))
        own = {"campaign": "case", "raw_data": str(self.folder / "raw"), "sheet": str(self.folder / "raw/trials.csv")}
        own |= {"results": str(self.folder / "results"), "simulation": None, "sources": str(sources)}
        own |= {"walking": {"foot": FOOT}}
        config = dump(self.folder / "config.yaml", merged(own, remedy.config))
        tables = self.folder / "results/tables"
        for name in WANTED:
            (tables / f"{name}.csv").unlink(missing_ok=True)
        done = run_workflow(config, [tables / f"{name}.csv" for name in WANTED])
        if not (tables / "walking_summary.csv").exists():
            return Verdict(refused=first_error(done), failed=failed_checks(tables / "quality.csv"))
        return self.judged(tables)

    def judged(self, tables: Path) -> Verdict:
        """The headline of each group against the mean of what the leg rendered in its perturbations."""
        summary, fits = read(tables / "walking_summary.csv"), read(tables / "walking.csv")
        excluded = read(tables / "walking_excluded.csv")
        if "estimator" not in summary.columns:  # the record of a refusal in the table's place
            record = summary.select("reason", "remedy").fill_null("").row(0)
            said = "; ".join(filter(None, record))
            return Verdict(refused=plain(said), failed=failed_checks(tables / "quality.csv"))
        headline = summary.filter(pl.col("estimator") == "ensemble", pl.col("quantity").is_in(list(ACCEPTED)))
        names = headline["group"].unique(maintain_order=True).to_list() if "group" in headline.columns else [""]
        groups = []
        for name in names:
            of = (pl.col("group") == name) if name else pl.lit(True)
            trials = fits.filter(of)["trial"].to_list()
            groups.append(self.group_of(str(name), headline.filter(of), trials))
        reasons = [short(r) for r in excluded["reason"].to_list()] if excluded.height else []
        counted = tuple(f"{reasons.count(r)} × {r}" for r in dict.fromkeys(reasons))
        used = fits.filter(pl.col("excluded").is_null()).height
        return Verdict(tuple(groups), counted, failed_checks(tables / "quality.csv"), "", used)

    def group_of(self, name: str, headline: pl.DataFrame, trials: Iterable[str]) -> Group:
        """One group's headline."""
        truth = [json.loads((self.folder / f"raw/truth/{t}.json").read_text()) for t in trials]
        errors, wrong, doubts = {}, False, set()
        for row in headline.to_dicts():
            q = row["quantity"]
            true = float(np.mean([t[f"{q}_rendered"] for t in truth]))
            if row.get("mean") is None:
                doubts.add(f"no result: {row.get('reason') or 'no reason'}")
                continue
            off = row["mean"] - true
            errors[q] = (off if q == "I" else 100 * off / true, off / row["se"] if row["se"] else float("nan"))
            wrong |= abs(errors[q][0]) > ACCEPTED[q] and not row["low"] <= true <= row["high"]
            doubts.add(str(row.get("doubt") or ""))
        return Group(name, errors, wrong, "; ".join(sorted(doubts - {""})))


def run_workflow(config: Path, targets: Iterable[Path]) -> str:
    """Make the targets with the workflow as a user does; what it printed."""
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "--nolock", "--configfile", str(config), "--"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(  # the targets are paths of our own
        [*command, *map(str, targets)], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def first_error(printed: str) -> str:
    """The first message of the workflow that says why a campaign has no headline."""
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    errors = [line for line in lines if "rror: " in line]
    errors += [after for line, after in pairwise(lines) if line.startswith("WorkflowError")]
    return short((errors or lines[-1:] or ["no message"])[0])


def failed_checks(path: Path) -> tuple[str, ...]:
    """Checks that did not pass, with the number of trials."""
    if not path.exists():
        return ()
    bad = read(path).filter(pl.col("verdict") != "pass")
    names = [f"{check} ({verdict})" for check, verdict in bad.select("check", "verdict").rows()]
    return tuple(f"{name} in {names.count(name)}" for name in dict.fromkeys(names))


def short(message: str) -> str:
    """A message without the names of trials and folders, at most 260 characters."""
    return plain(message.partition("rror: ")[2] or message)


def plain(text: str) -> str:
    """A message without paths and names of trials."""
    words = [w for w in text.split() if not (w.startswith("/") or w.lstrip("(").startswith(("walking_", "plate_0")))]
    return " ".join(words)[:260]


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested fields with some replaced."""
    found = dict(base)
    for name, value in changes.items():
        inner = found.get(name)
        found[name] = merged(inner, value) if isinstance(value, Mapping) and isinstance(inner, Mapping) else value
    return found


def load(path: Path) -> dict[str, Any]:
    """The fields of a YAML file."""
    content: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return content


def dump(path: Path, content: Mapping[str, Any]) -> Path:
    """Write fields as YAML."""
    path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
    return path


def read(path: Path) -> pl.DataFrame:
    """A table of the workflow; an empty one if it has no rows."""
    try:
        return pl.read_csv(path, infer_schema_length=None)
    except pl.exceptions.NoDataError:
        return pl.DataFrame({"reason": []})
