# SPDX-License-Identifier: BSD-3-Clause
"""Downloads.

1. Nothing is fetched before the terms are accepted; the refusal shows credit and terms.
2. A file of the right size and digest arrives whole in the cache, and is not fetched twice.
3. A wrong digest, a longer or shorter answer, a missing file or an unreachable server leaves nothing behind.
4. Only https, http and file addresses; unknown names and broken registries are refused.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from meshes.errors import InputError, MeshError
from meshes.remote import Remote, download, mesh_cache, registry

CONTENT = b"solid tet" * 30_000


class Handler(BaseHTTPRequestHandler):
    """Serves CONTENT as /whole and a part of it as /cut."""

    requests = 0

    def do_GET(self) -> None:
        """Answer one request."""
        Handler.requests += 1
        self.send_response(404 if self.path == "/missing" else 200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT if self.path == "/whole" else CONTENT[:1000])

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def server() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()
        thread.join()


@pytest.fixture
def entry(tmp_path, monkeypatch) -> Remote:
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path / "cache"))
    source = tmp_path / "source.stl"
    source.write_bytes(CONTENT)
    digest = hashlib.sha256(CONTENT).hexdigest()
    return Remote("tet", "tet.stl", source.as_uri(), len(CONTENT), digest, "a test", "A. Author", "free for all")


def left_behind() -> list[Path]:
    return list(mesh_cache().iterdir()) if mesh_cache().is_dir() else []


def test_terms_come_first(entry):
    with pytest.raises(InputError) as caught:
        download("tet", accept_terms=False, entries={"tet": entry})
    for part in ("A. Author", "free for all", "--accept-terms"):
        assert part in str(caught.value)
    assert left_behind() == []


def test_file_arrives_whole_and_once(entry, server):
    entry = replace(entry, address=f"{server}/whole")
    before = Handler.requests
    path = download("tet", accept_terms=True, entries={"tet": entry})
    assert path.read_bytes() == CONTENT
    assert left_behind() == [path]
    assert download("tet", accept_terms=True, entries={"tet": entry}) == path
    assert Handler.requests == before + 1
    path.write_bytes(b"damaged")
    assert download("tet", accept_terms=True, entries={"tet": entry}).read_bytes() == CONTENT


def test_file_addresses_work(entry):
    assert download("tet", accept_terms=True, entries={"tet": entry}).read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"sha256": "0" * 64}, "sha256 000"),
        ({"bytes": len(CONTENT) - 1}, "another file"),
        ({"bytes": len(CONTENT) + 1}, "another file"),
        ({"address": "file:///no/such/file.stl"}, "cannot be fetched"),
        ({"address": "http://127.0.0.1:9/tet.stl"}, "cannot be fetched"),
        ({"address": "ftp://127.0.0.1/tet.stl"}, "https, http, file"),
        ({"address": "tet.stl"}, "https, http, file"),
    ],
)
def test_failures_leave_nothing_behind(entry, change, part):
    with pytest.raises(MeshError) as caught:
        download("tet", accept_terms=True, entries={"tet": replace(entry, **change)})
    assert part in str(caught.value)
    assert left_behind() == []


@pytest.mark.parametrize("page", ["cut", "missing"])
def test_broken_answers_leave_nothing_behind(entry, server, page):
    with pytest.raises(MeshError, match=r"cannot be fetched|another file"):
        download("tet", accept_terms=True, entries={"tet": replace(entry, address=f"{server}/{page}")})
    assert left_behind() == []


def test_unknown_names_are_refused():
    with pytest.raises(InputError, match="ipc_bunny"):
        download("bunni", accept_terms=True)


@pytest.mark.parametrize("text", ["", "{}", '{"meshes": [{"name": "a"}]}', '{"meshes": 3}'])
def test_broken_registries_are_refused(tmp_path, text):
    path = tmp_path / "registry.json"
    path.write_text(text)
    with pytest.raises(MeshError, match="is not a mesh registry"):
        registry(path)
