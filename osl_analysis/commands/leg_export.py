"""`osl-analysis export`: the identified leg and its gains for other programs, with a round trip in
MuJoCo."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import motion_in
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.measured_components import (
    COMPONENTS,
    PARTS,
    Components,
    components_of,
)
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import Config
from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.tables import read_summary
from osl_analysis.errors import InputError, listing, nearest, optional_module
from osl_analysis.files import write_text
from osl_analysis.model import mjcf
from osl_analysis.model.actuator_in_time import Controller
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_of, read_parameters
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.table import read_table
from osl_analysis.trial import read_trial

SUFFIXES = {"mjcf": ".xml", "json": ".json"}  # of the file of each kind of export
TRIAL_COLUMNS = ("trial", *PLACE, "controller", "K_d", "B_d")
ROUND_TRIP_TEXT = (
    "Nothing was fitted to these trials, and no number above is from them. The joint was turned as"
    " recorded,",
    "under the paper's controller with the numbers of the parameter file; dof_frictionloss was set"
    " as above.",
    "RMS [N*m] is that of the difference without its mean; K, B, I are of Eq. 15, recorded and"
    " MuJoCo's.",
)


@dataclass(frozen=True)
class KnownController:
    """The controller of a trial with known gains."""

    desired: DesiredImpedance
    gains: Gains
    law: Controller


def export_leg(
    folder: Path, kind: str, patterns: Sequence[str], config: Config, output: Path
) -> str:
    """Write the leg that the component trials of a campaign identify.

    Parameters
    ----------
    folder : Path
        Results of the campaign.
    kind : str
        Of `SUFFIXES`.
    patterns : Sequence of str
        Names of the impedance trials of the round trip, or patterns.
    config : Config
        The campaign's.
    output : Path

    Returns
    -------
    str
        What the round trip proves.

    Raises
    ------
    InputError
        The results are of another campaign, or have no such trial; a part is missing.
    """
    if output.suffix != SUFFIXES[kind]:
        raise InputError(f"{output}: {kind} is written as {SUFFIXES[kind]}; choose this suffix")
    about = read_summary(folder / "summary.json")
    if about.get("campaign") != config.campaign:
        raise InputError(
            f"{folder}: results of campaign '{about.get('campaign')}', the configuration is of"
            f" '{config.campaign}'; name the one that they were made with by --config"
        )
    if config.parameters is None:
        raise InputError(
            f"{folder}: its configuration names no parameter file, which has n_T, n_m and the"
            " controller's numbers; name one under `parameters`"
        )
    file = read_parameters(config.parameters)
    joint = joint_of(config.parameters)
    trials = exported_trials(folder, patterns, joint)
    components = measured_leg(folder, trials, joint, file)
    controllers = known_controllers(trials, file, config)
    proof = proof_of(folder, controllers, config, components.p)
    # their gains are not known
    proof["not_compared"] = [name for name in trials["trial"] if name not in controllers]

    leg = {
        "about": sentence(about),
        "parameters": components.rows(),
        "covariance": {"order": list(COMPONENTS), "matrix": components.covariance.tolist()},
        "given": {"n_T": file.n_T, "n_m": file.n_m, "source": config.parameters.name},
        "controller": {
            "k_tau_n_m": file.k_tau * file.n_m,
            "f_C": file.f_C,
            "f_G": file.f_G,
            "source": config.parameters.name,
            "sign_width": config.model_comparison.sign_width,
            "gains": gains_of_conditions(controllers),
        },
        "equations": mjcf.EQUATIONS,
        "mjcf_cannot_say": mjcf.CANNOT,
        "proof": proof,
    }
    if kind == "json":
        text = json.dumps(leg, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    else:
        text = mjcf.mjcf_text(components.p, "\n".join(leg_lines(leg)))
    write_text(output, text)
    return str(proof["says"])


def exported_trials(folder: Path, patterns: Sequence[str], joint: str) -> pl.DataFrame:
    """The rows over all amplitudes of the impedance trials of a joint that have one of some names,
    or patterns."""
    path = folder / "tables/impedance.csv"
    if not path.exists() and list(patterns) == ["*"]:
        return pl.DataFrame(schema=dict.fromkeys(TRIAL_COLUMNS, pl.String))
    table = read_table(path, (*TRIAL_COLUMNS, "amplitude_deg"))
    table = table.filter(pl.col("amplitude_deg").is_null(), joint=joint)
    names = table["trial"].to_list()
    chosen: set[str] = set()
    for pattern in patterns:
        matching = [name for name in names if fnmatchcase(name, pattern)]
        if not matching:
            similar = nearest(pattern, names) or f"; it has {listing(names, 5)}"
            raise InputError(f"{path}: no trial '{pattern}' of the {joint}{similar}")
        chosen.update(matching)
    return table.filter(pl.col("trial").is_in(list(chosen))).select(TRIAL_COLUMNS)


def measured_leg(
    folder: Path, trials: pl.DataFrame, joint: str, file: DrivetrainParameters
) -> Components:
    """The components of the joint and side of some impedance trials; without trials, of the belt's.
    Raises InputError: they are of several."""
    tables = {}
    for part in PARTS:
        path = folder / f"tables/{part}.csv"
        if path.exists():
            tables[part] = read_table(path)
    rows = trials
    if rows.is_empty() and "belt" in tables:
        rows = tables["belt"].filter(joint=joint)
    places = rows.select(PLACE).unique(maintain_order=True).rows()
    if len(places) > 1:
        raise InputError(
            f"{folder}: trials of several joints or sides, {places}; choose those of one by"
            " --trials"
        )
    return components_of(tables, places[0] if places else (None, None), file)


def known_controllers(
    trials: pl.DataFrame, file: DrivetrainParameters, config: Config
) -> dict[str, KnownController]:
    """The controllers of the trials whose gains are known, by trial."""
    controllers = {}
    for trial, *condition in trials.select("trial", "controller", "K_d", "B_d").iter_rows():
        desired = DesiredImpedance(*condition)
        gains = desired.gains(file, config.gain_weight)
        if gains is not None:
            law = Controller(gains, file, config.model_comparison.sign_width)
            controllers[trial] = KnownController(desired, gains, law)
    return controllers


def gains_of_conditions(controllers: Mapping[str, KnownController]) -> list[dict[str, Any]]:
    """Each desired impedance once, with its gains."""
    conditions = {controller.desired: controller.gains for controller in controllers.values()}
    return [
        {**asdict(desired), "K_1": gains.K_1, "B_1": gains.B_1}
        for desired, gains in conditions.items()
    ]


def proof_of(
    folder: Path,
    controllers: Mapping[str, KnownController],
    config: Config,
    p: DrivetrainParameters,
) -> dict[str, Any]:
    """The round trip of the leg `p` over the trials by name; `says` is the result in words, or why
    there is none."""
    try:
        engine = f"MuJoCo {optional_module('mujoco', 'the round trip').__version__}"
    except (InputError, ImportError) as error:  # also where only a part of it is installed
        return {"says": f"not proven: {' '.join(str(error).split())}"}
    if not controllers:
        return {"says": "not proven: the results have no impedance trial whose gains are known"}
    rows = []
    for name, controller in controllers.items():
        rows.append(round_trip(folder / f"trials/{name}.parquet", controller.law, config, p))
    worst = min(rows, key=lambda row: row["VAF"])
    median = float(np.median([row["VAF"] for row in rows]))
    return {
        "says": (
            f"{engine} predicts the torque of {len(rows)} impedance trials: median VAF"
            f" {median:.3f} %, lowest {worst['VAF']:.3f} % ({worst['trial']})"
        ),
        "engine": engine,
        "VAF_median": median,
        "VAF_lowest": worst["VAF"],
        "trials": rows,
    }


def round_trip(
    trial: Path, law: Controller, config: Config, p: DrivetrainParameters
) -> dict[str, Any]:
    """Compare the torque of the leg in MuJoCo, whose joint is turned as recorded, with the recorded
    one.

    Both pass the same filter; the fitted rows count.

    Returns
    -------
    dict
        `VAF` [percent], `RMS` of the difference without its mean [N*m], and K, B and I of Eq. 15 of
        both.

    Raises
    ------
    InputError
        The actuator runs away.
    """
    record = record_of_trial(read_trial(trial), config.dynamometer)
    motion = record.motion
    torque = mjcf.mujoco_torque(record.rate_hz, motion.theta, motion.omega, motion.alpha, law, p)
    if not np.isfinite(torque).all():
        raise InputError(
            f"trial {record.name}: the actuator runs away in MuJoCo with K_1 = {law.gains.K_1:g},"
            f" B_1 = {law.gains.B_1:g}; check the component trials and the parameter file"
        )
    recorded = record.part(record.filtered_torque)
    simulated = record.part(record.low_pass(torque, record.rate_hz))
    difference = recorded - simulated
    row = {
        "trial": record.name,
        "VAF": variance_accounted_for(recorded, difference),
        "RMS": float(difference.std()),
    }
    X = np.column_stack([motion_in(record), np.ones(record.samples)])
    estimates = np.linalg.lstsq(X, np.column_stack([recorded, simulated]), rcond=None)[0].tolist()
    for name, (of_recorded, of_simulated) in zip("KBI", estimates[:3], strict=True):
        row[f"{name}_recorded"] = of_recorded
        row[f"{name}_mujoco"] = of_simulated
    return row


def leg_lines(leg: Mapping[str, Any]) -> list[str]:
    """What the MJCF says in words: the source of every number, what MuJoCo cannot say, and the
    proof."""
    given = leg["given"]
    proof = leg["proof"]
    lines = [
        f"Made by osl-analysis {version('osl-analysis')}, `export`. {leg['about']}.",
        "",
        "Identified from component trials, with the 95 % interval (a JSON export has the"
        " covariances):",
    ]
    for component in leg["parameters"]:
        interval = f"[{component['low']:.6g}, {component['high']:.6g}]"
        trials = component["trials"]
        lines.append(
            f"  {component['name']:<10}{component['value']:<12.6g}{interval:<26}"
            f"{component['unit']:<10} {len(trials)} {component['experiment']} trials:"
            f" {listing(trials, 12)}"
        )
    lines += [
        f"Given by {given['source']}: n_T {given['n_T']:.6g}, n_m {given['n_m']:g}, which k_tau_n_m"
        " has in it.",
        "",
        "What MJCF cannot say, or MuJoCo's defaults have otherwise:",
    ]
    lines += [f"  * {sentence}" for sentence in leg["mjcf_cannot_say"]]
    lines.append("")
    if "trials" in proof:
        lines += [f"Proof: {proof['says']}", *ROUND_TRIP_TEXT, *round_trip_lines(proof["trials"])]
    else:
        lines.append(proof["says"])
    if proof["not_compared"]:
        lines.append(
            f"Not compared, because their gains are not known: {listing(proof['not_compared'])}"
        )
    return lines


def round_trip_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line per trial of the round trip: VAF, RMS, and K, B and I recorded and in MuJoCo."""
    width = max(len(row["trial"]) for row in rows) + 2
    estimates = f"{'K':>9}{'':>9}{'B':>8}{'':>8}{'I':>10}{'':>10}"
    lines = [f"  {'trial':<{width}}{'VAF [%]':>8}{'RMS':>8}{estimates}"]
    for row in rows:
        lines.append(
            f"  {row['trial']:<{width}}{row['VAF']:8.3f}{row['RMS']:8.3f}"
            f"{row['K_recorded']:9.2f}{row['K_mujoco']:9.2f}"
            f"{row['B_recorded']:8.3f}{row['B_mujoco']:8.3f}"
            f"{row['I_recorded']:10.5f}{row['I_mujoco']:10.5f}"
        )
    return lines
