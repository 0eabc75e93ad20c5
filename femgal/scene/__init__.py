# SPDX-License-Identifier: BSD-3-Clause
"""What the user wrote: the validated model of a scene file, built-in scenes, and the plan made from them."""
