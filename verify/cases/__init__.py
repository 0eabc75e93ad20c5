# SPDX-License-Identifier: BSD-3-Clause
"""Verification cases, a file per topic. Every module in this folder belongs to the suite; see `verify.suite.case`."""
