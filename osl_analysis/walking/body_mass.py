"""The body mass of a trial: from the sample sheet, the recording, or the configuration."""

from osl_analysis.errors import InputError
from osl_analysis.trial import Trial

DISAGREE = 0.1
"""Share by which the masses of sheet and recording may differ: clothes, shoes and the leg weigh something."""
POSSIBLE_KG = (10.0, 300.0)
"""Body masses [kg] of people."""


def body_mass(trial: Trial, sheet: float | None, configured: float | None = None) -> float | None:
    """Body mass [kg] of a trial; None if nobody states it.

    The sheet's is used, else the recording's, else the configured one of the campaign. A recording that states 0 states
    none.

    Raises
    ------
    InputError
        Sheet and recording differ by more than a tenth, or the mass is not one of a person.
    """
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg") or None
    if sheet and recorded and abs(sheet / recorded - 1) > DISAGREE:
        raise InputError(
            f"trial {trial.name}: body_mass_kg is {sheet:g} in the sheet and {recorded:g} in the recording; correct "
            "the sheet, or leave its cell empty to use the recording's"
        )
    mass = sheet or recorded or configured
    if mass and not POSSIBLE_KG[0] <= mass <= POSSIBLE_KG[1]:
        where = "sheet" if sheet else "recording" if recorded else "configuration"
        raise InputError(
            f"trial {trial.name}: a body mass of {mass:g} kg, from the {where}, is not one of a person; state "
            "body_mass_kg in the sheet, in kg"
        )
    return float(mass) if mass else None
