# SPDX-License-Identifier: Apache-2.0
"""From recordings to trials."""

from pathlib import Path
from types import SimpleNamespace

from osl_analysis.base.files import own_yaml

LIMITS = SimpleNamespace(**own_yaml(Path(__file__).with_name("limits.yaml")))
"""The numbers that decide something here, with units and reasons."""
