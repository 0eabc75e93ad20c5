# SPDX-License-Identifier: BSD-3-Clause
"""How long a motion is looked at, and how often."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from femgal.scene.model import Scene

# Frames that a motion is compared at, at least: four per period over five periods. Stiff and light bodies swing many
# times within a frame of 1/60 s; theirs are made shorter.
LEAST_FRAMES = 20


@dataclass(frozen=True)
class Horizon:
    """Length of a motion.

    Parameters
    ----------
    frames : Number of frames.
    frames_per_second : Of simulated time.
    period : Of the lowest mode that the scene excites [s]; None where it excites none.
    """

    frames: int
    frames_per_second: float
    period: float | None

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return self.frames / self.frames_per_second

    def of(self, scene: Scene) -> Scene:
        """A scene of this length."""
        return scene.model_copy(update={"frames": self.frames, "frames_per_second": self.frames_per_second})

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {**asdict(self), "seconds": self.seconds, "periods": self.seconds / self.period if self.period else None}


# Periods of the lowest mode, where neither they nor frames are asked for.
PERIODS = 5.0


def choose_horizon(scene: Scene, period: float | None, periods: float | None, frames: int | None) -> Horizon:
    """As many frames as are asked for; else some periods of the lowest mode, but no more than the scene has.

    Where these are fewer than LEAST_FRAMES frames of the scene, the frames become so short that they are as many. Where
    both are asked for, the frames become so short that they are no more than these periods.
    """
    rate = scene.frames_per_second
    if period is None or (frames is not None and periods is None):
        return Horizon(frames or scene.frames, rate, period)
    periods = PERIODS if periods is None else periods
    if frames is not None:
        return Horizon(frames, max(rate, _rate(frames, periods * period)), period)
    count = math.ceil(periods * period * rate - 1e-9)
    if count >= LEAST_FRAMES or count >= scene.frames:
        return Horizon(min(count, scene.frames), rate, period)
    return Horizon(LEAST_FRAMES, max(rate, _rate(LEAST_FRAMES, periods * period)), period)


def _rate(frames: int, seconds: float) -> float:
    """Frames per second, to four digits: a scene file should not hold more than means something."""
    return float(f"{frames / seconds:.4g}")
