"""The tutorial is followed: its commands run, and print what the page shows."""

import re

import yaml
from tutorial_page import DOCS, FIGURE, LEFT_OUT, said_by_page


def lines_of(text):
    """Lines without the seconds that a stage took, and without blanks at the end."""
    return [re.sub(r" in \d+ s$", " in N s", line.rstrip()) for line in text]


def test_the_commands_of_the_tutorial_print_what_it_shows_and_end_with_its_figure_without_a_flag(tmp_path):
    folder = tmp_path / "a place with blanks"
    folder.mkdir()
    said = list(said_by_page(folder))
    assert [command.split()[1] for command, _, _ in said] == ["record.py", "init", "ingest", "fit", "run", "results"]
    for command, shown, printed in said:
        shown, printed = lines_of(shown), lines_of(printed)
        if LEFT_OUT in shown:
            assert [line for line in shown if line not in (*printed, LEFT_OUT)] == [], command
        else:
            assert shown == printed, command
    assert (folder / FIGURE).stat().st_size > 10_000
    assert (DOCS / "tutorial.png").exists()
    assert "flag" not in (folder / "my_campaign/results/tables/quality.csv").read_text()
    source = folder / "my_campaign/sources/csv.yaml"
    assert yaml.safe_load(source.read_text())["channels"]["torque"]["sign"] == -1
    schema = source.read_text().splitlines()[0].split("=")[1]
    assert (source.parent / schema).exists()
