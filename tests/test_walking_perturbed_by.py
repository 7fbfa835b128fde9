"""Perturbations by a boot, by the leg itself, and by a belt: logs and captures by formula, with
known K, B and I."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import walking_synthetic as synthetic
import yaml
from conftest import ROOT
from snakemake_runs import run_forked
from walking_synthetic import changed, settings, static_trial

from osl_analysis.campaign.campaign_checks import check_campaign
from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands import walking as jobs
from osl_analysis.config.sheet import read_sheet
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.table import read_table
from osl_analysis.trial import Trial, write_trial
from osl_analysis.walking.crossing import Crossing, analyse_crossing, crossing_of_log
from osl_analysis.walking.plate_model import NO_CORRECTION, identify_plate_model
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.shared_motion import identify_platform

K = 210.0
B = 2.5
INERTIA = 0.04
RATE, STRIDE, STANCE = 1000, 1.6, 0.72  # Hz, s, s

SOURCE = """
format: csv
clock: master
time: {column: t, unit: s}
channels:
  theta: {column: angle, unit: deg}
  torque: {column: torque, unit: N*m}
  load: {column: force, unit: N}
  trigger: {column: command, unit: V}
"""


def log(turns: tuple[int, ...], seed: int = 0, onset: float = 0.3) -> pl.DataFrame:
    """Strides, one after the other: 0 is unperturbed, 1 and -1 turn the toes up and down by 3 deg
    in 60 ms, from `onset` [s] after heel strike on. The command is the sign while the device
    pushes."""
    random = np.random.default_rng(seed)
    time = np.arange(round(RATE * STRIDE * len(turns))) / RATE
    columns = {name: np.zeros(len(time)) for name in ("angle", "torque", "force", "command")}
    for k, turn in enumerate(turns):
        since = time - k * STRIDE - 0.5
        part = (since >= -0.5) & (since < STRIDE - 0.5)
        s = np.clip(since / STANCE, 0, 1)
        size = 1 + 0.002 * random.standard_normal()
        y = np.clip((since - onset) / 0.06, 0, 1)
        moving = (since > onset) & (since < onset + 0.06)
        step = np.deg2rad(3) * turn
        held = 1 - np.clip((since - 0.8) / 0.2, 0, 1)
        d = step * y**3 * (10 - 15 * y + 6 * y**2) * held
        v = step / 0.06 * 30 * y**2 * (1 - y) ** 2 * moving
        a = step / 0.06**2 * 60 * y * (1 - y) * (1 - 2 * y) * moving
        wander = (
            0.1 * random.standard_normal() * np.sin(2 * np.pi * (1.5 * since + random.random()))
        )
        columns["angle"] += part * np.rad2deg(size * 0.15 * np.sin(5 * s) * np.sin(np.pi * s) + d)
        gait = size * 60 * np.sin(np.pi * s) ** 2 * (1 + s) + wander
        columns["torque"] += part * (gait + K * d + B * v + INERTIA * a)
        columns["force"] += part * 750 * np.clip(20 * np.sin(np.pi * s), 0, 1) * ((s > 0) & (s < 1))
        columns["command"] += part * turn * ((since >= onset) & (since < onset + 0.1))
    columns["torque"] += 0.02 * random.standard_normal(len(time))
    columns["angle"] += 0.003 * random.standard_normal(len(time))
    return pl.DataFrame({"t": time, **columns})


def as_trial(table: pl.DataFrame, name: str = "w") -> Trial:
    names = {"t": "time", "angle": "theta", "force": "load", "command": "trigger"}
    return Trial(name, table.rename(names).with_columns(pl.col("theta").radians()))


BOOT = settings(perturbed_by="boot")


def campaign(folder: Path, kind: str, turns: tuple[int, ...], **walking: Any) -> Path:
    """One log of many strides, a row of the sheet for each, and the configuration."""
    (folder / "sources").mkdir()
    (folder / "sources/boot.yaml").write_text(SOURCE)
    log(turns).write_csv(folder / "strides.csv")
    rows = ["trial,experiment,perturbed,direction,log,log_source,windows"]
    for k, turn in enumerate(turns):
        window = f"{k * STRIDE:.2f}-{k * STRIDE + 1.55:.2f}"
        way = {1: "up", -1: "down"}.get(turn, "")
        rows.append(f"w{k:02d},walking,{str(turn != 0).lower()},{way},strides.csv,boot,{window}")
    (folder / "trials.csv").write_text("\n".join(rows) + "\n")
    content = {
        "campaign": "strides", "raw_data": ".", "sheet": "trials.csv", "results": "results",
        "sources": "sources",
        "simulation": None, "parameters": None, "impedance_trajectory": None,
        "figures": {"time_series": None, "frequency_response": None, "midstance_stiffness": None},
        "walking": {"perturbed_by": kind, "bootstrap_samples": 100, "perturbed_stance": "own",
        **walking},
    }  # fmt: skip
    (folder / "config.yaml").write_text(yaml.safe_dump(content))
    return folder / "config.yaml"


def test_a_boot_s_log_of_many_strides_becomes_fig_9_without_platform_plate_static_trial_or_capture(
    tmp_path,
) -> None:
    config = campaign(tmp_path, "boot", (1, 0, -1, 0, 1, 0, -1))
    files = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", str(config)]
    # and every table
    done = run_forked(["snakemake", "--cores", "1", "results/summary.json", *files], tmp_path)
    assert done.returncode == 0, done.stdout
    tables = tmp_path / "results/tables"
    summary = read_table(tables / "walking_summary.csv").filter(estimator="ensemble")
    for name, truth in {"K": K, "B": B, "I": INERTIA}.items():
        row = summary.filter(quantity=name).row(0, named=True)
        # 1 % by the filter's spread into the baseline
        assert row["mean"] == pytest.approx(truth, rel=0.025)
        assert row["side"] is None
    crossings = read_table(tables / "walking_crossings.csv")
    assert crossings["status"].to_list() == ["used"] * 7
    assert crossings["direction"].to_list() == ["up", None, "down", None, "up", None, "down"]
    unknown = (
        "foot_outside_m",
        "foot_forward_m",
        "load_of_weight",
        "plate_zero_N",
        "platform_residual_mm",
    )
    assert crossings.select(unknown).null_count().row(0) == (7,) * 5
    assert not [name for name in ("plate", "platform") if (tables / f"{name}.csv").exists()]


def stride(turn: int, name: str = "w", **changes: float) -> Trial:
    return as_trial(log((turn,), **changes), name)


def test_a_crossing_of_a_log_has_its_signals_through_the_one_low_pass() -> None:
    up, down = stride(1), stride(-1)
    for trial, turned in ((up, "up"), (down, "down")):
        found = crossing_of_log(trial, True, BOOT)
        assert found.onset == pytest.approx(0.8, abs=1.5e-3)  # a sample of 1 ms, and a half
        assert (found.direction, found.platform, found.load) == (turned, None, None)
        assert found.stance.heel_strike == pytest.approx(0.5, abs=2e-3)
        assert found.stance.duration == pytest.approx(STANCE, abs=4e-3)
        inside = (found.time > 0.5) & (found.time < 1.2)
        for name in ("theta", "torque"):
            exact = BOOT.low_pass(trial.samples[name].to_numpy(), RATE)
            wanted = np.interp(found.time[inside], trial.samples["time"].to_numpy(), exact)
            np.testing.assert_allclose(
                getattr(found, name)[inside], wanted, atol=2e-3 * np.ptp(wanted)
            )
        # of a torque that is 1 ms late
        later = np.interp(found.time - 1e-3, found.time, found.torque) - found.torque
        assert np.corrcoef(found.lab_errors[0, 1:], later[1:])[0, 1] > 0.99
        assert np.ptp(found.lab_errors[0]) == pytest.approx(np.ptp(later), rel=0.05)
        np.testing.assert_allclose(found.lab_errors[1], 0.01 * found.torque)
    plate = changed(up, pl.col("load").alias("plate1_force_z")).samples.drop("load")
    by_plate = crossing_of_log(replace(up, samples=plate), True, BOOT)
    assert by_plate.stance == crossing_of_log(up, True, BOOT).stance


def without(trial: Trial, column: str) -> Trial:
    return replace(trial, samples=trial.samples.drop(column))


@pytest.mark.parametrize(
    ("trial", "perturbed", "said"),
    [
        (without(stride(1), "torque"), True,
         "no column 'torque'; map the channel in the source file"),
        (without(stride(1), "theta"), True, "no column 'theta'; map"),
        (without(stride(1), "load"), True,
         "neither a column 'load' nor a force plate .* `scale` of 100 N"),
        (without(stride(1), "trigger"), True,
         "the command in 'trigger' rests in stance, or is missing, but the sheet"),
        (stride(1), False,
         r"the command in 'trigger' leaves its rest at 0\.(799|80\d) s but .* = false"),
        (as_trial(log((1, 0))), True,
         r"one stance in 'load' is expected, found 0\.5.*2\.8\d\d s; cut .*`windows`"),
        (stride(1, onset=0.03), True, r"baseline and window, 0\.\d+-0\.\d+ s, leave stance"),
        (
            changed(stride(0),
            pl.when(pl.col("time") < 0.6).then(None).otherwise("torque").alias("torque")),
            False,
            r"theta and torque are not known throughout stance, 0\.50\d-1\.2\d\d s; cut",
        ),
    ],
)  # fmt: skip
def test_what_a_log_lacks_is_refused_with_the_remedy(
    trial: Trial, perturbed: bool, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        crossing_of_log(trial, perturbed, BOOT)


def test_the_sheet_names_the_direction_of_a_trigger_that_only_rises_and_cuts_a_log_to_one_stride(
    tmp_path,
) -> None:
    write_trial(as_trial(log((0, 1)), "w"), tmp_path / "w.parquet")
    for direction in (None, "up", "down"):
        files = tmp_path / "w.parquet", None, None, True, BOOT, tmp_path / "crossing.parquet"
        jobs.analyse(*files, direction=direction, windows=f"{STRIDE}-{2 * STRIDE}")
        found = jobs.read_crossing(tmp_path / "crossing.parquet")
        assert (found.direction, found.sign) == (
            direction or "up",
            -1 if direction == "down" else 1,
        )
        assert found.onset == pytest.approx(STRIDE + 0.8, abs=1.5e-3)
        assert found.platform is None


LEG_M = 0.9
BACK_M = 0.05


def on_a_belt(name: str, onset: float | None, seed: int, mass: float, loaded: bool = True) -> Trial:
    """A crossing on a platform that shifts back by 50 mm in 100 ms from `onset` [s] on; the hip
    stays behind, so that the shank leans by the shift over the leg's length, and the ankle answers
    with the K, B and I of `ankle_answer`."""
    random = np.random.default_rng(seed)
    fast = np.arange(3 * synthetic.PLATE_RATE) / synthetic.PLATE_RATE
    slow = fast[::5]

    def at(t: np.ndarray) -> np.ndarray:
        return BACK_M * synthetic.step(t, 9.0 if onset is None else onset, 0.1)

    def place(t: np.ndarray) -> np.ndarray:
        return np.column_stack([-at(t)[0], np.zeros((len(t), 2))])

    wrench = np.zeros((len(fast), 6))
    acceleration = -at(fast)[2]
    wrench[:, 0] = mass * acceleration
    wrench[:, 4] = -0.045 * mass * acceleration  # its centre of mass is 45 mm below the surface
    tracks = synthetic.labelled("PLAT", synthetic.PLATFORM + place(slow)[:, None])
    if loaded:
        phi, w, z = at(fast) / LEG_M
        torque = 40.0 * synthetic.stance_load(fast) + 340.0 * phi + 3.0 * w + 0.02 * z
        force = synthetic.stance_load(fast)[:, None] * [0, 0, 800.0]
        ankle = synthetic.ANKLE + place(fast)
        # in the plate's axes about its centre, which moves with the foot
        wrench += np.hstack(
            [force, np.cross(ankle - place(fast), force) - torque[:, None] * synthetic.LEFT]
        )
        lean = -0.1 + 0.35 * synthetic.step(slow, 0.9, 0.72)[0] + at(slow)[0] / LEG_M
        for prefix, points, angle in (
            ("FOOT", synthetic.FOOT, 0 * slow),
            ("SHANK", synthetic.SHANK, lean),
        ):
            turned = np.einsum("nij,mj->nmi", synthetic.about_y(angle), points - synthetic.ANKLE)
            tracks |= synthetic.labelled(prefix, turned + (synthetic.ANKLE + place(slow))[:, None])
    tracks = {
        label: track + 1e-4 * random.standard_normal(track.shape) for label, track in tracks.items()
    }
    wrench += 0.4 * random.standard_normal(wrench.shape) * np.repeat([1.0, 0.2], 3)
    return synthetic.recording(name, tracks, wrench[:, :3], wrench[:, 3:])


BELT = settings(perturbed_by="belt", correct_plate_lag=False)
CALIBRATION = static_calibration(static_trial(), BELT)


def answer(found: Crossing) -> tuple[np.ndarray, np.ndarray]:
    """The torque of the ankle beside the one that it should have, through one low-pass."""
    t = np.arange(3 * synthetic.PLATE_RATE) / synthetic.PLATE_RATE
    phi, w, z = BACK_M * synthetic.step(t, 1.19, 0.1) / LEG_M
    exact = BELT.low_pass(
        40.0 * synthetic.stance_load(t) + 340.0 * phi + 3.0 * w + 0.02 * z, synthetic.PLATE_RATE
    )
    window = (found.time > 1.1) & (found.time < 1.3)
    return found.torque[window], np.interp(found.time[window], t, exact)


def test_a_platform_that_shifts_back_turns_the_ankle_up() -> None:
    unloaded = [
        (on_a_belt(f"plate_{k}", 1.1 + 0.1 * k, k, 25.0, loaded=False), CALIBRATION)
        for k in range(3)
    ]
    model = identify_plate_model(unloaded, BELT)
    mass, *_, depth = model.parameters[:4]
    assert (mass, depth) == pytest.approx((25.0, -25 * 0.045), rel=0.02)
    walks = [on_a_belt(f"w{k}", 1.19, 10 + k, 25.0) for k in range(3)]
    shared = identify_platform([(walk, CALIBRATION) for walk in walks], BELT)
    assert shared.template is not None
    for walk in walks:
        found = analyse_crossing(walk, CALIBRATION, model, True, BELT, shared)
        assert found.onset == pytest.approx(1.19, abs=3e-3)
        assert found.direction == "up"
        np.testing.assert_allclose(*answer(found), atol=1.0)  # of 20 N*m; the plate's own is 7 N*m
        with pytest.raises(
            InputError, match=r"the platform shifts at 1.*but the sheet says perturbed = false"
        ):
            analyse_crossing(walk, CALIBRATION, model, False, BELT, shared)
    with pytest.raises(
        InputError, match=r"does not shift but .*largest_shift_mm or the platform markers"
    ):
        analyse_crossing(on_a_belt("w", None, 1, 25.0), CALIBRATION, model, True, BELT)


def test_a_belt_without_markers_over_a_plate_that_rests_has_its_onset_from_the_trigger() -> None:
    chosen = settings(
        perturbed_by="belt",
        plate_inertia="none",
        markers={**BELT.markers.model_dump(), "platform": []},
    )
    static = static_calibration(static_trial(), chosen)
    walk = on_a_belt("w", 1.19, 1, 0.0)
    moved = changed(walk, pl.when(pl.col("time") > 1.19).then(-4.0).otherwise(0.0).alias("trigger"))
    # the plate rests, so that the moment about its centre is larger by the load times the foot's
    # shift
    arm = BACK_M * synthetic.step(walk.samples["time"].to_numpy(), 1.19, 0.1)[0]
    still = changed(moved, pl.col("plate1_moment_y") + pl.Series(arm) * pl.col("plate1_force_z"))
    still = replace(
        still, samples=still.samples.drop([c for c in still.columns if c.startswith("marker_PLAT")])
    )
    shared = identify_platform([(still, static)], chosen)
    found = analyse_crossing(still, static, NO_CORRECTION, True, chosen, shared)
    assert found.onset == pytest.approx(1.19, abs=1e-3)
    assert (found.direction, found.quality.platform_residual_mm) == ("down", None)
    np.testing.assert_allclose(*answer(found), atol=1.0)
    for named in ({}, {"perturbed_by": "belt"}, {"plate_inertia": "none"}):
        with pytest.raises(ValueError, match=r"markers\.platform is empty"):
            settings(markers=chosen.markers.model_dump(), **named)


DEFAULT = read_config(ROOT / "config/config.yaml")


def checked(folder: Path, rows: str, **walking: Any) -> None:
    (folder / "trials.csv").write_text(rows)
    chosen = DEFAULT.walking.model_copy(update=walking)
    changes = {"simulation": None, "sheet": folder / "trials.csv", "walking": chosen}
    check_campaign(open_campaign(DEFAULT.model_copy(update=changes), None))


def test_a_campaign_asks_for_what_its_perturbation_needs_and_for_nothing_else(
    tmp_path: Path,
) -> None:
    head = "trial,experiment,perturbed,log,log_source,mocap,mocap_source,windows\n"
    walks = [f"w{k},walking,{str(k < 3).lower()}" for k in range(6)]
    logs = "".join(f"{walk},a,b,,,{k}-{k + 1}\n" for k, walk in enumerate(walks))
    captures = "".join(f"{walk},,,a,b,\n" for walk in walks)
    static = "s,static,,,,a,b,\n"
    for kind in ("boot", "leg"):
        checked(tmp_path, head + logs, perturbed_by=kind)
        with pytest.raises(
            InputError, match=r"trial 'w0': log is empty; a trial of .*perturbed_by: (boot|leg)"
        ):
            checked(tmp_path, head + captures, perturbed_by=kind)
    checked(tmp_path, head + static + captures, perturbed_by="belt", plate_inertia="none")
    for kind in ("platform", "belt"):
        with pytest.raises(
            InputError, match="trial 'w0': mocap is empty; a trial of experiment 'walking' needs it"
        ):
            checked(tmp_path, head + static + logs, perturbed_by=kind)
        with pytest.raises(InputError, match="0 trial of experiment 'static'"):
            checked(tmp_path, head + captures, perturbed_by=kind, plate_inertia="none")
        with pytest.raises(
            InputError, match=r"0 trial of experiment 'plate'.*state `plate_inertia: none` under"
        ):
            checked(tmp_path, head + static + captures, perturbed_by=kind)
        with pytest.raises(InputError, match="windows cut no capture"):
            checked(
                tmp_path, head + static + captures.replace("a,b,", "a,b,1-2"), perturbed_by=kind
            )
    with pytest.raises(InputError, match="windows '1-2 3-4' of a crossing; write one"):
        checked(tmp_path, head + logs.replace(",1-2\n", ",1-2 3-4\n"), perturbed_by="boot")


def test_every_worked_example_of_the_page_is_read_by_the_models_of_sheet_source_and_settings(
    tmp_path: Path,
) -> None:
    """`(kind, text)` of the blocks of "Who perturbs", and of the sheet of "Setting up"."""
    page = (ROOT / "docs/walking.md").read_text()
    chapter = page[page.index("## Who perturbs") : page.index("## Stance and phase")]
    blocks = re.findall(r"```(text|yaml)\n(.*?)```", chapter, re.DOTALL)
    seen = []
    for kind, text in blocks:
        (tmp_path / "block").write_text(text)
        if kind == "text":
            rows = read_sheet(tmp_path / "block")
            assert {
                bool(row["perturbed"]) for row in rows.values() if row["experiment"] == "walking"
            } == {True, False}
        elif text.startswith("# config.yaml"):
            seen.append(settings(**yaml.safe_load(text)["walking"]).perturbed_by)
        else:
            read_source(tmp_path / "block")
    assert seen == ["belt", "boot", "leg"]
    assert len(blocks) == 9
    sheet = re.search(r"### The sheet\n\n```\n(.*?)```", page, re.DOTALL)
    (tmp_path / "block").write_text(sheet[1])
    assert len(read_sheet(tmp_path / "block")) == 4
