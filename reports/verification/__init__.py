# SPDX-License-Identifier: BSD-3-Clause
"""Shows a run of the verification suite, from its JSON record alone: text, JUnit XML, Markdown and one HTML page."""
