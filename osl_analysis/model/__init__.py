# SPDX-License-Identifier: Apache-2.0
"""The drivetrain of Section II and the compensator of Section III, in the paper's symbols."""
