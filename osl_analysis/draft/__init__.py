# SPDX-License-Identifier: Apache-2.0
"""Draft source files, sample sheet and walking analysis from a folder of recordings.

Questions say what nobody stated. Only commands import it: an analysis rests on what the user has
confirmed.
"""
