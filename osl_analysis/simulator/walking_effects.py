"""Every imperfection of gait and gait laboratory, with switch, size and unit."""

from typing import Annotated

from pydantic import AfterValidator

from osl_analysis.simulator.effect import Effect, in_unit, off, positive
from osl_analysis.yaml_settings import Settings


class WalkingEffects(Settings):
    """Every imperfection of gait and gait laboratory.

    The size of a scatter, an offset or a noise is its standard deviation. The actuator's encoder and current have the
    imperfections of the campaign.
    """

    heel_strike_scatter: Annotated[Effect, in_unit("s")]
    """Scatter of the time of heel strike on the platform."""
    stance_scatter: Annotated[Effect, in_unit("%")]
    """Scatter of the duration of stance on the platform."""
    angle_scale: Annotated[Effect, in_unit("%")]
    """Scatter of a factor of the ankle's angle."""
    angle_wander: Annotated[Effect, in_unit("deg")]
    """Smooth deviation of the ankle's angle, below 4 Hz."""
    force_scale: Annotated[Effect, in_unit("%")]
    """Scatter of a factor of each component of the ground reaction."""
    placement_forward: Annotated[Effect, in_unit("mm")]
    """Scatter of the foot's place on the platform, forward."""
    placement_sideways: Annotated[Effect, in_unit("mm")]
    """Scatter of the foot's place on the platform, sideways."""
    foot_yaw: Annotated[Effect, in_unit("deg")]
    """Scatter of the foot's direction on the platform. The ankle's axis turns with it."""
    shank_yield: Annotated[Effect, in_unit("%")]
    """Share of the platform's rotation by which the shank rotates within 0.2 s."""
    foot_slip: Annotated[Effect, in_unit("mm")]
    """Distance by which the foot slides back during the perturbation."""
    amplitude_scatter: Annotated[Effect, in_unit("%")] = off("%")
    """Scatter of a common factor of the ankle's angle, its torque and the ground reaction."""
    load_scatter: Annotated[Effect, in_unit("%")] = off("%")
    """Scatter of a common factor of the ground reaction and the ankle's torque, at the same angle."""
    timing_wander: Annotated[Effect, in_unit("%")] = off("%")
    """Scatter of the phase of stance in its middle, in % of stance. Heel strike and toe-off stay."""
    torque_wander: Annotated[Effect, in_unit("N*m")] = off("N*m")
    """Smooth deviation of the ankle's torque, below 4 Hz. The leg's equilibrium follows it."""
    trigger_scatter: Annotated[Effect, in_unit("ms")] = off("ms")
    """Scatter of the time from the command, which the trigger channel shows, to the start of the ramp."""
    rise_scatter: Annotated[Effect, in_unit("%")] = off("%")
    """Scatter of the duration of the platform's ramp, over crossings and plate trials."""
    servo_shiver: Annotated[Effect, in_unit("deg")] = off("deg")
    """Vibration of the platform's angle at 8 to 20 Hz, while it moves and 0.1 s longer, another one in each trial."""
    platform_heave: Annotated[Effect, in_unit("mm")] = off("mm")
    """Height by which the platform rises in the middle of its ramp, as a hexapod does."""
    foot_inertia: Annotated[Effect, in_unit("kg")]
    """Mass of the foot and shoe below the ankle. Off: a foot without mass."""
    plate_inertia: Annotated[Effect, in_unit("kg")]
    """Mass of the plate above its sensors. Off: the reading is the ground reaction."""
    marker_noise: Annotated[Effect, in_unit("mm")]
    """White noise of the markers, each axis."""
    marker_gaps: Annotated[Effect, in_unit("1/trial")]
    """Mean number of gaps per trial in which a marker is hidden."""
    force_noise: Annotated[Effect, in_unit("N")]
    """White noise of the plate's forces, each axis."""
    moment_noise: Annotated[Effect, in_unit("N*m")]
    """White noise of the plate's moments, each axis."""
    force_offset: Annotated[Effect, in_unit("N")]
    """Offset of the plate's forces, constant over a trial."""
    moment_offset: Annotated[Effect, in_unit("N*m")]
    """Offset of the plate's moments, constant over a trial."""
    plate_lag: Annotated[Effect, in_unit("ms")]
    """Lag of the plate's channels behind markers, trigger and sync."""
    moment_clip: Annotated[Effect, in_unit("N*m"), AfterValidator(positive)] = off("N*m", 60.0)
    """Rails of the moment channels of a plate of type 1 or 2. Off: none."""
    force_clip: Annotated[Effect, in_unit("N"), AfterValidator(positive)] = off("N", 500.0)
    """Rails of the force channels of a plate of type 1 or 2. Off: none."""
    sensor_clip: Annotated[Effect, in_unit("N"), AfterValidator(positive)] = off("N", 250.0)
    """Rails of the eight channels of a plate of type 3. Off: none."""
    marker_placement: Annotated[Effect, in_unit("mm")] = off("mm")
    """Scatter of the place of each marker on foot and shank from session to session, each axis."""
    leg_clock_offset: Annotated[Effect, in_unit("s")]
    """Mean offset of the leg's clock from that of the recording."""
    leg_clock_drift: Annotated[Effect, in_unit("ppm")]
    """Scatter of the rate of the leg's clock."""
    leg_joint_encoder: Annotated[Effect, in_unit("bit")]
    """Resolution of the leg's joint encoder, in bits per turn."""

    def without(self, *names: str) -> "WalkingEffects":
        """These effects with the named ones off, or with all off if none is named."""
        names = names or tuple(type(self).model_fields)
        return self.model_copy(update={n: getattr(self, n).model_copy(update={"enabled": False}) for n in names})
