# SPDX-License-Identifier: Apache-2.0
"""File formats. Each module of this folder is one, and gives its files as one `Recording`.

To add a format, add one module with

    FORMAT = Format(
        name="xyz",               # what `format:` says in a source file
        suffixes=(".xyz",),       # endings of its files
        begins=_begins,           # whether a file that begins with these bytes is of this format
        source=XyzSource,         # the model of its source files, a subclass of one of
                                  # `osl_analysis.base.source_file`, with the keys of its own
        read=read,                # (path, source file or None) -> Recording
    )

and a line in docs/files.md; `tdms.py` is an example. A module may have several, under any
names. A package elsewhere offers one by the entry point group `osl_analysis.formats`.
"""

from osl_analysis.formats.reading import (
    formats_of,
    known_formats,
    read,
    recognise,
)

__all__ = ["formats_of", "known_formats", "read", "recognise"]
