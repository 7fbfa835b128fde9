"""The configuration of a campaign: choices with their units, validated when they are read."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis, ModelComparison
from osl_analysis.doubtful import DoubtfulFits
from osl_analysis.errors import InputError
from osl_analysis.model.admittance_error import FASTEST_HZ, HIGHEST_ORDER, SLOWEST_HZ, Weight
from osl_analysis.quality.settings import QualityRules
from osl_analysis.walking.settings import OvergroundAnalysis, WalkingAnalysis
from osl_analysis.yaml_settings import Model, Positive, Settings, read_mapping, validated


class WeightSettings(Settings):
    """W of Eq. 14, with which the laboratory selected its gains: Butterworth cut-off [Hz] and order."""

    cutoff_hz: Annotated[float, Field(ge=SLOWEST_HZ, le=FASTEST_HZ)]
    order: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)]

    @property
    def weight(self) -> Weight:
        """W itself."""
        return Weight(self.cutoff_hz, self.order)


class TimeSeriesFigure(Settings):
    """The trial of Fig. 4, and how many seconds of which amplitude [deg]."""

    K_d: Positive
    B_d: Annotated[float, Field(ge=0)]
    controller: Literal["compensated", "uncompensated"]
    amplitude_deg: Positive
    duration_s: Positive


class FrequencyResponseFigure(Settings):
    """The pair of trials of Fig. 7."""

    K_d: Positive
    B_d: Annotated[float, Field(ge=0)]


class FigureChoices(Settings):
    """What Figs. 4, 7 and 9 show, null for none; `midstance_stiffness` [N*m/rad] is the command marked in Fig. 9."""

    time_series: TimeSeriesFigure | None
    frequency_response: FrequencyResponseFigure | None
    midstance_stiffness: Positive | None


class StudySettings(Settings):
    """The Monte Carlo study of the estimators: what is simulated, how often, and in which jobs.

    Bench trials of the study have a short protocol of their own, at the frequencies of `dynamometer`.
    """

    simulation: Path
    """Settings of the simulated campaign."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of every random number."""
    trials: Annotated[int, Field(ge=2)]
    """Number of trials of each bench experiment."""
    campaigns: Annotated[int, Field(ge=0)]
    """Number of campaigns of walking."""
    recorded: Annotated[int, Field(ge=0)]
    """Number of campaigns of walking that go through recorded files."""
    crossings: Annotated[int, Field(ge=3)]
    """Number of perturbed crossings in a campaign, and of unperturbed ones."""
    batch: Annotated[int, Field(ge=1)]
    """Number of bench trials in a job."""
    amplitudes_deg: Annotated[tuple[Positive, ...], Field(min_length=1)]
    """Amplitudes [deg] of the short protocol."""
    cycles: Annotated[int, Field(ge=1)]
    """Cycles at each frequency of the short protocol."""
    K_d: Positive
    """Desired stiffness [N*m/rad]."""
    B_d: Annotated[float, Field(ge=0)]
    """Desired damping [N*m*s/rad]."""
    I: Annotated[float, Field(ge=0)]
    """Inertia [kg*m^2] of the second-order joint."""


class Config(Settings):
    """One campaign. Paths are relative to the folder in which the pipeline runs; see `config/config.yaml`."""

    RENAMED: ClassVar = {"gait": "overground", "validation": "study"}

    campaign: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
    raw_data: Path
    sheet: Path
    results: Path
    simulation: Path | None
    parameters: Path
    sources: Path
    dynamometer: DynamometerAnalysis
    actuator: ActuatorAnalysis
    doubtful: DoubtfulFits
    model_comparison: ModelComparison
    impedance_trajectory: Path | None
    gain_weight: WeightSettings
    walking: WalkingAnalysis
    overground: OvergroundAnalysis
    quality: QualityRules
    figures: FigureChoices
    study: StudySettings


def read_section(path: Path, section: str, model: type[Model]) -> Model:
    """One section of a configuration file.

    Raises
    ------
    InputError
        The file is missing or has no such section, or a field is not valid.
    """
    content = read_mapping(path)
    if section not in content:
        raise InputError(f"{path}: no section '{section}'; give a configuration like config/config.yaml")
    return validated(content[section], model, path)


def campaign_config(content: Any, files: str) -> Config:
    """Validate a merged configuration; `files` names where it came from, for messages.

    Raises
    ------
    InputError
        A field is unknown, missing or of a wrong value.
    """
    return validated(content, Config, Path(files))
