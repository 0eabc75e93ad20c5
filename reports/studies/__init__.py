# SPDX-License-Identifier: BSD-3-Clause
"""Shows a run of `femgal study`, from its JSON record alone: one HTML page with our figures beside the paper's."""
