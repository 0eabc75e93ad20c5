# SPDX-License-Identifier: BSD-3-Clause
"""run.json.

1. It is strict JSON after every call; NaN and infinity are null wherever they stand.
2. The header comes with versions, status and times; rows carry all keys, null where nothing was given.
3. Resuming keeps the first n rows and the header, and notes itself; a missing, damaged or short log is refused.
4. A failing write leaves the log as it was.
5. Frames stay cheap: the 2000th costs less than 20 ms of CPU time.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from femgal.output import runlog
from femgal.output.runlog import ROW_KEYS, RunLog, read_log
from meshes.errors import InputError


def strict(folder):
    def refuse(token):
        raise AssertionError(f"bare {token} in run.json")

    return json.loads((folder / "run.json").read_text(), parse_constant=refuse)


HEADER = {
    "scene": {"h": np.float64(0.01), "worst": float("inf"), "path": Path("a/b")},
    "mesh": {"vertices": np.int64(8), "bounds": np.array([0.0, np.nan])},
    "warnings": ["slivers"],
}


def test_valid_after_every_call(tmp_path):
    log = RunLog.create(tmp_path, HEADER)
    content = strict(tmp_path)
    assert content["status"] == "running"
    assert content["frames"] == []
    assert content["scene"] == {"h": 0.01, "worst": None, "path": "a/b"}
    assert content["mesh"] == {"vertices": 8, "bounds": [0.0, None]}
    assert content["warnings"] == ["slivers"]
    assert content["versions"]["numpy"] == np.__version__
    for frame in range(3):
        log.append_frame({"frame": frame, "eps18": np.float32("nan"), "passes": {"gradient": 2 * frame}})
        assert [row["frame"] for row in strict(tmp_path)["frames"]] == list(range(frame + 1))
    row = strict(tmp_path)["frames"][2]
    assert set(ROW_KEYS) <= set(row)
    assert (row["eps18"], row["min_J"], row["passes"]) == (None, None, {"gradient": 4})
    log.finish("finished", seconds=1.5, peak=float("nan"))
    content = strict(tmp_path)
    assert (content["status"], content["seconds"], content["peak"]) == ("finished", 1.5, None)
    assert list(content)[-1] == "frames"


def test_resume(tmp_path):
    log = RunLog.create(tmp_path, HEADER)
    for frame in range(5):
        log.append_frame({"frame": frame, "time": frame / 60})
    log.finish("interrupted")
    before = strict(tmp_path)
    log = RunLog.resume(tmp_path, 3)
    log.append_frame({"frame": 3, "time": 0.05})
    after = strict(tmp_path)
    assert after["frames"][:3] == before["frames"][:3]
    assert [row["frame"] for row in after["frames"]] == [0, 1, 2, 3]
    assert after["status"] == "running"
    assert after["started"] == before["started"]
    assert [entry["frames_kept"] for entry in after["resumed"]] == [3]


def test_unresumable(tmp_path):
    with pytest.raises(InputError, match=r"run\.json"):
        RunLog.resume(tmp_path, 0)
    RunLog.create(tmp_path, {}).append_frame({"frame": 0})
    with pytest.raises(InputError, match="1 frames"):
        RunLog.resume(tmp_path, 2)
    for text in ("{", "[]", '{"format_version": 99, "frames": []}', '{"format_version": 1}'):
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(InputError, match=r"run\.json"):
            read_log(tmp_path)


def test_failing_write_keeps_the_log(tmp_path, monkeypatch):
    log = RunLog.create(tmp_path, {})
    before = (tmp_path / "run.json").read_text()

    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(runlog, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        log.append_frame({"frame": 0})
    assert (tmp_path / "run.json").read_text() == before


def test_long_runs_stay_cheap(tmp_path, monkeypatch):
    log = RunLog.create(tmp_path, HEADER)
    row = dict.fromkeys(ROW_KEYS, 1.2345678901234567)
    with monkeypatch.context() as patch:
        patch.setattr(runlog, "write_text", lambda path, text: None)
        for frame in range(1999):
            log.append_frame({**row, "frame": frame})
    spent = []
    for frame in range(1999, 2009):
        start = time.process_time()
        log.append_frame({**row, "frame": frame})
        spent.append(time.process_time() - start)
    assert len(strict(tmp_path)["frames"]) == 2009
    assert sorted(spent)[5] < 0.02
