"""Common parts of the commands of `osl-analysis`: options, lists of numbers, and how errors are shown."""

import errno
import math
import signal
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from osl_analysis.errors import OslAnalysisError, printable, printable_lines
from osl_analysis.files import check_output, config_here, default_config, shipped
from osl_analysis.memory import limited_memory

if TYPE_CHECKING:
    from osl_analysis.bench.impedance import DesiredImpedance

MOST_NUMBERS = 300  # values in a range


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
        is_range = len(numbers) == 3 and all(map(math.isfinite, numbers))
        if not is_range or numbers[2] <= 0 or numbers[1] < numbers[0]:
            self.fail(f"'{text}' is not a range; write first:last:step, upwards, with a step above 0", param, ctx)
        first, last, step = numbers
        if (last - first) / step > MOST_NUMBERS:
            self.fail(f"'{text}' is more than {MOST_NUMBERS} numbers; take a longer step", param, ctx)
        return [first + step * k for k in range(int((last - first) / step + 1e-9) + 1)]


FILE = click.Path(path_type=Path)
WRITTEN = {"output", "plot", "draft_path"}  # parameters of commands that name a file to write
READ = ("log", "mocap", "file", "trial")  # parameters of commands that name a recording or a trial
SUFFIXES = {"ingest": ".parquet", "samples": ".md", "describe-tables": ".md", "design": ".csv"}
"""Suffix of what a command writes, where it writes one kind of file."""
INTERRUPTED = 130  # exit code after Ctrl-C or SIGTERM
NUMBERS = NumberList()
PARAMETERS = click.option(
    "--parameters",
    type=FILE,
    default=shipped("config/parameters/default.yaml"),
    show_default=True,
    help="Parameter file of the device.",
)
CONFIG = click.option(
    "--config",
    "config_path",
    type=FILE,
    default=config_here(),
    show_default=True,
    help="Configuration with the filter [Hz] and the stepped-sine protocol [deg, Hz].",
)
DEVICE = click.option(
    "--parameters",
    type=FILE,
    help="Parameter file of the device; `none`: it has none. Default: that of the configuration.",
)
NO_FILE = Path("none")
"""Value of `DEVICE` for a device without a parameter file."""


def desired_impedance(model: str, K_d: float | None, B_d: float | None, controller: str) -> "DesiredImpedance | None":
    """The desired impedance of a trial, as far as it is given; None if nothing is. Values without a use are refused."""
    from osl_analysis.bench.impedance import DesiredImpedance

    given = click.get_current_context().get_parameter_source("controller") is ParameterSource.COMMANDLINE
    if K_d is None and B_d is None and not given:
        return None
    if model != "impedance":
        said = "--stiffness, --damping and --controller are those of an impedance trial: give --model impedance"
        raise click.UsageError(said)
    return DesiredImpedance(controller, K_d, B_d)


AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON in SI units instead of a table.")


def say(text: str, err: bool = False) -> None:
    """Print lines to the terminal. Control characters, which names in files may have, are written as escapes."""
    click.echo(printable_lines(text), err=err)


class KeepsItsInput(click.Command):
    """A command that never writes to a file that it reads, no two results to one file, and only to regular files."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command, unless the file of an option that writes is in use, of another kind, or no file."""
        command = str(ctx.info_name)
        for name in sorted(WRITTEN & ctx.params.keys()):
            path = ctx.params[name]
            if path is None:
                continue
            others = {other: value for other, value in ctx.params.items() if other != name}
            if any(same_file(used, path) for used in files_used(others)):
                raise click.UsageError(f"{path} would be overwritten while it is used; name another file")
            suffix = SUFFIXES.get(command, path.suffix)
            if path.suffix != suffix:  # it may be a source file, a log or a configuration
                raise click.UsageError(f"{path}: `{command}` writes {suffix} files; choose this suffix")
            check_output(path)
        with limited_memory([ctx.params[name] for name in READ if isinstance(ctx.params.get(name), Path)]):
            return super().invoke(ctx)


def files_used(values: Mapping[str, Any]) -> Iterator[Path]:
    """The files that a command uses besides what it writes, by the values of its options and arguments.

    They are those that its options name, the source files that it finds by name, the default configuration, which that
    of an option overrides, and all files below the folder that it reads, but for pages of an earlier run.
    """
    yield from (value for value in values.values() if isinstance(value, Path))
    for source in ("log_source", "mocap_source"):
        if values.get(source) is not None:
            yield values["sources"] / f"{values[source]}.yaml"
    if "config_path" in values:
        yield default_config()
    if "folder" in values:
        yield from (path for path in values["folder"].rglob("*") if path.suffix != SUFFIXES["samples"])


def same_file(one: Path, other: Path) -> bool:
    """Whether two paths name one file, also through links; also one that does not exist yet."""
    try:
        return one.samefile(other) if one.exists() and other.exists() else realpath(one) == realpath(other)
    except OSError:
        return False


@contextmanager
def ended_quietly() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does, so that no half-written file stays behind."""
    before = signal.getsignal(signal.SIGTERM)
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        with suppress(ValueError):
            signal.signal(signal.SIGTERM, before)


class OneLineErrors(click.Group):
    """Shows a user's mistake as one line on standard error, exit code 1, and a warning as one line."""

    command_class = KeepsItsInput

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; show its warnings and the user's mistakes as one line each. Ctrl-C ends with code 130."""
        warnings.showwarning = lambda message, *_, **__: click.echo(f"warning: {printable(str(message))}", err=True)
        try:
            with ended_quietly():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            sys.exit(INTERRUPTED)
        except click.UsageError as error:
            raise click.UsageError(printable(error.message), error.ctx) from error
        except OslAnalysisError as error:
            click.echo(f"error: {error}", err=True)
        except OSError as error:
            if error.errno == errno.EPIPE:
                raise
            place = "the output" if error.filename is None else error.filename
            text = f"{place}: {error.strerror}; check the path, its permissions and the space on the disk"
            click.echo(f"error: {printable(text)}", err=True)
        sys.exit(1)
