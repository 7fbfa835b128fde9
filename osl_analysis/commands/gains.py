"""Gain selection for one pair, a grid or a trajectory of desired impedances, and the behaviour that
theory predicts. Export of the identified leg and its gains to other programs, with a round trip in
MuJoCo."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from osl_analysis.bench.analysis import motion_in
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.measured_components import COMPONENTS, PARTS, components_of
from osl_analysis.bench.recorded_motion import record_of_trial
from osl_analysis.campaign.configuration import Config
from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.tables import read_summary
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.errors import InputError, listing, naming, nearest, optional_module
from osl_analysis.figures import drawing_of
from osl_analysis.files import write_text
from osl_analysis.model import compensator, drivetrain, mjcf
from osl_analysis.model.actuator_in_time import Controller
from osl_analysis.model.compensator import Weight
from osl_analysis.model.rendered_impedance import predicted_impedance, rendering
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import read_trial

# frequencies of Section III-B, at which the fit of Eq. 15 is predicted
TESTED_HZ = (1.0, 2.0, 3.0, 4.0, 5.0)


def gain_table(
    K_d: ArrayLike,
    B_d: ArrayLike,
    p: drivetrain.DrivetrainParameters,
    weight: Weight,
    frequencies_hz: Sequence[float],
) -> pl.DataFrame:
    """A row per pair K_d [N*m/rad], B_d [N*m*s/rad], arrays of shape (pairs,); `results
    --columns` explains the columns.

    They are the gains at the actuator's output and at the joint (times n_T^2), the norm of Eq. 14,
    the flags of `optimal_damping`, the fit of Eq. 15 that linear theory predicts at
    `frequencies_hz`, and the stability, passivity and fidelity of the impedance (`rendering`);
    these are null where no finite B_1 is best."""
    compensator.check_request(K_d, B_d, p)
    K_d, B_d = (np.asarray(v, dtype=float) for v in (K_d, B_d))
    K_1 = compensator.stiffness_gain(K_d, p)
    optimum = compensator.optimal_damping(K_d, B_d, p, weight)
    B_1 = optimum.B_1
    finite = np.isfinite(B_1)
    at_joint = {"K_1_joint": K_1 * p.n_T**2, "B_1_joint": B_1 * p.n_T**2}
    table = pl.DataFrame(
        {"K_d": K_d, "B_d": B_d, "K_1": K_1, "B_1": B_1, **at_joint, **optimum._asdict()}
    )
    gains = [compensator.Gains(k, b, True) for k, b in zip(K_1[finite], B_1[finite], strict=True)]
    fits = [predicted_impedance(of_pair, p, frequencies_hz) for of_pair in gains]
    rendered = rendering(K_1[finite], B_1[finite], K_d[finite], B_d[finite], p)
    columns: dict[str, Any] = {
        **{f"{name}_predicted": [fit[k] for fit in fits] for k, name in enumerate("KBI")},
        **rendered._asdict(),
    }
    behaviour = pl.DataFrame(columns).with_columns(
        row=pl.Series(np.flatnonzero(finite), dtype=pl.UInt32)
    )
    return (
        table.with_row_index("row")
        .join(behaviour, on="row", how="left", maintain_order="left")
        .drop("row")
    )


def requested_gains(
    stiffness: Sequence[float],
    damping: Sequence[float],
    trajectory: Path | None,
    weight: Weight,
    parameters: Path,
) -> pl.DataFrame:
    """The gains for every row of a trajectory file, or for every combination of K_d [N*m/rad] and
    B_d [N*m*s/rad]."""
    p = drivetrain.read_parameters(parameters)
    if trajectory is not None:
        return trajectory_table(trajectory, p, weight)
    K_d, B_d = (v.ravel() for v in np.meshgrid(stiffness, damping, indexing="ij"))
    return gain_table(K_d, B_d, p, weight, TESTED_HZ)


def trajectory_table(
    trajectory: Path, p: drivetrain.DrivetrainParameters | None, weight: Weight
) -> pl.DataFrame:
    """The table of gains for every row of a trajectory file, `phase` first; a refusal names the
    file. `trajectory` is what the file says of itself, as synthetic. Without parameters there are
    no gains."""
    desired = read_impedance_trajectory(trajectory)
    with naming(trajectory):
        if p is None:
            none = dict.fromkeys(("K_1_joint", "B_1_joint"), pl.lit(None, pl.Float64))
            table = pl.DataFrame({"K_d": desired.K_d, "B_d": desired.B_d}).with_columns(**none)
        else:
            table = gain_table(desired.K_d, desired.B_d, p, weight, TESTED_HZ)
    kind = pl.lit(desired.kind, pl.String).alias("trajectory")
    return table.select(pl.Series("phase", desired.phase), kind, pl.all())


def select_trajectory(
    trajectory: Path,
    weight: Weight,
    output: Path,
    parameters: drivetrain.FileOrNone = None,
    data: str = "",
) -> None:
    """Write the gains for every row of a trajectory (Fig. 8)."""
    write_table(
        trajectory_table(trajectory, drivetrain.known_parameters(parameters), weight), output, data
    )


def gains_text(table: pl.DataFrame) -> str:
    """The table as text: one pair in words, several pairs in columns."""
    if len(table) > 1:
        printed = (
            "phase",
            "K_d",
            "B_d",
            "K_1",
            "B_1",
            "error",
            "K_predicted",
            "B_predicted",
            "faithful_to_hz",
        )
        columns = [c for c in printed if c in table.columns]
        rows = [columns, *([f"{v:.5g}" for v in row] for row in table.select(columns).rows())]
        return "\n".join("".join(f"{cell:>15}" for cell in row) for row in rows)
    row = table.row(0, named=True)
    minima = "exactly one local minimum" if row["minima"] == 1 else f"{row['minima']} local minima"
    lines = [
        f"K_1 = {row['K_1']:.6g} N·m/rad ({row['K_1_joint']:.6g} at the joint)",
        f"B_1 = {row['B_1']:.6g} N·m·s/rad ({row['B_1_joint']:.6g} at the joint)",
        f"||W (Y - Y_d)||_2 = {row['error']:.4g} rad/(N·m)·s^-1/2; {minima} among the stable gains",
    ]
    if row["at_lower_bound"]:
        lines.append(
            "warning: the joint alone damps more than desired; B_1 is the smallest stable gain"
        )
    if row["unbounded"]:
        lines.append(
            "warning: no finite B_1 minimises Eq. 14, a locked motor would be best; lower"
            " --weight-hz"
        )
    else:
        far = (
            f"warning: this K is far from {row['K_d']:g}: the leg renders K_d at rest; ask for more"
            " damping, or "
        )
        far += "lower --weight-hz"
        lines += [
            (
                f"predicted fit over 1 to 5 Hz: K {row['K_predicted']:.4g} N·m/rad, B"
                f" {row['B_predicted']:.4g} N·m·s/rad, I {row['I_predicted']:.3g} kg·m² (friction"
                " cancelled)"
            ),
            *[far] * bool(abs(row["K_predicted"] / row["K_d"] - 1) > 0.25),
            f"within 10 % of the desired impedance up to {row['faithful_to_hz']:.3g} Hz; passive",
            (
                f"the slowest mode decays with {row['decay_rate']:.3g} 1/s; with the joint held, "
                f"{1e3 * row['delay_margin']:.3g} ms of delay in the loop make it unstable"
            ),
        ]
    return "\n".join(lines)


def plot_gains(table: pl.DataFrame, parameters: Path, output: Path) -> None:
    """Draw the response of one pair over 0.1 to 10 Hz (as Fig. 7), a grid of gains, or a trajectory
    (as Fig. 8)."""
    from osl_analysis.commands.figure import draw_table  # matplotlib takes half a second

    if len(table) == 1:
        from osl_analysis.figures.frequency import DESIRED, LINEAR_MODEL, draw_fig7, response_curve
        from osl_analysis.figures.names import completed

        p, row, f = (
            drivetrain.read_parameters(parameters),
            table.row(0, named=True),
            np.geomspace(0.1, 10, 201),
        )
        curves = (
            (DESIRED, None, drivetrain.desired_admittance(row["K_d"], row["B_d"])),
            (
                LINEAR_MODEL,
                "compensated",
                drivetrain.joint_admittance(row["K_1"], row["B_1"], p, p.J_j),
            ),
        )
        frames = [
            response_curve(curve, name, f, Y(2j * np.pi * f), (None, None))
            for curve, name, Y in curves
        ]
        draw_table("fig7", completed(pl.concat(frames), draw_fig7.columns), [output])
    elif "phase" in table.columns:
        draw_table("fig8", drawing_of("fig8").points(table), [output])
    else:
        draw_table("gain_grid", table, [output])


EXPORTED = {"mjcf": ".xml", "json": ".json"}
"""Suffix of the file of each kind of export."""


def export_leg(folder: Path, kind: str, names: Sequence[str], config: Config, output: Path) -> str:
    """Write the leg that the component trials of the results in `folder` identify, as MJCF or JSON
    (`EXPORTED`), with its round trip in MuJoCo over the impedance trials of some `names`, which may
    be patterns. Returns what it proves. Raises InputError: the results are of another campaign than
    `config`, or have no such trial; a part is missing."""
    if output.suffix != EXPORTED[kind]:
        raise InputError(f"{output}: {kind} is written as {EXPORTED[kind]}; choose this suffix")
    about = read_summary(folder / "summary.json")
    if about.get("campaign") != config.campaign:
        said = (
            f"results of campaign '{about.get('campaign')}', the configuration is of"
            f" '{config.campaign}'"
        )
        raise InputError(f"{folder}: {said}; name the one that they were made with by --config")
    if config.parameters is None:
        lacking = (
            "its configuration names no parameter file, which has n_T, n_m and the controller's"
            " numbers"
        )
        raise InputError(f"{folder}: {lacking}; name one under `parameters`")
    file, source = drivetrain.read_parameters(config.parameters), config.parameters.name
    width = config.model_comparison.sign_width
    tables = {
        part: read_table(path) for part in PARTS if (path := folder / f"tables/{part}.csv").exists()
    }
    joint = drivetrain.joint_of(config.parameters)
    trials = exported_trials(folder, names, joint)
    known = trials if len(trials) else tables.get("belt", trials).filter(joint=joint)
    places = known.select(PLACE).unique(maintain_order=True).rows()
    if len(places) > 1:
        raise InputError(
            f"{folder}: trials of several joints or sides, {places}; choose those of one by"
            " --trials"
        )
    components = components_of(tables, places[0] if places else (None, None), file)
    laws, asked = dict[str, Controller](), dict[DesiredImpedance, compensator.Gains]()
    for trial, *condition in trials.select("trial", "controller", "K_d", "B_d").iter_rows():
        gains = (desired := DesiredImpedance(*condition)).gains(file, config.gain_weight)
        if gains is not None:
            laws[trial], asked[desired] = Controller(gains, file, width), gains
    proof = proof_of(folder, laws, config, components.p)
    # their gains are not known
    proof["not_compared"] = [name for name in trials["trial"] if name not in laws]
    constants = {
        "k_tau_n_m": file.k_tau * file.n_m,
        "f_C": file.f_C,
        "f_G": file.f_G,
        "source": source,
    }
    of_pairs = [
        asdict(desired) | {"K_1": gains.K_1, "B_1": gains.B_1} for desired, gains in asked.items()
    ]
    leg: dict[str, Any] = {"about": sentence(about), "parameters": components.rows()}
    leg |= {"covariance": {"order": list(COMPONENTS), "matrix": components.covariance.tolist()}}
    leg |= {"given": {"n_T": file.n_T, "n_m": file.n_m, "source": source}}
    leg |= {"controller": constants | {"sign_width": width, "gains": of_pairs}}
    leg |= {"equations": mjcf.EQUATIONS, "mjcf_cannot_say": mjcf.CANNOT, "proof": proof}
    text = json.dumps(leg, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_text(
        output, text if kind == "json" else mjcf.mjcf_text(components.p, "\n".join(leg_lines(leg)))
    )
    return str(proof["says"])


def exported_trials(folder: Path, names: Sequence[str], joint: str) -> pl.DataFrame:
    """The rows over all amplitudes of the impedance trials of a joint that have one of some names,
    or patterns."""
    path, columns = folder / "tables/impedance.csv", ("trial", *PLACE, "controller", "K_d", "B_d")
    if not path.exists() and list(names) == ["*"]:
        return pl.DataFrame(schema=dict.fromkeys(columns, pl.String))
    table = read_table(path, (*columns, "amplitude_deg")).filter(
        pl.col("amplitude_deg").is_null(), joint=joint
    )
    chosen = {name: [fnmatchcase(trial, name) for trial in table["trial"]] for name in names}
    for name in (name for name, found in chosen.items() if not any(found)):
        near = nearest(name, table["trial"]) or f"; it has {listing(table['trial'].to_list(), 5)}"
        raise InputError(f"{path}: no trial '{name}' of the {joint}{near}")
    return table.filter([any(found) for found in zip(*chosen.values(), strict=True)]).select(
        columns
    )


def proof_of(
    folder: Path, laws: Mapping[str, Controller], config: Config, p: drivetrain.DrivetrainParameters
) -> dict[str, Any]:
    """The round trip of the leg `p` over the trials by name; `says` is the result in words, or why
    there is none. The torque of the leg in MuJoCo, whose joint is turned as recorded, stands beside
    the recorded one, both through the same filter, in the fitted rows: VAF [percent], RMS of the
    difference without its mean [N*m], and K, B and I of Eq. 15 of both. Raises InputError: the
    actuator runs away."""
    try:
        engine = f"MuJoCo {optional_module('mujoco', 'the round trip').__version__}"
    except (InputError, ImportError) as error:  # also where only a part of it is installed
        return {"says": f"not proven: {' '.join(str(error).split())}"}
    if not laws:
        return {"says": "not proven: the results have no impedance trial whose gains are known"}
    rows = list[dict[str, Any]]()
    for name, law in laws.items():
        record = record_of_trial(read_trial(folder / f"trials/{name}.parquet"), config.dynamometer)
        motion = record.motion
        torque = mjcf.mujoco_torque(
            record.rate_hz, motion.theta, motion.omega, motion.alpha, law, p
        )
        if not np.isfinite(torque).all():
            said = (
                f"the actuator runs away in MuJoCo with K_1 = {law.gains.K_1:g}, B_1 ="
                f" {law.gains.B_1:g}"
            )
            raise InputError(
                f"trial {record.name}: {said}; check the component trials and the parameter file"
            )
        simulated = record.low_pass(torque, record.rate_hz)
        both = np.column_stack([record.part(record.filtered_torque), record.part(simulated)])
        left = both[:, 0] - both[:, 1]
        X = np.column_stack([motion_in(record), np.ones(record.samples)])
        row = {
            "trial": record.name,
            "VAF": variance_accounted_for(both[:, 0], left),
            "RMS": float(left.std()),
        }
        for quantity, found in zip(
            "KBI", np.linalg.lstsq(X, both, rcond=None)[0].tolist(), strict=False
        ):
            row |= {f"{quantity}_recorded": found[0], f"{quantity}_mujoco": found[1]}
        rows.append(row)
    worst, median = (
        min(rows, key=lambda row: row["VAF"]),
        float(np.median([row["VAF"] for row in rows])),
    )
    vaf = f"median VAF {median:.3f} %, lowest {worst['VAF']:.3f} % ({worst['trial']})"
    says = f"{engine} predicts the torque of {len(rows)} impedance trials: {vaf}"
    return {
        "says": says,
        "engine": engine,
        "VAF_median": median,
        "VAF_lowest": worst["VAF"],
        "trials": rows,
    }


def leg_lines(leg: Mapping[str, Any]) -> list[str]:
    """What the MJCF says in words: the source of every number, what MuJoCo cannot say, and the
    proof."""
    given, proof = leg["given"], leg["proof"]
    lines = [f"Made by osl-analysis {version('osl-analysis')}, `export`. {leg['about']}.", ""]
    lines += [
        "Identified from component trials, with the 95 % interval (a JSON export has the"
        " covariances):"
    ]
    for one in leg["parameters"]:
        interval = f"[{one['low']:.6g}, {one['high']:.6g}]"
        of = f"{len(one['trials'])} {one['experiment']} trials: {listing(one['trials'], 12)}"
        lines.append(
            f"  {one['name']:<10}{one['value']:<12.6g}{interval:<26}{one['unit']:<10} {of}"
        )
    ratios = f"n_T {given['n_T']:.6g}, n_m {given['n_m']:g}, which k_tau_n_m has in it."
    lines += [
        f"Given by {given['source']}: {ratios}",
        "",
        "What MJCF cannot say, or MuJoCo's defaults have otherwise:",
    ]
    lines += [*(f"  * {one}" for one in leg["mjcf_cannot_say"]), ""]
    lines.append(f"{'Proof: ' if 'engine' in proof else ''}{proof['says']}")
    if rows := proof.get("trials"):
        wide = max(len(row["trial"]) for row in rows) + 2
        head = f"  {'trial':<{wide}}{'VAF [%]':>8}{'RMS':>8}"
        head += f"{'K':>9}{'':>9}{'B':>8}{'':>8}{'I':>10}{'':>10}"
        lines += [
            (
                "Nothing was fitted to these trials, and no number above is from them. The joint"
                " was turned as recorded,"
            ),
            (
                "under the paper's controller with the numbers of the parameter file;"
                " dof_frictionloss was set as above."
            ),
            (
                "RMS [N*m] is that of the difference without its mean; K, B, I are of Eq. 15,"
                " recorded and MuJoCo's."
            ),
            head,
        ]
        for row in rows:
            K, B, I = ([row[f"{name}_{of}"] for of in ("recorded", "mujoco")] for name in "KBI")
            numbers = f"{K[0]:9.2f}{K[1]:9.2f}{B[0]:8.3f}{B[1]:8.3f}{I[0]:10.5f}{I[1]:10.5f}"
            lines.append(f"  {row['trial']:<{wide}}{row['VAF']:8.3f}{row['RMS']:8.3f}{numbers}")
    if proof["not_compared"]:
        lines.append(
            f"Not compared, because their gains are not known: {listing(proof['not_compared'])}"
        )
    return lines
