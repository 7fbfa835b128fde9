# SPDX-License-Identifier: Apache-2.0
"""The functions that open files: each reads, calls the packages below, and writes. A rule of the
workflow calls one by its full name (`rules/common.smk`), the command line another (`cli.py`)."""
