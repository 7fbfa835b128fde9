"""Common parts of the commands of `osl-analysis`: options, lists of numbers, and how errors are shown."""

import errno
import math
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from osl_analysis.errors import OslAnalysisError, printable

if TYPE_CHECKING:
    from osl_analysis.bench.impedance import DesiredImpedance

MOST_NUMBERS = 300
"""Largest number of values in a range."""


class NumberList(click.ParamType[list[float]]):
    """Numbers as 300, as 100,200 or as first:last:step."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[float]:
        """The numbers that an argument of the command line stands for."""
        text = str(value)
        try:
            numbers = [float(part) for part in text.replace(":", ",").split(",")]
        except ValueError:
            self.fail(f"'{text}' is neither a number nor a list like 100,200 or 100:400:50", param, ctx)
        if ":" not in text:
            return numbers
        if (
            len(numbers) != 3
            or not all(map(math.isfinite, numbers))
            or not (numbers[2] > 0 and numbers[1] >= numbers[0])
        ):
            self.fail(f"'{text}' is not a range; write first:last:step, upwards, with a step above 0", param, ctx)
        first, last, step = numbers
        if (last - first) / step > MOST_NUMBERS:
            self.fail(f"'{text}' is more than {MOST_NUMBERS} numbers; take a longer step", param, ctx)
        return [first + step * k for k in range(int((last - first) / step + 1e-9) + 1)]


FILE = click.Path(path_type=Path)
WRITTEN = {"output", "plot", "draft_path"}
"""Parameters of commands that name a file to write."""
NUMBERS = NumberList()
PARAMETERS = click.option(
    "--parameters",
    type=FILE,
    default=Path("config/parameters/default.yaml"),
    show_default=True,
    help="Parameter file of the device.",
)
CONFIG = click.option(
    "--config",
    "config_path",
    type=FILE,
    default=Path("config/config.yaml"),
    show_default=True,
    help="Configuration with the filter [Hz] and the stepped-sine protocol [deg, Hz].",
)
K_D = click.option("--stiffness", type=float, help="Desired K_d [N·m/rad] of the trial, for --model impedance.")
B_D = click.option("--damping", type=float, help="Desired B_d [N·m·s/rad] of the trial, for --model impedance.")
CONTROLLER = click.option(
    "--controller",
    type=click.Choice(["compensated", "uncompensated"]),
    default="compensated",
    show_default=True,
    help="Controller of the trial, with --stiffness and --damping.",
)


def desired_options(command: Any) -> Any:
    """The options of a command for the desired impedance of a trial."""
    return K_D(B_D(CONTROLLER(command)))


def desired_impedance(
    model: str, stiffness: float | None, damping: float | None, controller: str
) -> "DesiredImpedance | None":
    """The desired impedance of a trial; None without it. One value alone, or values without a use, are refused."""
    from osl_analysis.bench.impedance import DesiredImpedance

    if (stiffness is None) != (damping is None):
        raise click.UsageError("--stiffness and --damping go together")
    if stiffness is None or damping is None:
        return None
    if model != "impedance":
        raise click.UsageError("--stiffness and --damping are those of an impedance trial: give --model impedance")
    return DesiredImpedance(controller, stiffness, damping)


AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON in SI units instead of a table.")


class KeepsItsInput(click.Command):
    """A command that never writes to a file that it reads."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command, unless the file of an option that writes is the file of another option or argument."""
        files = {name: value for name, value in ctx.params.items() if isinstance(value, Path)}
        for written in WRITTEN & files.keys():
            for name, path in files.items():
                if name != written and same_file(path, files[written]):
                    raise click.UsageError(f"{files[written]} would be overwritten while it is read; name another file")
        return super().invoke(ctx)


def same_file(one: Path, other: Path) -> bool:
    """Whether two paths name one file that exists, also through links."""
    try:
        return one.samefile(other)
    except OSError:
        return False


class OneLineErrors(click.Group):
    """Shows a user's mistake as one line on standard error, exit code 1, and a warning as one line."""

    command_class = KeepsItsInput

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; show its warnings and the user's mistakes as one line each."""
        warnings.showwarning = lambda message, *_, **__: click.echo(f"warning: {printable(str(message))}", err=True)
        try:
            return super().invoke(ctx)
        except OslAnalysisError as error:
            click.echo(f"error: {error}", err=True)
        except OSError as error:
            if error.filename is None or error.errno == errno.EPIPE:
                raise
            text = f"{error.filename}: {error.strerror}; check the path, its permissions and the space on the disk"
            click.echo(f"error: {printable(text)}", err=True)
        sys.exit(1)
