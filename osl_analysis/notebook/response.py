"""For notebooks: the frequency response of an impedance trial, as the jobs of a campaign make it."""

from dataclasses import dataclass
from pathlib import Path

import polars as pl

from osl_analysis.bench.asked_impedance import AskedImpedance, judged_impedance
from osl_analysis.bench.frequency_response import frequency_response_table
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.bench.plausibility import Saturated, check_recording, saturated
from osl_analysis.bench.rendered import RenderedTrial, rendered_phasors, rendered_response, rendered_trial, sines_of
from osl_analysis.commands.fit import asked_impedance, fit_request
from osl_analysis.commands.plotted_numbers import beside_theory
from osl_analysis.commands.response import pooled_schema
from osl_analysis.doubtful import IS_DOUBTFUL, DoubtfulFits, marked, with_doubts_of
from osl_analysis.figures.names import of_place
from osl_analysis.figures.response import points as any_motion_points
from osl_analysis.notebook.inputs import OF_CONFIG, File, config_of, desired_of, device_of, trial_of
from osl_analysis.parameters import joint_of, known_parameters
from osl_analysis.trial import Trial


@dataclass(frozen=True, eq=False, repr=False)
class Response:
    """The frequency response of one trial. Nothing of it can be changed: its data frames are copies."""

    trial: str
    """Name of the trial."""
    figure: str
    """The figure that shows it: `fig7` of a stepped sine, `response` of any other motion."""
    _table: pl.DataFrame
    _models: pl.DataFrame
    _plotted: pl.DataFrame

    @property
    def table(self) -> pl.DataFrame:
        """A row per frequency. Of a stepped sine those of `frequency_response.csv`, the admittance Y, angle over torque
        [rad/(N*m)], averaged over amplitudes. Of any other motion those of `response.csv`, the impedance Z, torque over
        angle [N*m/rad], with noise and distortion."""
        return self._table.clone()

    @property
    def models(self) -> pl.DataFrame:
        """Eqs. 15 and 9 fitted to the response, the rows of `response_models.csv`; none of a stepped sine."""
        return self._models.clone()

    @property
    def plotted(self) -> pl.DataFrame:
        """The numbers that `plot_frequency_response` draws."""
        return self._plotted.clone()

    def __repr__(self) -> str:
        doubts = len(self._table.filter(IS_DOUBTFUL))
        counted = f"{len(self._table)} frequencies" + (f", doubtful at {doubts} of them" if doubts else "")
        return f"frequency response, {self.trial}: {counted}; `table`, `models` and `plotted` are data frames"


def frequency_response(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Response:
    """The frequency response of an impedance trial, with 95 % intervals of noise; arguments and errors as in
    `fit_impedance`.

    With `desired` the numbers to be plotted have the desired response (Eq. 11), and with the gains of a controller of
    the draft that of the drivetrain without friction (Eq. 9) too.
    """
    path, read = config_of(config), trial_of(trial)
    device = device_of(parameters, path)
    request = fit_request("impedance", path)
    asked = asked_impedance(desired_of(desired), path, request.settings)
    check_recording(read, request.settings)
    rails = saturated(read, "torque", "theta")
    rendered = rendered_trial(read, request.settings, windows)
    found = responses(rendered, rails, device, asked, request.limits)
    if isinstance(rendered, MovingRecord):
        plotted = any_motion_points(found["response"], pl.DataFrame(schema=pooled_schema()))
        return Response(read.name, "response", found["response"], found["response_models"], plotted)
    table = frequency_response_table(found["phasors"])
    joint = pl.lit(joint_of(device) if device else None, pl.String)
    plotted = beside_theory(of_place(table.with_columns(joint=joint)), device, asked.weight)
    return Response(read.name, "fig7", table, found["response_models"], plotted)


def responses(
    rendered: RenderedTrial, rails: Saturated, device: Path | None, asked: AskedImpedance, limits: DoubtfulFits
) -> dict[str, pl.DataFrame]:
    """The rows of `phasors`, `response` and `response_models` of one trial, with their doubts and those of its fit."""
    p, phasors = known_parameters(device), sines_of(rendered)
    fits = judged_impedance(rendered, rails, p, asked, phasors)
    of_motion = rendered_response(rendered, p)
    tables = {
        "phasors": rendered_phasors(rendered, phasors),
        "response": of_motion.response,
        "response_models": of_motion.models,
    }
    judged = {}
    for name, table in tables.items():
        own = marked(table.with_columns(**asked.desired.columns()), limits.of(name), name)
        judged[name] = with_doubts_of(own, fits, limits.of("impedance"), "impedance")
    return judged
