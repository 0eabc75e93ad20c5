# SPDX-License-Identifier: BSD-3-Clause
"""The slow, obvious passes in float64: the reference that every fast backend is compared with."""
