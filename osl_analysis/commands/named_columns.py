# SPDX-License-Identifier: Apache-2.0
"""A table whose columns are named by signal and unit, `theta_deg` and `torque_Nm`, as a trial.

The names state what a source file states for other recordings. What a name does not say, the sign
of a torque, the caller states.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from osl_analysis.base.errors import InputError, OslAnalysisError, listing, quoted
from osl_analysis.base.files import write_text
from osl_analysis.base.trial import COLUMNS, Trial
from osl_analysis.commands.trials import checked_trial, inspect_file
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel, name_and_ending

SIGNS = (1, -1)
FEWEST_SIGNALS = 2  # every fit needs a motion and a torque
TORQUES = ("torque", "torque_m")  # columns to which a stated sign applies
SEPARATORS = "_ .-/:"  # between signal and unit
SOURCE_NAME = "named_columns"  # of the source file that is made of the names


def trial_of_named_columns(path: Path, sign: int) -> Trial:
    """Read a table of rows whose columns are named by signal and unit.

    Parameters
    ----------
    path : Path
        CSV or other text, or a table of another format, with a column `time_s` or alike, and
        columns such as `theta_deg`, `theta_m_rad`, `torque_Nm`, `current_A`. Others are left out.
    sign : int
        1 if the torque column is the resisting torque of the joint, which is positive when it
        opposes positive motion; -1 if it is the opposite one.

    Returns
    -------
    Trial
        In SI units.

    Raises
    ------
    InputError
        No column is named so, or the recording is damaged.
    """
    overview = inspect_file(path)
    named = channels_by_signal(overview)
    if len(named) < FEWEST_SIGNALS or "time" not in overview.settings:
        raise not_named(path, overview)
    source = source_text(overview, named, sign)
    with TemporaryDirectory() as folder:
        write_text(Path(folder, f"{SOURCE_NAME}.yaml"), source)
        row = {"trial": path.stem, "log": path.name, "log_source": SOURCE_NAME}
        return checked_trial(row, path.parent, Path(folder))


def channels_by_signal(overview: Overview) -> dict[str, tuple[RecordedChannel, str]]:
    """The channels of a log that are named by a signal and a unit, as `theta_deg` or
    `theta [deg]`, each with that unit, by signal."""
    named = {}
    for channel in overview.drafted:
        name, ending = name_and_ending(channel.name)
        signal = name.rstrip(SEPARATORS)
        unit = channel.unit or ending
        if signal in COLUMNS and signal != "time" and unit:
            named[signal] = (channel, unit)
    return named


def not_named(path: Path, overview: Overview) -> InputError:
    """Why a table is not read by the names of its columns."""
    names = listing([channel.name for channel in overview.channels], 6)
    return InputError(
        f"{path}: too few columns are named by signal and unit, beside a time: it has {names}",
        "name the columns time_s, theta_deg and torque_Nm, or in other units; or let"
        " `osl-analysis init` draft a source file and call osl.read_recording",
    )


def source_text(
    overview: Overview, named: Mapping[str, tuple[RecordedChannel, str]], sign: int
) -> str:
    """The source file that the names of the columns stand for."""
    settings = {"format": overview.format, **overview.settings}
    lines = [f"{key}: {quoted(value)}" for key, value in settings.items()]
    lines.append("channels:")
    for signal, (channel, unit) in named.items():
        fields: dict[str, object] = {**channel.address, "unit": unit}
        if signal in TORQUES:
            fields["sign"] = sign
        lines.append(f"  {signal}: {quoted(fields)}")
    return "\n".join([*lines, ""])


def sign_not_stated(path: Path, fit_text: Callable[[Trial], str]) -> InputError:
    """The refusal of a table whose torque has no stated sign, with the sign that its motion
    suggests: that with which the fit is possible.

    Parameters
    ----------
    path : Path
    fit_text : callable
        Fits a trial, and tells its first estimate; raises OslAnalysisError where it is refused.
    """
    possible = {}
    for sign in SIGNS:
        trial = trial_of_named_columns(path, sign)
        try:
            possible[sign] = fit_text(trial)
        except OslAnalysisError:
            continue
    problem = f"{path}: the sign of the torque is not stated"
    meaning = (
        "state sign=1 if it is the joint's resisting torque, positive when it opposes positive"
        " motion, or sign=-1 if it is the opposite one"
    )
    if len(possible) != 1:
        return InputError(problem, meaning)
    ((sign, text),) = possible.items()
    return InputError(problem, f"{meaning}; its motion suggests sign={sign}, with {text}")
