"""The imperfections of the simulated benches, their drivetrain and its controller, with their units."""

from typing import Annotated, Self

from pydantic import AfterValidator, model_validator

from osl_analysis.simulator.effect import (
    Effect,
    Encoder,
    Hum,
    NotNegative,
    Positive,
    in_unit,
    off,
    positive,
    whole_number,
)
from osl_analysis.yaml_settings import Settings


class Effects(Settings):
    """Every imperfection of bench, drivetrain and controller."""

    friction: Annotated[Effect, in_unit("1")]
    """True friction as a multiple of the parameter file's, which the controller cancels. Off: no friction at all."""
    control_delay: Annotated[Effect, in_unit("update"), AfterValidator(whole_number)]
    """Delay from a measurement to the current computed from it [updates of the controller]. With size 0 the current is
    still held between two updates. Off: a continuous controller."""
    velocity_filter: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)]
    """Cut-off of the low-pass over the differentiated encoder. Off: the controller gets the true velocity."""
    actuator_encoder: Annotated[Encoder, in_unit("rad", "bit")]
    """Resolution of the actuator's encoder, at the actuator's output."""
    joint_encoder: Annotated[Encoder, in_unit("rad", "bit")]
    """Resolution of the joint's encoder."""
    load_cell_noise: Annotated[Effect, in_unit("N*m")]
    """Standard deviation of the load cell's white noise, at the rate of the log."""
    load_cell_offset: Annotated[Effect, in_unit("N*m")]
    """Standard deviation of the load cell's offset, constant over a trial."""
    load_cell_drift: Annotated[Effect, in_unit("N*m/min")]
    """Standard deviation of the load cell's drift, constant over a trial."""
    load_cell_quantisation: Annotated[Effect, in_unit("N*m")]
    """Resolution of the load cell."""
    current_noise: Annotated[Effect, in_unit("A")]
    """Standard deviation of the current's white noise, at the rate of the log."""
    current_quantisation: Annotated[Effect, in_unit("A")]
    """Resolution of the current."""
    belt_hysteresis: Annotated[Effect, in_unit("N*m")]
    """Largest torque by which loading and unloading differ from the elastic belt."""
    belt_scatter: Annotated[Effect, in_unit("1")]
    """Standard deviation of K_s from trial to trial in the belt experiment, as a share of K_s."""
    dynamometer_bandwidth: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)]
    """Natural frequency of the motor's position loop. Off: the motor follows its command exactly."""
    mount_stiffness: Annotated[Effect, in_unit("N*m/rad"), AfterValidator(positive)] = off("N*m/rad", 1.0)
    """Stiffness of the bench's frame. The joint's encoder also measures the frame's deflection. Off: a rigid frame."""
    load_cell_hum: Annotated[Hum, in_unit("N*m")] = Hum(enabled=False, size=0, unit="N*m")
    """Amplitude of the mains' hum in the load cell's signal."""
    load_cell_flicker: Annotated[Effect, in_unit("N*m")] = off("N*m")
    """Standard deviation of the load cell's 1/f noise within each decade of frequency."""
    encoder_zero: Annotated[Effect, in_unit("step")] = off("step")
    """Largest distance of the zero of the joint's encoder, drawn for each trial, in steps of the encoder."""

    def without(self, *names: str) -> "Effects":
        """These effects with the named ones off, or with all off if none is named."""
        silent = {
            name: getattr(self, name).model_copy(update={"enabled": False}) for name in names or type(self).model_fields
        }
        return self.model_copy(update=silent)


class SecondOrderJoint(Settings):
    """A joint with the torque of Eq. 15, in place of the drivetrain, and deviations from Eq. 15.

    Backlash is between bench and joint. Inside the gap the joint moves freely. The contact at an end is plastic.
    """

    K: Positive
    """Stiffness [N*m/rad]."""
    B: NotNegative
    """Damping [N*m*s/rad]."""
    I: NotNegative
    """Inertia [kg*m^2]."""
    stiffening: Annotated[Effect, in_unit("1/rad^2")] = off("1/rad^2")
    """The torque of the spring is K theta (1 + size theta^2)."""
    coulomb: Annotated[Effect, in_unit("N*m")] = off("N*m")
    """Coulomb friction of the joint."""
    backlash: Annotated[Effect, in_unit("rad")] = off("rad")
    """Width of the gap between bench and joint, from end to end."""

    @model_validator(mode="after")
    def _gap_is_computed_for_a_linear_joint(self) -> Self:
        if self.backlash.value and not self.I:
            raise ValueError("backlash needs an inertia I above 0")
        return self
