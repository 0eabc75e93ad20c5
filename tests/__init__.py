# SPDX-License-Identifier: BSD-3-Clause
"""Tests of all rooms; one file per source file."""
