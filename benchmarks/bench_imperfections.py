"""What each imperfection of a bench, its sensors and recorders does to the estimates, who says so, and what mends it.

Run from the repository: `python benchmarks/bench_imperfections.py`. Each recording is simulated (its truth is the
parameters that made it), written as MCAP, ingested, checked and fitted by the jobs of the workflow with
`config/config.yaml`. Writes the tables of `docs/bench_validation.md`; a quarter of an hour on one core. The same seed
gives the same tables. With names of tables or parts of labels as arguments, only those rows are printed, and nothing
is written.
"""

import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl
import yaml
from bench_cases import TABLES, Case, Changes, Remedy, on

from osl_analysis.commands.simulate import simulate_trial
from osl_analysis.config import Config, campaign_config
from osl_analysis.doubtful import marked
from osl_analysis.errors import OslAnalysisError
from osl_analysis.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.job import Job, call
from osl_analysis.parameters import read_parameters
from osl_analysis.table import read_table

SIMULATION, CONFIG = Path("config/simulation/default.yaml"), Path("config/config.yaml")
REPORT = Path("docs/bench_validation.md")
SEED = 11
K, B, I = 300.0, 5.0, 0.02
ACCEPTED = {
    "K": 0.1, "B": 0.5, "I": 3, "K_s": 0.1, "B_j": 0.5, "J_j": 3,
    "k_tau_n_m": 0.5, "f_C": 2, "f_G": 4, "B_m": 4, "J_m": 3,
}  # fmt: skip
"""Error [%] of each quantity that a reader accepts; a larger one is wrong if the interval does not cover it either."""
TRIALS = {
    "impedance": ("impedance_K300_B5.0_compensated", ("K", "B", "I")),
    "belt": ("belt_01", ("K_s",)),
    "transmission": ("transmission_1", ("B_j", "J_j")),
    "actuator": ("actuator_1", ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")),
}
"""Trial and quantities of each experiment."""
SENSORS = (
    "dynamometer_bandwidth",
    "joint_encoder",
    "actuator_encoder",
    "load_cell_noise",
    "load_cell_offset",
    "current_noise",
)
"""Effects of the shipped simulation that every recording has; the encoder's zero is drawn too."""

SILENT = "**silently wrong**"


@dataclass(frozen=True)
class Result:
    """What became of one recording.

    errors: error [%] and error in standard errors, by quantity; empty where there is no fit.
    refused: the message of a refusal.
    doubts: why the fit is doubtful.
    failed: checks of quality control that did not pass.
    wrong: a quantity is further off than a reader accepts, and its interval does not cover it.
    """

    errors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    refused: str = ""
    doubts: str = ""
    failed: tuple[str, ...] = ()
    wrong: bool = False

    @property
    def said(self) -> str:
        """Everything that is said."""
        doubts = f"doubtful: {self.doubts}" if self.doubts else ""
        quality = f"quality: {', '.join(self.failed)}" if self.failed else ""
        return "; ".join(filter(None, [self.refused, doubts, quality])) or "–"


def merged(base: Any, changes: Changes) -> Any:
    """A nested mapping with changes; what is no mapping is replaced."""
    both = dict(base or {})
    for name, value in changes.items():
        both[name] = merged(both.get(name), value) if isinstance(value, Mapping) else value
    return both


def simulation(experiment: str, changes: Changes) -> dict[str, Any]:
    """The shipped simulation with one trial of an experiment, an exact joint, good sensors and these changes."""
    content = yaml.safe_load(SIMULATION.read_text(encoding="utf-8"))
    for name, effect in content["effects"].items():
        effect["enabled"] = name in SENSORS
    content["effects"]["encoder_zero"] = on(0.5, "step")
    content["effects"]["friction"]["enabled"] = experiment == "actuator"
    content["experiments"] = {
        "belt": 1,
        "transmission": 1,
        "actuator": 1,
        "K_d": [K],
        "B_d": [B],
        "controllers": ["compensated"],
    }
    content |= {"seed": SEED, "joint": {"K": K, "B": B, "I": I}, "recorder": {}, "walking": None}
    return dict(merged(content, changes))


def recorded(experiment: str, changes: Changes, folder: Path) -> Mapping[str, Any]:
    """Simulate one trial into a folder; its row of the sample sheet."""
    settings = folder / "simulation.yaml"
    settings.write_text(yaml.safe_dump(simulation(experiment, changes)), encoding="utf-8")
    trial = TRIALS[experiment][0]
    simulate_trial(settings, folder, trial)
    log = EXPERIMENTS[experiment].simulated_files(trial)["log"]
    nodes = "_nodes" if changes.get("recorder", {}).get("torque_node") is not None else ""
    source = f"{EXPERIMENTS[experiment].log}{nodes}"
    desired = {"K_d": K, "B_d": B, "controller": "compensated"} if experiment == "impedance" else {}
    return {"trial": trial, "experiment": experiment, "log": log, "log_source": source, **desired}


def analysed(row: Mapping[str, Any], config: Config, sources: Path, folder: Path) -> tuple[pl.DataFrame, list[str]]:
    """The table of a trial's fits with doubts marked, and what quality control says; as the workflow does."""
    facts, trial = EXPERIMENTS[row["experiment"]], folder / f"{row['trial']}.parquet"
    recording = {"row": row, "raw_folder": folder, "sources_folder": sources, "needed_columns": []}
    rules = {"rules": config.quality.model_dump(mode="json"), "accept": []}
    commanded = {"commanded": config.dynamometer.model_dump(mode="json", include=set(PROTOCOL))}
    outputs = {"trial": trial, "quality": folder / "quality.csv"}
    ingested = {"input": {}, "output": outputs, "settings": recording | rules | commanded}
    call(Job("trials.ingest_and_check", ingested, (), ()))
    verdicts = read_table(folder / "quality.csv").filter(pl.col("verdict") != "pass")
    failed = [f"{check} ({verdict})" for check, verdict in verdicts.select("check", "verdict").rows()]
    assert facts.fit is not None
    parts = {name: getattr(config, section).part(model) for name, (section, model) in facts.fit.settings.items()}
    condition = {"condition": {name: row[name] for name in facts.fit.sheet}} if facts.fit.sheet else {}
    inputs = {"trial": trial} | ({"parameters": config.parameters} if facts.fit.parameters else {})
    tables = {table.name: folder / f"{table.name}.csv" for table in facts.tables}
    fitted = {"input": inputs, "output": {"tables": tables}, "settings": parts | condition}
    call(Job(facts.fit.job, fitted, (), ()))
    name = facts.tables[0].name
    return marked(read_table(tables[name]), config.doubtful.of(name), name), failed


def truth(experiment: str, config: Config) -> dict[str, float]:
    """The parameters that made a trial."""
    p = read_parameters(config.parameters)
    known = {"K": K, "B": B, "I": I, "k_tau_n_m": p.k_tau * p.n_m}
    return {name: known.get(name, getattr(p, name, 0.0)) for name in TRIALS[experiment][1]}


def judged(experiment: str, changes: Changes, remedy: Remedy | None) -> Result:
    """Simulate and analyse one recording."""
    content = merged(yaml.safe_load(CONFIG.read_text(encoding="utf-8")), remedy.config if remedy else {})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            config = campaign_config(content, [CONFIG])
            row = recorded(experiment, changes, folder)
            source = yaml.safe_load((config.sources / f"{row['log_source']}.yaml").read_text(encoding="utf-8"))
            stated = merged(source, remedy.source if remedy else {})
            (folder / f"{row['log_source']}.yaml").write_text(yaml.safe_dump(stated), encoding="utf-8")
            table, failed = analysed(row, config, folder, folder)
        except OslAnalysisError as refusal:
            reason = str(refusal).replace(f"{folder}/", "").replace(f"trial {TRIALS[experiment][0]}: ", "")
            return Result(refused=f"refused: {reason}")
        except Exception as fault:  # a row of the page, and not its end
            return Result(refused=f"CRASH: {type(fault).__name__}: {fault}")
    fit = table.filter(pl.col("amplitude_deg").is_null()) if "amplitude_deg" in table.columns else table
    numbers, true = fit.row(0, named=True), truth(experiment, config)
    return result_of(numbers, true, [flag for flag in failed if not changes or flag not in ordinary_flags(experiment)])


@cache
def ordinary_flags(experiment: str) -> tuple[str, ...]:
    """Flags of quality control on a recording without any imperfection, which therefore say nothing."""
    return judged(experiment, {}, None).failed


def result_of(fit: Mapping[str, Any], true: Mapping[str, float], failed: Iterable[str]) -> Result:
    """Errors of a fit against the truth, and what was said of it."""
    errors, wrong = {}, False
    for name, value in true.items():
        off = fit[name] - value
        errors[name] = (100 * off / value, off / fit[f"{name}_se"])
        covered = fit[f"{name}_low"] <= value <= fit[f"{name}_high"]
        wrong |= abs(errors[name][0]) > ACCEPTED[name] and not covered
    return Result(errors, doubts=fit["doubtful"] or "", failed=tuple(failed), wrong=wrong)


def cells(result: Result, names: Iterable[str]) -> list[str]:
    """Error of each quantity in percent and, in brackets, in standard errors."""
    return [f"{number(result.errors[n][0])} ({result.errors[n][1]:.1f})" if n in result.errors else "–" for n in names]


def number(percent: float) -> str:
    """A percentage with as many digits as matter."""
    return f"{percent:.3f}" if abs(percent) < 1 else f"{percent:.1f}" if abs(percent) < 100 else f"{percent:.0f}"


def verdict(result: Result, remedy: Remedy | None) -> str:
    """Whether a reader is misled."""
    if result.refused:
        return result.refused.partition(":")[0]
    if not result.wrong:
        return "right, but doubtful" if result.doubts else "right"
    if result.doubts:
        return "doubtful"
    if result.failed:
        return "flagged"
    return "must be stated" if remedy is not None and remedy.needed else SILENT


def rows_of(experiment: str, case: Case) -> Iterable[str]:
    """The rows of one case: as recorded, and with its remedy."""
    names = TRIALS[experiment][1]
    result = judged(experiment, case.changes, None)
    yield line([case.label, *cells(result, names), verdict(result, case.remedy), result.said])
    if case.remedy:
        mended = judged(experiment, case.changes, case.remedy)
        yield line([f"… {case.remedy.label}", *cells(mended, names), verdict(mended, None), mended.said])


def line(columns: Iterable[str]) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(text.replace("|", "/") for text in columns) + " |"


def table(name: str, words: Iterable[str] = ()) -> str:
    """One table of the page, or its rows that have one of the words in their labels."""
    experiment, cases = TABLES[name]
    names = TRIALS[experiment][1]
    lines = [line(["", *(f"{n}, % (SE)" for n in names), "", "what is said"]), line(["---"] * (len(names) + 3))]
    for case in cases:
        if not words or any(word in case.label for word in words):
            for text in rows_of(experiment, case):
                lines.append(text)
                print(text, flush=True)
    return "\n".join(lines)


def main() -> None:
    words = [word for word in sys.argv[1:] if word not in TABLES]
    chosen = [name for name in TABLES if name in sys.argv[1:]] or list(TABLES)
    tables = {name: table(name, words) for name in chosen}
    if len(sys.argv) > 1:
        return
    text = REPORT.read_text(encoding="utf-8")
    for mark, rows in tables.items():
        head, _, rest = text.partition(f"<!-- {mark} -->\n")
        text = f"{head}<!-- {mark} -->\n{rows}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    REPORT.write_text(text, encoding="utf-8")
    bad = sum(rows.count(SILENT) + rows.count("| CRASH |") for rows in tables.values())
    print(f"{bad} rows are silently wrong or crash")
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
