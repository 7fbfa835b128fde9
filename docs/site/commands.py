"""The page of the command line, from the commands themselves."""

import re
from inspect import cleandoc

import click

from osl_analysis.cli import main

SPECIAL = re.compile(r"([\\*|<>$\[\]])")
WIDTH = 10_000
"""Characters of a line, so that click does not break lines: the page does."""


def commands_page():
    """Every command in Markdown: what it does, its use, its arguments and options, an example."""
    with click.Context(main, info_name="osl-analysis") as context:
        parts = [
            escaped(help_of(main)),
            *(one_command(main.get_command(context, name), context) for name in names()),
        ]
    return "\n\n".join(parts)


def names():
    """Names of all commands, in order of the alphabet."""
    return sorted(name for name, command in main.commands.items() if not command.hidden)


def one_command(command, parent):
    """One command in Markdown."""
    with click.Context(
        command,
        info_name=command.name,
        parent=parent,
        max_content_width=WIDTH,
        terminal_width=WIDTH,
    ) as context:
        usage = command.get_usage(context).removeprefix("Usage: ")
        records = [one.get_help_record(context) for one in command.params]
    rows = [
        f"| `{bars(record[0])}` | {escaped(record[1])} |"
        for record in records
        if record and record[1]
    ]
    example = (command.epilog or "").removeprefix("Example: ")
    parts = [f"## {command.name}", f"```\n{usage}\n```", escaped(help_of(command))]
    parts += ["\n".join(["| option | meaning |", "|---|---|", *rows])] * bool(rows)
    parts += [f"Example:\n\n```\n{example}\n```"] * bool(example)
    return "\n\n".join(parts)


def help_of(command):
    """What a command says of itself, in paragraphs."""
    return cleandoc(command.help or "").replace("\b", "")


def bars(text):
    """Code in a cell of a table, where a bar would end the cell."""
    return text.replace("|", "\\|")


def escaped(text):
    """Text that Markdown shows as it is; what stands in single backticks is code."""
    parts = text.split("`")
    return "`".join(
        SPECIAL.sub(r"\\\1", part) if index % 2 == 0 else part for index, part in enumerate(parts)
    )
