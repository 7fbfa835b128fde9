"""Commands of `osl-analysis` for what is chosen before a trial: control gains, and the protocol of an experiment."""

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from osl_analysis.cli_options import AS_JSON, CONFIG, FILE, NUMBERS, PARAMETERS, KeepsItsInput, say

OF_STEPPED_SINE = {"frequencies", "amplitudes", "cycles"}
OF_BAND = {"band", "rms", "peak"}
OF_MULTISINE = OF_BAND | {"period", "periods", "realisations", "seed"}
OF_CONTINUOUS = OF_BAND | {"duration"}
OPTIONS = {
    "stepped-sine": OF_STEPPED_SINE,
    "multisine": OF_MULTISINE,
    "chirp": OF_CONTINUOUS,
    "noise": OF_CONTINUOUS,
}
"""Options that one kind of excitation has, by its name."""


class Percent(click.ParamType[float]):
    """A share, as 1% or as 1: percent."""

    name = "percent"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The share."""
        if isinstance(value, float):
            return value
        try:
            share = float(str(value).strip().removesuffix("%")) / 100
        except ValueError:
            share = -1.0
        if not 0 < share < 1:
            self.fail(f"'{value}' is no percentage between 0 and 100; write 1%", param, ctx)
        return share


PERCENT, POSITIVE, NOT_NEGATIVE = Percent(), click.FloatRange(0, min_open=True), click.FloatRange(0)


@click.command(
    cls=KeepsItsInput,
    epilog="Example: osl-analysis gains --stiffness 300 --damping 5 (or 100:400:50 and 0,5 for a grid)",
)
@click.option("--stiffness", type=NUMBERS, help="Desired joint stiffness K_d [N·m/rad]: 300, 100,200 or 100:400:50.")
@click.option("--damping", type=NUMBERS, help="Desired joint damping B_d [N·m·s/rad]: 5, 0,2.5,5 or 0:7.5:2.5.")
@click.option(
    "--trajectory", type=FILE, help="CSV file with phase (0 to 1), K_d [N·m/rad] and B_d [N·m·s/rad] instead."
)
@click.option("--weight-hz", type=float, default=1.0, show_default=True, help="Cut-off of W in Eq. 14 [Hz].")
@click.option("--weight-order", type=int, default=3, show_default=True, help="Order of W in Eq. 14.")
@PARAMETERS
@AS_JSON
@click.option("--output", type=FILE, help="Write the table to this file (.csv or .json).")
@click.option("--plot", type=FILE, help="Draw response, gains or trajectory to this file (.pdf, .svg or .png).")
def gains(
    stiffness: list[float] | None,
    damping: list[float] | None,
    trajectory: Path | None,
    weight_hz: float,
    weight_order: int,
    parameters: Path,
    as_json: bool,
    output: Path | None,
    plot: Path | None,
) -> None:
    """Select the control gains K_1 and B_1 that render a desired impedance best (Eqs. 13 and 14).

    For one pair, a grid or a trajectory. The table also has the impedance that a fit will estimate, stability,
    passivity and the frequency up to which the desired impedance is rendered.
    """
    from osl_analysis.commands import gains as command

    if trajectory is not None and (stiffness is not None or damping is not None):
        raise click.UsageError("--trajectory has K_d and B_d of its own: leave out --stiffness and --damping, or it")
    if trajectory is None and (stiffness is None or damping is None):
        raise click.UsageError("give --stiffness and --damping, or --trajectory")
    request = command.Request(stiffness or [], damping or [], trajectory, weight_hz, weight_order)
    table = command.requested_gains(request, parameters)
    if output is not None:
        command.write_gains(table, output)
    if plot is not None:
        command.plot_gains(request, table, parameters, plot)
    say(command.gains_json(table) if as_json else command.gains_text(request, table))


@click.command(
    cls=KeepsItsInput,
    epilog="Example: osl-analysis design --excitation multisine --friction 0.3 --stiffness-within 1% "
    "--damping-within 3% --write multisine.csv",
)
@click.option("--excitation", type=click.Choice(list(OPTIONS)), default="stepped-sine", show_default=True)
@click.option("--frequencies", type=NUMBERS, help="Of a stepped sine [Hz]; default: the configuration's.")
@click.option("--amplitudes", type=NUMBERS, help="Of a stepped sine [deg]; default: the configuration's.")
@click.option("--cycles", type=click.IntRange(1, 10_000), help="At each frequency; default: the configuration's.")
@click.option("--band", type=NUMBERS, help="Lowest and highest frequency [Hz]; default: 0.5,6.")
@click.option("--rms", type=POSITIVE, help="Root mean square of the angle [deg]; default: 2.")
@click.option("--peak", type=POSITIVE, help="Largest angle [deg], instead of --rms.")
@click.option("--period", type=click.FloatRange(0.1, 600), default=8.0, show_default=True, help="Of a multisine [s].")
@click.option("--periods", type=click.IntRange(2, 1000), default=4, show_default=True, help="Fitted, per realisation.")
@click.option("--realisations", type=click.IntRange(1, 200), default=4, show_default=True, help="Of a multisine.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the multisine's phases.")
@click.option(
    "--duration", type=click.FloatRange(1, 100_000), default=60.0, show_default=True, help="Of a chirp or noise [s]."
)
@click.option("--stiffness", type=float, help="Expected K [N·m/rad]; default: study.K_d of the configuration.")
@click.option("--damping", type=float, help="Expected B [N·m·s/rad]; default: study.B_d.")
@click.option("--inertia", type=float, help="Expected I [kg·m²]; default: study.I.")
@click.option("--rate", type=POSITIVE, default=1000.0, show_default=True, help="Sampling rate [Hz].")
@click.option("--torque-noise", type=NOT_NEGATIVE, default=0.05, show_default=True, help="SD [N·m].")
@click.option("--noise-band", type=POSITIVE, help="Bandwidth of this noise [Hz]; default: half the rate.")
@click.option("--torque-step", type=NOT_NEGATIVE, default=0.0, show_default=True, help="Of the load cell [N·m].")
@click.option("--encoder-bits", type=click.IntRange(4, 32), default=18, show_default=True, help="Bits per turn.")
@click.option("--encoder-step", type=NOT_NEGATIVE, help="Step [deg] instead of bits; 0: not rounded.")
@click.option("--angle-noise", type=NOT_NEGATIVE, default=0.0, show_default=True, help="SD before rounding [deg].")
@click.option("--drift", type=NOT_NEGATIVE, help="Of the load cell [N·m/min]; default: dynamometer.load_cell_drift.")
@click.option("--friction", type=NOT_NEGATIVE, help="Coulomb friction of the joint [N·m].")
@click.option("--distortion", type=PERCENT, help="Odd distortion at the excited lines, of the torque there [percent].")
@click.option("--earlier", type=FILE, help="response.csv or impedance.csv of an earlier trial: its distortion.")
@click.option("--trial", help="The trial in that table.")
@click.option("--lag", type=float, default=0.1, show_default=True, help="Lag of the torque whose effect is said [ms].")
@click.option("--stiffness-within", type=PERCENT, help="Half width of the interval that is asked for, of K [percent].")
@click.option("--damping-within", type=PERCENT, help="The same of B.")
@click.option("--inertia-within", type=PERCENT, help="The same of I.")
@click.option("--write", "output", type=FILE, help="Write the multisine (the recommended one) to this CSV file.")
@CONFIG
@AS_JSON
def design(config_path: Path, output: Path | None, as_json: bool, **chosen: Any) -> None:
    """Say what 95 % intervals of K, B and I to expect from a protocol, and how long to record.

    For a stepped sine, an odd random-phase multisine, a chirp or band-limited noise, with the noise of the load cell,
    the rounding of the encoder, and the distortion of a joint that is not linear.
    """
    from osl_analysis.commands.design import designed, write_command
    from osl_analysis.commands.design_request import design_request
    from osl_analysis.commands.design_text import design_json, design_text
    from osl_analysis.config import read_config

    check_used(chosen)
    config = read_config(config_path)
    request = design_request(chosen, config)
    made = designed(request, config)
    if output is not None:
        write_command(made.recommended or request.plan, request.sensors.rate_hz, output)
        say(f"wrote {output}", err=True)
    say(design_json(made) if as_json else design_text(made))


def check_used(chosen: dict[str, Any]) -> None:
    """Refuse options that the excitation does not have, and those that exclude one another."""
    ctx, kind = click.get_current_context(), chosen["excitation"]
    given = {name for name in chosen if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE}
    unused = sorted(given & set().union(*OPTIONS.values()) - OPTIONS[kind])
    if unused:
        raise click.UsageError(f"a {kind} has no --{unused[0].replace('_', '-')}")
    for one, other in (("rms", "peak"), ("encoder_bits", "encoder_step")):
        if {one, other} <= given:
            raise click.UsageError(f"give --{one.replace('_', '-')} or --{other.replace('_', '-')}, not both")
    if "trial" in given and "earlier" not in given:
        raise click.UsageError("--trial is that of an earlier table: give --earlier too")
    if chosen["band"] is not None and len(chosen["band"]) != 2:
        raise click.UsageError("--band has the lowest and the highest frequency, as 0.5,6")
