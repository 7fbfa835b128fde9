"""The components of the drivetrain as the campaign measured each of them alone: actuator, belt and
transmission, of one joint and side."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.transmission import LOSSES
from osl_analysis.errors import InputError
from osl_analysis.measured import rms
from osl_analysis.model.drivetrain import PARAMETER_UNITS, DrivetrainParameters
from osl_analysis.stats.repeats import counted
from osl_analysis.table import finite_or_null
from osl_analysis.trial import Array

COMPONENTS = {
    **dict.fromkeys(ACTUATOR_PARAMETERS, "actuator"),
    "K_s": "belt",
    **dict.fromkeys(LOSSES, "transmission"),
}
"""The experiment that measures each component."""
PARTS = tuple(dict.fromkeys(COMPONENTS.values()))
CERTAINLY_NEGATIVE = 3.0  # standard errors by which a component may be below 0 by chance


@dataclass(frozen=True)
class Components:
    """The drivetrain as its components were measured.

    Attributes
    ----------
    p : DrivetrainParameters
        With these components, and the ratios n_T and n_m of the parameter file.
    values : Mapping
        Mean of each component over the trials, in the order of `COMPONENTS` [SI].
    covariance : Array (8, 8)
        Of these means.
    freedom : Mapping
        Degrees of freedom of the variance of each.
    trials : Mapping
        Names of the trials, by experiment.
    """

    p: DrivetrainParameters
    values: Mapping[str, float]
    covariance: Array
    freedom: Mapping[str, float]
    trials: Mapping[str, tuple[str, ...]]

    def se(self, name: str) -> float:
        """Standard error of a component."""
        k = list(COMPONENTS).index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def rows(self) -> list[dict[str, Any]]:
        """For JSON, in SI units: each component with its 95 % interval and its trials."""
        rows = []
        for name, value in self.values.items():
            experiment = COMPONENTS[name]
            half_width = float(scipy.special.stdtrit(self.freedom[name], 0.975)) * self.se(name)
            row = {
                "name": name,
                "value": value,
                "unit": PARAMETER_UNITS["k_tau" if name == "k_tau_n_m" else name],
                "standard_error": self.se(name),
                "low": value - half_width,
                "high": value + half_width,
                "degrees_of_freedom": self.freedom[name],
            }
            of_trials = {"experiment": experiment, "trials": self.trials[experiment]}
            rows.append({**finite_or_null(row), **of_trials})
        return rows


def components_of(
    tables: Mapping[str, pl.DataFrame], place: Sequence[str | None], file: DrivetrainParameters
) -> Components:
    """Gather the components of one joint and side: means over the trials that count.

    The variance of a mean is from the scatter of trials, or from their fits if that is larger;
    correlations are from the fits.

    Parameters
    ----------
    tables
        `actuator`, `belt` and `transmission` of the campaign.
    place
        Joint and side.
    file
        Parameters with the ratios.

    Raises
    ------
    InputError
        A table has no such trial, or a component is negative beyond its uncertainty.
    """
    rows_of_parts = component_rows(tables, place)
    values: dict[str, float] = {}
    freedom: dict[str, float] = {}
    covariance = np.zeros((len(COMPONENTS), len(COMPONENTS)))
    for part, rows in rows_of_parts.items():
        names = components_in(part)
        of_part = [list(COMPONENTS).index(name) for name in names]
        covariance[np.ix_(of_part, of_part)] = covariance_of_means(rows, names)
        for name in names:
            values[name] = float(np.mean(rows[name].to_numpy()))
            freedom[name] = float(len(rows) - 1) if len(rows) > 1 else np.inf

    trials = {part: tuple(rows["trial"]) for part, rows in rows_of_parts.items()}
    components = Components(file, values, covariance, freedom, trials)
    for name, value in values.items():
        if value < 0 and value + CERTAINLY_NEGATIVE * components.se(name) < 0:
            part = COMPONENTS[name]
            raise InputError(
                f"{part}.csv: {name} = {value:.4g} is negative; look for the cause in the {part}"
                " trials"
            )
    return replace(components, p=drivetrain_of(values, file))


def components_in(part: str) -> list[str]:
    """The components that an experiment measures."""
    return [name for name, experiment in COMPONENTS.items() if experiment == part]


def covariance_of_means(rows: pl.DataFrame, names: Sequence[str]) -> Array:
    """Covariance (k, k) of the means of k components over n trials."""
    n = len(rows)
    within = np.array([[mean_covariance(rows, a, b) for b in names] for a in names]) / n
    of_fits = np.sqrt(np.diag(within))
    # of all trials on the bench
    shared = np.array([rms(rows[f"{name}_se_bench"].to_numpy()) for name in names])
    of_fits_alone = np.sqrt(np.maximum(of_fits**2 - shared**2 / n, 0.0))
    scatter = np.zeros(len(names))
    if n > 1:
        scatter = rows.select(names).to_numpy().std(axis=0, ddof=1) / np.sqrt(n)
    se = np.hypot(np.maximum(of_fits_alone, scatter), shared)
    return np.asarray(within / np.outer(of_fits, of_fits) * np.outer(se, se))


def mean_covariance(rows: pl.DataFrame, a: str, b: str) -> float:
    """Mean covariance of two estimates over the trials."""
    if a == b:
        return float((rows[f"{a}_se"].to_numpy() ** 2).mean())
    column = f"cov_{a}_{b}" if f"cov_{a}_{b}" in rows.columns else f"cov_{b}_{a}"
    return float(np.mean(rows[column].to_numpy()))


def component_rows(
    tables: Mapping[str, pl.DataFrame], place: Sequence[str | None]
) -> dict[str, pl.DataFrame]:
    """Select the rows of each part that count, of one joint and side. Raises as `components_of`."""
    at_place = [
        pl.col(name).eq_missing(pl.lit(value, pl.String))
        for name, value in zip(PLACE, place, strict=True)
    ]
    rows_of_parts: dict[str, pl.DataFrame] = {}
    for part in PARTS:
        table = tables.get(part, pl.DataFrame())
        if table.is_empty():
            rows_of_parts[part] = table
            continue
        rows = table.filter(*at_place)
        if "amplitude_deg" in rows.columns:  # fits to whole trials
            rows = rows.filter(pl.col("amplitude_deg").is_null())
        # an actuator at rest lacks some
        rows_of_parts[part] = counted(rows.drop_nulls(components_in(part)))

    missing = [part for part, rows in rows_of_parts.items() if rows.is_empty()]
    if missing:
        has_clamped = missing[0] == "actuator" and len(tables.get("actuator", ())) > 0
        stands = ", with a shaft that turns" if has_clamped else ""
        raise InputError(
            f"the campaign has no {' and no '.join(missing)} trials of this joint and side{stands};"
            " record them"
        )
    return rows_of_parts


def drivetrain_of(values: Mapping[str, float], file: DrivetrainParameters) -> DrivetrainParameters:
    """The drivetrain with these components; a loss that is negative by chance is set to 0."""
    named = {name: max(value, 0.0) for name, value in values.items() if name != "k_tau_n_m"}
    return replace(file, k_tau=values["k_tau_n_m"] / file.n_m, K_s2=0.0, **named)
