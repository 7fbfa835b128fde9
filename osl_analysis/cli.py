"""The command line `osl-analysis`: one trial, or one pair of gains, at a time; `snakemake` runs whole campaigns."""

from pathlib import Path

import click

from osl_analysis.cli_campaign import completion, doctor, init, run, watch
from osl_analysis.cli_design import design, gains
from osl_analysis.cli_options import (
    AS_JSON,
    CONFIG,
    DEVICE,
    FILE,
    NO_FILE,
    OneLineErrors,
    desired_impedance,
    desired_options,
    say,
)
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.shipped import shipped


@click.group(cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="osl-analysis")
def main() -> None:
    """From the logs of a powered prosthesis to stiffness [N·m/rad], damping [N·m·s/rad] and inertia [kg·m²].

    `init` makes a campaign and `run` analyses it; in a clone of the project, `snakemake reproduce-all` does the same.
    The other commands do one thing at a time.
    """


main.add_command(init)
main.add_command(run)
main.add_command(doctor)
main.add_command(watch)
main.add_command(completion)
main.add_command(gains)
main.add_command(design)


@main.command(epilog="Example: osl-analysis simulate --trial impedance_K300_B5.0_compensated /tmp/campaign")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--settings",
    type=FILE,
    default=shipped("config/simulation/default.yaml"),
    show_default=True,
    help="What to simulate: experiments, protocol [Hz, deg], imperfections with their units, seed.",
)
@click.option("--trial", help="Name of a single trial of the plan; default: the whole campaign.")
@click.option(
    "--config",
    "config_path",
    type=FILE,
    help="Take parameters, protocol, gain weight and desired impedance from this configuration, as snakemake does.",
)
def simulate(folder: Path, settings: Path, trial: str | None, config_path: Path | None) -> None:
    """Simulate a campaign into FOLDER: sample sheet, MCAP and C3D logs, and the truth beside them."""
    from osl_analysis.commands.simulate import NOTHING, simulate_campaign, simulate_trial
    from osl_analysis.config import read_config

    followed = NOTHING if config_path is None else read_config(config_path).shared()
    if trial is None:
        simulate_campaign(settings, folder, followed)
    else:
        simulate_trial(settings, folder, trial, followed)


@main.command(
    epilog="Example: osl-analysis ingest --log dyno.mcap --log-source dynamometer --output results/trials/dyno.parquet"
)
@click.option("--log", type=FILE, help="Log of the dynamometer or the leg (MCAP, CSV or MATLAB).")
@click.option("--log-source", help="Name of the file in the sources folder that describes the log.")
@click.option("--log-part", help="Part of a log that holds several trials: in a MATLAB file a struct, as Test.run(2).")
@click.option("--mocap", type=FILE, help="File of the motion-capture system (C3D, or a CSV export of Nexus).")
@click.option("--mocap-source", help="Name of the file in the sources folder that describes it.")
@click.option(
    "--sources",
    type=FILE,
    default=shipped("config/sources"),
    show_default=True,
    help="Folder of source files: channel, unit and sign per signal.",
)
@click.option("--output", type=FILE, required=True, help="Parquet file to write, in SI units.")
def ingest(
    log: Path | None,
    log_source: str | None,
    log_part: str | None,
    mocap: Path | None,
    mocap_source: str | None,
    sources: Path,
    output: Path,
) -> None:
    """Convert the raw logs of one trial into one canonical Parquet file, with provenance inside."""
    from osl_analysis.commands.ingest import ingest_trial
    from osl_analysis.trial import read_trial

    for path, source, option in ((log, log_source, "--log"), (mocap, mocap_source, "--mocap")):
        if (path is None) != (source is None):
            raise click.UsageError(f"{option} and {option}-source go together")
    if log is None and mocap is None:
        raise click.UsageError("give --log, --mocap or both")
    row = {
        "trial": output.stem,
        "experiment": "ingest_only",
        "log": log and str(log),
        "log_source": log_source,
        "log_part": log_part,
        "mocap": mocap and str(mocap),
        "mocap_source": mocap_source,
    }
    ingest_trial(row=row, raw_folder=Path(), sources_folder=sources, output=output)
    for warning in read_trial(output).provenance.get("warnings", []):
        say(f"warning: {warning}", err=True)
    say(f"wrote {output}")


@main.command(epilog="Example: osl-analysis inspect unknown.mcap --draft config/sources/mine.yaml")
@click.argument("file", type=FILE)
@click.option("--draft", "draft_path", type=FILE, help="Write the draft of a source file here instead of printing it.")
def inspect(file: Path, draft_path: Path | None) -> None:
    """List what an MCAP, C3D, CSV or MATLAB file holds: rates [Hz], units, gaps, damage. Draft a source file for it."""
    from osl_analysis.commands import inspect as command
    from osl_analysis.files import atomic_path
    from osl_analysis.ingest.draft import draft_source

    overview = command.inspect_file(file)
    say(command.overview_text(overview))
    text = draft_source(overview, file.name)
    if draft_path is None:
        say(f"\nA source file to start from:\n\n{text}")
    elif draft_path.exists():
        raise click.UsageError(f"{draft_path} exists; name a new file")
    else:
        with atomic_path(draft_path) as temporary:
            temporary.write_text(text, encoding="utf-8")
        say(f"wrote {draft_path}")


@main.command(epilog="Example: osl-analysis fit results/trials/belt_01.parquet --model belt --plot belt.png")
@click.argument("trial", type=FILE)
@click.option(
    "--model",
    type=click.Choice([name for name, facts in EXPERIMENTS.items() if facts.place == "bench"]),
    default="impedance",
    show_default=True,
    help="K, B, I of Eq. 15; B_j, J_j of Eq. 4; belt stiffness K_s; the actuator of Eqs. 1-2; torque-angle curve.",
)
@desired_options
@DEVICE
@CONFIG
@AS_JSON
@click.option("--plot", type=FILE, help="Draw measured and modelled torque [N·m] to this file.")
def fit(
    trial: Path,
    model: str,
    stiffness: float | None,
    damping: float | None,
    controller: str,
    parameters: Path | None,
    config_path: Path,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Fit one ingested TRIAL (Parquet) and print the estimates in SI units with 95 % intervals.

    The configuration may be a campaign's own, which overrides fields of the default. With --stiffness and --damping an
    impedance trial is judged as in a campaign: whether the torque is late, and whether K is plausible.
    """
    from osl_analysis.commands import fit as command
    from osl_analysis.commands.fit_text import estimates_json, estimates_text

    desired = desired_impedance(model, stiffness, damping, controller)
    device = command.campaign_parameters(config_path) if parameters is None else parameters
    request = command.fit_request(model, config_path, desired)
    fitted = command.fit_one_trial(model, trial, None if device == NO_FILE else device, request)
    if model == "impedance" and desired is None:
        click.echo(command.NOT_CHECKED, err=True)
    if unchecked := command.said_not_checked(fitted):
        say(unchecked, err=True)
    if plot is not None:
        from osl_analysis.commands.figure import draw_table

        draw_table("torque", fitted.series, [plot])
    say(estimates_json(fitted.estimates) if as_json else estimates_text(fitted.estimates))


@main.command(epilog="Example: osl-analysis samples ../shared/real_data --output docs/real_samples.md")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--output", type=FILE, help="Write a Markdown page to this file instead of printing the table.")
@CONFIG
def samples(folder: Path, output: Path | None, config_path: Path) -> None:
    """List the content of every recording below FOLDER, and the quality checks that it fails, without a source file.

    Rates are in Hz, gaps in s; a file that is refused is listed with the reason.
    """
    from osl_analysis.commands.inspect import samples_table, write_samples
    from osl_analysis.config import read_campaign_section
    from osl_analysis.quality.checks import QualityRules

    rules = read_campaign_section(config_path, "quality", QualityRules)
    if output is None:
        say(samples_table(folder, rules))
    else:
        write_samples(folder, rules, output, f"osl-analysis samples {folder} --output {output}")
        say(f"wrote {output}")


@main.command("describe-tables", epilog="Example: osl-analysis describe-tables --output docs/tables.md")
@click.option("--output", type=FILE, help="Write the page to this file instead of printing it.")
def describe_tables(output: Path | None) -> None:
    """Print meaning and unit of every column of every result table and every entry of the summary, as Markdown."""
    from osl_analysis.commands.describe_tables import page, write_page

    if output is None:
        say(page("osl-analysis describe-tables"))
    else:
        write_page(output, f"osl-analysis describe-tables --output {output}")
        say(f"wrote {output}")


@main.command(epilog="Example: osl-analysis results results/mine --markdown")
@click.argument("folder", type=FILE, default=Path("results"))
@click.option("--summary", type=FILE, help="Summary of a campaign, in place of that in FOLDER.")
@click.option("--markdown", is_flag=True, help="A Markdown table in place of aligned columns.")
def results(folder: Path, summary: Path | None, markdown: bool) -> None:
    """Print the headline numbers of the results in FOLDER, with units, intervals and the draft's values."""
    from osl_analysis.commands.summarise import format_results_table, later_failures, read_summary

    path = folder / "summary.json" if summary is None else summary
    say(format_results_table(read_summary(path), markdown))
    if failed := later_failures(path):
        say(failed, err=True)
