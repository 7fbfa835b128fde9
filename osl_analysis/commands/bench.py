"""The fits of bench trials, the same for the workflow, the command line, `watch` and notebooks; and
the jobs on tables of the bench."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench import bench_settings as choices
from osl_analysis.bench import (
    condition_tables,
    controller_law,
    frequency_response,
    impedance,
    known_spring,
    measured_components,
    phasors,
    prediction,
    torque_angle,
    torque_angle_tables,
)
from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS, actuator_table, actuator_trial
from osl_analysis.bench.analysis import QUANTITIES, analysed
from osl_analysis.bench.belt import belt_curve, belt_table, belt_trial
from osl_analysis.bench.bench_frame import measured_frame
from osl_analysis.bench.component_summary import PLACE, part_summary
from osl_analysis.bench.effects import IMPEDANCE, plain_sums
from osl_analysis.bench.fit_tables import FitTables, tables_of_fit
from osl_analysis.bench.fixture import fixture_column, with_fixture
from osl_analysis.bench.plausibility import plausible
from osl_analysis.bench.record import Record, read_record, stored_record, with_actuator
from osl_analysis.bench.recorded_motion import record_of_trial, sine_record
from osl_analysis.bench.transmission import LOSSES, transmission_of, transmission_table
from osl_analysis.campaign.configuration import Config, over_default, own_fields, read_section
from osl_analysis.config.experiments import EXPERIMENTS, FitJob
from osl_analysis.errors import IdentifiabilityError, InputError, nearest, printable_lines
from osl_analysis.files import shipped
from osl_analysis.ingest.examine import check_recording, saturated
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.judging import judged, marked
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.words import finding_text, words_of
from osl_analysis.model.actuator_in_time import Controller
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    DrivetrainParameters,
    FileOrNone,
    joint_admittance,
    known_parameters,
)
from osl_analysis.table import finite_or_null, read_table, with_evidence, write_table
from osl_analysis.trial import Trial


def fit_belt_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.BeltAnalysis
) -> FitTables:
    """The belt's row, and torque against deflection. `parameters` is the device's file, None for
    one without."""
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    trial = with_fixture(trial, settings.fixture)
    belt = belt_trial(trial, p, settings)
    return tables_of_fit(
        replace(belt.series(), motion=belt.sums.columns["theta"]),  # against the deflection
        lambda: {"timebase": belt.time_base(["K_s"])},
        belt=plausible(belt_table(belt), rails, p, "K_s"),
        belt_curves=belt_curve(belt),
    )


def fit_transmission_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.SteppedSineAnalysis
) -> FitTables:
    """The transmission's rows, and the series of the fit to all amplitudes."""
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    trial = with_fixture(trial, settings.fixture)
    analysis = transmission_of(sine_record(trial, settings))
    table = plausible(transmission_table(analysis), rails, p, "B_j", "J_j")
    table = table.with_columns(fixture_column(trial))
    return tables_of_fit(
        analysis.series(),
        lambda: {"timebase": analysis.time_base(LOSSES)},
        transmission=table,
    )


def fit_impedance_trial(
    trial: Trial,
    parameters: FileOrNone,
    condition: impedance.DesiredImpedance | None,
    weight: Weight,
    models: choices.ModelComparison,
    settings: choices.ImpedanceAnalysis,
    windows: str | None = None,
) -> FitTables:
    """Fit Eq. 15 to a trial, and tell what else its record shows.

    Parameters
    ----------
    trial : Trial
    parameters : Path or None
        The device's file; None for a device without one.
    condition : DesiredImpedance or None
        What the leg was asked to render, as far as it is known.
    weight : Weight
        W of Eq. 14.
    models : ModelComparison
    settings : ImpedanceAnalysis
    windows : str or None
        Those of the sheet [s], which are fitted where the motion is no stepped sine.

    Returns
    -------
    FitTables
        Where the gains are known, with the `record` with which the drivetrain is compared.
    """
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    trial = with_fixture(trial, settings.fixture)
    record = record_with_actuator(trial, settings, windows)
    stated = condition or impedance.DesiredImpedance(None, None, None)
    programmed = stated.gains(p, weight)
    law = pl.DataFrame(schema=controller_law.LAW_COLUMNS)
    gains = programmed  # those that ran: by the log of the controller others than programmed
    if p is not None and programmed is not None:
        law = controller_law.law_table(record, p, programmed, models.sign_width)
        measured, cancelled_friction = controller_law.law_that_ran(law, programmed, p)
        cancels_friction = measured.cancels_friction and cancelled_friction == p
        gains = replace(measured, cancels_friction=cancels_friction)
    analysis, table = impedance.fit_and_judge_impedance(record, rails, p, condition, gains)
    table = table.with_columns(fixture_column(trial))

    def others() -> dict[str, pl.DataFrame]:
        columns = stated.columns() if condition else {}
        expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j) if p and gains else None
        by_frequency = phasors.phasor_table(trial.name, phasors.phasors_of_record(record))
        response = frequency_response.impedance_over_frequency(record, analysis.whole, expected)
        return {
            "phasors": by_frequency.with_columns(**columns),
            "response": response.with_columns(**columns),
            "law": law.with_columns(**columns),
            "timebase": analysis.time_base(QUANTITIES),
            "record": stored_record(record) if gains else pl.DataFrame(schema={"time": pl.Float64}),
        }

    return tables_of_fit(analysis.series(), others, impedance=table)


def record_with_actuator(
    trial: Trial, settings: choices.ImpedanceAnalysis, windows: str | None
) -> Record:
    """The record of a trial with its actuator's signals. The clocks of the devices, which take
    0.4 GB of an hour, are found for it alone."""
    trial = replace(trial, clocks={})
    return with_actuator(record_of_trial(trial, settings, windows), trial)


def fit_actuator_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.ActuatorAnalysis
) -> FitTables:
    """The row of an actuator alone, and the series of its fit."""
    p = known_parameters(parameters)
    check_recording(trial, settings, "torque_m", angle=None)
    rails = saturated(trial, "torque_m", "current")
    actuator = actuator_trial(trial, settings)
    table = plausible(actuator_table(actuator), rails, p, "k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
    is_velocity = table["motion"][0] == "omega_m"
    series = replace(actuator.series(), motion=actuator.record.theta, is_velocity=is_velocity)
    fitted = [name for name in ACTUATOR_PARAMETERS if name in actuator.whole.names]
    return tables_of_fit(series, lambda: {"timebase": actuator.time_base(fitted)}, actuator=table)


def fit_torque_angle_trial(
    trial: Trial, settings: choices.TorqueAngleAnalysis, condition: Mapping[str, Any] | None = None
) -> FitTables:
    """The row of torque against angle, and its curves; `condition` may name the curve that it
    should follow."""
    desired = (condition or {}).get("desired")
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    trial = with_fixture(trial, settings.fixture)
    cycles = torque_angle.torque_angle_trial(trial, settings)
    table = torque_angle_tables.torque_angle_table(cycles, desired)
    return tables_of_fit(
        cycles.series(),
        lambda: {
            "torque_angle_cycles": torque_angle_tables.cycle_table(cycles),
            "timebase": cycles.time_base(),
        },
        torque_angle=table.with_columns(rails, fixture_column(trial)),
        torque_angle_curves=torque_angle_tables.curve_table(cycles, desired),
    )


def fit_calibration_trial(
    trial: Trial, settings: choices.ImpedanceAnalysis, condition: Mapping[str, Any] | None = None
) -> FitTables:
    """What a bench reads of a spring or an inertia that is known, or of its fixture alone;
    `condition` has the columns `known_...` and `fixture`."""
    stated = condition or {}
    uncertainty = (stated.get("known_percent") or 0.0) / 100
    is_fixture_alone = bool(stated.get("fixture"))
    known = known_spring.Known(
        stated.get("known_K"), stated.get("known_I"), uncertainty, is_fixture_alone
    )
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    if is_fixture_alone:  # which nothing is taken off
        settings = settings.model_copy(update={"fixture": None})
    trial = with_fixture(trial, settings.fixture)
    record = record_of_trial(trial, settings)
    frame = measured_frame(trial, settings, record.groups)
    if frame is not None and settings.bench_stiffness is None:  # the spring is behind the frame
        settings = settings.model_copy(update={"bench_stiffness": frame.stiffness})
        record = record_of_trial(trial, settings)
    analysis = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE)
    table = known_spring.calibration_table(analysis, known, frame).with_columns(rails)
    return tables_of_fit(
        analysis.series(), lambda: {"timebase": analysis.time_base(QUANTITIES)}, calibration=table
    )


def summarise(table: Path, output: Path, data: str = "") -> None:
    """What a table of the campaign tells of its trials together: K, B and I of conditions with
    several trials, the frequency response averaged over the amplitudes, the summary of a part."""
    if table.stem == "impedance":
        rows = with_evidence(table, ("amplitude_deg", "doubtful"))
        summary = condition_tables.repeated_trials_table(rows)
    elif table.stem == "phasors":
        rows = with_evidence(table, ("amplitude_deg", "doubtful"))
        summary = frequency_response.frequency_response_table(rows)
    else:
        summary = part_summary(table.stem, with_evidence(table))
    write_table(summary, output, data)


def compare_controllers(table: Path, output: Path, data: str = "") -> None:
    """Compensated beside uncompensated trials of the same desired impedance."""
    needed = (
        "commanded_deg",
        "amplitude_deg",
        "controller",
        "K_d",
        "B_d",
        "K",
        "B",
        "VAF",
        "torque_error",
    )
    write_table(condition_tables.compensation_table(read_table(table, needed)), output, data)


def gather_predictions(
    records: Sequence[Path],
    table: Path,
    law: Path,
    components: Mapping[str, Path],
    unpredicted: Mapping[str, str],
    weight: Weight,
    sign_width: float,
    settings: choices.FilterSettings,
    output: Path,
    causes: Path,
    frequencies: Path,
    parameters: FileOrNone = None,
    data: str = "",
) -> None:
    """Write the predictions of all trials with their intervals, what would explain what they leave,
    and how much that is at each frequency.

    Parameters
    ----------
    records
        Those of the trials' fits.
    table, law
        `impedance.csv`, and `law.csv`: where other gains ran than were programmed, these count.
    unpredicted
        Why other trials with known gains have no prediction.
    weight
        W of Eq. 14.
    sign_width
        Over which the controller smooths the sign of the velocity [rad/s].
    """
    evidence = with_evidence(table)
    fits = evidence.filter(pl.col("amplitude_deg").is_null())
    p = known_parameters(parameters)
    measured = {part: read_table(path) for part, path in components.items()}
    laws = read_table(law)
    record_of_trial = {path.stem: path for path in records}
    without = dict(unpredicted)

    def predicted_trial(
        row: Mapping[str, Any], p: DrivetrainParameters, parts: measured_components.Components
    ) -> PredictedTrial:
        desired = impedance.DesiredImpedance(row["controller"], row["K_d"], row["B_d"])
        gains = desired.gains(p, weight)
        assert gains is not None  # of other trials no record is read
        record = read_record(record_of_trial[row["trial"]], settings.low_pass)
        of_trial = laws.filter(trial=row["trial"])
        measured_gains, cancelled_friction = controller_law.law_that_ran(of_trial, gains, p)
        controller = Controller(measured_gains, cancelled_friction, sign_width)
        terms, misses = prediction.prediction_terms(record, controller, parts)
        is_programmed = (measured_gains, cancelled_friction) == (gains, p)
        return PredictedTrial(terms, misses, "programmed" if is_programmed else "measured")

    predictions: list[pl.DataFrame] = []
    of_components: list[pl.DataFrame] = []
    misses = [pl.DataFrame(schema=prediction.MISSES)]
    with_record = fits.filter(pl.col("trial").is_in(list(record_of_trial)))
    for at_place in with_record.partition_by(PLACE, maintain_order=True):
        assert p is not None  # without a parameter file no gains are known
        predicted: dict[str, PredictedTrial] = {}
        try:
            parts = measured_components.components_of(measured, at_place.select(PLACE).row(0), p)
        except (InputError, IdentifiabilityError) as error:
            reason = f"components that predict a torque ({error})"
            without.update(dict.fromkeys(at_place["trial"], reason))
            continue
        for row in at_place.to_dicts():
            try:
                predicted[row["trial"]] = predicted_trial(row, p, parts)
            except (InputError, IdentifiabilityError) as error:
                without[row["trial"]] = f"components that predict a torque ({error})"
        if not predicted:
            continue
        misses += [trial.misses for trial in predicted.values()]
        terms = {name: trial.terms for name, trial in predicted.items()}
        law_names = {name: trial.law for name, trial in predicted.items()}
        of_terms = at_place.filter(pl.col("trial").is_in(list(terms)))
        rows, rows_of_components = prediction.prediction_table(terms, of_terms, parts)
        law_of_trial = pl.col("trial").replace_strict(law_names)
        predictions.append(rows.with_columns(law=law_of_trial))
        of_components.append(rows_of_components)

    why_missing = pl.col("trial").replace_strict(without, default=None, return_dtype=pl.String)
    unknown = pl.DataFrame(schema=dict.fromkeys(prediction.NUMBERS, pl.Float64))
    others = fits.filter(pl.col("trial").is_in(list(without))).select(
        "trial", *PLACE, "controller", "K_d", "B_d", missing_components=why_missing
    )
    others = pl.concat([others, unknown], how="diagonal_relaxed")
    others = others.with_columns(doubtful=pl.lit(None, pl.String))
    write_table(pl.concat([others, *predictions], how="diagonal_relaxed"), output, data)

    no_causes = pl.DataFrame(schema=[*PLACE, "component"])
    write_table(pl.concat([no_causes, *of_components], how="diagonal_relaxed"), causes, data)

    condition = fits.select("trial", *PLACE, "controller", "K_d", "B_d", "doubtful")
    of_condition = condition.join(pl.concat(misses), on="trial", maintain_order="left")
    write_table(of_condition, frequencies, data)


@dataclass(frozen=True)
class PredictedTrial:
    """What one trial gives to the tables of predictions."""

    terms: pl.DataFrame  # as `prediction_terms`
    misses: pl.DataFrame  # as `miss_over_frequency`
    law: str  # that its controller ran: programmed or measured


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial. Every column of its table is an attribute, with the value of the fit to all
    data: `fit.K`, `fit.K_se`, `fit.VAF`; `fit.K_interval` is (low, high), the 95 % interval.
    Meaning and unit of each are told by `osl-analysis results --columns`.

    Attributes
    ----------
    experiment : str
        It names the table that the fit has rows of in a campaign.
    table : DataFrame
        Those rows: one per amplitude, if there are several, and last the fit to all data.
    series : DataFrame
        `time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit
        explains.
    curves : DataFrame or None
        Torque over angle, rows of `belt_curves` or `torque_angle_curves`; None for another
        experiment.
    findings : list
        What was judged of each row: doubts, what could not be checked, notes.
    """

    experiment: str
    table: pl.DataFrame
    series: pl.DataFrame
    curves: pl.DataFrame | None
    findings: Sequence[Sequence[Finding]] = ()

    @property
    def row(self) -> Mapping[str, Any]:
        """The fit to all data."""
        return self.table.row(-1, named=True)

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do.
        Empty: nothing."""
        return "\n".join(self.sentences(Grade.DOUBTS))

    @property
    def not_checked(self) -> str:
        """What could not be checked, and why, a line each, and what is to be known; empty if there
        is nothing."""
        lines = [f"not checked: {text}" for text in self.sentences(Grade.UNCHECKED)]
        lines += [f"remark: {text}" for text in self.sentences(Grade.NOTES)]
        return "\n".join(lines)

    def sentences(self, *grades: Grade) -> list[str]:
        """The findings of some grades about the fit to all data, in words."""
        of_whole = self.findings[-1] if self.findings else ()
        return [finding_text(finding, self.row) for finding in of_whole if finding.grade in grades]

    def __getattr__(self, name: str) -> Any:
        """A column of the table by name, of the fit to all data, or `NAME_interval`."""
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        row = self.row
        quantity = name.removesuffix("_interval")
        if quantity != name and f"{quantity}_low" in row:
            return row[f"{quantity}_low"], row[f"{quantity}_high"]
        if name not in row:
            known = ", ".join(estimated(row))
            raise AttributeError(
                f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has {known}"
            )
        return row[name]

    def __dir__(self) -> list[str]:
        intervals = [f"{name}_interval" for name in estimated(self.row)]
        return sorted({*super().__dir__(), *self.row, *intervals})

    def __repr__(self) -> str:
        text = f"{self.experiment}, {estimates_text(self.table.tail(1), self.findings[-1:])}"
        if self.not_checked:
            text += f"\n{self.not_checked}"
        return printable_lines(text)


def job_of(experiment: str) -> FitJob:
    """The fit of an experiment's trials. Raises InputError where it has none."""
    fit = EXPERIMENTS[experiment].fit
    if fit is None:
        raise InputError(
            f"a trial of '{experiment}' is not fitted alone; choose another experiment for it"
        )
    return fit


def fit_settings(experiment: str, config: Path) -> tuple[dict[str, Any], DoubtfulFits]:
    """Read the settings of an experiment's fit.

    Parameters
    ----------
    experiment : str
    config : Path
        A configuration file, which may override fields of the default only.

    Returns
    -------
    settings : dict
        By the arguments of the fit's job.
    limits : DoubtfulFits
        Beyond which a fit is doubtful.
    """
    settings: dict[str, Any] = {}
    for argument, (section, _) in job_of(experiment).settings.items():
        model: Any = Config.model_fields[section].annotation
        settings[argument] = read_section(config, section, model)
    return settings, read_section(config, "doubtful", DoubtfulFits)


def campaign_parameters(config: Path) -> Path | None:
    """The parameter file that a configuration names, which may override fields of the default only;
    None: null."""
    name = over_default(own_fields(config))["parameters"]
    return None if name is None else shipped(str(name))


def fitted_trial(
    experiment: str,
    trial: Trial,
    parameters: Path | None,
    settings: Mapping[str, Any],
    condition: Any = None,
    windows: str | None = None,
) -> FitTables:
    """Fit a trial as the job of a campaign does.

    Parameters
    ----------
    experiment : str
    trial : Trial
    parameters : Path or None
        The device's file; None for a device without one.
    settings : Mapping
        By the arguments of the job, as of `fit_settings`.
    condition : DesiredImpedance or Mapping or None
        What the sheet states; a mapping has its cells by column.
    windows : str or None
        Those of the sheet [s].

    Raises
    ------
    InputError
        The experiment has no fit, or the recording cannot be fitted.
    """
    fit = job_of(experiment)
    arguments = dict(settings)
    if fit.parameters:
        arguments["parameters"] = parameters
    if fit.sheet:
        arguments["condition"] = condition
    if fit.windows:
        arguments["windows"] = windows
    module_name, _, function_name = fit.job.partition(".")
    module = import_module(f"osl_analysis.commands.{module_name}")
    fit_it: Callable[..., FitTables | Mapping[str, pl.DataFrame]] = getattr(module, function_name)
    tables = fit_it(trial, **arguments)
    return tables if isinstance(tables, FitTables) else FitTables(tables)


def fit_trial(
    experiment: str,
    trial: Trial,
    device: Path | None,
    settings: Mapping[str, Any],
    limits: DoubtfulFits,
    *stated: Any,
) -> Fit:
    """Fit a trial and judge it; `fit_settings` gives `settings` and `limits`, the rest and errors
    as `fitted_trial`."""
    tables = fitted_trial(experiment, trial, device, settings, *stated).estimates
    name = EXPERIMENTS[experiment].tables[0].name
    findings = judged(tables[name], limits.of(name), name)
    curves = [table for name, table in tables.items() if name.endswith("_curves")]
    no_torque = pl.DataFrame(schema=dict.fromkeys(("time", "torque", "torque_model"), pl.Float64))
    return Fit(
        experiment=experiment,
        table=marked(tables[name], findings, name),
        series=tables.get("torque", no_torque),
        curves=curves[0] if curves else None,
        findings=findings,
    )


UNIT_OF = {
    "K": "N·m/rad",
    "B": "N·m·s/rad",
    "B_viscous": "N·m·s/rad",
    "I": "kg·m²",
    "K_s": "N·m/rad",
    "B_j": "N·m·s/rad",
    "B_j_viscous": "N·m·s/rad",
    "J_j": "kg·m²",
    "T_C": "N·m",
    "k_tau_n_m": "N·m/A",
    "f_C": "N·m",
    "f_G": "N·m/A",
    "B_m": "N·m·s/rad",
    "J_m": "kg·m²",
    "offset": "N·m",
    "drift": "N·m/s",
    "K_secant": "N·m/rad",
    "lag_s": "s",
    "gain": "",
    "inertia": "kg·m²",
    "weight": "N·m/rad",
    "K_unloading": "N·m/rad",
    "energy_stored": "J",
    "energy_returned": "J",
    "energy_lost": "J",
}


def rows_json(table: pl.DataFrame, findings: Sequence[Sequence[Finding]] = ()) -> str:
    """A table as JSON in SI units: an object per row, null for what is not finite, with its
    `findings`."""
    rows: list[dict[str, Any]] = [finite_or_null(row) for row in table.to_dicts()]
    for row, of_row in zip(rows, findings, strict=False):
        row["findings"] = [finding_json(finding, row) for finding in of_row]
    return json.dumps(rows, indent=2)


def finding_json(finding: Finding, row: Mapping[str, Any]) -> dict[str, Any]:
    """A finding about a row as an object of JSON."""
    return {
        "grade": finding.grade.value,
        "cause": finding.cause,
        "sizes": dict(finding.sizes),
        "without": dict(finding.without),
        **words_of(finding, row)._asdict(),
        "evidence": [finite_or_null(asdict(number)) for number in finding.evidence],
    }


def estimates_text(estimates: pl.DataFrame, findings: Sequence[Sequence[Finding]] = ()) -> str:
    """The estimates as text: a line per fit and quantity, with 95 % interval and VAF, and the
    doubts about each row."""
    lines: list[str] = []
    for row, of_row in zip_longest(estimates.to_dicts(), findings, fillvalue=()):
        assert isinstance(row, dict)
        quality = f"VAF {row['VAF']:.2f} %" if "VAF" in row else "no VAF"
        if "R2" in row:
            quality += f", R2 {row['R2']:.5f}, condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {fitted_motion(row)}: {quality}")
        lines += [estimate_line(row, name) for name in estimated(row)]
        for finding in of_row:
            if finding.grade is Grade.DOUBTS:
                lines.append(f"  doubtful: {finding_text(finding, row)}")
    lines.append(
        "± is the half-width of the 95 % interval, by the method that interval_method names"
    )
    return "\n".join(lines)


def fitted_motion(row: Mapping[str, Any]) -> str:
    """What of a trial is fitted: cycles, an amplitude, or a motion with its band."""
    if "cycles" in row:
        return cycles_text(row)
    if row.get("amplitude_deg") is not None:
        return f"{row['amplitude_deg']:g} deg"
    if row.get("excitation") in (None, "stepped sine"):
        return "all amplitudes"
    kind = "periodic" if row["excitation"] == "periodic" else "any"
    return (
        f"{row['fitted_s']:.1f} s of {kind} motion, {row['band_low_hz']:.3g} to"
        f" {row['band_high_hz']:.3g} Hz, {row['theta_rms_deg']:.2g} deg RMS"
    )


EVEN = 1.1  # ratio of an interval's sides below which it is printed with a ±
LEFT_OUT_CYCLES = {"settled": "first", "smaller": "below 90 % of the range", "partial": "not whole"}
"""Why cycles are left out, by the begin of the column with their number."""


def cycles_text(row: Mapping[str, Any]) -> str:
    left_out = []
    for kind, reason in LEFT_OUT_CYCLES.items():
        number = row.get(f"{kind}_cycles")
        if number:
            left_out.append(f"{number} {reason}")
    text = f"mean of cycles: {row['cycles']}"
    return f"{text} (left out: {', '.join(left_out)})" if left_out else text


def estimate_line(row: Mapping[str, Any], name: str) -> str:
    """One estimate with its interval and its range over single amplitudes."""
    interval = interval_text(row[name], row.get(f"{name}_low"), row.get(f"{name}_high"))
    line = f"  {name:<15}{row[name]:>12.5g} {interval:<12} {UNIT_OF.get(name, '')}"
    lowest = row.get(f"{name}_amplitudes_low")
    if lowest is not None:
        highest = row[f"{name}_amplitudes_high"]
        line += f", single amplitudes {lowest:.5g} to {highest:.5g}"
    return line


def interval_text(value: float, low: float | None, high: float | None) -> str:
    """The half-width of an interval, or its ends where these lie at other distances."""
    if low is None or high is None:
        return ""
    above = high - value
    below = value - low
    if max(above, below) > EVEN * min(above, below):
        return f"({low:.4g} to {high:.4g})"
    return f"± {above:.2g}"


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities that a fit estimates (a belt at a constant velocity has no B_j), or all its
    numbers."""
    quantities = [name for name in UNIT_OF if f"{name}_se" in row and row[name] is not None]
    return quantities or [name for name, value in row.items() if isinstance(value, float)]
