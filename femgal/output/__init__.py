# SPDX-License-Identifier: BSD-3-Clause
"""What a run leaves behind: VTKHDF or VTU series, run log, checkpoints, pictures."""
