# SPDX-License-Identifier: BSD-3-Clause
"""One file per sub-command of the command line; loaded only when called."""
