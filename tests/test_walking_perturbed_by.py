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
from osl_analysis.commands import walking, walking_files
from osl_analysis.config.sheet import read_sheet
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.table import read_table
from osl_analysis.trial import Array, Trial, write_trial
from osl_analysis.walking.crossing import Crossing, analyse_crossing, crossing_of_log
from osl_analysis.walking.plate_model import NO_CORRECTION, PlateModel, identify_plate_model
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.shared_motion import identify_platform

K = 210.0
B = 2.5
INERTIA = 0.04
RATE = 1000  # [Hz]
STRIDE = 1.6  # [s]
STANCE = 0.72  # [s]

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


def stride_samples(turn: int, onset: float, random: np.random.Generator) -> pl.DataFrame:
    """One stride; heel strike is 0.5 s after its first sample."""
    since = np.arange(round(RATE * STRIDE)) / RATE - 0.5
    phase = np.clip(since / STANCE, 0, 1)
    held = 1 - np.clip((since - 0.8) / 0.2, 0, 1)
    d, v, a = np.deg2rad(3) * turn * synthetic.step(since, onset, 0.06) * held
    size = 1 + 0.002 * random.standard_normal()
    wave = np.sin(2 * np.pi * (1.5 * since + random.random()))
    gait = size * 60 * np.sin(np.pi * phase) ** 2 * (1 + phase)
    angle = size * 0.15 * np.sin(5 * phase) * np.sin(np.pi * phase) + d
    torque = gait + 0.1 * random.standard_normal() * wave + K * d + B * v + INERTIA * a
    return pl.DataFrame(
        {
            "angle": np.rad2deg(angle) + 0.003 * random.standard_normal(len(since)),
            "torque": torque + 0.02 * random.standard_normal(len(since)),
            "force": 750 * np.clip(20 * np.sin(np.pi * phase), 0, 1),
            "command": turn * ((since >= onset) & (since < onset + 0.1)).astype(float),
        }
    )


def log(turns: tuple[int, ...], onset: float = 0.3) -> pl.DataFrame:
    """Strides, one after the other: 0 is unperturbed, 1 and -1 turn the toes up and down by 3 deg
    in 60 ms, from `onset` [s] after heel strike on. The command is the sign while the device
    pushes."""
    random = np.random.default_rng(0)
    samples = pl.concat([stride_samples(turn, onset, random) for turn in turns])
    return samples.insert_column(0, pl.Series("t", np.arange(len(samples)) / RATE))


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


def test_a_boot_s_log_of_many_strides_becomes_fig_9(tmp_path: Path) -> None:
    """Without platform, plate, static trial or capture."""
    config = campaign(tmp_path, "boot", (1, 0, -1, 0, 1, 0, -1))
    files = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", str(config)]

    done = run_forked(["snakemake", "--cores", "1", "results/summary.json", *files], tmp_path)

    assert done.returncode == 0, done.stdout
    tables = tmp_path / "results/tables"
    summary = read_table(tables / "walking_summary.csv").filter(estimator="ensemble")
    mean = dict(summary.select("quantity", "mean").iter_rows())
    # 1 % by the filter's spread into the baseline
    assert [mean[name] for name in "KBI"] == pytest.approx([K, B, INERTIA], rel=0.025)
    crossings = read_table(tables / "walking_crossings.csv")
    assert crossings["status"].to_list() == ["used"] * 7
    assert crossings["direction"].to_list() == ["up", None, "down", None, "up", None, "down"]
    assert crossings["load_of_weight"].is_null().all()
    assert not (tables / "plate.csv").exists()
    assert not (tables / "platform.csv").exists()


def stride(turn: int, onset: float = 0.3) -> Trial:
    return as_trial(log((turn,), onset))


@pytest.mark.parametrize(("turn", "direction"), [(1, "up"), (-1, "down")])
def test_a_crossing_of_a_log_has_its_stance_onset_and_direction(turn: int, direction: str) -> None:
    """A sample of 1 ms, and a half."""
    crossing = crossing_of_log(stride(turn), True, BOOT)

    assert crossing.onset == pytest.approx(0.8, abs=1.5e-3)
    assert crossing.direction == direction
    assert crossing.stance.heel_strike == pytest.approx(0.5, abs=2e-3)
    assert crossing.stance.duration == pytest.approx(STANCE, abs=4e-3)
    assert crossing.platform is None
    assert crossing.load is None


@pytest.mark.parametrize("name", ["theta", "torque"])
def test_a_crossing_of_a_log_has_its_signals_through_the_one_low_pass(name: str) -> None:
    trial = stride(1)

    crossing = crossing_of_log(trial, True, BOOT)

    inside = (crossing.time > 0.5) & (crossing.time < 1.2)
    low_passed = BOOT.low_pass(trial.samples[name].to_numpy(), RATE)
    expected = np.interp(crossing.time[inside], trial.samples["time"].to_numpy(), low_passed)
    signal = getattr(crossing, name)[inside]
    np.testing.assert_allclose(signal, expected, atol=2e-3 * np.ptp(expected))


def test_the_errors_of_a_log_are_a_late_and_a_large_torque() -> None:
    """By 1 ms and by 1 %."""
    crossing = crossing_of_log(stride(1), True, BOOT)

    late, large = crossing.lab_errors

    later = np.interp(crossing.time - 1e-3, crossing.time, crossing.torque) - crossing.torque
    assert np.corrcoef(late[1:], later[1:])[0, 1] > 0.99
    assert np.ptp(late) == pytest.approx(np.ptp(later), rel=0.05)
    np.testing.assert_allclose(large, 0.01 * crossing.torque)


def test_a_plate_tells_stance_where_the_log_has_no_load() -> None:
    trial = stride(1)
    with_plate = changed(trial, pl.col("load").alias("plate1_force_z"))

    by_load = crossing_of_log(trial, True, BOOT)
    by_plate = crossing_of_log(without(with_plate, "load"), True, BOOT)

    assert by_plate.stance == by_load.stance


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


@pytest.mark.parametrize(("stated", "sign"), [(None, 1), ("up", 1), ("down", -1)])
def test_the_sheet_names_the_direction_and_cuts_a_log_to_one_stride(
    tmp_path: Path, stated: str | None, sign: int
) -> None:
    """Of a trigger that only rises."""
    write_trial(as_trial(log((0, 1))), tmp_path / "w.parquet")
    output = tmp_path / "crossing.parquet"
    files = (tmp_path / "w.parquet", None, None, True, BOOT, output)

    walking.analyse(*files, direction=stated, windows=f"{STRIDE}-{2 * STRIDE}")

    crossing = walking_files.read_crossing(output)
    assert crossing.direction == (stated or "up")
    assert crossing.sign == sign
    assert crossing.onset == pytest.approx(STRIDE + 0.8, abs=1.5e-3)


LEG_M = 0.9
BACK_M = 0.05
ONSET = 1.19  # of the shift [s]
STAMPS = np.arange(3 * synthetic.PLATE_RATE) / synthetic.PLATE_RATE


def shift(time: Array, onset: float) -> Array:
    """The platform's shift back [m] of 50 mm in 100 ms, with two derivatives (3, n)."""
    return BACK_M * synthetic.step(time, onset, 0.1)


def belt_torque(time: Array, onset: float) -> Array:
    """The ankle's torque (n,) [N*m]; the hip stays behind, so that the shank leans by the shift
    over the leg's length."""
    phi, w, z = shift(time, onset) / LEG_M
    return 40.0 * synthetic.stance_load(time) + 340.0 * phi + 3.0 * w + 0.02 * z


def on_a_belt(
    name: str, seed: int, mass: float, onset: float = ONSET, loaded: bool = True
) -> Trial:
    """A crossing on a platform that shifts back; the centre of mass of its plate is 45 mm below
    the surface. The wrench is about the plate's centre, which moves with the foot."""
    random = np.random.default_rng(seed)
    fast = STAMPS
    slow = fast[::5]
    place = np.outer(-shift(slow, onset)[0], [1.0, 0.0, 0.0])
    of_plate = -mass * shift(fast, onset)[2]
    wrench = np.outer(of_plate, [1.0, 0.0, 0.0, 0.0, -0.045, 0.0])
    tracks = synthetic.labelled("PLAT", synthetic.PLATFORM + place[:, None])
    if loaded:
        force = np.outer(synthetic.stance_load(fast), [0, 0, 800.0])
        moment = np.cross(synthetic.ANKLE, force)
        moment -= np.outer(belt_torque(fast, onset), synthetic.LEFT)
        wrench += np.hstack([force, moment])
        lean = -0.1 + 0.35 * synthetic.step(slow, 0.9, 0.72)[0] + shift(slow, onset)[0] / LEG_M
        for prefix, points, angle in (
            ("FOOT", synthetic.FOOT, 0 * slow),
            ("SHANK", synthetic.SHANK, lean),
        ):
            turned = (points - synthetic.ANKLE) @ np.swapaxes(synthetic.about_y(angle), 1, 2)
            tracks |= synthetic.labelled(prefix, turned + (synthetic.ANKLE + place)[:, None])
    noisy = {
        label: track + 1e-4 * random.standard_normal(track.shape) for label, track in tracks.items()
    }
    wrench += random.normal(0, [0.4] * 3 + [0.08] * 3, wrench.shape)
    return synthetic.recording(name, noisy, wrench[:, :3], wrench[:, 3:])


BELT = settings(perturbed_by="belt", correct_plate_lag=False)
CALIBRATION = static_calibration(static_trial(), BELT)


def torque_error(crossing: Crossing) -> float:
    """Largest error [N*m] of the torque about the shift, through one low-pass."""
    exact = BELT.low_pass(belt_torque(STAMPS, ONSET), synthetic.PLATE_RATE)
    window = (crossing.time > 1.1) & (crossing.time < 1.3)
    error = crossing.torque - np.interp(crossing.time, STAMPS, exact)
    return float(np.abs(error[window]).max())


@pytest.fixture(scope="module")
def unloaded_plate() -> PlateModel:
    """Of 25 kg."""
    trials = [on_a_belt(f"plate_{k}", k, 25.0, 1.1 + 0.1 * k, loaded=False) for k in range(3)]
    return identify_plate_model([(trial, CALIBRATION) for trial in trials], BELT)


def test_the_plate_of_a_belt_has_its_mass_and_centre(unloaded_plate: PlateModel) -> None:
    mass, _, _, moment = unloaded_plate.parameters[:4]

    assert mass == pytest.approx(25.0, rel=0.02)
    assert moment == pytest.approx(-25 * 0.045, rel=0.02)


def test_a_platform_that_shifts_back_turns_the_ankle_up(unloaded_plate: PlateModel) -> None:
    """Of 20 N*m; the plate's own is 7 N*m."""
    walks = [on_a_belt(f"w{k}", 10 + k, 25.0) for k in range(2)]
    shared = identify_platform([(walk, CALIBRATION) for walk in walks], BELT)
    assert shared.template is not None

    for walk in walks:
        crossing = analyse_crossing(walk, CALIBRATION, unloaded_plate, True, BELT, shared)

        assert crossing.onset == pytest.approx(ONSET, abs=3e-3)
        assert crossing.direction == "up"
        assert torque_error(crossing) < 1.0


@pytest.mark.parametrize(
    ("onset", "perturbed", "message"),
    [
        (ONSET, False, r"the platform shifts at 1.*but the sheet says perturbed = false"),
        (9.0, True, r"does not shift but .*largest_shift_mm or the platform markers"),
    ],
)
def test_a_shift_that_the_sheet_contradicts_is_refused(
    unloaded_plate: PlateModel, onset: float, perturbed: bool, message: str
) -> None:
    walk = on_a_belt("w", 1, 25.0, onset)

    with pytest.raises(InputError, match=message):
        analyse_crossing(walk, CALIBRATION, unloaded_plate, perturbed, BELT)


NO_PLATFORM_MARKERS = {**BELT.markers.model_dump(), "platform": []}


def test_a_belt_without_markers_has_its_onset_from_the_trigger() -> None:
    """The plate rests, so that the moment about its centre is larger by the load times the foot's
    shift."""
    chosen = settings(perturbed_by="belt", plate_inertia="none", markers=NO_PLATFORM_MARKERS)
    static = static_calibration(static_trial(), chosen)
    walk = on_a_belt("w", 1, 0.0)
    arm = pl.Series(shift(walk.samples["time"].to_numpy(), ONSET)[0])
    walk = changed(
        walk,
        pl.col("plate1_moment_y") + arm * pl.col("plate1_force_z"),
        trigger=pl.when(pl.col("time") > ONSET).then(-4.0).otherwise(0.0),
    )
    walk = replace(walk, samples=walk.samples.select(pl.exclude("^marker_PLAT.*$")))
    shared = identify_platform([(walk, static)], chosen)

    crossing = analyse_crossing(walk, static, NO_CORRECTION, True, chosen, shared)

    assert crossing.onset == pytest.approx(ONSET, abs=1e-3)
    assert crossing.direction == "down"
    assert crossing.quality.platform_residual_mm is None
    assert torque_error(crossing) < 1.0


@pytest.mark.parametrize("choices", [{}, {"perturbed_by": "belt"}, {"plate_inertia": "none"}])
def test_a_platform_without_markers_is_refused_elsewhere(choices: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"markers\.platform is empty"):
        settings(markers=NO_PLATFORM_MARKERS, **choices)


DEFAULT = read_config(ROOT / "config/config.yaml")


def checked(folder: Path, rows: str, **walking: Any) -> None:
    (folder / "trials.csv").write_text(rows)
    chosen = DEFAULT.walking.model_copy(update=walking)
    changes = {"simulation": None, "sheet": folder / "trials.csv", "walking": chosen}
    check_campaign(open_campaign(DEFAULT.model_copy(update=changes), None))


HEAD = "trial,experiment,perturbed,log,log_source,mocap,mocap_source,windows\n"
WALKS = [f"w{k},walking,{str(k < 3).lower()}" for k in range(6)]
LOGS = HEAD + "".join(f"{walk},a,b,,,{k}-{k + 1}\n" for k, walk in enumerate(WALKS))
CAPTURES = HEAD + "".join(f"{walk},,,a,b,\n" for walk in WALKS)
STATIC = "s,static,,,,a,b,\n"


@pytest.mark.parametrize(
    ("rows", "choices"),
    [
        (LOGS, {"perturbed_by": "boot"}),
        (LOGS, {"perturbed_by": "leg"}),
        (CAPTURES + STATIC, {"perturbed_by": "belt", "plate_inertia": "none"}),
    ],
)
def test_a_campaign_needs_no_more_than_its_perturbation(
    tmp_path: Path, rows: str, choices: dict[str, str]
) -> None:
    checked(tmp_path, rows, **choices)


@pytest.mark.parametrize(
    ("rows", "choices", "message"),
    [
        (CAPTURES, {"perturbed_by": "boot"},
         r"trial 'w0': log is empty; a trial of .*perturbed_by: boot"),
        (CAPTURES, {"perturbed_by": "leg"},
         r"trial 'w0': log is empty; a trial of .*perturbed_by: leg"),
        (LOGS.replace(",1-2\n", ",1-2 3-4\n"), {"perturbed_by": "boot"},
         "windows '1-2 3-4' of a crossing; write one"),
        (LOGS + STATIC, {"perturbed_by": "belt"},
         "trial 'w0': mocap is empty; a trial of experiment 'walking' needs it"),
        (CAPTURES, {"perturbed_by": "belt", "plate_inertia": "none"},
         "0 trial of experiment 'static'"),
        (CAPTURES + STATIC, {"perturbed_by": "platform"},
         r"0 trial of experiment 'plate'.*state `plate_inertia: none` under"),
        (CAPTURES.replace("a,b,", "a,b,1-2") + STATIC, {"perturbed_by": "platform"},
         "windows cut no capture"),
    ],
)  # fmt: skip
def test_a_campaign_asks_for_what_its_perturbation_needs(
    tmp_path: Path, rows: str, choices: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        checked(tmp_path, rows, **choices)


PAGE = (ROOT / "docs/walking.md").read_text()
CHAPTER = PAGE[PAGE.index("## Who perturbs") : PAGE.index("## Stance and phase")]
EXAMPLES = re.findall(r"```(text|yaml)\n(.*?)```", CHAPTER, re.DOTALL)
SHEET = re.findall(r"### The sheet\n\n```\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("text", SHEET + [text for kind, text in EXAMPLES if kind == "text"])
def test_every_sheet_of_the_page_has_perturbed_and_unperturbed_crossings(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / "trials.csv").write_text(text)

    rows = read_sheet(tmp_path / "trials.csv").values()

    walking = [row["perturbed"] for row in rows if row["experiment"] == "walking"]
    assert set(walking) == {True, False}


@pytest.mark.parametrize("text", [text for kind, text in EXAMPLES if kind == "yaml"])
def test_every_source_and_setting_of_the_page_is_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "source.yaml").write_text(text)

    if text.startswith("# config.yaml"):
        assert settings(**yaml.safe_load(text)["walking"]).perturbed_by in ("belt", "boot", "leg")
    else:
        source = read_source(tmp_path / "source.yaml")
        assert source.format == yaml.safe_load(text)["format"]
