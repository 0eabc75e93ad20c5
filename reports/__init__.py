# SPDX-License-Identifier: BSD-3-Clause
"""Shows results: turns JSON into tables, plots and pages; imports nothing of the other rooms."""
