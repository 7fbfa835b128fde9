"""The configuration of a campaign: choices with units, validated when they are read."""

import json
from collections.abc import Collection, Mapping, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from osl_analysis.bench.bench_settings import (
    ActuatorAnalysis,
    DynamometerAnalysis,
    ModelComparison,
    TorqueAngleAnalysis,
)
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.shared_choices import SharedChoices
from osl_analysis.errors import InputError
from osl_analysis.files import default_config, root
from osl_analysis.judge.claims import Claims
from osl_analysis.judge.limits import DoubtfulFits, QualityRules
from osl_analysis.model.compensator import Weight
from osl_analysis.walking.walking_settings import OvergroundAnalysis, WalkingAnalysis
from osl_analysis.yaml_settings import (
    AnySettings,
    Degrees,
    Settings,
    ShippedPath,
    Stiffness,
    check_rising,
    read_mapping,
    refuse_if,
    validated,
)

EARLIEST_DATE = date(1990, 1, 1)


def dates(value: date | str) -> date | str:
    """Check one date, or the first and the last, as `2026-03-14 to 2026-03-16`."""
    try:
        text = value if isinstance(value, str) else value.isoformat()
        days = [date.fromisoformat(day) for day in text.split(" to ")]
        # tomorrow it is already today elsewhere
        check_rising((EARLIEST_DATE - timedelta(1), *days, date.today() + timedelta(2)))
    except (ValueError, AttributeError) as error:
        raise ValueError(
            "write a date, 1990 to today, as 2026-03-14, or two, as 2026-03-14 to 2026-03-16"
        ) from error
    return value


class FrequencyResponseFigure(Settings):
    """A desired impedance: Fig. 7 shows all trials that have it."""

    K_d: Stiffness | None = None  # Desired stiffness [N*m/rad]; null: of trials without one.
    # Desired damping [N*m*s/rad]; null: of trials without one.
    B_d: Annotated[float, Field(ge=0)] | None = None


class TimeSeriesFigure(FrequencyResponseFigure):
    """The part of a trial that Fig. 4 shows: the first one with this controller and desired
    impedance."""

    controller: str | None = None  # Controller of the trial; null: a trial without one.
    amplitude_deg: Degrees | None = None  # Amplitude of the sines [deg]; null: the largest.
    # Length of the part [s], which ends with that block.
    duration_s: Annotated[float, Field(gt=0, le=3600)] = 10.0


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
    stance_share: Annotated[float, Field(gt=0, le=1)] = 0.62
    """Share of the gait cycle that is stance, for the phase of `impedance_trajectory`; Fig. 8 ends
    there."""
    footer: bool = True
    """Whether a small line below each figure says what its data are, as its metadata always do."""


class ReportChoices(Settings):
    """The page `report.html` of a run."""

    REMOVED: ClassVar = {"largest_mb": "the page is never thinned out; remove the line"}

    beside_draft: bool | None = None
    """Whether the paper's draft stands beside the campaign's numbers; null: if it simulates the
    draft's device."""


class Config(Settings):
    """One campaign, as in `config/config.yaml`. Paths are relative to the folder in which the
    pipeline runs. A file that is not there may be a shipped one, such as
    `config/parameters/default.yaml`."""

    # Name of the campaign, as written in its summary.
    campaign: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
    raw_data: Path  # Folder of the recordings.
    sheet: Path  # The sample sheet.
    results: Path  # Folder of the results.
    # Settings of the simulator that makes the recordings; null: they are real.
    simulation: ShippedPath | None
    data: Literal["simulated", "measured"] | None = None
    """What the recordings are, as figures, tables and summary say; null: simulated where the
    simulator made them."""
    recorded: Annotated[date | str, BeforeValidator(dates)] | None = None
    """Date of the recordings, as the figures say, such as 2026-03-14; null: the dates of the
    files."""
    parameters: ShippedPath | None
    """Parameter file of the device; null: none, it is analysed without predictions and without
    ratios to a file."""
    sources: ShippedPath  # Folder of the source files.
    dynamometer: DynamometerAnalysis  # Analysis of the trials on the dynamometer.
    actuator: ActuatorAnalysis  # Analysis of the trials on the actuator's own bench.
    torque_angle: TorqueAngleAnalysis  # Analysis of the trials of torque against angle.
    doubtful: DoubtfulFits  # Limits beyond which a fit is doubtful, by table.
    model_comparison: ModelComparison  # Models of the drivetrain beside what was recorded.
    claims: Claims  # What the paper's text claims, and the margins of its verdicts.
    impedance_trajectory: ShippedPath | None
    """CSV file of the impedance over the gait cycle, for Fig. 8; null: no Fig. 8."""
    gain_weight: Weight  # W of Eq. 14.
    walking: WalkingAnalysis  # Analysis of the crossings.
    overground: OvergroundAnalysis  # Comparison of the ankle moment in overground gait.
    failed_trials: Literal["refuse", "accept"]
    """Whether a run in which something was refused, or failed, ends with exit code 1 or 0."""
    quality: QualityRules  # Thresholds of quality control.
    figures: FigureChoices  # What the figures show.
    report: ReportChoices = ReportChoices()  # The page `report.html`.
    REMOVED: ClassVar = {
        "study": "the Monte Carlo study is a script, benchmarks/study.py; remove the section"
    }

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

    def shared(self, experiment: str | None = None) -> SharedChoices:
        """The choices that the simulator follows in the trials of one experiment, or in all
        (None)."""
        dynamometer = self.dynamometer
        protocol = None
        if dynamometer.amplitudes_deg and dynamometer.frequencies_hz:
            seconds = dynamometer.seconds_per_frequency
            protocol = {
                "amplitudes_deg": dynamometer.amplitudes_deg,
                "frequencies_hz": dynamometer.frequencies_hz,
                "cycles": dynamometer.cycles if seconds is None else None,
                "seconds": seconds,
            }
        choices = {
            "parameters": self.parameters,
            "gain_weight": self.gain_weight,
            "protocol": protocol,
            "impedance_trajectory": self.impedance_trajectory,
        }
        used = choices if experiment is None else EXPERIMENTS[experiment].follows
        return SharedChoices.model_validate({name: choices[name] for name in used})


def overriding(base: Any, override: Any) -> Any:
    """Replace fields of a nested mapping by those of another, as `snakemake --configfile` merges
    them."""
    if not isinstance(base, dict) or not isinstance(override, dict):
        return override
    replaced = {name: overriding(base.get(name), value) for name, value in override.items()}
    return {**base, **replaced}


# Settings in which the default configuration states facts on its own bench, device and text, and on
# no other.
FACTS = (
    "parameters", "impedance_trajectory", "dynamometer.amplitudes_deg",
    "dynamometer.frequencies_hz", "dynamometer.cycles", "figures.time_series.amplitude_deg",
    "figures.midstance_stiffness", "claims.K_percent", "torque_angle.zero",
)  # fmt: skip
# Settings of the stepped sine, and the columns of `phasors.csv` with the recorded values, used if
# none is stated.
FOUND = {
    "dynamometer.amplitudes_deg": "amplitude_deg",
    "dynamometer.frequencies_hz": "frequency_hz",
}
# the experiments whose fit takes settings of the section `dynamometer`
OF_BENCH = tuple(
    name
    for name, facts in EXPERIMENTS.items()
    if facts.fit and any(section == "dynamometer" for section, _ in facts.fit.settings.values())
)
# Settings that are facts on a bench, device, laboratory or text, and filters and windows; each with
# the experiments that it judges, labels or enters. All others are choices of the analysis.
JUDGING: dict[str, tuple[str, ...]] = {
    "dynamometer.cutoff_hz": OF_BENCH,
    "actuator.cutoff_hz": ("actuator",),
    "torque_angle.cutoff_hz": ("torque_angle",),
    "parameters": ("belt", "transmission", "actuator", "impedance"),
    "gain_weight": ("impedance",),
    "model_comparison.sign_width": ("impedance",),
    "dynamometer.amplitudes_deg": ("transmission", "impedance"),
    "dynamometer.frequencies_hz": ("transmission", "impedance"),
    "dynamometer.cycles": ("transmission", "impedance"),
    "dynamometer.load_cell_drift": ("belt",),
    "dynamometer.calibration": OF_BENCH,
    "dynamometer.bench_stiffness": OF_BENCH,
    "dynamometer.fixture": OF_BENCH,
    "dynamometer.windows": ("impedance",),
    "actuator.calibration": ("actuator",),
    "torque_angle.zero": ("torque_angle",),
    "torque_angle.calibration": ("torque_angle",),
    "torque_angle.bench_stiffness": ("torque_angle",),
    "torque_angle.fixture": ("torque_angle",),
    "claims.K_percent": ("impedance", "walking"),
    "impedance_trajectory": ("walking",),
    "figures.midstance_stiffness": ("walking",),
    "figures.stance_share": ("walking",),
    "walking.perturbed_by": ("walking",),
    "walking.side": ("walking",),
    "walking.plate": ("walking",),
    "walking.markers": ("walking",),
    "walking.cutoff_hz": ("walking",),
    "walking.window_s": ("walking",),
    "walking.baseline_s": ("walking",),
    "walking.guard_s": ("walking",),
}
ASSUMED = {"torque_angle.zero": "end"}  # values used for null
# settings that are not used without these files
RESTS_ON = {
    "gain_weight": "parameters",
    "model_comparison.sign_width": "parameters",
    "figures.stance_share": "impedance_trajectory",
}


def named_in(settings: Any, name: str) -> Any:
    """A setting of nested mappings by its dotted name; None if there is none."""
    value = settings
    for key in name.split("."):
        value = (value or {}).get(key)
    return value


def states_of(
    config: Config, own: Mapping[str, Any], experiments: Collection[str]
) -> list[dict[str, Any]]:
    """Find value and state of every setting that judges or labels some experiments.

    Parameters
    ----------
    config : Config
    own : Mapping
        The fields that the campaign's file states.
    experiments : Collection of str

    Returns
    -------
    list of dict
        `setting`, `value` as JSON, and `state`: stated (by the configuration or its simulation),
        measured (each recording has its own), assumed (the default), or none.
    """
    settings = config.model_dump(mode="json")
    rows = []
    for name, judged in JUDGING.items():
        if not set(judged) & set(experiments):
            continue
        value = named_in(settings, name)
        state = state_of(name, value, config, own)
        rows.append({"setting": name, "value": shown_value(name, value, state), "state": state})
    return rows


def is_empty(value: Any) -> bool:
    """Whether a setting is null, or a mapping of nothing but that."""
    return not any(value.values()) if isinstance(value, dict) else value is None


def state_of(name: str, value: Any, config: Config, own: Mapping[str, Any]) -> str:
    """State of a setting, as `states_of` names it."""
    if config.simulation is not None or named_in(own, name) is not None:
        return "stated"
    is_unused = name in RESTS_ON and getattr(config, RESTS_ON[name]) is None
    if not is_empty(value) and not is_unused:
        return "assumed"
    if name in FOUND:
        return "measured"
    return "assumed" if name in ASSUMED else "none"


def shown_value(name: str, value: Any, state: str) -> str | None:
    """A setting as text; a shipped file is shown without its folder."""
    if is_empty(value):
        value = ASSUMED.get(name)
    if value is None or state == "none":
        return None
    return json.dumps(value).strip('"').removeprefix(f"{root()}/")


def over_default(own: Mapping[str, Any]) -> Any:
    """Replace fields of the default configuration by those of another.

    Real recordings are not from the bench of the default campaign: for them, `FACTS` that are not
    stated are null.
    """
    default = read_mapping(default_config())
    is_simulated = own.get("simulation", default["simulation"]) is not None
    if default["simulation"] is None or is_simulated:
        return overriding(default, own)
    for name in FACTS:
        default = overriding(default, nested(name, None))
    if own.get("gain_weight") is None:  # the damping that gains should give depends on it
        default = overriding(default, nested("doubtful.impedance.above.B_gap_s", None))
    return overriding(default, own)


def nested(name: str, value: Any) -> Any:
    """A setting by its dotted name, as nested mappings."""
    for key in reversed(name.split(".")):
        value = {key: value}
    return value


def own_fields(path: Path) -> Mapping[str, Any]:
    """The fields that a configuration file states; the shipped default states none for recordings
    of others."""
    is_shipped = path == default_config() and not Path("config/config.yaml").is_file()
    return {"simulation": None} if is_shipped else read_mapping(path, by_snakemake=True)


def read_section(path: Path, section: str, model: type[AnySettings]) -> AnySettings:
    """Read one section of a campaign's configuration, whose file overrides fields of the default
    configuration."""
    content = over_default(own_fields(path))
    unknown = [name for name in content if name not in Config.model_fields]
    if unknown:
        raise InputError(
            f"{path}: unknown field '{unknown[0]}'; give a configuration, or fields that"
            " override it"
        )
    return validated(content[section], model, path, (default_config(), path), (section,))


def read_config(path: Path, of_any: bool = False) -> Config:
    """Read a whole configuration, from a file that overrides some fields of the default.

    Recordings `of_any` bench are not compared with what the shipped default states.
    """
    own = own_fields(path) if of_any else read_mapping(path, by_snakemake=True)
    return validated(over_default(own), Config, path)


def campaign_config(content: Any, files: Sequence[Path]) -> Config:
    """Validate a configuration that Snakemake merged from files. Later files override earlier
    ones."""
    for file in files:
        read_mapping(file, by_snakemake=True)
    return validated(content, Config, Path(" overridden by ".join(map(str, files))), files)
