# SPDX-License-Identifier: Apache-2.0
"""What a sample sheet may say, choices that several settings share, and the facts of every
experiment."""
