"""What cannot be negative: a torque read with the wrong sign turns every estimate round and fits as well as before."""

from osl_analysis.errors import InputError


def check_sign(trial: str, symbol: str, value: float) -> None:
    """Refuse a negative estimate of what only resists motion (belt, joint damping, a stiffness that was asked for).

    Raises
    ------
    InputError
        It is negative; names the trial.
    """
    if value < 0:
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion instead of resisting "
            "it; turn the `sign` of the torque, or of the angle, in the source file"
        )
