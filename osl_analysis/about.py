"""What a campaign's results are made of: whether the data are simulated, by which version and configuration, and when.

Every figure, `captions.md`, `summary.json`, `numbers.tex` and `csv-metadata.json` says it. Nothing in it changes from
run to run.
"""

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from osl_analysis.campaign import Campaign
from osl_analysis.files import digest
from osl_analysis.yaml_settings import read_mapping

ABOUT_MEANING = {
    "campaign": "name of the campaign",
    "data": "simulated or measured",
    "version": "version of osl-analysis",
    "configuration": "first digits of the SHA-256 of the configuration and of the files that it names",
    "recorded": "date of the data, or what is known in its place",
}
"""What the fields of `About` are."""
ABOUT_MACROS = {name: name.capitalize() for name in ABOUT_MEANING}
"""Their LaTeX macros, without prefix."""


@dataclass(frozen=True)
class About:
    """What results are made of: the fields are those of `ABOUT_MEANING`."""

    campaign: str
    data: str
    version: str
    configuration: str
    recorded: str

    def of_figure(self) -> str:
        """The line below a figure but for its numbers: a configuration that it does not use does not draw it anew."""
        return f"{self.data.capitalize()} data: campaign {self.campaign}, osl-analysis {self.version}, {self.recorded}"

    def sentence(self) -> str:
        return (
            f"{self.data.capitalize()} data: campaign {self.campaign}, osl-analysis {self.version}, configuration "
            f"{self.configuration}, {self.recorded}"
        )


def about(campaign: Campaign, simulation: list[Path]) -> About:
    """What the results of a campaign are made of; `simulation` are the files of its simulation's settings."""
    config = campaign.config
    files = {path for path in (config.parameters, config.impedance_trajectory, *simulation) if path is not None}
    # these say where files are, how a run ends, or what stands beside the hash: others give the same results
    places = {"raw_data", "sheet", "results", "sources", "failed_trials", "data", "recorded"}
    settings = config.model_dump(mode="json", exclude=places)  # with the defaults
    text = json.dumps([settings, sorted(str(digest(path)) for path in files)], sort_keys=True)
    configuration = hashlib.sha256(text.encode()).hexdigest()[:8]
    return About(config.campaign, campaign.data, version("osl-analysis"), configuration, date_of(campaign))


def date_of(campaign: Campaign) -> str:
    """When the data were recorded: as the configuration states it, else the seed of the simulation, else the dates of
    the recordings' files (UTC)."""
    config = campaign.config
    if config.recorded is not None:
        return f"recorded {config.recorded}"
    if config.simulation is not None:
        return f"made with seed {read_mapping(config.simulation).get('seed')}"
    files = {path for trial in campaign.trials() for path in campaign.logs(trial) if path.is_file()}
    days = sorted({datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat() for path in files})
    if not days:
        return "date not known"
    return f"files of {days[0]}" if len(days) == 1 else f"files of {days[0]} to {days[-1]}"
