"""What the functions for notebooks are given: a trial or its file, a configuration, a parameter file."""

from pathlib import Path

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.commands.fit import campaign_parameters
from osl_analysis.errors import InputError
from osl_analysis.shipped import config_here
from osl_analysis.trial import Trial
from osl_analysis.trial import read_trial as read_trial_file

File = str | Path
OF_CONFIG = "of the configuration"
"""In place of a parameter file: the one that the configuration names."""
NOT_KNOWN = DesiredImpedance(None, None, None)
"""Nothing is known of what the leg was asked to render."""


def path_of(value: File, what: str) -> Path:
    """A path.

    Raises
    ------
    InputError
        It is neither a path nor text; `what` is the argument.
    """
    if not isinstance(value, str | Path) or not str(value):
        raise InputError(f"{what}: a path is needed, not {value!r}")
    return Path(value)


def desired_of(desired: DesiredImpedance | None) -> DesiredImpedance:
    """A desired impedance as it is, or one of which nothing is known.

    Raises
    ------
    InputError
        It is another thing.
    """
    if desired is None:
        return NOT_KNOWN
    if not isinstance(desired, DesiredImpedance):
        raise InputError(f"desired: {desired!r} is none; write DesiredImpedance(controller, K_d, B_d)")
    return desired


def trial_of(trial: Trial | File) -> Trial:
    """A trial as it is, or read from its file.

    Raises
    ------
    InputError
        As `trial.read_trial`; it is neither a trial nor a path; or a column holds no numbers.
    """
    if isinstance(trial, Path | str):
        return read_trial_file(Path(trial))
    if not isinstance(trial, Trial):
        raise InputError(
            f"a trial is needed, not {type(trial).__name__}; give what `read_trial` or `read_recording` returned, a "
            "path, or `Trial(name, samples)` with a data frame in SI units"
        )
    for name, dtype in trial.samples.schema.items():
        if not (dtype.is_numeric() or dtype.is_(bool)):
            raise InputError(f"trial {trial.name}: column '{name}' holds {dtype}, expected numbers; convert or drop it")
    return trial


def config_of(config: File | None) -> Path:
    """A configuration file; without one that of the campaign in the working folder, else the shipped one."""
    return config_here() if config is None else path_of(config, "config")


def device_of(parameters: File | None, config: Path) -> Path | None:
    """A parameter file; None for a device without one. Raises as `campaign_parameters`."""
    if parameters == OF_CONFIG:
        return campaign_parameters(config)
    return None if parameters is None else path_of(parameters, "parameters")
