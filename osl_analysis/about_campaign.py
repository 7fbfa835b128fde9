"""What the results of a campaign are made of (`about.py`), from its configuration and the files that it names."""

import hashlib
import json
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from osl_analysis.about import About
from osl_analysis.campaign import Campaign
from osl_analysis.config import Config
from osl_analysis.files import digest
from osl_analysis.yaml_settings import read_mapping

PLACES = {"raw_data", "sheet", "results", "sources", "failed_trials", "data", "recorded"}
"""Settings that say where files are, how a run ends, or what stands beside the hash: others give the same results."""
DIGITS = 8
"""Hexadecimal digits of the configuration's hash that are written."""


def about(campaign: Campaign, simulation: list[Path]) -> About:
    """What the results of a campaign are made of; `simulation` are the files of its simulation's settings."""
    config = campaign.config
    named = [path for path in (config.parameters, config.impedance_trajectory) if path is not None]
    return About(
        campaign=config.campaign,
        data=campaign.data,
        version=version("osl-analysis"),
        configuration=configuration_hash(config, [*named, *simulation]),
        recorded=date_of(campaign),
    )


def configuration_hash(config: Config, files: list[Path]) -> str:
    """First digits of the SHA-256 of the settings, defaults included, and of the content of these files."""
    settings = config.model_dump(mode="json", exclude=PLACES)
    text = json.dumps([settings, sorted(str(digest(path)) for path in set(files))], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


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
