"""One imperfection of a simulated campaign, and the imperfections of the benches, with their units."""

from typing import Annotated

from pydantic import AfterValidator, Field

from osl_analysis.yaml_settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Effect(Settings):
    """One imperfection."""

    enabled: bool
    """Whether the imperfection acts. (`on` would be a truth value in YAML.)"""
    size: NotNegative
    """Its size, in `unit`."""
    unit: str
    """The unit of the size. It must be the one that the settings expect."""

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off."""
        return self.size if self.enabled else 0.0


def in_unit(unit: str) -> AfterValidator:
    """A check that an effect's size is given in `unit`."""

    def check(effect: Effect) -> Effect:
        """Refuse another unit."""
        if effect.unit != unit:
            raise ValueError(f"its unit must be '{unit}', not '{effect.unit}'")
        return effect

    return AfterValidator(check)


def whole_number(effect: Effect) -> Effect:
    """Refuse a size that is not a whole number."""
    if effect.size != int(effect.size):
        raise ValueError(f"its size is {effect.size:g}; give a whole number")
    return effect


def positive(effect: Effect) -> Effect:
    """Refuse a size of 0, which would not switch the effect off."""
    if effect.size == 0:
        raise ValueError("its size must be positive; set enabled: false to switch it off")
    return effect


class Effects(Settings):
    """Every imperfection of bench, drivetrain and controller."""

    friction: Annotated[Effect, in_unit("1")]
    """True friction as a multiple of the parameter file's, which the controller cancels. Off: no friction at all."""
    control_delay: Annotated[Effect, in_unit("update"), AfterValidator(whole_number)]
    """Updates of the controller between a measurement and the current that answers it. With size 0 the current is still
    held between two updates. Off: a continuous controller."""
    velocity_filter: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)]
    """Cut-off of the low-pass over the differentiated encoder. Off: the controller gets the true velocity."""
    actuator_encoder: Annotated[Effect, in_unit("rad")]
    """Resolution of the actuator's encoder, at the actuator's output."""
    joint_encoder: Annotated[Effect, in_unit("rad")]
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
    """Natural frequency with which the motor follows its command. Off: it follows exactly."""

    def without(self, *names: str) -> "Effects":
        """These effects with the named ones off, or with all off if none is named."""
        off = {
            name: getattr(self, name).model_copy(update={"enabled": False}) for name in names or type(self).model_fields
        }
        return self.model_copy(update=off)
