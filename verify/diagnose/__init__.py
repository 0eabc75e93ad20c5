# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with a mesh and its material, in words, with numbers and with what to do."""
