"""Five people with recordings of their own, written by plain writers: `init --from`, at most two
edited lines and the units that no name or header states give the numbers that the files were made
of. What a draft guesses it says, with its evidence, beside the guess."""

import difflib
import re
from pathlib import Path

import numpy as np
import pytest
from any_motion import chirp
from mcap_builder import HEADER, stamped, write_topics
from nptdms import ChannelObject, TdmsWriter
from scipy.interpolate import CubicSpline
from test_formats_mat import write_mat

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands import new_campaign as drafting
from osl_analysis.commands import trials as module
from osl_analysis.commands.first_look import fit_of_row
from osl_analysis.commands.trials import checked_trial
from osl_analysis.commands.watch import quality_text
from osl_analysis.ingest.draft import draft_source

pytestmark = pytest.mark.usefixtures("without_inference", "schemas_made_once")
TRUE = {"K": 80.0, "B": 1.5, "I": 0.03}  # N*m/rad, N*m*s/rad, kg*m^2
NOISE = np.random.default_rng(5).standard_normal((6, 20_000))


def joint(rate, motion):
    """Time [s], angle, velocity and torque of a joint, with 0.05 N*m of noise, by its motion and
    two derivatives."""
    theta, omega, alpha = motion
    time = np.arange(len(theta)) / rate
    torque = (
        TRUE["K"] * theta + TRUE["B"] * omega + TRUE["I"] * alpha + 0.05 * NOISE[0, : len(theta)]
    )
    return time, theta, omega, torque


def sines(runs, amplitude_deg, rate=250):
    """A joint that is moved by runs of (Hz, cycles), with rests of 1 s."""
    pieces = [np.zeros((3, rate))]
    for hz, cycles in runs:
        t, w, a = (
            np.arange(round(cycles / hz * rate)) / rate,
            2 * np.pi * hz,
            np.radians(amplitude_deg),
        )
        pieces += [
            [a * np.sin(w * t), a * w * np.cos(w * t), -a * w * w * np.sin(w * t)],
            np.zeros((3, rate)),
        ]
    return joint(rate, np.hstack(pieces))


def write_csv(path, columns, sign=",", decimal="."):
    rows = [
        sign.join(f"{x:.6f}".replace(".", decimal) for x in row)
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([sign.join(columns), *rows]) + "\n", encoding="utf-8")


class Journey:
    """A campaign that is drafted from a folder of recordings, and edited."""

    def __init__(self, folder: Path) -> None:
        self.recordings, self.made = folder / "recordings", folder / "mine"
        self.recordings.mkdir()

    def drafted(self):
        """What `init` prints, and the source file."""
        draft = drafting.new_campaign(self.made, recordings=self.recordings)
        self.before = self.texts()
        said = [
            drafting.campaign_text(self.made, draft),
            *drafting.left_to_decide(self.made, draft),
        ]
        return "\n".join(said), next((self.made / "sources").glob("*.yaml")).read_text()

    def states(self, **units):
        """Write the units of channels, which the draft leaves open."""
        (path,) = (self.made / "sources").glob("*.yaml")
        text = path.read_text()
        for column, unit in units.items():
            text, count = re.subn(rf'(\n  {column}: .*unit: )"UNKNOWN"', rf'\1"{unit}"', text)
            assert count == 1, column
        path.write_text(text)

    def texts(self):
        files = [
            self.made / "config.yaml",
            self.made / "trials.csv",
            *(self.made / "sources").glob("*.yaml"),
        ]
        return [line for path in files for line in path.read_text().splitlines()]

    def edited(self):
        return sum(line.startswith("+ ") for line in difflib.ndiff(self.before, self.texts()))

    def opened(self, monkeypatch):
        monkeypatch.chdir(self.made)
        config = read_config(Path("config.yaml"))
        campaign = open_campaign(config, None)
        for name, row in campaign.rows.items():
            yield (
                name,
                row,
                checked_trial(campaign.recording(name), config.raw_data, config.sources),
                config,
            )

    def fits(self, monkeypatch):
        """The fit to all amplitudes of each trial, and what the checks say of it."""
        for name, row, trial, config in self.opened(monkeypatch):
            fitted = fit_of_row(trial, row, None, Path("config.yaml"))
            yield (
                name,
                fitted.table.row(-1, named=True),
                quality_text(trial, row["experiment"], config, ()),
            )


def is_right(fit):
    return {name: fit[name] for name in TRUE} == pytest.approx(TRUE, rel=0.02)


def test_a_bench_log_with_names_of_another_language(tmp_path, monkeypatch):
    """A clock in ms, decimal commas, a load cell that counts the other way, a channel that is not
    connected and one of noise. The first recording is of a bench at rest."""
    journey = Journey(tmp_path)
    time, theta, omega, torque = sines([(1, 8), (2, 10), (4, 16)], 4)
    for name, moves in (("meting 1", 0), ("meting 2", 1), ("meting 3", 1)):
        noise = NOISE[1:, : time.size]
        pairs = zip((theta, -torque, omega), noise, strict=False)
        angle, load, speed = (np.where(moves, x, 0.01 * n) for x, n in pairs)
        columns = {"Tijd [ms]": 1e3 * time, "Stand arm [°]": np.degrees(angle), "Koppel [Nm]": load}
        columns |= {"Kanaal 5": 0 * time + 3.1, "Kanaal 6": noise[4], "Snelheid": np.degrees(speed)}
        write_csv(journey.recordings / f"{name}.csv", columns, ";", ",")
    said, source = journey.drafted()
    for line in (
        '# .*"Kanaal 5".*left out: it does not move',
        '# .*"Kanaal 6".*left out: nothing but noise',
        'theta: {column: "Stand arm", .*  # a guess: as a spring with "Koppel", r = [01]',
        'torque: {column: "Koppel", .*sign: -1}  # guessed from its name: it falls as the angle'
        ' rises',
    ):  # fmt: skip
        assert re.search(line, source)
    sheet = journey.made / "trials.csv"
    sheet.write_text(sheet.read_text().replace("meting_1,", "# meting_1,"))
    assert (
        "to be confirmed, guessed from angle and torque: experiment impedance (meting_1, meting_2,"
        " meting_3)" in said
    )
    assert [is_right(fit) for _, fit, _ in journey.fits(monkeypatch)] == [True, True]
    assert journey.edited() == 1


VECTORS = (
    "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    "float64 x\nfloat64 y\nfloat64 z\n",
)
JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[]"
    f" effort\n{HEADER}"
)
WRENCH = f"std_msgs/Header header\ngeometry_msgs/Wrench wrench\n{HEADER}"
for kind, own in zip(("Wrench", "Vector3"), VECTORS, strict=True):
    WRENCH += f"{'=' * 80}\nMSG: geometry_msgs/{kind}\n{own}"


def test_a_bench_that_logs_joint_states_and_a_wrench(tmp_path, monkeypatch):
    """Of the motor's and the load cell's torques, which leaks from z into x; two rates, any
    motion."""
    journey = Journey(tmp_path)
    _, sweep = chirp(np.random.default_rng(1), (0.5, 5.5), 5 / np.sqrt(2), 20.0, 200)
    time, theta, omega, torque = joint(200, sweep)
    late = CubicSpline(time, torque)(time + 0.001)
    drive, noise = 9 * (theta + torque / 2000), 0.3 * NOISE[1:, : time.size].T
    joints = [
        stamped(
            round(t * 1e9),
            name=["ankle", "motor"],
            position=[a, m],
            velocity=[v, 9 * v],
            effort=[0.0, e],
        )
        for t, a, m, v, e in zip(
            *(x.tolist() for x in (time, theta, drive, omega, torque / 9)), strict=True
        )
    ]
    wrench = [
        stamped(round(t * 1e9) + 1_000_000, wrench={
            "force": dict(zip("xyz", n[:3], strict=True)), "torque": {"x": 0.06 * m + 0.01 * n[3],
            "y": n[4], "z": m}})
        for t, m, n in zip(*(x[::2].tolist() for x in (time, late, noise)), strict=True)
    ]  # fmt: skip
    topics = {"/joint_states": ("sensor_msgs/msg/JointState", JOINTS, joints)}
    topics |= {"/cell": ("geometry_msgs/msg/WrenchStamped", WRENCH, wrench)}
    write_topics(journey.recordings / "run_0.mcap", topics)
    _, source = journey.drafted()
    assert '\n  theta: {topic: "/joint_states", field: "position[name=ankle]"' in source
    asked = re.findall('NAME_[^\n]*field: "(.*?)".*# torque\\?', source)
    assert asked == ["wrench.torque.x", "wrench.torque.z"]
    path = journey.made / "sources/mcap.yaml"
    lines = [re.sub(r"NAME_\d+(?=.*torque.z)", "torque", line) for line in source.splitlines()]
    path.write_text("\n".join(line for line in lines if not re.match("  NAME", line)))
    sheet = journey.made / "trials.csv"
    sheet.write_text(sheet.read_text().replace("ingest_only", "impedance"))
    ((_, fit, _),) = journey.fits(monkeypatch)
    assert (is_right(fit), journey.edited()) == (True, 2)


def leg_columns(amps, theta, torque, time):
    return {
        "loop_time": time + 17.0,
        "<__main__.Leg object at 0x7fe6>.output_position": theta + torque / 2000,
        "output_velocity": np.gradient(theta + torque / 2000, time), "joint_position": theta,
        "motor_current": 1e3 * amps, "joint_torque": 0.11 * amps, "loadcell_mz": torque,
        "genvar_0": 0 * time,
    }  # fmt: skip


def test_a_log_of_the_leg_with_a_load_cell(tmp_path, monkeypatch):
    """opensourceleg's logger states no units, names an object, fails at times, and writes the
    drive's own torque beside the load cell's."""
    journey = Journey(tmp_path)
    time, theta, _, torque = sines([(0.5, 4), (1.5, 10), (3, 20)], 5)
    amps = (-torque / 0.9 + 0.3 * NOISE[1, : time.size]).round(2)
    path = journey.recordings / "leg_1.csv"
    write_csv(path, leg_columns(amps, theta, torque, time))
    lines = path.read_text().splitlines()
    cells = lines[700].split(",")
    path.write_text(
        "\n".join([*lines[:700], ",".join([*cells[:6], "ERROR", cells[7]]), *lines[701:]])
    )
    # none failed: the same file
    write_csv(journey.recordings / "leg_2.csv", leg_columns(amps, theta, torque, time))
    said, source = journey.drafted()
    assert "sources/csv.yaml: 2 recordings" in said
    for line in (
        r'#   theta_m: {column: "\*.output_position", unit: "UNKNOWN"}  # guessed .*; no unit'
        ' is stated',
        '  theta: {column: "joint_position", unit: "UNKNOWN"}',
        '#   current: {column: "motor_current", unit: "UNK',
        '#   .*"joint_torque".* # left out: "motor_current" times 0.00011, .*no measured torque',
        '  torque: {column: "loadcell_mz", unit: "UNKNOWN"}  # guessed from its name; no unit is'
        ' stated',
    ):  # fmt: skip
        assert re.search(f"\n{line}", source), line
    journey.states(theta="rad", torque="N*m")
    (_, fit, _), _ = journey.fits(monkeypatch)
    assert (is_right(fit), journey.edited()) == (True, 2)


def test_a_log_of_an_actuator_that_is_known_and_a_load_cell(tmp_path, monkeypatch):
    """Dephy's names and counts are those of the shipped source file, which is completed by what
    follows its angle."""
    journey = Journey(tmp_path)
    time, theta, _, torque = sines([(0.5, 4), (1.5, 10), (3, 20)], 5)
    columns = {
        "state_time": 1e3 * time,
        "mot_ang": 16384 * 9 / (2 * np.pi) * (theta + torque / 2000),
    }
    columns |= {
        "ank_ang": 100 * np.degrees(theta),
        "mot_cur": 1e3 * torque + 300 * NOISE[1, : time.size],
    }
    write_csv(journey.recordings / "act_1.csv", {**columns, "loadcell": torque})
    said, source = journey.drafted()
    assert "sources/dephy_actpack.yaml: 1 recordings" in said
    assert re.search(
        r'scale: 0.01}\n(.*\n)*  torque: {column: "loadcell", unit: "UNKNOWN"}  # guessed', source
    )
    journey.states(torque="N*m")
    ((_, fit, _),) = journey.fits(monkeypatch)
    assert (is_right(fit), journey.edited()) == (True, 1)


@pytest.mark.parametrize("kind", ["tdms", "mat"])
def test_a_dynamometer_with_a_protocol_of_its_own(tmp_path, monkeypatch, kind):
    """Other frequencies, cycles and amplitude than the draft's, N*mm, and no unit anywhere."""
    journey = Journey(tmp_path)
    time, theta, _, torque = sines([(0.5, 6), (1.5, 12), (3.5, 12)], 3)
    if kind == "mat":
        write_mat(
            journey.recordings / "proef3.mat",
            x=time,
            theta=theta,
            tau=1e3 * torque,
            aux=np.zeros_like(time),
        )
    else:
        with TdmsWriter(journey.recordings / "proef3.tdms") as writer:
            named = {"Hoek": np.degrees(theta), "Koppel": 1e3 * torque, "Aux": np.zeros_like(time)}
            timing = {"wf_increment": 1 / 250, "wf_start_offset": 0.0}
            writer.write_segment(
                [ChannelObject("Meting", name, one, timing) for name, one in named.items()]
            )
    _, source = journey.drafted()
    assert re.search('  torque: {[^}]*, unit: "UNKNOWN"}  # guessed .*; no unit is stated', source)
    journey.states(theta="deg" if kind == "tdms" else "rad", torque="N*mm")
    ((_, fit, quality),) = journey.fits(monkeypatch)
    assert (is_right(fit), fit["excitation"], journey.edited()) == (True, "stepped sine", 2)
    assert quality == "quality ok", "no protocol is stated"


def test_a_torque_has_the_sign_by_which_a_joint_resists(
    tmp_path,
):
    time, theta, _, torque = sines([(1, 8), (3, 20)], 4)
    noise, drafted = 1e-3 * NOISE[1, : time.size], {}
    for name, columns in (
        ("spring", {"theta [rad]": theta, "torque [Nm]": torque}),
        ("turned", {"theta [rad]": theta, "torque [Nm]": -torque}),
        ("damper", {"theta [rad]": theta, "torque [Nm]": -np.gradient(theta, time)}),
        (
            "actuator",
            {
                "theta_m [rad]": theta,
                "current [A]": np.cos(3 * time) + noise,
                "torque [Nm]": np.sin(time),
            },
        ),
    ):
        write_csv(tmp_path / f"{name}.csv", {"time_s": time, **columns})
        drafted[name] = draft_source(module.inspect_file(tmp_path / f"{name}.csv"), "")
    assert [drafted[name].count("sign: -1") for name in drafted] == [0, 1, 0, 0]
    assert "\n  torque_m: {" in drafted["actuator"]


def test_channels_of_tdms_that_begin_apart_are_compared_at_their_own_instants(tmp_path):
    _time, theta, _, torque = sines([(1, 8), (3, 20)], 4)
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for name, unit, one, start in (("x", "rad", theta, 0), ("y", "Nm", torque[75:], 300)):
            begin = np.datetime64("2026-01-01T00:00:00") + np.timedelta64(start, "ms")
            named = {
                "wf_increment": 1 / 250,
                "wf_start_time": begin,
                "wf_start_offset": 0.0,
                "unit_string": unit,
            }
            writer.write_segment([ChannelObject("Log", name, one, named)])
    drafted = draft_source(module.inspect_file(tmp_path / "a.tdms"), "")
    assert '\n  theta: {channel: "Log/x"' in drafted
    assert '\n  torque: {channel: "Log/y"' in drafted
