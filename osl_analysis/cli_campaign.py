"""The commands of `osl-analysis` for a whole campaign: make one, run it, look whether machine and data will do."""

import shlex
import sys
from contextlib import suppress
from pathlib import Path

import click

from osl_analysis.cli_options import CONFIG, FILE, say

FOLDER = click.Path(path_type=Path, file_okay=False)


@click.command(epilog="Example: osl-analysis init my_campaign --from /data/2026-03-14")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--recorder",
    "recorders",
    multiple=True,
    metavar="NAME",
    help="Begin with this shipped source file; may be repeated.",
)
@click.option(
    "--from",
    "recordings",
    type=FILE,
    help="Draft sample sheet and source files for the recordings in this folder, which stay there, and try the first.",
)
@click.option("--example", is_flag=True, help="A small simulated campaign, which runs in about a minute.")
def init(folder: Path, recorders: tuple[str, ...], recordings: Path | None, example: bool) -> None:
    """Make the folder of a new campaign: configuration, sample sheet, source files and their JSON schemas."""
    from osl_analysis.commands.new_campaign import drafted_text, left_to_decide, new_campaign

    if example and (recorders or recordings):
        raise click.UsageError("--example has recordings of its own; leave --recorder and --from")
    draft = new_campaign(folder, recorders, recordings, example)
    say(f"made {folder} with config.yaml, {'simulation.yaml' if example else 'trials.csv'}, sources/ and schemas/")
    if recordings is not None:
        say(drafted_text(draft))
        decisions = left_to_decide(folder, draft)
        say("\n".join(["left to decide:", *(f"  {line}" for line in decisions)]) if decisions else "")
        print_first_look(folder)
    elif not example:
        say("next: recordings into recordings/, a row for each into trials.csv, their channels into sources/")
        say("      `osl-analysis inspect FILE --draft sources/NAME.yaml` drafts a source file")
    say(f"then: cd {shlex.quote(str(folder))} && osl-analysis run")


@click.command(
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    epilog="Example: osl-analysis run results/figures/fig5.pdf -n",
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def run(arguments: tuple[str, ...]) -> None:
    """Analyse the campaign in this folder: everything, or the files that are named. Takes all options of Snakemake.

    The same as `snakemake --snakefile ... --configfile config.yaml`. Write files before options.
    """
    from osl_analysis.commands.run import run_workflow

    run_workflow(arguments)


@click.command(epilog="Example: osl-analysis doctor --look")
@click.option("--look", is_flag=True, help="Also ingest and fit the first bench trial of each source file.")
def doctor(look: bool) -> None:
    """Say whether this machine, and the campaign in this folder, can run, and what is missing."""
    from osl_analysis.commands.doctor import as_text, findings

    found = list(findings(Path()))
    say(as_text(found))
    if look:
        print_first_look(Path())
    if any(one.remedy for one in found):
        sys.exit(1)


@click.command(epilog="Example: osl-analysis watch /data/today --source sources/my_bench.yaml")
@click.argument("folder", type=FOLDER)
@click.option(
    "--source", type=FILE, help="Source file that describes the recordings. Default: what the campaign has, or a guess."
)
@click.option("--output", type=FOLDER, default=Path("watched"), show_default=True, help="Folder of the pictures.")
@CONFIG
def watch(folder: Path, source: Path | None, output: Path, config_path: Path) -> None:
    """Examine every recording in FOLDER as soon as it is complete: a line with quality, K, B, I, doubts, and a picture.

    Ctrl-C ends it. A recording that was examined is not examined again until it changes.
    """
    from osl_analysis.commands.watch import bench_of, watch

    bench = bench_of(config_path, source, output)
    say(f"watching {folder}; Ctrl-C ends")
    with suppress(KeyboardInterrupt):
        for line in watch(folder, bench):
            say(line)


@click.command(epilog="Example: osl-analysis completion bash >> ~/.bashrc")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the lines with which a shell completes commands, options and files of osl-analysis."""
    from click.shell_completion import get_completion_class

    from osl_analysis.cli import main

    made = get_completion_class(shell)
    if made is not None:
        click.echo(made(main, {}, "osl-analysis", "_OSL_ANALYSIS_COMPLETE").source())


def print_first_look(folder: Path) -> None:
    """Print what the first bench trials of a campaign give, or why nothing can be said."""
    from osl_analysis.commands.inspect import first_look
    from osl_analysis.errors import OslAnalysisError

    try:
        for look in first_look(folder):
            say(f"first trial of experiment {look.experiment}, {look.trial}: {'ok' if look.is_sound else 'LOOK AT IT'}")
            say("\n".join(f"  {line}" for line in look.said.splitlines()))
    except OslAnalysisError as error:
        say(f"no first look: {error}")
