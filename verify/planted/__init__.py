# SPDX-License-Identifier: BSD-3-Clause
"""Bugs planted one at a time into a copy of the sources, to see that a case of the suite turns red."""
