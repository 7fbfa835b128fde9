"""The platform's motion in a campaign: the shape that crossings share, when each starts, and the trigger's latency."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.signals import runs
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import Calibrations, StaticCalibration, calibration_of
from osl_analysis.walking.cluster import BodyMotion, Mask, Poses, reference_positions, segment_poses
from osl_analysis.walking.plate import rotation_from_rest
from osl_analysis.walking.platform_jackknife import without_groups
from osl_analysis.walking.platform_motion import PlatformTrack, shared_directions
from osl_analysis.walking.platform_rank import gate
from osl_analysis.walking.platform_shape import Alignment, PlatformTemplate
from osl_analysis.walking.platform_template import platform_template
from osl_analysis.walking.settings import PlatformMotionSettings, PlatformSettings
from osl_analysis.walking.trigger import TriggerLatency, trigger_edge, trigger_latency

FADE_S = 0.025
"""Time [s] over which the shape gives way to a crossing's own motion, at the shape's end."""

NUMBERS = (
    "onset_s", "template_onset_s", "template_onset_se_s", "shared_onset_se_s", "onset_shape_s", "amplitude", "duration",
    "misfit",
)  # fmt: skip
MORE_NUMBERS = ("trigger_s", "latency_s", "latency_sd_s")
PLATFORM_COLUMNS = (
    {"trial": pl.String}
    | dict.fromkeys(NUMBERS, pl.Float64)
    | {"follows": pl.Int64, "directions": pl.Int64}
    | dict.fromkeys(MORE_NUMBERS, pl.Float64)
    | {"trigger_used": pl.Int64}
)


@dataclass(frozen=True)
class PlatformModel:
    """What the platform's motions have in common.

    template: the shape; None if they share none.
    reason: why there is no shape.
    alignments: how each perturbed crossing follows it, by trial.
    triggers: time [s] of the trigger's edge, by trial, where it is recorded.
    latency: of the motion behind the trigger; None where no trigger is recorded, or no shape shared.
    leave_out: the shape without each of up to ten groups of crossings.
    """

    template: PlatformTemplate | None
    reason: str | None
    alignments: dict[str, Alignment]
    triggers: dict[str, float]
    latency: TriggerLatency | None
    leave_out: tuple[PlatformTemplate, ...] = ()

    def onset(self, trial: str, own: float) -> float:
        """Onset [s] of a trial's perturbation. `own` [s] is the one that the trial shows alone.

        From the trigger, where its latency is constant and the trigger is sampled more finely than the shape tells the
        start, or where the trial does not follow the shape; else from the shape.
        """
        a = self.alignments.get(trial)
        follows = a is not None and a.follows
        late = self.latency
        constant = late is not None and late.used and trial in self.triggers
        if late is not None and constant and (not follows or late.resolution < late.template_se):
            return self.triggers[trial] + late.mean
        return a.start if a is not None and follows else own

    def onset_se(self, a: Alignment) -> float:
        """Standard error [s] of a start by the shape: its crossing's noise, and that of the shape's own start."""
        return float(np.hypot(a.start_se, self.template.start_se if self.template is not None else 0.0))

    def followed(self, trial: str) -> Alignment | None:
        """How a trial follows the shape; None if it does not."""
        a = self.alignments.get(trial)
        return a if self.template is not None and a is not None and a.follows else None


ALONE = PlatformModel(None, "each crossing is analysed alone", {}, {}, None)
"""No shared motion of the platform."""


def identify_platform(
    trials: Sequence[Trial], calibrations: Calibrations, settings: PlatformMotionSettings
) -> PlatformModel:
    """The shape that the platform's motions share in perturbed crossings. Without one, each keeps its own motion.

    A crossing whose platform is hidden, or does not turn by `perturbation_deg`, has no part; its analysis says so.
    """
    if moved := differing_clusters([calibration_of(calibrations, trial.name) for trial in trials], settings):
        warnings.warn(f"each crossing keeps its own motion of the platform: {moved}", stacklevel=2)
        return PlatformModel(None, moved, {}, {}, None)
    tracks = []
    for trial in trials:
        try:
            tracks.append(turning_track(trial, calibration_of(calibrations, trial.name), settings))
        except InputError as error:
            warnings.warn(f"trial {trial.name}: has no part in the platform's shared motion: {error}", stacklevel=2)
    try:
        template, alignments = platform_template(tracks, settings.window_s)
    except InputError as error:
        return PlatformModel(None, str(error), {}, {}, None)
    for a in alignments:
        if not a.follows:
            warnings.warn(
                f"trial {a.name}: the platform does not move as in the other crossings (misfit {a.misfit:.1f} times "
                "that of marker noise): its own motion is used, which has more noise",
                stacklevel=2,
            )
    edges = {t.name: trigger_edge(t) for t in trials}
    triggers = {name: edge.time for name, edge in edges.items() if edge is not None}
    step = max((edge.step for edge in edges.values() if edge is not None), default=0.0)
    latency = trigger_latency([a for a in alignments if a.follows], triggers, step)
    left = without_groups(tracks, alignments, template)
    return PlatformModel(template, None, {a.name: a for a in alignments}, triggers, latency, left)


def differing_clusters(calibrations: Sequence[StaticCalibration], settings: PlatformMotionSettings) -> str:
    """Why motions measured with these calibrations cannot be compared, for a message; empty if they can.

    The coordinates of a motion are those of its cluster: of the place of each platform marker among the others.
    """
    labels, limit = settings.markers.platform, settings.largest_residual_mm
    clusters = [reference_positions(c.platform, labels, "static") for c in calibrations]
    local = [cluster - cluster.mean(axis=0) for cluster in clusters]
    apart = [1e3 * float(np.sqrt(np.mean(np.sum((one - local[0]) ** 2, axis=1)))) for one in local]
    if max(apart, default=0.0) <= limit:
        return ""
    return (
        f"the platform markers {', '.join(labels)} stand {max(apart):.0f} mm (RMS) otherwise in one static trial than "
        f"in another, expected {limit:g} mm or less; leave them in place between sessions, or analyse sessions apart"
    )


def turning_track(trial: Trial, calibration: StaticCalibration, settings: PlatformMotionSettings) -> PlatformTrack:
    """The platform's coordinates in the run of frames in which it turns.

    Raises
    ------
    InputError
        It does not turn, or its markers are hidden.
    """
    time, poses = segment_poses(trial, settings.markers.platform, calibration.platform, settings)
    turned = np.nan_to_num(rotation_from_rest(poses))
    if not len(turned) or turned.max() < np.deg2rad(settings.perturbation_deg):
        raise InputError(f"the platform does not turn by {settings.perturbation_deg:g} deg")
    return track_about(trial.name, time, poses, calibration, settings, float(time[np.argmax(turned)]))


def track_about(
    trial: str, time: Array, poses: Poses, calibration: StaticCalibration, settings: PlatformSettings, instant: float
) -> PlatformTrack:
    """The platform's coordinates in the run of seen frames about an instant [s], from its poses at times (n,) [s]."""
    labels = settings.markers.platform
    reference = reference_positions(calibration.platform, labels, trial)
    around = [run for run in runs(poses.seen()) if time[run.start] <= instant <= time[run.stop - 1]]
    if not around:
        raise InputError(f"the platform markers {', '.join(labels)} are hidden at {instant:.3f} s")
    return PlatformTrack.of(trial, time[around[0]], poses[around[0]], reference, settings.low_pass)


def inertial_motion(
    track: PlatformTrack, centre: Array, template: PlatformTemplate | None = None, follows: Alignment | None = None
) -> BodyMotion:
    """Motion (n,) of the plate's centre, at rest at `centre` (3,) [m], without accelerations where the platform rests.

    Until the shape ends, a crossing that `follows` it moves by the shape. Otherwise, and afterwards, it moves as
    measured, along its own directions.
    """
    if template is None or follows is None:
        own = shared_directions([track])[0]
        motion, weights = track.own_motion(own, centre)
        return motion.weighted(weights)
    since = (track.time - follows.start) / follows.duration
    end = float(template.time[-1]) - FADE_S
    shared = (follows.offset + template.curve(track.time, follows)) @ template.axes
    rest = track.rest - track.rest @ template.axes.T @ template.axes
    later = np.clip((since - end) / FADE_S, 0, 1)[:, None]
    measured = track.measured @ template.axes.T @ template.axes
    motion = track.motion_of(rest + (1 - later) * shared + later * measured, centre)
    return motion.weighted(gate(track.time, moves_with(track, template, follows, since, end), track.spread))


def moves_with(track: PlatformTrack, template: PlatformTemplate, follows: Alignment, since: Array, end: float) -> Mask:
    """Frames (n,) in which a platform moves: by the shape, whose noise is that of a mean, and as measured after it."""
    sharper = float(np.sqrt(template.crossings))
    curve = track.low_pass(template.curve(track.time, follows), track.rate)
    shared = replace(track, filtered=curve, noise=track.noise / sharper).moves(np.eye(curve.shape[1]))
    return np.asarray(np.where(since < end, shared, track.moving))


def platform_table(model: PlatformModel) -> pl.DataFrame:
    """`platform.csv`: one row per perturbed crossing whose platform was seen."""
    late = model.latency
    rows = [
        {
            "trial": a.name,
            "onset_s": model.onset(a.name, a.start),
            "template_onset_s": a.start,
            "template_onset_se_s": model.onset_se(a),
            "shared_onset_se_s": model.template and model.template.start_se,
            "onset_shape_s": model.template and model.template.start_shape,
            "amplitude": a.amplitude,
            "duration": a.duration,
            "misfit": a.misfit,
            "follows": int(a.follows),
            "directions": None if model.template is None else len(model.template.axes),
            "trigger_s": model.triggers.get(a.name),
            "latency_s": late and late.mean,
            "latency_sd_s": late and late.sd,
            "trigger_used": int(late is not None and late.used),
        }
        for a in model.alignments.values()
    ]
    return pl.DataFrame(rows, schema=PLATFORM_COLUMNS)
