# SPDX-License-Identifier: Apache-2.0
"""The command line, in this process."""

from click.testing import CliRunner, Result

from osl_analysis.cli import main


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])
