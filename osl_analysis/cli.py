# SPDX-License-Identifier: Apache-2.0
"""The command line `osl-analysis`: one trial, or one pair of gains, at a time; `snakemake` runs
whole campaigns."""

import errno
import io
import json
import os
import shlex
import signal
import sys
import warnings
from functools import partial
from os.path import realpath
from pathlib import Path
from typing import Any, Literal

import click
from click import argument, option

from osl_analysis.base.errors import (
    OslAnalysisError,
    listing,
    printable,
    printable_lines,
    show_advice_alone,
)
from osl_analysis.base.files import CAMPAIGN, check_target, shipped, write_text
from osl_analysis.base.memory import SET_TO_ONE, limited_memory
from osl_analysis.config.experiments import EXPERIMENTS


def numbers_in(value: str) -> list[float]:
    """Numbers as 300 or as 100,200."""
    try:
        return [float(part) for part in value.split(",")]
    except ValueError:
        raise click.BadParameter(
            f"'{value}' is neither a number nor a list of numbers; write it as 100,200,300"
        ) from None


FILE, FOLDER = click.Path(path_type=Path), click.Path(path_type=Path, file_okay=False)
WRITTEN_SUFFIXES = {
    "ingest": ".parquet",
    "gains": ".csv",
    "bundle": ".zip",
}
"""Suffix of what a command writes, where it writes one kind of file."""
file_option = partial(option, type=FILE)
AS_JSON = option(
    "--json", "as_json", is_flag=True, help="Print JSON in SI units instead of a table."
)


def say(text: str, err: bool = False) -> None:
    """Print lines to the terminal. Control characters, which names in files may have, are written
    as escapes."""
    click.echo(printable_lines(text), err=err)


class KeepsItsInput(click.Command):
    """A command that never writes to a file that it reads, no two results to one file, and only to
    regular files. What it refuses of an option names the option."""

    def invoke(self, ctx: click.Context) -> Any:
        files = {name: path for name, path in ctx.params.items() if isinstance(path, Path)}
        for name in files.keys() & {"output", "plot", "draft_path"}:
            path = files.pop(name)
            if realpath(path) in map(realpath, files.values()):
                raise click.UsageError(
                    f"{path} would be overwritten while it is used; name another file"
                )
            suffix = WRITTEN_SUFFIXES.get(str(ctx.info_name), path.suffix)
            # it may be a source file, a log or a configuration
            if path.suffix != suffix:
                raise click.UsageError(
                    f"{path}: `{ctx.info_name}` writes {suffix} files; choose this suffix"
                )
            check_target(path)
        read = [files[name] for name in ("log", "log_2", "mocap", "file", "trial") if name in files]
        try:
            with limited_memory(read):
                return super().invoke(ctx)
        except OslAnalysisError as error:
            typed = [option for option in self.params if ctx.params[option.name] is not None]
            at_fault = [option.opts[0] for option in typed if option.name in error.settings]
            if not at_fault:
                raise
            reason = f"{', '.join(at_fault)}: {error.reason}"
            raise type(error)(reason, error.remedy) from error


class OneLineErrors(click.Group):
    """Shows a user's mistake as one line on standard error, exit code 1, and a warning as one line.
    Ctrl-C ends with code 130, and SIGTERM in the same way, so that no half-written file stays
    behind."""

    command_class = KeepsItsInput

    def main(self, *args: Any, **extra: Any) -> Any:
        """Call a command. Letters that an output of Windows has no code for, as Greek ones in a
        pipe, are written as escapes."""
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        return super().main(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order in which they are used."""
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        show_advice_alone()
        warnings.showwarning = lambda message, *_, **__: click.echo(
            f"warning: {printable(str(message))}", err=True
        )
        # before numpy is imported
        os.environ.update({name: os.environ.get(name, "1") for name in SET_TO_ONE})
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            # for coroutines of Snakemake, which say that nobody has waited for them
            sys.stderr = io.StringIO()
            sys.exit(130)
        except click.UsageError as error:
            # click lists the choices of an option on lines of their own
            message = error.format_message().replace("\n\t", " ")
            raise click.UsageError(printable(message), error.ctx) from error
        except OslAnalysisError as error:
            click.echo(f"error: {error}", err=True)
        except OSError as error:
            if error.errno == errno.EPIPE:
                raise
            text = f"{error.strerror}; check the path, its permissions and the space on the disk"
            click.echo(printable(f"error: {error.filename or 'the output'}: {text}"), err=True)
        finally:
            signal.signal(signal.SIGTERM, before)
        sys.exit(1)


def show_version(ctx: click.Context, _: click.Parameter, is_asked: bool) -> None:
    """Show the version of the code."""
    if is_asked:
        from osl_analysis.campaign.campaign_trials import code_version

        say(f"osl-analysis, version {code_version()}")
        ctx.exit()


@click.group(
    cls=OneLineErrors,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=show_version,
    help="Show the version and exit.",
)
def main() -> None:
    """From the logs of a powered prosthesis to stiffness [N·m/rad], damping [N·m·s/rad] and inertia
    [kg·m²].

    `init` makes a campaign and `run` analyses it; in a clone of the project, `snakemake
    reproduce-all` does the same. The other commands do one thing at a time."""


@main.command(
    cls=click.Command,
    short_help="make the folder of a campaign, also from recordings",
    epilog="Example: osl-analysis init my_campaign --from /data/2026-03-14",
)
@argument("folder", type=FILE)
@file_option(
    "--from",
    "recordings",
    help=(
        "Draft sample sheet and source files for the recordings in this folder, which stay there."
    ),
)
@option(
    "--example",
    "example",
    flag_value="bench",
    help="A small simulated bench, which runs in about a minute.",
)
@option(
    "--example-walking",
    "example",
    flag_value="walking",
    help="A small simulated walkway with perturbations.",
)
def init(
    folder: Path,
    recordings: Path | None,
    example: Literal["bench", "walking"] | None,
) -> None:
    """Make the folder of a new campaign: configuration, sample sheet, source files and their JSON
    schemas."""
    from osl_analysis.commands import new_campaign as command

    if example and recordings:
        raise click.UsageError("an example has recordings of its own; leave --from")
    draft = command.new_campaign(folder, recordings, example)
    if recordings is not None:
        say(command.campaign_text(folder, draft))
        return
    rows = "simulation.yaml" if example else "trials.csv"
    say(f"made {folder} with config.yaml, {rows}, sources/ and schemas/")
    next_step = "run"
    if not example:
        say("put recordings into recordings/, and a row for each into trials.csv")
        next_step = "inspect recordings/FILE --draft sources/NAME.yaml"
    say(f"then: cd {shlex.quote(str(folder))} && osl-analysis {next_step}")


@main.command(
    "run",
    cls=click.Command,
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    short_help="analyse the campaign in this folder",
    epilog="Example: osl-analysis run results/figures/fig5.pdf -n",
)
@argument("arguments", nargs=-1, type=click.UNPROCESSED)
def run_campaign(arguments: tuple[str, ...]) -> None:
    """Analyse the campaign in this folder: everything, or the files that are named. Takes all
    options of Snakemake.

    The same as `snakemake --snakefile ... --configfile config.yaml`. Write files before options."""
    from snakemake.cli import main as snakemake

    from osl_analysis.commands.run import first_look, snakemake_arguments

    snakemake_options = snakemake_arguments(arguments)
    if CAMPAIGN.is_file() and {"-n", "--dry-run"} & {*snakemake_options}:
        for problem in first_look():
            say(f"to be mended: {problem}", err=True)
    snakemake(snakemake_options)


@main.command(
    short_help="print what was found",
    epilog="Example: osl-analysis results results/mine --markdown",
)
@argument("folder", type=FILE, default=Path("results"))
@option("--all", "everything", is_flag=True, help="Every headline number, and findings in full.")
@option("--markdown", is_flag=True, help="The same as a Markdown table.")
@option(
    "--columns",
    is_flag=True,
    help="Unit and meaning of every column of every table in place of the numbers.",
)
@option(
    "--trace",
    "number",
    metavar="NUMBER",
    help="Files, trials and settings from which this number comes: its name, macro or value.",
)
def results(
    folder: Path, everything: bool, markdown: bool, columns: bool, number: str | None
) -> None:
    """Print what the results in FOLDER are: trials that are clear, doubtful and left out, K and B
    with intervals, and each doubt with what to do; with --all every number, and the draft's."""
    from osl_analysis.campaign.origin import sentence
    from osl_analysis.commands.tables import (
        columns_text,
        format_results_table,
        read_summary_file,
    )
    from osl_analysis.jobs.progress import later_failures
    from osl_analysis.report.verdicts import brief_lines

    if columns:
        say(columns_text())
        return
    summary = read_summary_file(folder / "summary.json")
    if number is not None:
        from osl_analysis.commands.report import trace_text

        say(trace_text(summary, number))
    elif everything or markdown:
        say(format_results_table(summary, markdown))
    else:
        how_to_see_all = "every number, and findings in full: osl-analysis results --all"
        say("\n".join([sentence(summary), "", *brief_lines(summary), "", how_to_see_all]))
    failures = later_failures(folder / "summary.json")
    if failures:
        say(failures, err=True)


@main.command(
    short_help="list what a recording holds",
    epilog="Example: osl-analysis inspect unknown.mcap --draft config/sources/mine.yaml",
)
@argument("file", type=FILE)
@file_option(
    "--draft", "draft_path", help="Write the draft of a source file here instead of printing it."
)
@option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def inspect(file: Path, draft_path: Path | None, as_json: bool) -> None:
    """List what a recording holds, an MCAP, C3D, CSV or MATLAB file: rates [Hz], units, gaps,
    damage. Draft a source file for it."""
    from osl_analysis.commands import trials as command
    from osl_analysis.draft.draft_source import draft_source
    from osl_analysis.formats import formats_of

    if file.is_dir() and not formats_of(file):  # that of a ROS 2 bag is one recording
        raise click.UsageError(
            f"{file} is a folder: name a recording, or draft all of them by `osl-analysis init"
            f" CAMPAIGN --from {shlex.quote(str(file))}`"
        )
    overview = command.inspect_file(file)
    draft = draft_source(overview, file.name)
    if as_json:
        say(json.dumps(command.overview_facts(overview), indent=2, ensure_ascii=False))
    else:
        say(command.overview_text(overview))
    if draft_path is not None:
        if draft_path.exists():
            raise click.UsageError(f"{draft_path} exists; name a new file")
        write_text(draft_path, draft)
        say(f"wrote {draft_path}")
    elif not as_json:
        say(f"\nA source file to start from:\n\n{draft}")


@main.command(
    short_help="fit one trial and print its estimates",
    epilog="Example: osl-analysis fit raw.csv --source source.yaml --plot fit.png",
)
@argument("trial", type=FILE)
@file_option(
    "--source",
    help="Source file of a raw recording, which says what is what, or the name of a shipped one.",
)
@option(
    "--model",
    # of a calibration the sheet of a campaign says what is known
    type=click.Choice(
        [
            name
            for name, facts in EXPERIMENTS.items()
            if facts.place == "bench" and name != "calibration"
        ]
    ),
    default="impedance",
    help=(
        "K, B, I of Eq. 15; B_j, J_j of Eq. 4; belt stiffness K_s; the actuator of Eqs. 1-2;"
        " torque-angle curve."
    ),
)
@option(
    "--stiffness",
    "K_d",
    type=float,
    help="Desired K_d [N·m/rad] of the trial, for --model impedance.",
)
@option(
    "--damping",
    "B_d",
    type=float,
    help="Desired B_d [N·m·s/rad] of the trial, for --model impedance.",
)
@option(
    "--controller",
    help=(
        "Controller of the trial, any name; default: compensated. The gains of compensated and"
        " uncompensated are known (Eqs. 13 and 14)."
    ),
)
@option(
    "--parameters",
    help="Parameter file of the device, or `none`. Default: that of the configuration.",
)
@option("--windows", help="Parts of the trial that are fitted [s], as `2-30 40-62`.")
@file_option(
    "--config",
    "config_path",
    show_default="config.yaml here, else the shipped one",
    help="Configuration with the filter [Hz] and the stepped-sine protocol [deg, Hz].",
)
@AS_JSON
@file_option("--plot", help="Draw measured and modelled torque [N·m] to this file.")
def fit(
    trial: Path,
    source: Path | None,
    model: str,
    K_d: float | None,
    B_d: float | None,
    controller: str | None,
    parameters: str | None,
    windows: str | None,
    config_path: Path | None,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Fit one TRIAL and print the estimates in SI units with 95 % intervals.

    TRIAL is a raw recording with its --source (`inspect --draft` drafts one), or what `ingest` or
    a campaign made of it (Parquet).

    The configuration may be a campaign's own, which overrides fields of the default. With
    --stiffness and --damping an impedance trial is judged as in a campaign: whether the torque is
    late, and whether K is plausible."""
    from osl_analysis import notebook
    from osl_analysis.base.trial import read_trial
    from osl_analysis.bench.evidence import DesiredImpedance
    from osl_analysis.campaign.configuration import OF_CONFIG
    from osl_analysis.commands.fit_results import estimates_text, rows_json

    desired = None
    if (K_d, B_d, controller) != (None, None, None):
        desired = DesiredImpedance(controller or "compensated", K_d, B_d)
    recorded = read_trial(trial) if source is None else notebook.read_recording(trial, source)
    device = None if parameters == "none" else parameters or OF_CONFIG
    fitted = notebook.fit(recorded, model, desired, windows, config_path, device)
    if plot is not None:
        from osl_analysis.commands.figure import write_figure

        write_figure(notebook.plot_torque(fitted), [plot])
    if as_json:
        say(rows_json(fitted.table, fitted.findings))
    else:
        say(estimates_text(fitted.table, fitted.findings, fitted.budget))
    if fitted.remarks:
        say(fitted.remarks, err=True)


@main.command(
    short_help="convert the raw logs of one trial into one file",
    epilog=(
        "Example: osl-analysis ingest --log dyno.mcap --log-source dynamometer --output"
        " dyno.parquet"
    ),
)
@file_option("--log", help="Log of the dynamometer or the leg (MCAP, CSV or MATLAB).")
@option("--log-source", help="Name of the file in the sources folder that describes the log.")
@option(
    "--log-part",
    help="Part of a log that holds several trials: in a MATLAB file a struct, as Test.run(2).",
)
@file_option("--log-2", help="Second log of the trial, of another recorder.")
@option("--log-2-source", help="Name of the file in the sources folder that describes it.")
@file_option("--mocap", help="File of the motion-capture system (C3D, or a CSV export of Nexus).")
@option("--mocap-source", help="Name of the file in the sources folder that describes it.")
@file_option(
    "--sources",
    default=shipped("config/sources"),
    help="Folder of source files, which say what is what.",
)
@file_option("--output", required=True, help="Parquet file to write, in SI units.")
def ingest(sources: Path, output: Path, **options: Any) -> None:
    """Convert the raw logs of one trial into one canonical Parquet file, with provenance inside."""
    from osl_analysis.base.trial import write_trial
    from osl_analysis.commands.trials import checked_trial

    for role in ("log", "log_2", "mocap"):
        if (options[role] is None) != (options[f"{role}_source"] is None):
            option_name = role.replace("_", "-")
            raise click.UsageError(f"--{option_name} and --{option_name}-source go together")
    if not (options["log"] or options["mocap"]):
        raise click.UsageError("give --log, --mocap or both")
    cells = {name: None if value is None else str(value) for name, value in options.items()}
    row = {"trial": output.stem, "experiment": "ingest_only", **cells}
    write_trial(checked_trial(row, Path(), sources), output)
    say(f"wrote {output}")


@main.command(
    "gains",
    short_help="control gains that render a stiffness and a damping",
    epilog="Example: osl-analysis gains --stiffness 300 --damping 5 (a grid: 100,200,300 and 0,5)",
)
@option(
    "--stiffness",
    "K_d",
    type=numbers_in,
    help="Desired joint stiffness K_d [N·m/rad]: 300, or 100,200.",
)
@option(
    "--damping",
    "B_d",
    type=numbers_in,
    help="Desired joint damping B_d [N·m·s/rad]: 5, or 0,2.5,5.",
)
@file_option(
    "--trajectory", help="CSV file with phase (0 to 1), K_d [N·m/rad] and B_d [N·m·s/rad] instead."
)
@option("--weight-hz", "cutoff_hz", type=float, default=1.0, help="Cut-off of W in Eq. 14 [Hz].")
@option("--weight-order", "order", type=int, default=3, help="Order of W in Eq. 14.")
@file_option(
    "--parameters",
    default=shipped("config/parameters/default.yaml"),
    help="Parameter file of the device.",
)
@AS_JSON
@file_option("--output", help="Write the table to this CSV file.")
def select_gains(
    trajectory: Path | None,
    parameters: Path,
    as_json: bool,
    output: Path | None,
    K_d: list[float] | None,
    B_d: list[float] | None,
    cutoff_hz: float,
    order: int,
) -> None:
    """Select the control gains K_1 and B_1 that render a desired impedance best (Eqs. 13 and 14).

    For one pair, a grid or a trajectory. The table also has the impedance that a fit will estimate,
    stability and passivity."""
    from osl_analysis.base.table import write_table
    from osl_analysis.base.yaml_settings import validated
    from osl_analysis.commands import gains as command
    from osl_analysis.commands.fit_results import rows_json
    from osl_analysis.model.compensator import Weight

    is_half = bool(K_d) != bool(B_d)
    if is_half or bool(trajectory) == bool(K_d):
        raise click.UsageError("give --stiffness and --damping, or --trajectory, which has both")
    weight = validated({"cutoff_hz": cutoff_hz, "order": order}, Weight, "W of Eq. 14")
    table = command.requested_gains(K_d or (), B_d or (), trajectory, weight, parameters)
    if output is not None:
        write_table(table, output)
    say(rows_json(table) if as_json else command.gains_text(table))


@main.command(
    short_help="simulate a campaign",
    epilog="Example: osl-analysis simulate --trial impedance_K300_B5.0_compensated /tmp/campaign",
)
@argument("folder", type=FOLDER)
@file_option(
    "--settings",
    default=shipped("config/simulation/default.yaml"),
    help="What to simulate: experiments, protocol [Hz, deg], imperfections with their units, seed.",
)
@option("--trial", help="Name of a single trial of the plan; default: the whole campaign.")
@file_option(
    "--config",
    "config_path",
    help=(
        "Take parameters, protocol, gain weight and desired impedance from this configuration, as"
        " snakemake does."
    ),
)
def simulate(folder: Path, settings: Path, trial: str | None, config_path: Path | None) -> None:
    """Simulate a campaign into FOLDER: sample sheet, MCAP and C3D logs, and the truth beside
    them."""
    from osl_analysis.campaign.configuration import read_config
    from osl_analysis.commands.simulate import UNFOLLOWED, simulate_campaign, simulate_planned_trial

    followed = UNFOLLOWED if config_path is None else read_config(config_path).shared()
    if trial is None:
        simulate_campaign(settings, folder, followed)
    else:
        simulate_planned_trial(settings, folder, trial, followed)


@main.command(
    "dead-weights",
    short_help="scale and zero of a load cell by masses at an arm",
    epilog='Example: osl-analysis dead-weights weights.csv --arm-error "0.5 mm" --gravity 9.81',
)
@argument("table", type=FILE)
@option("--arm-error", default="0 mm", help="Standard uncertainty of the arm, as `0.5 mm`.")
@option("--mass-error", default="0 g", help="Standard uncertainty of a mass, as `1 g`.")
@option("--gravity", type=float, help="Of the place [m/s^2]; else the standard one, to 0.15 %.")
def dead_weights(table: Path, arm_error: str, mass_error: str, gravity: float | None) -> None:
    """Fit scale and zero of a load cell to TABLE, whose columns are `arm [mm]`, `mass [g]` and
    `counts`, in any unit of length and mass. Print what to state of it."""
    from osl_analysis.commands import dead_weights as command

    say(command.gain_text(command.gain_in_table(table, arm_error, mass_error, gravity)))


@main.command(
    short_help="pack a campaign with its results into one ZIP file",
    epilog="Example: osl-analysis bundle . campaign.zip",
)
@argument("folder", type=FOLDER)
@argument("output", type=FILE)
def bundle(folder: Path, output: Path) -> None:
    """Write the campaign in FOLDER, with its recordings and results, to the ZIP file OUTPUT.

    Unpacked elsewhere, `osl-analysis run` analyses it again, and `sha256sum -c SHA256SUMS` checks
    its files."""
    from osl_analysis.commands.bundle import write_bundle

    outside = write_bundle(folder, output)
    say(f"wrote {output}")
    if outside:
        say(f"! with files from outside of {folder}: {listing(outside, 5)}", err=True)
