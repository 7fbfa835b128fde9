# SPDX-License-Identifier: Apache-2.0
"""What a folder of recordings may be: a draft of source files, sample sheet and walking analysis,
with questions. Only commands import it: an analysis rests on what the user has confirmed."""
