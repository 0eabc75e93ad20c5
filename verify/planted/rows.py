# SPDX-License-Identifier: BSD-3-Clause
"""``python -m verify.planted.rows PATTERN``: run the rows that fit and print their verdicts as one line of JSON."""

from __future__ import annotations

import json
import sys

import femgal
from verify.suite.run import choose, run
from verify.suite.use import Use

if __name__ == "__main__":
    verdicts = {str(result.row): result.status.value for result in run(choose(sys.argv[1], quick=True), Use())}
    print(json.dumps({"femgal": femgal.__file__, "rows": verdicts}))
