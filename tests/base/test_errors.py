# SPDX-License-Identifier: Apache-2.0
"""What an error says of the file, the trial or the setting at fault."""

import pytest

from osl_analysis.base.errors import InputError, naming


@pytest.mark.parametrize("reason", ["no column 'torque'", "trial a: no column 'torque'"])
def test_an_error_names_its_trial_once_and_knows_it(reason):
    with pytest.raises(InputError) as caught, naming("trial a", trial="a"):
        raise InputError(reason, "map one")

    assert str(caught.value) == "trial a: no column 'torque'; map one"
    assert caught.value.trial == "a"


@pytest.mark.parametrize(
    ("remedy", "message"), [("", "x: no unit, as a"), ("add", "x: no unit; add, as a")]
)
def test_what_stands_behind_an_error_ends_its_remedy_or_else_its_reason(remedy, message):
    with pytest.raises(InputError) as caught, naming("x", ", as a"):
        raise InputError("no unit", remedy)

    assert str(caught.value) == message
