# SPDX-License-Identifier: BSD-3-Clause
"""HTML and SVG elements from Python: whatever is not markup already is escaped."""

from __future__ import annotations

import html

_EMPTY = frozenset({"meta", "input", "br"})


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(tag: str, /, *content: str | None, **attributes: str | float | bool | None) -> Markup:
    """One element: ``element("td", "a < b", class_="number", data_status="PASS")``.

    Parameters
    ----------
    content : Text, which is escaped, or `Markup`; None is left out.
    attributes : Underscores become hyphens, one at the end is dropped; True stands alone, False and None are left out.
    """
    written = "".join(_attribute(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items())
    if tag in _EMPTY:
        return Markup(f"<{tag}{written}>")
    return Markup(f"<{tag}{written}>{join(*content)}</{tag}>")


def join(*content: str | None) -> Markup:
    """Markup one after the other, text escaped."""
    return Markup("".join(part if isinstance(part, Markup) else html.escape(part) for part in content if part))


def _attribute(key: str, value: str | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    return f" {key}" if value is True else f' {key}="{html.escape(str(value))}"'
