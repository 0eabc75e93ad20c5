# SPDX-License-Identifier: BSD-3-Clause
"""Shows a run of `femgal bench SCENE...`, from its JSON record alone: CSV, PNG plots and one HTML page."""
