"""What each imperfection of a laboratory, its sensors and recorders does to the estimates, who says so, what mends it.

Run from the repository: `python benchmarks/bench_imperfections.py`. Each recording of a bench is simulated (its truth
is the parameters that made it), written as MCAP, ingested, checked and fitted by the jobs of the workflow with
`config/config.yaml`; each imperfection of the gait laboratory is a campaign of the workflow, whose truth is what the
leg rendered. Writes the tables of `docs/bench_validation.md`; half an hour on one core. The same seed gives the same
tables. With names of tables or parts of labels as arguments, only those rows are printed, and nothing is written.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import yaml

from osl_analysis.campaign.configuration import Config, campaign_config
from osl_analysis.commands.simulate import simulate_trial
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import OslAnalysisError
from osl_analysis.jobs.job import call
from osl_analysis.judge.judging import judged as judged_rows
from osl_analysis.judge.judging import marked
from osl_analysis.judge.used import Judge
from osl_analysis.model.parameters import read_parameters
from osl_analysis.refusal import is_refused, read_refusals
from osl_analysis.table import read_table

Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Remedy:
    """What the user states: fields of the source file and of the configuration, and how the row is called."""

    label: str
    source: Changes = field(default_factory=dict)
    config: Changes = field(default_factory=dict)
    needed: bool = True
    """Whether nothing in the data can tell, so that the user must state it."""


@dataclass(frozen=True)
class Case:
    """One imperfection: how its row is called, and the fields of the simulation that differ."""

    label: str
    changes: Changes = field(default_factory=dict)
    remedy: Remedy | None = None


def on(size: float, unit: str, **more: Any) -> dict[str, Any]:
    """An effect that is switched on."""
    return {"enabled": True, "size": size, "unit": unit, **more}


def one(**node: Any) -> Changes:
    """One node."""
    return {"recorder": {"node": node}}


def two(torque: Changes, **node: Any) -> Changes:
    """Two nodes, the torque's 0.3 ms later."""
    return {"recorder": {"node": node, "torque_node": {"phase": on(3e-4, "s"), **torque}}}


def sensor(channel: str, **faults: Any) -> Changes:
    """Faults of one sensor."""
    return {"recorder": {"sensors": {channel: faults}}}


def at_rate(rate_hz: float, changes: Changes | None = None) -> Changes:
    """The rate of the log, and other changes."""
    return {"dynamometer": {"rate_hz": rate_hz}, **(changes or {})}


def jitter(seconds: float) -> dict[str, Any]:
    """True jitter."""
    return on(seconds, "s", distribution="normal")


def latency(seconds: float) -> dict[str, Any]:
    """Host latency, exponentially distributed."""
    return on(seconds, "s", distribution="exponential")


PYTHON_LOOP = at_rate(
    500, one(jitter=on(1e-4, "s", distribution="exponential"), dropped=on(2e-4, "1"), burst=on(2, "sample"))
)
"""As a soft real-time loop writes: 0.1 ms of scatter, some steps of 6 ms."""
SET_APART, SET_APART_TWICE = (
    Remedy(
        "stated: `delay`, what the clocks differ by at the largest amplitude",
        source={"channels": {"torque": {"delay": f"{ppm / 10} ms"}}},
    )
    for ppm in (1, 2)
)
EVERY_100 = on(100, "sample", scatter=3)
NAN = {"recorder": {"sensors": {name: {"failed": on(5e-3, "1")} for name in ("joint_angle", "load_cell_torque")}}}
RECORDERS = [
    Case("none"),
    *(Case(f"true jitter, {s * 1e6:g} µs", one(jitter=jitter(s))) for s in (1e-6, 20e-6, 50e-6, 300e-6)),
    *(Case(f"host latency, {s * 1e3:g} ms", one(latency=latency(s))) for s in (2e-4, 2e-3)),
    Case("stamps late by half-normal noise, 0.2 ms", one(latency=on(2e-4, "s", distribution="half_normal"))),
    Case("a Python loop at 500 Hz, 0.1 ms of scatter, steps of 6 ms", PYTHON_LOOP),
    *(
        Case(f"stamps with {d} decimals at {rate:g} Hz", at_rate(rate, one(decimals=on(d, "decimal"))))
        for d, rate in ((4, 300), (4, 1024), (3, 1024), (6, 1000))
    ),
    Case("1 sample of 141 000 missing", one(dropped=on(1e-6, "1"))),
    Case("0.1 % of the samples missing", one(dropped=on(1e-3, "1"))),
    Case("gaps of 20 ms, 0.2 % of the samples", one(dropped=on(2e-3, "1"), burst=on(20, "sample"))),
    Case("gaps of 200 ms, 0.6 % of the samples", one(dropped=on(6e-3, "1"), burst=on(200, "sample"))),
    *(
        Case(f"gaps of {ms} ms in every cycle", one(lost_every=on(200, "sample"), burst=on(ms, "sample")))
        for ms in (20, 50)
    ),
    Case("0.5 % of the angle and of the torque NaN", NAN),
    Case("1 % of the samples written twice", one(duplicated=on(0.01, "1"))),
    Case("two nodes, 0.3 ms apart", two({})),
    Case("two nodes, 20 µs of true jitter each", two({"jitter": jitter(20e-6)}, jitter=jitter(20e-6))),
    Case("two nodes, torque at 333 Hz", two({"rate": on(333, "Hz")})),
    Case("two nodes, angle at 333 Hz", two({}, rate=on(333, "Hz"))),
    Case("two nodes, torque's host latency 0.5 ms", two({"latency": latency(5e-4)})),
    Case(
        "two nodes, the same, and 1 % of the torque missing",
        two({"latency": latency(5e-4), "dropped": on(0.01, "1")}),
    ),
    *(
        Case(
            f"two nodes, the same, and one in {n} of the torque missing",
            two({"latency": latency(5e-4), "lost_every": on(n, "sample", scatter=n // 33)}),
        )
        for n in (50, 100, 300)
    ),
    Case("two nodes, 2 ms, and one in 100 missing", two({"latency": latency(2e-3), "lost_every": EVERY_100})),
    Case(
        "two nodes, torque's host latency 0.5 ms, one in 100 of the angle missing",
        two({"latency": latency(5e-4)}, lost_every=EVERY_100),
    ),
    Case("two nodes, clocks 1 ppm apart", two({"clock_drift": on(1, "ppm")}), SET_APART),
    Case("two nodes, clocks 2 ppm apart", two({"clock_drift": on(2, "ppm")}), SET_APART_TWICE),
    Case("two nodes, clocks 50 ppm apart", two({"clock_drift": on(50, "ppm")})),
]
LITTLE_LATE = Remedy("stated: `delay` of the torque", source={"channels": {"torque": {"delay": "0.1 ms"}}})
LATE = Remedy("stated: `delay` of the torque", source={"channels": {"torque": {"delay": "2 ms"}}})
SLOW = Remedy(
    "stated: `low_pass` of the torque", source={"channels": {"torque": {"low_pass": {"cutoff": "100 Hz", "order": 1}}}}
)
STIFFNESS = {"value": "3000 N*m/rad", "standard_error": "3 N*m/rad"}
STIFFER = {"value": "8000 N*m/rad", "standard_error": "8 N*m/rad"}
STIFF_FRAME = Remedy("stated: `bench_stiffness`", config={"dynamometer": {"bench_stiffness": STIFFER}})
FRAME = Remedy("stated: `bench_stiffness`", config={"dynamometer": {"bench_stiffness": STIFFNESS}})
BITS = Remedy("stated: `bits` of the angle", source={"channels": {"theta": {"bits": 14}}}, needed=False)
SENSOR_FAULTS = [
    Case("torque 0.1 ms late", sensor("load_cell_torque", delay=on(1e-4, "s")), LITTLE_LATE),
    Case("torque 2 ms late", sensor("load_cell_torque", delay=on(2e-3, "s")), LATE),
    Case(
        "load cell behind a 100 Hz low-pass, first order",
        sensor("load_cell_torque", low_pass=on(100, "Hz", order=1)),
        SLOW,
    ),
    Case("encoder of 14 bits", {"effects": {"joint_encoder": on(14, "bit")}}, BITS),
    Case("encoder of 12 bits", {"effects": {"joint_encoder": on(12, "bit")}}),
    Case("torque with 12 bits over ± 50 N·m", sensor("load_cell_torque", clipping=on(50, "N*m"), adc=on(12, "bit"))),
    *(Case(f"log at {rate:g} Hz", at_rate(rate)) for rate in (100, 250)),
    *(
        Case(f"torque × {gain:g}", sensor("load_cell_torque", gain=on(gain, "1")))
        for gain in (4.45, 1.3558, 0.113, 0.01, -1)
    ),
    Case("angle × 57.3: degrees declared as radians", sensor("joint_angle", gain=on(57.29578, "1"))),
    Case("load cell clips at 30 N·m", sensor("load_cell_torque", clipping=on(30, "N*m"))),
    Case("encoder sticks at 5.5°", sensor("joint_angle", clipping=on(0.096, "rad"))),
    Case("hum of 0.3 N·m at 50 Hz", {"effects": {"load_cell_hum": on(0.3, "N*m", frequency_hz=50)}}),
    Case("1/f noise, 0.05 N·m in a decade", {"effects": {"load_cell_flicker": on(0.05, "N*m")}}),
    Case("the bench's frame yields, 3000 N·m/rad", {"effects": {"mount_stiffness": on(3000, "N*m/rad")}}, FRAME),
    Case("the bench's frame yields, 8000 N·m/rad", {"effects": {"mount_stiffness": on(8000, "N*m/rad")}}, STIFF_FRAME),
]
JOINTS = [
    *(Case(f"backlash of {deg:g}°", {"joint": {"backlash": on(deg * 0.01745, "rad")}}) for deg in (0.05, 0.1)),
    *(Case(f"Coulomb friction, {size:g} N·m", {"joint": {"coulomb": on(size, "N*m")}}) for size in (1, 3)),
    Case("a spring that is 8 % stiffer at 6°", {"joint": {"stiffening": on(7.3, "1/rad^2")}}),
    Case("a spring that is 20 % stiffer at 6°", {"joint": {"stiffening": on(18.2, "1/rad^2")}}),
    Case(
        "motion with 2 % of second and 5 % of third harmonic",
        {"protocol": {"second_harmonic": on(0.02, "1"), "third_harmonic": on(0.05, "1")}},
    ),
    Case("motion that decays by 1 % in a second", {"protocol": {"decay": on(0.01, "1/s")}}),
]
PROTOCOLS = [
    Case("1 s of rest between frequencies", {"protocol": {"rest_between_s": 1.0}}),
    Case("every frequency starts as a cosine", {"protocol": {"start": "cosine"}}),
    Case("ramps of 1 s at both ends of a frequency", {"protocol": {"ramp_s": 1.0}}),
    Case("10 s per frequency instead of 20 cycles", {"protocol": {"cycles": None, "seconds": 10.0}}),
    Case("10, 15, 20, 25, 30 cycles", {"protocol": {"cycles": [10, 15, 20, 25, 30]}}),
    Case("frequencies 5, 4, 3, 2, 1 Hz", {"protocol": {"frequencies_hz": [5, 4, 3, 2, 1]}}),
    Case(
        "amplitudes 6, 2, 4°; frequencies 3, 1, 5, 2, 4 Hz",
        {"protocol": {"frequencies_hz": [3, 1, 5, 2, 4], "amplitudes_deg": [6, 2, 4]}},
    ),
    *(Case(f"protocol clock {ppm / 1e4:+g} %", {"protocol": {"clock_error": on(ppm, "ppm")}}) for ppm in (-5000, 5000)),
]
COMMON = [
    Case("none"),
    Case("true jitter, 20 µs", one(jitter=jitter(20e-6))),
    Case("host latency, 0.5 ms", one(latency=latency(5e-4))),
    Case("stamps with 4 decimals at 1024 Hz", at_rate(1024, one(decimals=on(4, "decimal")))),
    Case("two nodes, 0.3 ms apart", two({})),
    Case("1 sample missing", one(dropped=on(1e-6, "1"))),
]
"""Of the recorders, for the other experiments."""
DYNAMOMETER = [
    *COMMON,
    Case("encoder of 14 bits", {"effects": {"joint_encoder": on(14, "bit")}}),
    Case("torque 2 ms late", sensor("load_cell_torque", delay=on(2e-3, "s")), LATE),
    Case("torque × −1", sensor("load_cell_torque", gain=on(-1, "1"))),
    Case("angle × 57.3: degrees declared as radians", sensor("joint_angle", gain=on(57.29578, "1"))),
]
ACTUATOR = [
    *COMMON,
    Case("true jitter, 2 µs", one(jitter=jitter(2e-6))),
    Case("a Python loop at 500 Hz, 0.1 ms of scatter, steps of 6 ms", PYTHON_LOOP),
    Case("current × −1", sensor("motor_current", gain=on(-1, "1"))),
    Case("torque clipped at 5 N·m", sensor("output_torque", clipping=on(5, "N*m"))),
    Case("angle × 57.3: degrees declared as radians", sensor("actuator_angle", gain=on(57.29578, "1"))),
]


def gait(size: float, unit: str, *names: str) -> Changes:
    """Effects of the gait laboratory, all of one size."""
    return {"effects": dict.fromkeys(names, on(size, unit))}


GAIT = [
    Case("as shipped"),
    Case("load and size of the gait scatter by 5 %", gait(5, "%", "load_scatter", "amplitude_scatter")),
    Case("the middle of stance scatters by 2 %", gait(2, "%", "timing_wander")),
    Case("the ankle's torque wanders by 4 N·m", gait(4, "N*m", "torque_wander")),
    Case("the foot slips by 5 mm", gait(5, "mm", "foot_slip")),
    Case("the trigger scatters by 3 ms", gait(3, "ms", "trigger_scatter")),
    Case("the ramp's duration scatters by 10 %", gait(10, "%", "rise_scatter")),
    Case("the servo shivers by 0.1°", gait(0.1, "deg", "servo_shiver")),
    Case("the platform heaves by 5 mm", gait(5, "mm", "platform_heave")),
    Case("marker noise of 1 mm", gait(1, "mm", "marker_noise")),
    Case("20 gaps of markers in each crossing", gait(20, "1/trial", "marker_gaps")),
    Case("the plate is 4 ms late", gait(4, "ms", "plate_lag")),
    Case("offset of 20 N and of 20 N·m", {"effects": {"force_offset": on(20, "N"), "moment_offset": on(20, "N*m")}}),
    Case("moments clipped at 60 N·m", gait(60, "N*m", "moment_clip")),
    Case("a dead moment channel", {"capture": {"dead_channels": {"Mx1": 0.0}}}),
    Case("moments in N·mm that the file states in N·m", {"capture": {"moment_label": "Nm"}}),
    Case("two foot markers exchanged in all trials", {"capture": {"swapped_labels": [["FOOT1", "FOOT2"]]}}),
    Case("20 % of the weight on the other foot, behind", {"changes": [{"second_foot_percent": 20}]}),
    Case("a third of the foot beside the plate", {"changes": [{"overhang_mm": 30}]}),
    Case("perturbed stance 8 % shorter", {"changes": [{"of": "perturbed", "after_window_percent": -8}]}),
    Case("perturbed crossings 8 % slower", {"changes": [{"of": "perturbed", "slower_percent": 8}]}),
]
"""Of the gait laboratory, which has every other imperfection that is shipped."""
TABLES: dict[str, tuple[str, list[Case]]] = {
    "recorders": ("impedance", RECORDERS),
    "sensors": ("impedance", SENSOR_FAULTS),
    "joints": ("impedance", JOINTS),
    "protocols": ("impedance", PROTOCOLS),
    "belt": (
        "belt",
        [*DYNAMOMETER, Case("load cell clips at 30 N·m", sensor("load_cell_torque", clipping=on(30, "N*m")))],
    ),
    "transmission": ("transmission", DYNAMOMETER),
    "actuator": ("actuator", ACTUATOR),
    "walking": ("walking", GAIT),
}
"""Tables of the page: experiment and cases."""


LABORATORY = Path("config/simulation/walking.yaml")
SIMULATION, CONFIG = Path("config/simulation/default.yaml"), Path("config/config.yaml")
REPORT = Path("docs/bench_validation.md")
SEED = 11
K, B, I = 300.0, 5.0, 0.02
ACCEPTED = {
    "K": 0.1, "B": 0.5, "I": 3, "K_s": 0.1, "B_j": 0.5, "J_j": 3,
    "k_tau_n_m": 0.5, "f_C": 2, "f_G": 4, "B_m": 4, "J_m": 3,
}  # fmt: skip
"""Error [%] of each quantity that a reader accepts; a larger one is wrong if the interval does not cover it either."""
ACCEPTED_WALKING = {"K": 5, "B": 20}  # the same of crossings [%]
TRIALS = {
    "impedance": ("impedance_K300_B5.0_compensated", ("K", "B", "I")),
    "belt": ("belt_01", ("K_s",)),
    "transmission": ("transmission_1", ("B_j", "J_j")),
    "actuator": ("actuator_1", ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")),
    "walking": ("", ("K", "B")),
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
    commanded = {"commanded": config.dynamometer.model_dump(mode="json", include=set(PROTOCOL))}
    outputs = {"trial": trial, "quality": folder / "quality.csv"}
    plain = {"needs": (), "data": "", "judge": ""}
    settings = recording | commanded
    call({"command": "trials.ingest_and_check", "input": {}, "output": outputs, "settings": settings, **plain})
    verdicts = (
        Judge(config.quality, {})
        .verdicts([folder / "quality.csv"])
        .filter(pl.col("verdict").is_in(["flag", "exclude"]))
    )
    failed = [f"{check} ({verdict})" for check, verdict in verdicts.select("check", "verdict").rows()]
    assert facts.fit is not None
    parts = {name: getattr(config, section).part(model) for name, (section, model) in facts.fit.settings.items()}
    condition = {"condition": {name: row[name] for name in facts.fit.sheet}} if facts.fit.sheet else {}
    inputs = {"trial": trial} | ({"parameters": config.parameters} if facts.fit.parameters else {})
    tables = {table.name: folder / f"{table.name}.csv" for table in facts.tables}
    fitted = {"input": inputs, "output": {"tables": tables}, "settings": parts | condition}
    call({"command": facts.fit.job, **fitted, **plain})
    name = facts.tables[0].name
    table = read_table(tables[name])
    return marked(table, judged_rows(table, config.doubtful.of(name), name)), failed


def truth(experiment: str, config: Config) -> dict[str, float]:
    """The parameters that made a trial."""
    p = read_parameters(config.parameters)
    known = {"K": K, "B": B, "I": I, "k_tau_n_m": p.k_tau * p.n_m}
    return {name: known.get(name, getattr(p, name, 0.0)) for name in TRIALS[experiment][1]}


def crossed(changes: Changes) -> Result:
    """Simulate and analyse a campaign of 12 perturbed and 12 other crossings, more or less: its ensemble."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        campaign = yaml.safe_load(SIMULATION.read_text(encoding="utf-8"))
        counts = {"static": 1, "plate": 3, "walking": 24, "perturbed_share": 0.5}
        none = {"belt": 0, "transmission": 0, "K_d": [], "B_d": [], "controllers": []}
        campaign |= {"seed": SEED, "walking": str(folder / "walking.yaml"), "experiments": counts | none}
        own = {name: str(folder / name) for name in ("raw_data", "results")}
        own |= {"simulation": str(folder / "simulation.yaml"), "sheet": str(folder / "raw_data/trials.csv")}
        laboratory = merged(yaml.safe_load(LABORATORY.read_text(encoding="utf-8")), changes)
        for file, content in (("walking", laboratory), ("simulation", campaign), ("own", own)):
            (folder / f"{file}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
        table = folder / "results/tables/walking_summary.csv"
        command = ["snakemake", str(table), "--quiet", "all", "--cores", "2", "--configfile", str(folder / "own.yaml")]
        ended = subprocess.run(command, capture_output=True, text=True)
        if is_refused(table):
            return Result(refused=f"refused: {'; '.join(dict.fromkeys(one.reason for one in read_refusals(table)))}")
        if not table.is_file():
            return Result(refused=f"CRASH: {ended.stderr.strip().splitlines()[-1]}")
        rows = read_table(table).filter(pl.col("estimator") == "ensemble")
        left = read_table(folder / "results/tables/walking_excluded.csv")["reason"].to_list()
        truths = [json.loads(path.read_text(encoding="utf-8")) for path in (folder / "raw_data/truth").glob("*.json")]
    excluded = [f"{len(left)} of 24 crossings are excluded, one because: {left[0]}"] if left else []
    if rows["mean"].null_count():
        return Result(refused=f"refused: {rows['reason'][0]}")
    fit, true = {"doubtful": rows["doubt"][0]}, {}
    for row in rows.filter(pl.col("quantity").is_in(TRIALS["walking"][1])).iter_rows(named=True):
        quantity = row["quantity"]
        fit |= {quantity: row["mean"]} | {f"{quantity}_{name}": row[name] for name in ("se", "low", "high")}
        true[quantity] = float(np.mean([t[f"{quantity}_rendered"] for t in truths if f"{quantity}_rendered" in t]))
    return result_of(fit, true, excluded, ACCEPTED_WALKING)


def judged(experiment: str, changes: Changes, remedy: Remedy | None) -> Result:
    """Simulate and analyse one recording, or one campaign of crossings."""
    if experiment == "walking":
        return crossed(changes)
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


def result_of(
    fit: Mapping[str, Any], true: Mapping[str, float], failed: Iterable[str], accepted: Mapping[str, float] = ACCEPTED
) -> Result:
    """Errors of a fit against the truth, and what was said of it. Where friction is certain, the damping is that part
    of it that is not friction."""
    errors, wrong = {}, False
    if fit.get("B_viscous") is not None:
        fit = {**fit, **{f"B{end}": fit[f"B_viscous{end}"] for end in ("", "_se", "_low", "_high")}}
    for name, value in true.items():
        off = fit[name] - value
        errors[name] = (100 * off / value, off / fit[f"{name}_se"])
        covered = fit[f"{name}_low"] <= value <= fit[f"{name}_high"]
        wrong |= abs(errors[name][0]) > accepted[name] and not covered
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
