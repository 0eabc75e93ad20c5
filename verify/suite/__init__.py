# SPDX-License-Identifier: BSD-3-Clause
"""The suite: what a case is, what it is given, how rows are chosen and run, and their results as data."""
