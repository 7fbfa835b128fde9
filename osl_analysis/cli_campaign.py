"""The commands of `osl-analysis` for a whole campaign: make one, run it, look whether machine and data will do."""

import sys
from pathlib import Path

import click

from osl_analysis.cli_options import FILE, say

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
    say(f"then: cd {folder} && osl-analysis run")


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


def print_first_look(folder: Path) -> None:
    """Print what the first bench trials of a campaign give, or why nothing can be said."""
    from osl_analysis.commands.first_look import first_look
    from osl_analysis.errors import OslAnalysisError

    try:
        for look in first_look(folder):
            say(f"first trial of experiment {look.experiment}, {look.trial}: {'ok' if look.is_sound else 'LOOK AT IT'}")
            say("\n".join(f"  {line}" for line in look.said.splitlines()))
    except OslAnalysisError as error:
        say(f"no first look: {error}")
