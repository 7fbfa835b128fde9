# SPDX-License-Identifier: Apache-2.0
"""How the jobs of the workflow run and end: warm processes, logs, and lines of progress."""
