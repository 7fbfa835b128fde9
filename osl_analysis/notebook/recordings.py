"""For notebooks: recordings and trials, whether they are usable, and a simulated recording to try things with."""

from pathlib import Path

import polars as pl

from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config import read_section
from osl_analysis.errors import InputError, nearest
from osl_analysis.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.files import shipped
from osl_analysis.ingest.known_formats import FORMATS, read_source
from osl_analysis.notebook.fits import File, config_of, path_of, trial_of
from osl_analysis.quality.checks import Commanded, QualityRules
from osl_analysis.quality.verdict import examine, quality_table, validate_rules
from osl_analysis.trial import Trial

SOURCES = Path("config/sources")


def read_trial(path: File) -> Trial:
    """A trial from the Parquet file of `osl-analysis ingest` or of a campaign (`results/trials/NAME.parquet`).

    `trial.samples` is a polars data frame in SI units with a row per time stamp, `trial.provenance` says where each
    column comes from.

    Raises InputError: the file is missing, is not Parquet, or is Parquet that ingest did not write.
    """
    return trial_of(path_of(path, "path"))


def read_recording(path: File, source: File, part: str | None = None, name: str | None = None) -> Trial:
    """A trial from the raw log, or the capture, of one recorder, converted to SI units by its source file.

    Nothing is written. A trial of two recorders (walking) needs a campaign, or `osl-analysis ingest`.

    Parameters
    ----------
    path
        the recording, or the folder of a split ROS 2 bag.
    source
        the source file (YAML) with channel, unit and sign of each signal, or the name of a shipped one, such as
        "opensourceleg". `osl-analysis inspect FILE --draft mine.yaml` drafts one.
    part
        the part of a log that holds several trials, such as a struct of a MATLAB file.
    name
        name of the trial; default: that of the file.

    Raises InputError: the recording or the source file is missing, or the recording is not what the source file
    says.
    """
    file, described = path_of(path, "path"), source_file(source)
    role = "mocap" if FORMATS[read_source(described).format].is_capture else "log"
    if part is not None and role == "mocap":
        raise InputError(f"{file}: a capture has no part '{part}'; leave out `part`")
    if not file.exists():
        raise InputError(f"{file}: no such file; name the recording as seen from the folder {Path.cwd()}")
    row = {"trial": file.stem if name is None else name, role: file.name, f"{role}_source": described.stem}
    return checked_trial({**row, "log_part": part}, file.parent, described.parent)


def source_file(source: File) -> Path:
    """A source file by its path, or by its name among those of the working folder or the shipped ones."""
    path = path_of(source, "source")
    if path.suffix == ".yaml" and path.is_file():
        return path
    named = shipped(SOURCES / f"{source}.yaml")
    if named.is_file():
        return named
    known = sorted(file.stem for file in shipped(SOURCES).glob("*.yaml"))
    raise InputError(
        f"{source}: no such source file; give the path of a file that ends in .yaml, or one of {', '.join(known)}"
        f"{nearest(path.stem, known)}"
    )


def check(trial: Trial | File, experiment: str = "impedance", config: File | None = None) -> pl.DataFrame:
    """The quality of a trial: a row per check, as in `quality.csv`.

    `check`, `value` in its `unit`, `threshold`, `verdict` (pass, flag, or exclude) and `remark`. What `experiment`
    needs is checked as well. `config` is a configuration file, whose section `quality` has the thresholds.

    Raises InputError: as `read_trial`; there is no such experiment; or the configuration is not valid.
    """
    if experiment not in EXPERIMENTS:
        known = ", ".join(EXPERIMENTS)
        raise InputError(f"no experiment '{experiment}'; it is one of {known}{nearest(experiment, EXPERIMENTS)}")
    read, path = trial_of(trial), config_of(config)
    rules = read_section(path, "quality", QualityRules)
    validate_rules(rules)
    bench = read_section(path, "dynamometer", DynamometerAnalysis)
    commanded = Commanded(**{name: getattr(bench, name) for name in PROTOCOL})
    return quality_table(read.name, examine(read, experiment, commanded), rules, ())


def simulate_trial(folder: File, trial: str, settings: File = "config/simulation/default.yaml") -> tuple[Path, str]:
    """Simulate one bench trial of a simulated campaign into a folder: its log, and the name of the source file of it.

    `trial` is a name of the plan, such as "impedance_K300_B5.0_compensated", and `settings` a file of the simulator:
    experiments, protocol [Hz, deg], imperfections with their units, seed. `read_recording(*simulate_trial(...))` is the
    trial. What is true of it is in `truth/TRIAL.json`.

    Raises InputError: the settings plan no such trial, it is not of a bench, or the folder has recordings that the
    simulator did not make.
    """
    from osl_analysis.commands import simulate  # half a second, which only this needs

    path, place = shipped(path_of(settings, "settings")), path_of(folder, "folder")
    row = simulate.row_of_trial(simulate.read_simulation(path, simulate.NOTHING), path, trial)
    if EXPERIMENTS[row["experiment"]].place != "bench":
        raise InputError(f"trial {trial}: is of the walkway; simulate a campaign (`osl-analysis simulate`) and run it")
    simulate.simulate_trial(path, place, trial)
    return place / str(row["log"]), str(row["log_source"])
