"""The state of each setting that judges or labels results: stated, measured, assumed or none.

What nobody stated neither judges nor labels a recording in silence: the page tells what is assumed.
"""

import json
from collections.abc import Collection, Mapping
from typing import Any

from osl_analysis.campaign.configuration import Config
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.files import root

# Settings of the stepped sine, and the columns of `response.csv` with the recorded values, used if
# none is stated.
MEASURED_COLUMNS = {
    "dynamometer.amplitudes_deg": "amplitude_deg",
    "dynamometer.frequencies_hz": "frequency_hz",
}
# the experiments whose fit takes settings of the section `dynamometer`
FITTED_ON_DYNAMOMETER = tuple(
    name
    for name, facts in EXPERIMENTS.items()
    if facts.fit and any(section == "dynamometer" for section, _ in facts.fit.settings.values())
)
# Settings that are facts on a bench, device, laboratory or text, and filters and windows; each with
# the experiments that it judges, labels or enters. All others are choices of the analysis.
EXPERIMENTS_BY_SETTING: dict[str, tuple[str, ...]] = {
    "dynamometer.cutoff_hz": FITTED_ON_DYNAMOMETER,
    "actuator.cutoff_hz": ("actuator",),
    "torque_angle.cutoff_hz": ("torque_angle",),
    "parameters": ("belt", "transmission", "actuator", "impedance"),
    "gain_weight": ("impedance",),
    "dynamometer.amplitudes_deg": ("transmission", "impedance"),
    "dynamometer.frequencies_hz": ("transmission", "impedance"),
    "dynamometer.cycles": ("transmission", "impedance"),
    "dynamometer.load_cell_drift": ("belt",),
    "dynamometer.calibration": FITTED_ON_DYNAMOMETER,
    "dynamometer.bench_stiffness": FITTED_ON_DYNAMOMETER,
    "dynamometer.fixture": FITTED_ON_DYNAMOMETER,
    "dynamometer.windows": ("impedance",),
    "actuator.calibration": ("actuator",),
    "torque_angle.zero": ("torque_angle",),
    "torque_angle.calibration": ("torque_angle",),
    "torque_angle.bench_stiffness": ("torque_angle",),
    "torque_angle.fixture": ("torque_angle",),
    "claims.K_percent": ("impedance", "walking"),
    "impedance_trajectory": ("walking",),
    "figures.midstance_stiffness": ("walking",),
    "walking.side": ("walking",),
    "walking.plate": ("walking",),
    "walking.markers": ("walking",),
    "walking.cutoff_hz": ("walking",),
    "walking.window_s": ("walking",),
    "walking.baseline_s": ("walking",),
    "walking.guard_s": ("walking",),
}
USED_FOR_NULL = {"torque_angle.zero": "end"}  # values used for null


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
        measured (each recording has its stated), assumed (the default), or none.
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
    if name in MEASURED_COLUMNS:
        return "measured"
    return "assumed" if name in USED_FOR_NULL else "none"


def shown_value(name: str, value: Any, state: str) -> str | None:
    """A setting as text; a shipped file is shown without its folder."""
    if is_empty(value):
        value = USED_FOR_NULL.get(name)
    if value is None or state == "none":
        return None
    return json.dumps(value).strip('"').removeprefix(f"{root()}/")
