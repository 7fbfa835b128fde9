# SPDX-License-Identifier: Apache-2.0
"""The default configuration and device, as they are shipped."""

import yaml
from conftest import ROOT

from osl_analysis.campaign.configuration import config_for_trials
from osl_analysis.model.drivetrain import read_parameters

SETTINGS = yaml.safe_load((ROOT / "config/config.yaml").read_text())
CONFIG = config_for_trials(ROOT / "config/config.yaml")
DEVICE = ROOT / "config/parameters/default.yaml"
LEG = read_parameters(DEVICE)
