"""What the fit of one trial gives: a type for each experiment, with its estimates as fields."""

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from html import escape
from typing import Any

import polars as pl

from osl_analysis.commands.estimates import estimated, estimates_text
from osl_analysis.errors import nearest, printable_lines
from osl_analysis.figures import drawn
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.words import finding_text

DOTS_PER_INCH = 100  # of the picture in a notebook
Interval = tuple[float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial of any experiment, which `fit_impedance`, `fit_belt` and the like return as
    their own type.

    Every column of its table is an attribute, with the value of the fit to all data: `fit.K_se`,
    `fit.VAF`. An absent value is None, as in the table. `fit.K_interval` is (low, high), the 95 %
    interval. An absent one is (NaN, NaN), so that there are always two numbers to compute and to
    plot with. Meaning and unit of each are told by `osl-analysis results --columns`. `trial`,
    `doubtful` and `remarks` are texts: the trial's name, and sentences of its findings. A notebook
    shows text and picture.

    Attributes
    ----------
    experiment : str
        It names the table that the fit has rows of in a campaign.
    table : polars.DataFrame
        Those rows: one per amplitude, if there are several, and last the fit to all data.
    series : polars.DataFrame
        `time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit
        explains.
    curves : polars.DataFrame or None
        Torque over angle, rows of `belt_curves` or `torque_angle_curves`; None for another
        experiment.
    findings : Sequence of Sequence of Finding
        What was judged of each row: doubts, what could not be checked, notes.

    Examples
    --------
    >>> fit = osl.fit_impedance(trial)
    >>> isinstance(fit, osl.Fit), fit.experiment, fit.table.height
    (True, 'impedance', 1)
    """

    experiment: str
    table: pl.DataFrame
    series: pl.DataFrame
    curves: pl.DataFrame | None
    findings: Sequence[Sequence[Finding]] = ()

    def __post_init__(self) -> None:
        for estimate in fields(self):
            if not estimate.init:
                object.__setattr__(self, estimate.name, self.value_of(estimate.name))

    @property
    def row(self) -> Mapping[str, Any]:
        """The fit to all data, by the columns of the table."""
        return self.table.row(-1, named=True)

    @property
    def trial(self) -> str:
        """Name of the trial."""
        return str(self.row["trial"])

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do.
        Empty: nothing."""
        return "\n".join(self.sentences(Grade.DOUBTS))

    @property
    def remarks(self) -> str:
        """What could not be checked, and why, a line each, and what is to be known, such as
        friction; empty if there is nothing."""
        lines = [f"not checked: {text}" for text in self.sentences(Grade.UNCHECKED)]
        lines += [f"remark: {text}" for text in self.sentences(Grade.NOTES)]
        return "\n".join(lines)

    def sentences(self, *grades: Grade) -> list[str]:
        """The findings of some grades about the fit to all data, in words."""
        of_whole = self.findings[-1] if self.findings else ()
        return [finding_text(finding, self.row) for finding in of_whole if finding.grade in grades]

    def value_of(self, name: str) -> Any:
        """A column of the table, of the fit to all data, or its `NAME_interval`. Raises
        AttributeError for another name."""
        row = self.row
        quantity = name.removesuffix("_interval")
        is_interval = quantity != name
        if is_interval and f"{quantity}_low" in row:
            ends = (row[f"{quantity}_low"], row[f"{quantity}_high"])
            return tuple(math.nan if end is None else end for end in ends)
        if name not in row:
            estimates = ", ".join(estimated(row))
            raise AttributeError(
                f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has"
                f" {estimates}"
            )
        return row[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        return self.value_of(name)

    def __dir__(self) -> list[str]:
        intervals = [f"{name}_interval" for name in estimated(self.row)]
        return sorted({*super().__dir__(), *self.row, *intervals})

    def __repr__(self) -> str:
        text = f"{self.experiment}, {estimates_text(self.table.tail(1), self.findings[-1:])}"
        if self.remarks:
            text += f"\n{self.remarks}"
        return printable_lines(text)

    def _repr_html_(self) -> str:
        html = f"<pre>{escape(repr(self))}</pre>"
        if not self.series.is_empty():
            picture = b64encode(drawn("torque", self.series)._repr_png_(DOTS_PER_INCH)).decode()
            html += (
                '<img alt="Torque over time" style="max-width: 100%"'
                f' src="data:image/png;base64,{picture}">'
            )
        return html


@dataclass(frozen=True, eq=False, repr=False)
class ImpedanceFit(Fit):
    """K, B and I of a joint (Eq. 15), torque = K theta + B omega + I alpha + offset: a `Fit` of
    experiment `impedance`.

    Attributes
    ----------
    K, K_interval : float, (float, float)
        Stiffness and its 95 % interval [N*m/rad].
    B, B_interval : float, (float, float)
        Damping [N*m*s/rad].
    I, I_interval : float, (float, float)
        Apparent inertia [kg*m^2]; it may be negative (Eq. 9).
    B_viscous : float or None
        Damping of the torque less its Coulomb friction [N*m*s/rad]; None where friction is not
        certain.
    VAF : float
        Variance of the torque that the fit accounts for [%].

    Examples
    --------
    >>> fit = osl.fit_impedance(trial)
    >>> low, high = fit.K_interval
    >>> bool(low < fit.K < high)
    True
    """

    K: float = field(init=False)
    K_interval: Interval = field(init=False)
    B: float = field(init=False)
    B_interval: Interval = field(init=False)
    I: float = field(init=False)
    I_interval: Interval = field(init=False)
    B_viscous: float | None = field(init=False)
    VAF: float = field(init=False)


@dataclass(frozen=True, eq=False, repr=False)
class BeltFit(Fit):
    """Stiffness of the belt (Fig. 3), torque over deflection while loading: a `Fit` of experiment
    `belt`.

    Attributes
    ----------
    K_s, K_s_interval : float, (float, float)
        Stiffness and its 95 % interval [N*m/rad].
    hysteresis_area : float
        Energy lost in a cycle of loading and unloading [J].
    VAF : float
        Variance of the torque that the fit accounts for [%].

    Examples
    --------
    >>> fit = osl.fit_belt(belt_trial)
    >>> round(fit.K_s / 10) * 10
    690
    """

    K_s: float = field(init=False)
    K_s_interval: Interval = field(init=False)
    hysteresis_area: float = field(init=False)
    VAF: float = field(init=False)


@dataclass(frozen=True, eq=False, repr=False)
class TransmissionFit(Fit):
    """Damping and inertia of the transmission (Eq. 4), of a trial without motor: a `Fit` of
    experiment `transmission`.

    Attributes
    ----------
    B_j, B_j_interval : float, (float, float)
        Damping and its 95 % interval [N*m*s/rad].
    J_j, J_j_interval : float, (float, float)
        Inertia [kg*m^2].
    VAF : float
        Variance of the torque that the fit accounts for [%].

    Examples
    --------
    >>> fit = osl.fit_transmission(motorless_trial)
    >>> fit.B_j > 0, fit.J_j > 0
    (True, True)
    """

    B_j: float = field(init=False)
    B_j_interval: Interval = field(init=False)
    J_j: float = field(init=False)
    J_j_interval: Interval = field(init=False)
    VAF: float = field(init=False)


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorFit(Fit):
    """The actuator alone (Eqs. 1-2), at its output: a `Fit` of experiment `actuator`.

    Attributes
    ----------
    k_tau_n_m, k_tau_n_m_interval : float, (float, float)
        Torque per q-axis current and its 95 % interval [N*m/A].
    f_C, f_C_interval : float, (float, float)
        Coulomb friction [N*m].
    f_G, f_G_interval : float, (float, float)
        Friction of the gear per current [N*m/A].
    B_m, B_m_interval : float, (float, float)
        Damping [N*m*s/rad].
    J_m, J_m_interval : float, (float, float)
        Inertia [kg*m^2].
    VAF : float
        Variance of the torque that the fit accounts for [%].

    Examples
    --------
    >>> fit = osl.fit_actuator(actuator_trial)
    >>> fit.k_tau_n_m > 0, fit.J_m > 0
    (True, True)
    """

    k_tau_n_m: float = field(init=False)
    k_tau_n_m_interval: Interval = field(init=False)
    f_C: float = field(init=False)
    f_C_interval: Interval = field(init=False)
    f_G: float = field(init=False)
    f_G_interval: Interval = field(init=False)
    B_m: float = field(init=False)
    B_m_interval: Interval = field(init=False)
    J_m: float = field(init=False)
    J_m_interval: Interval = field(init=False)
    VAF: float = field(init=False)


@dataclass(frozen=True, eq=False, repr=False)
class TorqueAngleFit(Fit):
    """Torque over angle of a passive foot or a spring in slow cycles: a `Fit` of experiment
    `torque_angle`.

    Attributes
    ----------
    K, K_interval : float, (float, float)
        Slope of the straight line while loading, mean of the cycles, and its 95 % interval
        [N*m/rad]; NaN with one cycle.
    energy_stored : float
        Energy that the device takes up in a cycle [J].
    energy_returned : float
        Energy that it gives back [J].
    energy_lost : float
        Area of the loop [J].
    VAF : float
        Variance of the torque that the curves of loading and unloading account for [%].

    Examples
    --------
    >>> fit = osl.fit_torque_angle(foot)
    >>> bool(fit.energy_returned < fit.energy_stored)
    True
    """

    K: float = field(init=False)
    K_interval: Interval = field(init=False)
    energy_stored: float = field(init=False)
    energy_returned: float = field(init=False)
    energy_lost: float = field(init=False)
    VAF: float = field(init=False)


FIT_TYPES: Mapping[str, type[Fit]] = {
    "impedance": ImpedanceFit,
    "belt": BeltFit,
    "transmission": TransmissionFit,
    "actuator": ActuatorFit,
    "torque_angle": TorqueAngleFit,
}
"""By experiment; the fit of another one is a plain `Fit`."""
