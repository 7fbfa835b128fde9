# SPDX-License-Identifier: Apache-2.0
"""What every room stands on: a trial and a recording, units, settings, tables, files and errors."""
