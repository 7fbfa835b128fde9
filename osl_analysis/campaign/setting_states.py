"""The state of each setting that judges or labels results: stated, assumed or none.

What nobody stated neither judges nor labels a recording in silence: the page tells what is assumed.
"""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from osl_analysis.campaign.configuration import Config
from osl_analysis.files import own_yaml, root

# experiments that a setting judges, labels or enters
EXPERIMENTS_BY_SETTING: dict[str, list[str]] = own_yaml(Path(__file__).with_suffix(".yaml"))


def named_in(settings: Any, name: str) -> Any:
    """A setting of nested mappings by its dotted name; None if there is none."""
    value = settings
    for key in name.split("."):
        value = (value or {}).get(key)
    return value


def states_of(
    config: Config, stated: Mapping[str, Any], experiments: Collection[str]
) -> list[dict[str, Any]]:
    """Find value and state of every setting that judges or labels some experiments.

    Parameters
    ----------
    config : Config
    stated : Mapping
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
        state = state_of(name, value, config, stated)
        rows.append({"setting": name, "value": shown_value(name, value, state), "state": state})
    return rows


def is_empty(value: Any) -> bool:
    """Whether a setting is null, or a mapping of nothing but that."""
    return not any(value.values()) if isinstance(value, dict) else value is None


def state_of(name: str, value: Any, config: Config, stated: Mapping[str, Any]) -> str:
    """State of a setting, as `states_of` names it."""
    if config.simulation is not None or named_in(stated, name) is not None:
        return "stated"
    is_unused = name == "gain_weight" and config.parameters is None
    if not is_empty(value) and not is_unused:
        return "assumed"
    return "none"


def shown_value(name: str, value: Any, state: str) -> str | None:
    """A setting as text; a shipped file is shown without its folder."""
    if is_empty(value) or state == "none":
        return None
    return json.dumps(value).strip('"').removeprefix(f"{root()}/")
