"""The origin of a campaign's results: what figures, tables and summary say of it."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.files import digest
from osl_analysis.yaml_settings import flat, read_mapping

# facts on the origin of results
ABOUT_MEANING = {
    "campaign": "name of the campaign",
    "data": "simulated or measured",
    "version": "version of osl-analysis",
    "configuration": (
        "first digits of the SHA-256 of the configuration and of the files that it names"
    ),
    "recorded": "date of the data, or what is known in its place",
}
# settings that do not change results, or stand beside the hash
NOT_HASHED = {"raw_data", "sheet", "results", "sources", "failed_trials", "data", "recorded"}
HASH_DIGITS = 8


def about(campaign: Campaign, simulation: Sequence[Path]) -> dict[str, str]:
    """Tell the origin of a campaign's results.

    Parameters
    ----------
    campaign : Campaign
    simulation : Sequence of Path
        The files of its simulation's settings.

    Returns
    -------
    dict
        By `ABOUT_MEANING`. The data are dated by the configuration, else by the seed of the
        simulation, else by the recordings (UTC).
    """
    return {
        "campaign": campaign.config.campaign,
        "data": campaign.data,
        "version": version("osl-analysis"),
        "configuration": hash_of_settings(campaign, simulation),
        "recorded": date_of_data(campaign),
    }


def hash_of_settings(campaign: Campaign, simulation: Sequence[Path]) -> str:
    """First digits of the SHA-256 of the settings that results depend on, with the defaults, and of
    the files that they name."""
    facts = [settings_of(campaign), sorted(str(digest(path)) for path in simulation)]
    text = json.dumps(facts, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:HASH_DIGITS]


def settings_of(campaign: Campaign) -> dict[str, str]:
    """The settings that results depend on, as JSON by dotted name, and the first digits of the
    SHA-256 of files that they name."""
    config = campaign.config
    settings = flat(config.model_dump(mode="json", exclude={*NOT_HASHED, "campaign"}))
    for name in ("parameters", "impedance_trajectory"):
        path = getattr(config, name)
        if path is not None:
            settings[name] = f"{path.name} ({str(digest(path))[:HASH_DIGITS]})"
    return settings


def date_of_data(campaign: Campaign) -> str:
    """When the data were recorded, in words."""
    config = campaign.config
    if config.recorded is not None:
        return f"recorded {config.recorded}"
    if config.simulation is not None:
        return f"made with seed {read_mapping(config.simulation).get('seed')}"
    logs = [path for trial in campaign.trials() for path in campaign.logs(trial) if path.is_file()]
    times = [path.stat().st_mtime for path in logs]
    if not times:
        return "date not known"
    first, last = (datetime.fromtimestamp(end(times), UTC).date() for end in (min, max))
    return f"files of {first}" if first == last else f"files of {first} to {last}"


def sentence(about: Mapping[str, str], below_figure: bool = False) -> str:
    """Say the origin of results (`about`) in a sentence. Below a figure, without the hash of
    settings that it may not even use."""
    made_by = f"osl-analysis {about['version']}"
    if not below_figure:
        made_by += f", configuration {about['configuration']}"
    return (
        f"{about['data'].capitalize()} data: campaign {about['campaign']}, {made_by},"
        f" {about['recorded']}"
    )
