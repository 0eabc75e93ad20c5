# SPDX-License-Identifier: BSD-3-Clause
"""What follows from the samples.

1. Rate, bound, share of the bound by wall and by CPU time, speed-up and ratios, checked by hand.
2. What cannot be said is None: no model of bytes, no run on one thread, no pass to compare with.
3. Through JSON and back nothing is lost, and the derived numbers stand beside the samples.
4. Other content is refused.
"""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from meshes.errors import InputError
from tests.verify.kernel_report_sample import sample_report
from verify.benchmark.kernel_report import SCHEMA, KernelReport
from verify.benchmark.passes import BLOCKS, GRADIENT, SUBSTEPS

REPORT = sample_report()
SUBSTEP = next(iter(SUBSTEPS))


def found(name, variant, threads):
    result = REPORT.find(name, variant, threads)
    assert result is not None
    return result


def test_bound():
    blocks = found(BLOCKS, "float32", 1)
    assert (blocks.rate, blocks.cpu_rate) == pytest.approx((1000 / 2e-3, 1000 / 1e-3))
    # 24 MB in 2 ms are 12 GB/s.
    assert REPORT.bound(blocks) == pytest.approx(12e9 / 80.0)
    # By CPU time STREAM moves 24 MB in 1.5 ms and the pass 80 kB in 1 ms.
    assert REPORT.bound_share(blocks) == pytest.approx((40e6 / 12e9, 80e6 / 16e9))
    # On two threads 24 MB take 1 ms, and 2 ms of CPU time.
    two = found(BLOCKS, "float32", 2)
    assert (two.rate, two.cpu_rate) == pytest.approx((1000 / 1e-3, 2 * 1000 / 2e-3))
    assert REPORT.bound(two) == pytest.approx(24e9 / 80.0)
    assert REPORT.bound_share(two) == pytest.approx((80e6 / 24e9, 40e6 / 12e9))


def test_speed_up():
    # Rounds: 1, 2, 4 against 1, 1, 1; CPU time 2 x 1 over 2.
    assert REPORT.speed_up(found(BLOCKS, "float32", 2)) == pytest.approx((2.0, 1.0))
    assert REPORT.speed_up(found(GRADIENT, "float32", 1)) == pytest.approx((1.0, 1.0))


def test_ratios():
    assert REPORT.relative(found(BLOCKS, "float32", 1), GRADIENT) == pytest.approx((4.0, 2.0, 8.0, 2.0))
    assert REPORT.relative(found(SUBSTEP, "float32", 1), BLOCKS) == pytest.approx((3.0, 3.0, 3.0, 3.0))


def test_what_cannot_be_said():
    substep = found(SUBSTEP, "float32", 1)
    assert REPORT.bound(substep) is None
    assert REPORT.bound_share(substep) is None
    assert REPORT.speed_up(found(BLOCKS, "plain", 2)) is None
    assert REPORT.relative(found(BLOCKS, "plain", 2), GRADIENT) is None
    assert REPORT.find(GRADIENT, "float64", 1) is None


def test_json_and_back():
    content = json.loads(json.dumps(REPORT.as_dict()))
    settings = REPORT.settings | {"threads": [1, 2], "variants": ["float32", "plain"]}
    assert KernelReport.from_dict(content) == replace(REPORT, settings=settings)
    assert content["schema"] == SCHEMA
    row = content["passes"][1]
    assert row["timing"] == {"wall": [1e-3, 2e-3, 4e-3], "cpu": [1e-3, 1.5e-3, 1e-3]}
    assert row["derived"]["tets_per_second_wall_cpu"] == pytest.approx([5e5, 1e6])
    assert row["derived"]["speed_up_wall_cpu"] == [1.0, 1.0]
    assert content["passes"][3]["derived"]["bound_tets_per_second"] is None


@pytest.mark.parametrize("schema", [None, "femgal-bench-kernels-0"])
def test_other_content_is_refused(schema):
    with pytest.raises(InputError, match="not a report") as caught:
        KernelReport.from_dict(REPORT.as_dict() | {"schema": schema})
    assert SCHEMA in str(caught.value)
