"""What a campaign's results are made of: whether the data are simulated, by which version and configuration, and when.

Every figure, `captions.md`, `summary.json`, `numbers.tex` and `csv-metadata.json` says it. Nothing in it changes from
run to run.
"""

from dataclasses import dataclass

ABOUT_MACROS = {
    "campaign": "Campaign", "data": "Data", "version": "Version", "configuration": "Configuration",
    "recorded": "Recorded",
}  # fmt: skip
"""The LaTeX macros of the fields of `About`, without prefix."""
ABOUT_MEANING = {
    "campaign": "name of the campaign",
    "data": "simulated or measured",
    "version": "version of osl-analysis",
    "configuration": "first digits of the SHA-256 of the configuration and of the files that it names",
    "recorded": "date of the data, or what is known in its place",
}
"""What the fields of `About` are."""


@dataclass(frozen=True)
class About:
    """What results are made of."""

    campaign: str
    """Name of the campaign."""
    data: str
    """`simulated` or `measured`."""
    version: str
    """Version of osl-analysis."""
    configuration: str
    """First digits of the SHA-256 of the configuration, with the files that it names, without the places of files."""
    recorded: str
    """Date of the data, or what is known in its place."""

    def sentence(self) -> str:
        """All of it in one line."""
        return (
            f"{self.data.capitalize()} data: campaign {self.campaign}, osl-analysis {self.version}, configuration "
            f"{self.configuration}, {self.recorded}"
        )
