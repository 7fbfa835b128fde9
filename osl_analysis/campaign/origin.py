# SPDX-License-Identifier: Apache-2.0
"""Say where a campaign's results come from, and which settings are stated, assumed or none.

A setting that nobody stated may judge or label a recording only if the page says that it is
assumed.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.base.files import DISTRIBUTION, ROOT, package_yaml
from osl_analysis.base.yaml_settings import flat, read_mapping
from osl_analysis.campaign.campaign_trials import Campaign, code, code_version, digest_of, values_in
from osl_analysis.campaign.configuration import LIMIT_BY_WEIGHT, Config
from osl_analysis.judge.checks import SHIPPED_QUALITY
from osl_analysis.judge.limits import SHIPPED_DOUBTFUL

# facts on the origin of results
ABOUT_MEANING = {
    "campaign": "name of the campaign",
    "data": "simulated or measured",
    "version": f"version of {DISTRIBUTION}",
    "configuration": (
        "first digits of the SHA-256 of all that is stated: configuration, sheet, source files and"
        " the files that they name, by their values"
    ),
    "recorded": "date of the data, or what is known in its place",
    "digest": (
        "first digits of the SHA-256 of all that decides: what is stated, recordings, code and"
        " libraries"
    ),
}
# settings that do not change results, or stand beside the hash
NOT_HASHED = {
    "campaign",
    "raw_data",
    "sheet",
    "results",
    "sources",
    "failed_trials",
    "data",
    "recorded",
}
# experiments that a setting judges, labels or enters
EXPERIMENTS_BY_SETTING: dict[str, list[str]] = package_yaml(
    Path(__file__).with_name("setting_states.yaml")
)


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
        By `ABOUT_MEANING`, without the digest, for which recordings must be read.
    """
    return {
        "campaign": campaign.config.campaign,
        "data": campaign.data,
        "version": code_version(),
        "configuration": digest_of(stated_digests(campaign, simulation)),
        "recorded": date_of_data(campaign),
    }


def made_by(campaign: Campaign) -> dict[str, str]:
    """What makes the results: the version of the package, the digest of its code; and whether the
    data are simulated."""
    return {"version": code_version(), "code": code(), "data": campaign.data}


def settings_of(campaign: Campaign) -> dict[str, str]:
    """The settings that results depend on, as JSON by dotted name, and the first digits of the
    digest of files that they name."""
    config = campaign.config
    settings = flat(config.model_dump(mode="json", exclude=NOT_HASHED))
    for name in ("parameters", "impedance_trajectory", "claims"):
        path = getattr(config, name)
        if path is not None:
            settings[name] = f"{path.name} ({digest_of(values_in(path))})"
    return settings


def stated_digests(campaign: Campaign, simulation: Sequence[Path]) -> dict[str, str | None]:
    """The digests of what is stated, by its values."""
    digests: dict[str, str | None] = {
        "configuration": digest_of(settings_of(campaign)),
        "sheet": digest_of(campaign.sheet),
    }
    for path, text in campaign.source_digests.items():
        digests[f"source {path.stem}"] = text
    for path in simulation:
        digests[f"simulation {path.name}"] = digest_of(values_in(path))
    return digests


def date_of_data(campaign: Campaign) -> str:
    """When the data were recorded, in words."""
    config = campaign.config
    if config.recorded is not None:
        return f"recorded {config.recorded}"
    if config.simulation is not None:
        return f"made with seed {read_mapping(config.simulation).get('seed')}"
    return "date not stated"


def sentence(about: Mapping[str, str], below_figure: bool = False) -> str:
    """Say the origin of results (`about`) in a sentence. Below a figure it is short, and without
    the hash of settings that the figure may not even use."""
    made_by = f"{DISTRIBUTION} {about['version']}"
    data = about["data"].capitalize()
    if below_figure:
        return f"{data}: {about['campaign']}, {made_by}, {about['recorded']}"
    made_by += f", configuration {about['configuration']}"
    if "digest" in about:
        made_by += f", digest {about['digest']}"
    return f"{data} data: campaign {about['campaign']}, {made_by}, {about['recorded']}"


# Which settings are stated, and which decide otherwise than the defaults


def changed_settings(campaign: Campaign) -> list[dict[str, Any]]:
    """What decides verdicts and differs from the shipped defaults, which may be edited in a clone:
    `setting`, `value`, `default` and `state`."""
    config = campaign.config
    current = flat(config.model_dump(mode="json", include={"doubtful", "quality"}))
    defaults = flat({"doubtful": SHIPPED_DOUBTFUL, "quality": SHIPPED_QUALITY})
    if config.simulation is None:
        defaults.update(flat(LIMIT_BY_WEIGHT))
    settings = [
        (name, current.get(name), defaults.get(name)) for name in sorted({*current, *defaults})
    ]
    for column in ("accept", "exclude"):
        for trial, row in campaign.sheet.items():
            settings.append((f"{column} of {trial}", row[column], None))
    return [
        {"setting": name, "value": value, "default": default, "state": "changed"}
        for name, value, default in settings
        if value != default and {value, default} - {None, "", "{}"}
    ]


def named_in(settings: Any, name: str) -> Any:
    """A setting of nested mappings by its dotted name; None if there is none."""
    value = settings
    for key in name.split("."):
        value = (value or {}).get(key)
    return value


def states_of(
    config: Config, campaign_settings: Mapping[str, Any], experiments: Collection[str]
) -> list[dict[str, Any]]:
    """Find value and state of every setting that judges or labels some experiments.

    Parameters
    ----------
    config : Config
    campaign_settings : Mapping
        The fields that the campaign's file states.
    experiments : Collection of str

    Returns
    -------
    list of dict
        `setting`, `value` as JSON, and `state`: stated (by the configuration or its simulation),
        assumed (the default), or none: where one is needed, each recording has its own.
    """
    settings = config.model_dump(mode="json")
    rows = []
    for name, judged in EXPERIMENTS_BY_SETTING.items():
        if not set(judged) & set(experiments):
            continue
        value = named_in(settings, name)
        is_stated = config.simulation is not None or named_in(campaign_settings, name) is not None
        is_empty = isinstance(value, dict) and not any(value.values())
        is_unused = name == "gain_weight" and config.parameters is None and not is_stated
        if is_empty or is_unused:
            value = None
        state = "none" if value is None else "stated" if is_stated else "assumed"
        # a shipped file is shown without its folder
        shown = json.dumps(value).strip('"').removeprefix(f"{ROOT}/")
        rows.append({"setting": name, "value": None if value is None else shown, "state": state})
    return rows
