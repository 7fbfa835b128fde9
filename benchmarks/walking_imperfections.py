"""What each imperfection of gait, platform, plate and laboratory does to the ankle's impedance, and what mends it.

Run from the repository: `python benchmarks/walking_imperfections.py`. Simulated crossings pass through C3D files,
ingest and the walking analysis of `config/config.yaml`. The truth is the impedance that the simulated leg rendered.
Writes the tables of `docs/walking_validation.md`. The remedies for plate and sensors take ten minutes on one core,
the whole campaigns (`walking_cases.py`) half an hour on two. With `campaigns`, or names of tables of campaigns, as
arguments only these are made. With other words only the rows that have one in their labels are made, and replace those
of the page. The same seeds give the same tables.
"""

import json
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from walking_cases import TABLES
from walking_headlines import headline_table

from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.config import read_section
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking import simulate_walking_trial
from osl_analysis.simulator.walking_settings import WalkingEffects, WalkingSettings
from osl_analysis.study.walking import weighed_foot
from osl_analysis.trial import Array, Trial, read_trial
from osl_analysis.walking.bodies import static_calibration
from osl_analysis.walking.crossing import Crossing, analyse_crossing
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.plate_model import PlateModel, identify_plate_model
from osl_analysis.walking.platform import identify_platform
from osl_analysis.walking.response import fit_response, isolate_response
from osl_analysis.walking.settings import FootSettings, WalkingAnalysis
from osl_analysis.yaml_settings import read_yaml

SETTINGS, CONFIG, SOURCES = Path("config/simulation/default.yaml"), Path("config/config.yaml"), Path("config/sources")
REPORT = Path("docs/walking_validation.md")
FIRST_SEED = 101
CAMPAIGNS, CAMPAIGNS_ALONE = 8, 4
"""Campaigns with every imperfection, and with a single one whose effect depends on the draw."""
CROSSINGS = 60
FEW = 12
"""Crossings of a campaign, half of them perturbed, and of one whose imperfection does not vary gait."""
PLATE_TRIALS = 3
UNSEEN = ("leg_clock_offset", "leg_clock_drift", "leg_joint_encoder")
"""Imperfections of the leg's log, which the torque and the angle from markers never see."""
VARIES = ("stance_scatter", "angle_wander", "marker_noise")
"""Imperfections whose effect differs from campaign to campaign; that of the others is the same to 0.1 %."""
REMEDIES = {
    "inertia": "the plate's inertia removed",
    "lag": "the plate's lag corrected",
    "zero": "the plate's zero read before each step",
    "foot": "the foot's weight and inertia removed",
}
QUANTITIES = ("K", "B", "I", "torque")


@dataclass(frozen=True)
class Session:
    """Ingested trials of one simulated campaign by name, and the truth of its perturbed crossings."""

    trials: Mapping[str, Trial]
    perturbed: tuple[str, ...]
    unperturbed: tuple[str, ...]
    truth: Mapping[str, Mapping[str, Any]]
    curves: Mapping[str, pl.DataFrame]


@dataclass(frozen=True)
class Laboratory:
    """The shipped simulation with some of its imperfections."""

    settings: SimulationSettings
    walking: WalkingSettings

    def only(self, *effects: str) -> "Laboratory":
        """With none but these imperfections of the gait laboratory; the leg's are off too, but for 'the leg'."""
        others = [name for name in WalkingEffects.model_fields if name not in effects]
        walking = self.walking.model_copy(update={"effects": self.walking.effects.without(*others)})
        ideal = self.settings.model_copy(update={"effects": self.settings.effects.without()})
        return Laboratory(self.settings if "the leg" in effects else ideal, walking)


def record(laboratory: Laboratory, seed: int, crossings: int, folder: Path) -> Session:
    """Simulate a campaign, write its C3D files and ingest them."""
    settings = laboratory.settings.model_copy(update={"seed": seed})
    p = read_parameters(settings.parameters)
    names = [f"walking_{k + 1:02d}" for k in range(crossings)]
    rows: list[dict[str, Any]] = [{"trial": "static_1", "experiment": "static"}]
    rows += [{"trial": f"plate_{k + 1:02d}", "experiment": "plate"} for k in range(PLATE_TRIALS)]
    rows += [{"trial": n, "experiment": "walking", "perturbed": k % 2 == 0} for k, n in enumerate(names)]
    trials = {}
    for row in rows:
        simulate_walking_trial(row, settings, laboratory.walking, p, folder)
        name = row["trial"]
        files = {"mocap": f"vicon/{name}.c3d", "mocap_source": "vicon"}
        ingest_trial(row | files, folder, SOURCES, folder / f"{name}.parquet")
        trials[name] = read_trial(folder / f"{name}.parquet")
    perturbed = tuple(names[::2])
    truth = {name: json.loads((folder / f"truth/{name}.json").read_text()) for name in perturbed}
    curves = {name: pl.read_parquet(folder / f"truth/{name}.parquet") for name in names}
    return Session(trials, perturbed, tuple(names[1::2]), truth, curves)


def analysed(session: Session, settings: WalkingAnalysis, weigh_plate: bool = True) -> list[Crossing]:
    """The session's crossings, perturbed ones first."""
    calibration = static_calibration(session.trials["static_1"], settings)
    unloaded = [session.trials[f"plate_{k + 1:02d}"] for k in range(PLATE_TRIALS)]
    plate: PlateModel = identify_plate_model(unloaded, calibration, settings)
    if not weigh_plate:
        plate = replace(plate, inertia=replace(plate.inertia, parameters=0 * plate.inertia.parameters))
    platform = identify_platform([session.trials[name] for name in session.perturbed], calibration, settings)
    return [
        analyse_crossing(session.trials[name], calibration, plate, name in session.perturbed, settings, platform)
        for name in (*session.perturbed, *session.unperturbed)
    ]


def errors_of(session: Session, crossings: Iterable[Crossing], settings: WalkingAnalysis) -> Array:
    """Errors (4,) of the campaign: mean K and B [% of the rendered], mean I [kg*m^2], RMS of the torque [N*m]."""
    walked = [c for c in crossings if c.onset is not None]
    gait = unperturbed_gait([c for c in crossings if c.onset is None], settings.fewest_unperturbed)
    fits = [fit_response(isolate_response(c, gait, settings.timing, settings.perturbed_stance)) for c in walked]
    true = {q: np.mean([session.truth[c.name][f"{q}_rendered"] for c in walked]) for q in "KBI"}
    K, B, I = (np.mean([getattr(fit, q) for fit in fits]) for q in "KBI")
    torque = np.mean([torque_error(c, session.curves[c.name], settings.window_s) for c in walked])
    return np.array([100 * (K / true["K"] - 1), 100 * (B / true["B"] - 1), I - true["I"], torque])


def torque_error(crossing: Crossing, curves: pl.DataFrame, window: float) -> float:
    """RMS [N*m] of the ankle's torque against the exact one, in the window after the onset."""
    assert crossing.onset is not None
    rows = (crossing.time >= crossing.onset) & (crossing.time <= crossing.onset + window)
    true = np.interp(crossing.time[rows], curves["time"].to_numpy(), curves["torque"].to_numpy())
    return float(np.sqrt(np.mean((crossing.torque[rows] - true) ** 2)))


def exact_crossings(session: Session, crossings: Iterable[Crossing], settings: WalkingAnalysis) -> list[Crossing]:
    """The same crossings with the exact angle and torque through the same filter in place of the measured ones."""
    found = []
    for c in crossings:
        curves = session.curves[c.name]
        step = c.time[1] - c.time[0]
        frames = curves.gather_every(round(step / (curves["time"][1] - curves["time"][0])))
        rows = np.searchsorted(frames["time"].to_numpy(), c.time - step / 2)
        theta, torque = (settings.low_pass(frames[name].to_numpy(), 1 / step)[rows] for name in ("theta", "torque"))
        found.append(replace(c, theta=theta, torque=torque))
    return found


def with_remedies(settings: WalkingAnalysis, remedies: Iterable[str], foot: FootSettings | None) -> WalkingAnalysis:
    """The analysis with these remedies and no others; that of the plate's inertia is not a setting."""
    return settings.model_copy(
        update={
            "correct_plate_lag": "lag" in remedies,
            "unloaded_s": settings.unloaded_s if "zero" in remedies else None,
            "foot": foot if "foot" in remedies else None,
        }
    )


def alone(shipped: Laboratory, settings: WalkingAnalysis, folder: Path) -> Iterable[tuple[str, Array]]:
    """Errors (campaigns, 4) of nothing, and of each imperfection alone, under the analysis as configured."""
    session = record(shipped.only(), FIRST_SEED, FEW, folder / "none")
    crossings = analysed(session, settings)
    yield "none", errors_of(session, crossings, settings)[None]
    exact = exact_crossings(session, crossings, settings)
    yield "none; exact angle and torque through the same filter and fit", errors_of(session, exact, settings)[None]
    effects = [name for name in WalkingEffects.model_fields if name not in UNSEEN]
    for effect in ("the leg", *effects):
        if effect != "the leg" and not getattr(shipped.walking.effects, effect).enabled:
            continue
        found = []
        for k in range(CAMPAIGNS_ALONE if effect in VARIES else 1):
            place = folder / f"{effect} {k}"
            session = record(shipped.only(effect), FIRST_SEED + k, CROSSINGS if effect in VARIES else FEW, place)
            found.append(errors_of(session, analysed(session, settings), settings))
        yield effect_label(effect, shipped.walking), np.array(found)


def effect_label(effect: str, walking: WalkingSettings) -> str:
    """An imperfection with its size, as a row is called."""
    if effect == "the leg":
        return "the leg's friction, encoders, delay and belt"
    found = getattr(walking.effects, effect)
    return f"{effect.replace('_', ' ')}, {found.size:g} {found.unit}"


def together(shipped: Laboratory, settings: WalkingAnalysis, folder: Path) -> Iterable[tuple[str, Array]]:
    """Errors (campaigns, 4) with every imperfection, under all remedies, none, each alone, and all but each."""
    foot = weighed_foot(shipped.walking)
    sessions = [record(shipped, FIRST_SEED + k, CROSSINGS, folder / f"all {k}") for k in range(CAMPAIGNS)]
    chosen = {"no remedy": (), "all remedies": tuple(REMEDIES)}
    chosen |= {f"only {text}": (name,) for name, text in REMEDIES.items()}
    chosen |= {f"all but {text}": tuple(r for r in REMEDIES if r != name) for name, text in REMEDIES.items()}
    for label, remedies in chosen.items():
        those = with_remedies(settings, remedies, foot)
        found = [errors_of(s, analysed(s, those, "inertia" in remedies), those) for s in sessions]
        yield label, np.array(found)
    exact = [errors_of(s, exact_crossings(s, analysed(s, settings), settings), settings) for s in sessions]
    yield "exact angle and torque of the same crossings, same filter and fit", np.array(exact)


def table(rows: Iterable[tuple[str, Array]]) -> str:
    """Markdown rows: mean over campaigns, with its standard error where there are several."""
    lines = [
        "| | K error, % | B error, % | I error, kg·m² | torque RMS error, N·m |",
        "| --- | --- | --- | --- | --- |",
    ]
    for label, found in rows:
        mean, n = found.mean(axis=0), len(found)
        errors = found.std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else [None] * len(mean)
        cells = [cell(m, e, d) for m, e, d in zip(mean, errors, (2, 2, 4, 2), strict=True)]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def cell(mean: float, error: float | None, digits: int) -> str:
    """A number, with its standard error if there is one."""
    return f"{mean:.{digits}f}" if error is None else f"{mean:.{digits}f} ± {error:.{digits}f}"


def main() -> None:
    chosen = [name for name in TABLES if name in sys.argv[1:]]
    words = [word for word in sys.argv[1:] if word not in (*TABLES, "campaigns")]
    if words:
        for name in chosen or TABLES:
            replace_rows(name, headline_table(name, words))
        return
    tables = {name: headline_table(name) for name in chosen or (TABLES if "campaigns" in sys.argv[1:] else ())}
    if len(sys.argv) == 1:
        tables = remedy_tables() | {name: headline_table(name) for name in TABLES}
    write_tables(tables)


def write_tables(tables: Mapping[str, str]) -> None:
    """Write tables between their marks in the page."""
    text = REPORT.read_text(encoding="utf-8")
    for mark, rows in tables.items():
        head, _, rest = text.partition(f"<!-- {mark} -->\n")
        text = f"{head}<!-- {mark} -->\n{rows}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    REPORT.write_text(text, encoding="utf-8")


def replace_rows(mark: str, made: str) -> None:
    """Put some rows of a table of campaigns into the page, in place of those of the same campaigns."""
    old = REPORT.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n")[2].partition("\n<!-- end -->")[0]
    head = old.split("\n")[:2]
    rows = rows_by_case(mark, old) | rows_by_case(mark, made)
    write_tables({mark: "\n".join([*head, *(row for case in TABLES[mark] for row in rows.get(case.label, []))])})


def rows_by_case(mark: str, rows: str) -> dict[str, list[str]]:
    """The rows of a table of campaigns by the label of their case; rows that begin with … belong to the one before,
    unless a case has that label."""
    labels, found, last = {case.label for case in TABLES[mark]}, dict[str, list[str]](), ""
    for row in rows.split("\n")[2:]:
        label = row.split("|")[1].strip()
        named = label if label in labels else label.rpartition(" [")[0]
        last = named if named in labels else last
        found.setdefault(last, []).append(row)
    return found


def remedy_tables() -> dict[str, str]:
    """The tables of the remedies for gait, plate and sensors, by their marks in the page."""
    shipped_settings = read_yaml(SETTINGS, SimulationSettings)
    assert shipped_settings.walking is not None
    shipped = Laboratory(shipped_settings, read_yaml(shipped_settings.walking, WalkingSettings))
    settings = read_section(CONFIG, "walking", WalkingAnalysis)
    with tempfile.TemporaryDirectory() as name:
        return {
            "together": table(together(shipped, settings, Path(name))),
            "alone": table(alone(shipped, settings, Path(name))),
        }


if __name__ == "__main__":
    main()
