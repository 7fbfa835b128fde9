# SPDX-License-Identifier: Apache-2.0
"""What a motion repeats: the sines of a stepped sine (`stepped_sine`), and the period of any motion
(`periodic`)."""
