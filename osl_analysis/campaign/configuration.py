# SPDX-License-Identifier: Apache-2.0
"""The configuration of a campaign: choices with units, validated when they are read."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, Field

from osl_analysis.base.errors import InputError, on_one_line
from osl_analysis.base.files import CAMPAIGN, ROOT, default_config, package_yaml, shipped
from osl_analysis.base.yaml_settings import (
    FILE_NAME,
    NOT_YAML,
    Settings,
    ShippedPath,
    Stiffness,
    flat,
    located,
    read_mapping,
    refuse_if,
    validated,
)
from osl_analysis.bench.bench_settings import (
    ActuatorAnalysis,
    DynamometerAnalysis,
    TorqueAngleAnalysis,
)
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.recording_checks import QualityRules
from osl_analysis.model.compensator import Weight
from osl_analysis.walking.walking_settings import WalkingAnalysis


class FrequencyResponseFigure(Settings):
    """A desired impedance: Fig. 7 shows all trials that have it."""

    K_d: Stiffness | None = None  # Desired stiffness [N*m/rad]; null: of trials without one.
    # Desired damping [N*m*s/rad]; null: of trials without one.
    B_d: Annotated[float, Field(ge=0)] | None = None


class TimeSeriesFigure(FrequencyResponseFigure):
    """The trial that Fig. 4 shows: the first one with this controller and desired impedance."""

    controller: str | None = None  # Controller of the trial; null: a trial without one.


class FigureChoices(Settings):
    """What the figures show. What is null, or of the default campaign alone, is chosen from the
    data, which is said."""

    time_series: TimeSeriesFigure | None = None
    """The trial of Fig. 4, whose estimates are headline numbers too; null: the first trial."""
    frequency_response: FrequencyResponseFigure | None = None
    """The desired impedance of Fig. 7; null: the one with the most trials."""
    midstance_stiffness: Stiffness | None
    """Stiffness that the walking controller commands in midstance [N*m/rad], marked in Fig. 9 where
    the sheet states no K_d and the campaign has one group; null: no mark."""
    footer: bool = True
    """Whether a small line below each figure says what its data are, as its metadata always do."""


class SharedChoices(Settings):
    """The choices of a configuration that replace those of its simulation. Null: the simulation's
    own."""

    parameters: Path | None = None  # Parameter file of the device.
    gain_weight: Weight | None = None  # W with which the simulated leg's gains are selected.
    protocol: dict[str, Any] | None = None  # The stepped sine, as fields of a simulated schedule.
    # The impedance that the leg is asked to render over the gait cycle.
    impedance_trajectory: Path | None = None


class Config(Settings):
    """One campaign, as in `config/config.yaml`. Paths are relative to the folder in which the
    pipeline runs. A file that is not there may be a shipped one, such as
    `config/parameters/default.yaml`."""

    # Name of the campaign, as written in its summary.
    campaign: Annotated[str, Field(pattern=FILE_NAME)]
    raw_data: Path  # Folder of the recordings.
    sheet: Path  # The sample sheet.
    results: Path  # Folder of the results.
    # Settings of the simulator that makes the recordings; null: they are real.
    simulation: ShippedPath | None
    data: Literal["simulated", "measured"] | None = None
    """What the recordings are, as figures, tables and summary say; null: simulated where the
    simulator made them."""
    recorded: date | Annotated[str, Field(max_length=40), AfterValidator(on_one_line)] | None = None
    """When the recordings were made, as the figures say, such as 2026-03-14; null: not stated."""
    parameters: ShippedPath | None
    """Parameter file of the device; null: none, it is analysed without predictions and without
    ratios to a file."""
    sources: ShippedPath  # Folder of the source files.
    dynamometer: DynamometerAnalysis  # Analysis of the trials on the dynamometer.
    actuator: ActuatorAnalysis  # Analysis of the trials on the actuator's own bench.
    torque_angle: TorqueAngleAnalysis  # Analysis of the trials of torque against angle.
    doubtful: DoubtfulFits  # Limits beyond which a fit is doubtful, by table.
    claims: ShippedPath | None  # File of what the text claims, with margins; null: none.
    impedance_trajectory: ShippedPath | None
    """CSV file of the impedance over the gait cycle, for Fig. 8; null: no Fig. 8."""
    gain_weight: Weight  # W of Eq. 14.
    walking: WalkingAnalysis  # Analysis of the crossings.
    failed_trials: Literal["refuse", "accept"]
    """Whether a run in which something was refused, or failed, ends with exit code 1 or 0."""
    quality: QualityRules  # Thresholds of quality control.
    figures: FigureChoices  # What the figures show.

    _is_simulated = refuse_if(
        lambda s: s.simulation and s.data == "measured",
        "data = measured, but the recordings are those of `simulation`; write data: null, or"
        " simulation: null",
        "data",
    )
    _one_plate = refuse_if(
        lambda s: s.simulation and s.walking.plate != 1,
        "walking.plate = {s.walking.plate}: the simulated laboratory has one force plate; write 1",
        "walking.plate",
    )

    def shared(self, names: Collection[str] = tuple(SharedChoices.model_fields)) -> SharedChoices:
        """The choices that the simulator follows, or those of them that are named."""
        choices = self.model_dump(include={*names})
        sine = {"amplitudes_deg", "frequencies_hz", "cycles"}
        protocol = self.dynamometer.model_dump(include=sine)
        if "protocol" in names and all(protocol.values()):
            choices["protocol"] = protocol
        return SharedChoices.model_validate(choices)


def overriding(base: Any, override: Any) -> Any:
    """Replace fields of a nested mapping by those of another, as `snakemake --configfile` merges
    them."""
    if not isinstance(base, dict) or not isinstance(override, dict):
        return override
    replaced = {name: overriding(base.get(name), value) for name, value in override.items()}
    return {**base, **replaced}


# the facts that the default configuration states on its own bench, device and text, and on no other
FACTS_OF_DEFAULT = {
    "parameters": None,
    "impedance_trajectory": None,
    "dynamometer": {"amplitudes_deg": None, "frequencies_hz": None, "cycles": None},
    "figures": {"midstance_stiffness": None},
    "claims": None,
    "torque_angle": {"zero": None},
}
# the damping that gains should give depends on a weight that only its device has
LIMIT_BY_WEIGHT = {"doubtful": {"impedance": {"above": {"B_gap_s": None}}}}


def over_default(campaign_settings: Mapping[str, Any]) -> Any:
    """Replace fields of the default configuration by those of another.

    Real recordings are not from the bench of the default campaign: for them, `FACTS_OF_DEFAULT`
    that are not stated are null.
    """
    path = default_config()
    # the shipped file is the same for both readers, and the one in C takes 2 ms for 30
    default = package_yaml(path) if path.is_relative_to(ROOT) else read_mapping(path)
    is_simulated = campaign_settings.get("simulation", default["simulation"]) is not None
    if default["simulation"] is not None and not is_simulated:
        default = overriding(default, FACTS_OF_DEFAULT)
        if campaign_settings.get("gain_weight") is None:
            default = overriding(default, LIMIT_BY_WEIGHT)
    return overriding(default, campaign_settings)


def read_campaign_file(path: Path) -> dict[str, Any]:
    """The fields of a configuration. Raises InputError: Snakemake, which reads YAML 1.1, takes a
    value for another one."""
    content = read_mapping(path)
    try:
        by_snakemake = flat(yaml.safe_load(path.read_text(encoding="utf-8-sig")))
    except NOT_YAML as error:
        raise InputError(
            f"{path}: Snakemake cannot read it ({on_one_line(error)})",
            "write a name before each `:`",
        ) from error
    for name, value in flat(content).items():
        # of a text as 1e3, fields of numbers make the number
        read = by_snakemake.get(name, "")
        if read != value and not read.startswith('"'):
            raise InputError(
                f"{path}: {located([path], tuple(name.split('.')))}{name}: Snakemake reads"
                " another value",
                "write a plain decimal number, true or false, or text in quotes",
            )
    return content


OF_CONFIG = "of the configuration"  # stands for the parameter file that the configuration names


def config_for_trials(
    path: Path | str | None = None, parameters: Path | str | None = OF_CONFIG
) -> Config:
    """The configuration by which single trials are analysed, from a file that overrides some fields
    of the default, by default that of the working folder; the shipped default states no facts on
    recordings of others. It names the stated parameter file of the device, if any."""
    default = default_config()
    campaign_file = CAMPAIGN if CAMPAIGN.is_file() else default
    config_path = Path(path or campaign_file)
    local_files = tuple(Path("config").rglob("*"))  # each stands for the shipped one of its name
    contents = [file.read_bytes() for file in (default, config_path) if file.is_file()]
    config = config_of_state(config_path, (Path.cwd(), local_files, *contents))
    if parameters == OF_CONFIG:
        return config
    device = None if parameters is None else shipped(parameters)
    return config.model_copy(update={"parameters": device})


# to validate it takes 9 ms, and a notebook fits many trials
@lru_cache(maxsize=8)
def config_of_state(path: Path, state: Hashable) -> Config:
    """What `config_for_trials` gives while the `state` of the files is the same."""
    is_shipped = path == default_config() and path.is_relative_to(ROOT)
    campaign_settings = {"simulation": None} if is_shipped else read_campaign_file(path)
    return validated(over_default(campaign_settings), Config, path, (default_config(), path))


def read_config(path: Path) -> Config:
    """Read a whole configuration, from a file that overrides some fields of the default."""
    return validated(over_default(read_campaign_file(path)), Config, path)


def campaign_config(content: Any, files: Sequence[Path]) -> Config:
    """Validate a configuration that Snakemake merged from files. Later files override earlier
    ones."""
    for file in files:
        read_campaign_file(file)
    return validated(content, Config, Path(" overridden by ".join(map(str, files))), files)
