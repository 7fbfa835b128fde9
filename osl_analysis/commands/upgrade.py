"""`osl-analysis doctor --upgrade`: make a campaign of an earlier release one of this."""

from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from osl_analysis.campaign.configuration import read_config
from osl_analysis.errors import Removal, RemovedFieldError
from osl_analysis.files import atomic_path
from osl_analysis.yaml_settings import dotted


def upgraded_fields(path: Path) -> Iterator[str]:
    """Rename the fields of a configuration that have another name in this release, and remove those
    that are gone, until there is none. Comments and order of the file stay.

    Parameters
    ----------
    path : Path
        Configuration of the campaign.

    Yields
    ------
    str
        What was written for each field, and what to use instead of one that is gone.

    Raises
    ------
    InputError
        The configuration has another mistake, which only its author can correct.
    """
    while True:
        try:
            read_config(path)
        except RemovedFieldError as error:
            removal = error.removal
            rewrite_field(path, removal)
            field = dotted(removal.place)
            if removal.new_name:
                yield f"{field}: renamed to {removal.new_name}"
            else:
                yield f"{field}: removed; {removal.instead}"
        else:
            return


def rewrite_field(path: Path, removal: Removal) -> None:
    """Rename one field in a file, or remove it with the sections above it that it leaves empty."""
    round_trip = YAML()
    round_trip.preserve_quotes = True
    round_trip.width = 1000  # no line is wrapped
    # `null` stays a word; ruamel would write nothing in its place
    round_trip.representer.add_representer(type(None), written_null)
    content = round_trip.load(path.read_text(encoding="utf-8-sig"))

    *above, name = removal.place
    sections: list[MutableMapping[Any, Any]] = [content]
    for key in above:
        sections.append(sections[-1][key])
    value = sections[-1].pop(name)
    if removal.new_name:
        sections[-1][removal.new_name] = value
    while above and not sections[-1]:
        sections.pop()
        del sections[-1][above.pop()]

    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        round_trip.dump(content, file)


def written_null(representer: Any, _value: None) -> Any:
    """`null` as YAML has it."""
    return representer.represent_scalar("tag:yaml.org,2002:null", "null")
