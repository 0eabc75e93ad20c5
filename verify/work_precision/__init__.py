# SPDX-License-Identifier: BSD-3-Clause
"""Error against time of every solver over a grid of scenes, sizes and materials: `femgal bench SCENE...`."""
