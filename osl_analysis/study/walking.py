"""Walking in the study: whole campaigns of crossings whose truth is known, from sensors or from recorded files."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.simulator import crossing as simulated
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.simulator.step import GaitTrial, draw_step
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.study.bench import STUDIED_QUANTITIES, StudyInputs, StudyRow
from osl_analysis.trial import Trial
from osl_analysis.walking.bodies import static_calibration
from osl_analysis.walking.crossing import Crossing, analyse_crossing
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.plate import Stance, identify_plate_model
from osl_analysis.walking.platform import identify_platform
from osl_analysis.walking.response import Ensemble, common_errors, fit_response, fit_without_offset, isolate_response
from osl_analysis.walking.settings import FootSettings, WalkingAnalysis

Made = TypeVar("Made")


@dataclass(frozen=True)
class StudyLaboratory:
    """The settings that make a crossing, and those that analyse it."""

    settings: SimulationSettings
    gait: WalkingSettings
    p: DrivetrainParameters
    analysis: WalkingAnalysis
    recorded: Callable[[str, simulated.SimulatedCrossing], Crossing] | None = None
    """How a crossing that was recorded by markers and plate is analysed; None: angle and torque themselves are seen."""

    def unperturbed(self, name: str) -> Crossing:
        """An unperturbed crossing through the sensors."""
        return self.seen(name, self.walk(name, False), noisy=True)

    def perturbed(self, name: str) -> tuple[Crossing, LinearFit, Mapping[str, float]]:
        """A perturbed crossing through the sensors; the same estimator's fit to the perturbation alone, through ideal
        sensors; and the impedance that the leg rendered, by name. The same crossing is also simulated without the
        perturbation, whose effect is the difference."""
        unperturbed, walked = self.walk(name, False), self.walk(name, True)
        alone = unperturbed_gait([self.seen(name, unperturbed, noisy=False)], 1)
        walked_ideally, analysis = self.seen(name, walked, noisy=False), self.analysis
        # the same crossing's stance without the perturbation, whatever the perturbation does to it
        ideal = isolate_response(walked_ideally, alone, analysis, "unperturbed")
        exact = fit_without_offset(ideal.fitted_motion, ideal.fitted_torque)
        return self.seen(name, walked, noisy=True), exact, simulated.impedance_of_leg(walked, unperturbed)

    def walk(self, name: str, perturbed: bool) -> simulated.SimulatedCrossing:
        """One crossing. Its name determines its random quantities, which are the same with and without the
        perturbation."""
        step = draw_step(GaitTrial(name, self.settings.seed, self.gait))
        effects = drivetrain_effects(self.settings) | {"cancels_friction": True}
        return simulated.simulate_crossing(step, perturbed, effects, self.p)

    def seen(self, name: str, walked: simulated.SimulatedCrossing, noisy: bool) -> Crossing:
        """Filtered angle and torque of a crossing at the markers' rate. Noise of markers and forces acts on a lever of
        0.1 m: from the middle of a cluster to its markers, and from the plate to the ankle."""
        if noisy and self.recorded is not None:
            return self.recorded(name, walked)
        every, rate = self.gait.rates.motion_hz // self.gait.rates.points_hz, float(self.gait.rates.points_hz)
        effects, lever_m, found = self.gait.effects, 0.1, []
        for effect, size, signal in (
            ("angle_noise", 1e-3 * effects.marker_noise.value / lever_m, walked.motion.theta),
            ("torque_noise", np.hypot(effects.moment_noise.value, lever_m * effects.force_noise.value), walked.torque),
        ):
            noise = float(size) * stream(self.settings.seed, name, effect).standard_normal(len(signal[::every]))
            found.append(self.analysis.low_pass(signal[::every] + noisy * noise, rate))
        step, platform = walked.step, walked.platform
        seen = walked.time[::every], found[0], found[1], platform.angle[::every]
        stance, none = Stance(step.heel_strike, step.toe_off), np.zeros((0, len(found[0])))
        return Crossing(name, *seen, stance, platform.onset, 0.0, none)


def recording(laboratory: StudyLaboratory, folder: Path, sources: Path, perturbed: Sequence[str]) -> StudyLaboratory:
    """A laboratory whose noisy crossings are recorded by markers and plate, written as C3D in `folder`, ingested and
    analysed, after its static trial and six trials of the unloaded plate. The foot's inertial parameters are known:
    otherwise its inertia would be part of the ankle's. What the platform's motions share is known from the `perturbed`
    crossings; one that cannot be read has no part."""
    gait, mass, foot = laboratory.gait, laboratory.gait.effects.foot_inertia.value, None
    if mass:  # without a mass there is nothing to weigh
        inertia = mass * gait.foot.gyration_m[1] ** 2
        foot = FootSettings(mass_kg=mass, centre_of_mass_m=gait.foot.centre_of_mass_m, inertia_kg_m2=inertia)
    analysis = laboratory.analysis.model_copy(update={"foot": foot})

    def ingested(name: str) -> Trial:
        row = {"trial": name, "mocap": f"vicon/{name}.c3d", "mocap_source": "vicon"}
        return trial_from_files(row, folder, sources)

    def recorded(name: str, walked: simulated.SimulatedCrossing) -> Trial:
        if not (folder / "vicon" / f"{name}.c3d").exists():
            simulated.write_crossing_capture(folder, walked)
        return ingested(name)

    rows = [{"trial": "static_1", "experiment": "static"}]
    rows += [{"trial": f"plate_{i}", "experiment": "plate"} for i in range(6)]
    for row in rows:
        simulated.simulate_walking_trial(row, laboratory.settings, gait, laboratory.p, folder)
    standing, *unloaded = (ingested(row["trial"]) for row in rows)
    calibration, moved = static_calibration(standing, analysis), []
    plate = identify_plate_model([(trial, calibration) for trial in unloaded], analysis)
    for name in perturbed:
        with suppress(OslAnalysisError):
            moved.append((recorded(name, laboratory.walk(name, True)), calibration))
    platform = identify_platform(moved, analysis)

    def analysed(name: str, walked: simulated.SimulatedCrossing) -> Crossing:
        trial, is_perturbed = recorded(name, walked), walked.platform.onset is not None
        return analyse_crossing(trial, calibration, plate, is_perturbed, analysis, platform)

    return replace(laboratory, analysis=analysis, recorded=analysed)


def walking_rows(inputs: StudyInputs, numbers: Iterable[int], recorded: bool) -> Iterator[StudyRow]:
    """Estimates of campaigns, by their numbers. The signals of `recorded` campaigns go through files and ingest."""
    if inputs.gait is None:
        raise InputError(
            f"{inputs.study.simulation}: names no 'walking' file, which the study of walking needs; add it as in "
            "config/simulation/default.yaml"
        )
    laboratory = StudyLaboratory(inputs.simulation, inputs.gait, inputs.p, inputs.walking)
    for number in numbers:
        names = [f"study_{number:05d}_{i}" for i in range(2 * inputs.study.crossings)]
        if not recorded:
            yield from campaign_rows(number, names, laboratory)
            continue
        own = inputs.simulation.model_copy(update={"seed": inputs.simulation.seed + 1 + number})
        with TemporaryDirectory() as folder:
            session = recording(replace(laboratory, settings=own), Path(folder), inputs.sources, names[1::2])
            yield from campaign_rows(number, names, session)


def campaign_rows(number: int, names: Sequence[str], laboratory: StudyLaboratory) -> list[StudyRow]:
    """Estimates of a campaign of crossings, every second one of which is perturbed: of the first perturbation, the mean
    of all, and the ensemble. The truth is the estimate of the same estimator for the same perturbations without gait,
    with ideal sensors. `model_error` is the truth minus the impedance that the leg rendered."""
    analysis = laboratory.analysis
    gait = unperturbed_gait(usable(laboratory.unperturbed, names[::2]), analysis.fewest_unperturbed)
    perturbed = usable(laboratory.perturbed, names[1::2])
    responses = [isolate_response(one, gait, analysis, analysis.perturbed_stance) for one, *_ in perturbed]
    fits = [fit_response(response) for response in responses]
    joined = Ensemble(responses)
    resampled, ensemble = joined.resampled(300), joined.fitted().fit
    common = common_errors(responses)
    rows: list[StudyRow] = []
    for quantity in STUDIED_QUANTITIES:
        truths = np.array([exact[quantity] for _, exact, _ in perturbed])
        rendered = np.array([leg[f"{quantity}_rendered"] for *_, leg in perturbed])
        estimates = [fit[quantity] for fit in fits]
        single, mean = fits[0], over_repeats(estimates, common[quantity])
        made: list[tuple[str, str, int, Sequence[float]]] = [
            ("single perturbation", single.interval_method, 1,
             (single[quantity], single.se(quantity), *single.interval(quantity))),
            ("mean of perturbations", "Student", len(fits), (mean.mean, mean.se, mean.low, mean.high)),
            ("ensemble", "bootstrap", len(fits),
             (ensemble[quantity], resampled.se(quantity), *resampled.interval(quantity))),
        ]  # fmt: skip
        for estimator, method, first, numbers in made:
            truth = float(np.mean(truths[:first]))
            row: StudyRow = {"trial": f"study_{number:05d}", "quantity": quantity, "bound": None}
            row |= {"truth": truth, "model_truth": truth, "model_error": truth - float(np.mean(rendered[:first]))}
            row |= {"estimator": estimator, "interval_method": method}
            rows.append(row | dict(zip(("value", "se", "low", "high"), numbers, strict=True)))
    return rows


def usable(make: Callable[[str], Made], names: Iterable[str]) -> list[Made]:
    """Result of `make` for each name. Crossings that the analysis refuses are excluded, as in a recorded campaign. If
    all are refused, the error is that of the last one."""
    made, refused = [], None
    for name in names:
        try:
            made.append(make(name))
        except OslAnalysisError as error:
            refused = error
    if refused is not None and not made:
        raise refused
    return made
