# SPDX-License-Identifier: BSD-3-Clause
"""Replacing a file so that a reader, or a crash, sees the old content or the new one, never half of it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside `path`; on success what was written there becomes `path`.

    The data reach the disk before the name does, so the guarantee holds through a power cut as well. After an
    exception the temporary file is gone and `path` is as it was.

    Raises
    ------
    OSError
        The folder cannot be written, or the disk is full.
    """
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        _sync(part)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    _sync(path.parent)


def write_text(path: Path, text: str) -> None:
    """Replace the content of `path` by `text` (UTF-8)."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
