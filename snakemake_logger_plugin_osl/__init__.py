# SPDX-License-Identifier: Apache-2.0
"""The progress of a run, as a logger of Snakemake: it finds loggers by the name of their
package."""

from osl_analysis.jobs.progress import LogHandler

__all__ = ["LogHandler"]
