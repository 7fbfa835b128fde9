# SPDX-License-Identifier: Apache-2.0
"""What the product costs beside a student's script: one table.

    python benchmarks/doors.py [PART ... | all] [--recordings N ...] [--most MB]

| part | rows |
|---|---|
| `fit` | 150 s at 1 kHz: fit, and read and fit, in a warm process; commands with their imports |
| `run` | `osl-analysis run` of recordings of 60 s, from an empty folder, beside the script on all |
| `hour` | ingest of an hour: CSV at 1 kHz of six channels beside polars, MCAP of the bench |
| `bags` | ingest of 20 minutes of the bench in MCAP, and the same messages in sqlite3 and ROS 1 |
| `plan` | `osl-analysis run -n` of many recordings of one size, which could be copies |
| `figures` | a figure in PDF, SVG and PNG, the mean of those of `tests/figure_tables` |
| `page` | the page of a campaign of 1,000 recordings of 8 s, and its opening in headless Chromium |

Without a part all but the last one, which takes an hour. Columns are processor seconds of the
product with all of its processes, those of the script (pandas, filtfilt, lstsq), their ratio, what
is allowed, and the largest memory of a process. Each process has one thread; runs of campaigns have
two processes at a time (`--cores 2`). With `--most`, as CI runs it, only the memory of ingest and
fit of 20 minutes is measured: the command ends with exit code 1 where that is more.
"""

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import yaml

from osl_analysis.base.files import DISTRIBUTION
from osl_analysis.jobs.workers import ENVIRONMENT

ROOT = Path(__file__).resolve().parents[1]
HERE = ROOT / "benchmarks"
COMMAND = (sys.executable, "-c", "from osl_analysis.cli import main; main()")
SETTINGS = ROOT / "config/simulation/default.yaml"
TRIAL = "impedance_K300_B5.0_compensated"
SIMULATED = (
    *("--log-source", "dynamometer"),
    *("--sources", str(ROOT / "config/sources")),
)
DESIRED = ("--stiffness", "300", "--damping", "5")
ADOPT_ORPHANS = 36
"""PR_SET_CHILD_SUBREAPER of Linux: workers are forked from a process that ends after its parent."""
PARTS = ("fit", "run", "hour", "bags", "plan", "figures", "page")
USUAL_PARTS = PARTS[:-1]
PLANNED = {1000: "", 3000: "15 s", 10000: "50 s"}  # recordings, and what is allowed
CYCLES_150_S, CYCLES_60_S, CYCLES_8_S = 22, 9, 1  # of `planted.stepped_sine`
# cycles of the simulated bench at each frequency
THIRD = 173  # 20 minutes
HOUR = 520
HOUR_ROWS = 3_600_000
CSV_SOURCE = """\
format: csv
time: {column: Time}
channels:
  theta: {column: Ankle angle, unit: deg}
  torque: {column: Torque, unit: Nm}
"""

SCRIPT = """import sys
import numpy as np, pandas as pd
from scipy.signal import butter, filtfilt
def read(path):
    time, theta, torque = pd.read_csv(path).to_numpy().T[:3]
    return time, np.deg2rad(theta), torque
def fit(time, theta, torque):
    step = time[1] - time[0]
    b, a = butter(4, 30 * step)  # 15 Hz
    theta, torque = filtfilt(b, a, theta), filtfilt(b, a, torque)
    omega = np.gradient(theta, step)
    columns = np.column_stack([theta, omega, np.gradient(omega, step), np.ones_like(theta)])
    return np.linalg.lstsq(columns, torque, rcond=None)[0]
if __name__ == "__main__":
    for path in sys.argv[1:]:
        print(path, *fit(*read(path)))
"""
"""What a student writes for K, B and I: no checks, no intervals, no page. The columns of a
recording are time [s], angle [deg] and torque [N*m]."""
STUDENT = (sys.executable, "-c", SCRIPT)
WRITE_RECORDING = """import sys
import numpy as np, polars as pl
sys.path.insert(0, sys.argv[1])
from planted import Joint, stepped_sine
for number in range(int(sys.argv[4])):
    rng = np.random.default_rng(number)
    moved = stepped_sine(rng, cycles=int(sys.argv[3]))
    torque = moved.torque(Joint(K=300 + number % 7)) + 0.3 + rng.normal(0, 0.05, len(moved.time))
    step = 360 / 2**16
    columns = {
        "Time [s]": moved.time.round(6),
        "Ankle angle [deg]": (np.round(np.rad2deg(moved.theta) / step) * step).round(5),
        "Torque [Nm]": torque.round(4),
    }
    pl.DataFrame(columns).write_csv(f"{sys.argv[2]}_{number:04d}.csv")
"""
WRITE_HOUR = """import sys
import numpy as np, polars as pl
time = np.arange(int(sys.argv[2])) / 1000
columns = {"Time [s]": time.round(3)}
names = ("Ankle angle [deg]", "Torque [Nm]", "Current [A]", "Motor angle [deg]", "A", "B")
for number, name in enumerate(names):
    columns[name] = (5 * np.sin(3 * time + number)).round(5)
pl.DataFrame(columns).write_csv(sys.argv[1])
"""
READ_BY_POLARS = """import sys, time
import polars as pl
before = time.process_time()
pl.read_csv(sys.argv[1])
print(time.process_time() - before)
"""
WARM = """import sys, time
from collections.abc import Callable
sys.path.insert(0, sys.argv[1])
import osl_analysis as osl
student = {}
exec(sys.argv[2], student)  # its __name__ is not __main__
def least(call: Callable[[], object]) -> float:
    times = []
    for _ in range(9):
        before = time.process_time()
        call()
        times.append(time.process_time() - before)
    return min(times)
stored, recording, source = sys.argv[3:]
def fit(trial: osl.Trial) -> None:
    osl.fit(trial, parameters=None)
trial, columns = osl.read_recording(recording, source), student["read"](recording)
print(
    least(lambda: fit(trial)),
    least(lambda: student["fit"](*columns)),
    least(lambda: fit(osl.read_trial(stored))),
    least(lambda: fit(osl.read_recording(recording, source))),
    least(lambda: student["fit"](*student["read"](recording))),
)
"""
OPEN = """import shutil, sys
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait
options = webdriver.ChromeOptions()
for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"):
    options.add_argument(f"--{flag}")
options.page_load_strategy = "none"  # the driver's own wait hangs on a busy machine
driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
loaded = (
    "return location.protocol === 'file:'"
    " && performance.getEntriesByType('navigation')[0].loadEventEnd"
)
times = []
for _ in range(3):
    driver.get("about:blank")
    WebDriverWait(driver, 60).until(lambda there: there.current_url == "about:blank")
    driver.get(f"file://{sys.argv[1]}")
    loaded_ms = WebDriverWait(driver, 60).until(lambda there: there.execute_script(loaded))
    times.append(loaded_ms / 1000)
driver.quit()
print(min(times))
"""
DRAW = """import sys, time
from pathlib import Path
from osl_analysis.commands.figure import draw_figure
from osl_analysis.figures.drawing import (FIGURES)
folder = Path(sys.argv[2])
tables = [path for path in sorted(Path(sys.argv[1]).glob("*.csv")) if path.stem in FIGURES]
for again in range(2):  # the first time imports and finds fonts
    before = time.process_time()
    for path in tables:
        files = [folder / f"{path.stem}.{ending}" for ending in ("pdf", "svg", "png")]
        draw_figure(path.stem, path, files)
print((time.process_time() - before) / len(tables))
"""
WRITE_BAGS = """import sys
from pathlib import Path
from mcap.reader import make_reader
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore
log, of_ros_2, of_ros_1 = map(Path, sys.argv[1:])
types, types_1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
sqlite = rosbag2.Writer(of_ros_2, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
with log.open("rb") as file, sqlite, rosbag1.Writer(of_ros_1) as bag:
    places = {}
    for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
        topic, name = channel.topic, schema.name
        if topic not in places:
            in_sqlite = sqlite.add_connection(topic, name, typestore=types)
            places[topic] = in_sqlite, bag.add_connection(topic, name, typestore=types_1)
        in_sqlite, in_bag = places[topic]
        sqlite.write(in_sqlite, message.log_time, message.data)
        bag.write(in_bag, message.log_time, types.cdr_to_ros1(message.data, name))
"""
SIMULATE = """import sys
from pathlib import Path
from osl_analysis.commands.simulate import simulate_planned_trial
simulate_planned_trial(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
"""


@dataclass(frozen=True)
class Spent:
    """What a command took, with all processes that it started."""

    seconds: float
    memory_mb: float
    printed: str = ""


def spent(folder: Path, *command: str) -> Spent:
    """Run a command in a folder, with one thread; its processor time and largest memory.

    Raises
    ------
    SystemExit
        It ended with another exit code than 0.
    """
    environment = os.environ | ENVIRONMENT | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=output, stderr=output
        )
        seconds = memory_kb = 0.0
        while True:  # the command, and those of its processes that outlive it
            try:
                number, status, used = os.wait3(0)
            except ChildProcessError:
                break
            if number == process.pid:
                process.returncode = os.waitstatus_to_exitcode(status)
            seconds += used.ru_utime + used.ru_stime
            memory_kb = max(memory_kb, used.ru_maxrss)
        output.seek(0)
        printed = output.read().decode()
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}:\n{printed[-3000:]}")
    return Spent(seconds, memory_kb / 1024, printed)


def least(folder: Path, *command: str, repeats: int = 3) -> Spent:
    """The least of a few runs of a command."""
    return min((spent(folder, *command) for _ in range(repeats)), key=lambda each: each.seconds)


def product(folder: Path, *words: str, repeats: int = 3) -> Spent:
    """The least of a few runs of `osl-analysis`."""
    return least(folder, *COMMAND, *words, repeats=repeats)


def python(folder: Path, code: str, *words: object) -> Spent:
    """Run code with arguments."""
    return spent(folder, sys.executable, "-c", code, *map(str, words))


def show(
    what: str,
    seconds: float,
    script: float | None = None,
    allowed: str = "",
    memory_mb: float | None = None,
) -> None:
    """Print a row of the table."""
    beside = f"{script:9.3f}{seconds / script:8.1f}" if script else f"{'':17}"
    memory = "" if memory_mb is None else f"{memory_mb:.0f} MB"
    print(f"{what:42}{seconds:9.3f}{beside}  {allowed:14}{memory:>8}", flush=True)


# --- parts of the table ---------------------------------------------------------------------------


def commit() -> str:
    """The commit of this checkout."""
    show_commit = ["git", "rev-parse", "--short=8", "HEAD"]
    return subprocess.check_output(show_commit, cwd=ROOT, text=True).strip()


def write_recordings(folder: Path, cycles: int, number: int) -> list[Path]:
    """Write recordings of stepped sines at 1 kHz, of one joint with other noises."""
    folder.mkdir(exist_ok=True)
    python(folder, WRITE_RECORDING, HERE, "joint", cycles, number)
    return sorted(folder.glob("joint_*.csv"))


def show_fit(folder: Path) -> None:
    """150 s at 1 kHz: in a warm process, and by commands."""
    (recording,) = write_recordings(folder / "fit", CYCLES_150_S, 1)
    (folder / "csv.yaml").write_text(CSV_SOURCE, encoding="utf-8")
    ingest = ("ingest", "--log", str(recording), "--log-source", "csv", "--sources", str(folder))
    cold_ingest = product(folder, *ingest, "--output", "trial.parquet")
    files = (folder / "trial.parquet", recording, folder / "csv.yaml")
    warm = python(folder, WARM, HERE, SCRIPT, *files)
    fit, of_student, stored, read, read_by_student = map(float, warm.printed.split()[-5:])
    show("150 s at 1 kHz, warm: fit (script's file)", fit, of_student, "0.08 s")
    show("  read a leg's trial (Parquet) and fit", stored, None, "0.15 s")
    show("  read the recording (CSV) and fit", read, read_by_student, "6 x")

    student = least(folder, *STUDENT, str(recording))
    show("  cold: osl-analysis ingest", cold_ingest.seconds, memory_mb=cold_ingest.memory_mb)
    cold = product(folder, "fit", "--parameters", "none", "trial.parquet")
    show("  cold: osl-analysis fit", cold.seconds, student.seconds, "1.3 x", cold.memory_mb)
    for words in (("--help",), ("inspect", str(recording))):
        command = product(folder, *words)
        show(f"osl-analysis {words[0]}", command.seconds, memory_mb=command.memory_mb)


def new_campaign(folder: Path, cycles: int, number: int) -> list[Path]:
    """Draft a campaign of recordings in a folder; the recordings."""
    recordings = write_recordings(folder.with_name(f"{folder.name}_raw"), cycles, number)
    product(folder.parent, "init", folder.name, "--from", str(recordings[0].parent), repeats=1)
    return recordings


def show_runs(folder: Path, numbers: Sequence[int]) -> None:
    """Campaigns of a few and of many recordings, from empty folders."""
    for number in numbers:
        campaign = folder / f"run_{number}"
        recordings = new_campaign(campaign, CYCLES_60_S, number)
        run = product(campaign, "run", "--cores", "2", repeats=1)
        script = spent(campaign, *STUDENT, *map(str, recordings))
        allowed = "7 x" if number <= 16 else "10 x"
        show(f"run, {number} of 60 s", run.seconds, script.seconds, allowed, run.memory_mb)


def simulate(folder: Path, cycles: int) -> Path:
    """Simulate a trial of the bench with so many cycles at each frequency; its log."""
    settings = yaml.safe_load(SETTINGS.read_text(encoding="utf-8"))
    settings["protocol"]["cycles"] = cycles
    (folder / "simulation.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    (folder / f"{cycles}.yaml").write_text(f"dynamometer: {{cycles: {cycles}}}\n", encoding="utf-8")
    simulated = folder / f"simulated_{cycles}"
    python(folder, SIMULATE, folder / "simulation.yaml", simulated, TRIAL)
    return next(simulated.rglob(f"{TRIAL}.mcap")).rename(folder / f"{cycles}.mcap")


def show_hour(folder: Path) -> None:
    """Ingest of an hour at 1 kHz."""
    table = folder / "hour.csv"
    python(folder, WRITE_HOUR, table, HOUR_ROWS)
    (folder / "csv.yaml").write_text(CSV_SOURCE, encoding="utf-8")
    files = ("--log", str(table), "--output", "hour.parquet")
    ours = product(
        folder, "ingest", *files, "--log-source", "csv", "--sources", str(folder), repeats=1
    )
    by_polars = float(python(folder, READ_BY_POLARS, table).printed.splitlines()[-1])
    table.unlink()
    show("an hour of CSV, six channels: ingest", ours.seconds, by_polars, "3 x", ours.memory_mb)

    log = simulate(folder, HOUR)
    files = ("--log", str(log), "--output", "hour.parquet")
    ours = product(folder, "ingest", *SIMULATED, *files, repeats=1)
    show("an hour of MCAP: ingest", ours.seconds, allowed="4 s", memory_mb=ours.memory_mb)
    fit = product(folder, "fit", *DESIRED, "--config", f"{HOUR}.yaml", "hour.parquet", repeats=1)
    show("  and its fit, a leg", fit.seconds, memory_mb=fit.memory_mb)


def show_bags(folder: Path) -> None:
    """Ingest of the same 20 minutes of the bench in three containers."""
    log = simulate(folder, THIRD)
    containers = {"mcap": log, "rosbag2": folder / "sqlite3", "rosbag1": folder / "ros1.bag"}
    python(folder, WRITE_BAGS, *containers.values())
    source = (ROOT / "config/sources/dynamometer.yaml").read_text(encoding="utf-8")
    for name, recording in containers.items():
        described = source.replace("format: mcap", f"format: {name}")
        (folder / f"{name}.yaml").write_text(described, encoding="utf-8")
        files = ("--log", str(recording), "--log-source", name, "--sources", str(folder))
        ours = product(folder, "ingest", *files, "--output", "bag.parquet", repeats=1)
        show(f"20 minutes as {name}: ingest", ours.seconds, memory_mb=ours.memory_mb)


def show_plans(folder: Path, numbers: Mapping[int, str]) -> None:
    """Plans of campaigns whose recordings have one size and differ in their last value alone."""
    campaign, raw = folder / "plan", folder / "plan_raw"
    (recording,) = new_campaign(campaign, CYCLES_8_S, 1)
    content = recording.read_text(encoding="utf-8")
    head, row = (campaign / "trials.csv").read_text(encoding="utf-8").splitlines()
    rows = [head]
    for number in range(max(numbers)):
        name = f"{recording.stem}_{number:05d}"
        last_value = f"{content.rstrip().rpartition(',')[0]},{number:05d}\n"
        (raw / f"{name}.csv").write_text(last_value, encoding="utf-8")
        rows.append(row.replace(recording.stem, name))
    for number, allowed in numbers.items():
        sheet = "\n".join(rows[: number + 1])
        (campaign / "trials.csv").write_text(f"{sheet}\n", encoding="utf-8")
        plan = product(campaign, "run", "-n", repeats=1)
        show(f"plan, {number} of one size", plan.seconds, None, allowed, plan.memory_mb)


def show_figures(folder: Path) -> None:
    """Figures in three formats."""
    drawn = folder / "drawn"
    drawn.mkdir()
    seconds = float(python(folder, DRAW, ROOT / "tests/figure_tables", drawn).printed.split()[-1])
    show("a figure in three formats, warm", seconds, allowed="0.5 s")


def show_page(folder: Path, number: int) -> None:
    """The page of a campaign of many short recordings."""
    campaign = folder / "page"
    new_campaign(campaign, CYCLES_8_S, number)
    run = product(campaign, "run", "--cores", "2", repeats=1)
    show(f"run, {number} of 8 s", run.seconds, memory_mb=run.memory_mb)
    log = yaml.safe_load((campaign / "results/logs/report.log").read_text(encoding="utf-8"))
    show(f"  its page, {number} trials (wall time)", log["seconds"], allowed="6 s")
    page = campaign / "results/report.html"
    if shutil.which("chromedriver") is None:
        print("  its opening was not measured: Debian's chromium and chromium-driver are not here")
        return
    opened = float(python(folder, OPEN, page).printed.split()[-1])
    megabytes = page.stat().st_size / 1e6
    show(f"  opened in Chromium, {megabytes:.0f} MB (wall time)", opened, allowed="1 s")


def check_memory(folder: Path, most_mb: float) -> None:
    """Raise SystemExit where ingest or fit of 20 minutes takes more memory than that [MB]."""
    log = simulate(folder, THIRD)
    files = ("--output", "third.parquet", "--log", str(log))
    ingest = product(folder, "ingest", *SIMULATED, *files, repeats=1).memory_mb
    settings = ("--config", f"{THIRD}.yaml")
    fit = product(folder, "fit", *DESIRED, *settings, "third.parquet", repeats=1).memory_mb
    print(f"20 minutes: ingest {ingest:.0f} MB, fit {fit:.0f} MB")
    if max(ingest, fit) > most_mb:
        raise SystemExit(f"at most {most_mb:g} MB are allowed")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="The product beside a student's script.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--recordings", type=int, nargs="+", default=[16, 120], metavar="N")
    parser.add_argument("--most", type=float, metavar="MB", help="largest memory of 20 minutes")
    asked = parser.parse_args()
    ctypes.CDLL(None).prctl(ADOPT_ORPHANS, 1, 0, 0, 0)
    parts = PARTS if asked.parts == ["all"] else asked.parts or USUAL_PARTS
    if unknown := set(parts) - set(PARTS):
        parser.error(f"no part is named {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if asked.most is not None:
            check_memory(folder, asked.most)
            return
        begin = f"{DISTRIBUTION} {version(DISTRIBUTION)}, {commit()}; processor s"
        print(f"{begin:42}{'product':>9}{'script':>9}{'ratio':>8}  allowed")
        if "fit" in parts:
            show_fit(folder)
        if "run" in parts:
            show_runs(folder, asked.recordings)
        if "hour" in parts:
            show_hour(folder)
        if "bags" in parts:
            show_bags(folder)
        if "plan" in parts:
            show_plans(folder, PLANNED)
        if "figures" in parts:
            show_figures(folder)
        if "page" in parts:
            show_page(folder, 1000)


if __name__ == "__main__":
    main()
