# SPDX-License-Identifier: BSD-3-Clause
"""Makes meshes: generators, surface catalogue, tetrahedraliser, quality, ordering, files."""
