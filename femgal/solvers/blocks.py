# SPDX-License-Identifier: BSD-3-Clause
"""Diagonal blocks kept over several substeps, for as long as that changes less than the solver leaves undone anyway.

A pass for the gradient alone costs about half of one that also makes the blocks. Blocks are a preconditioner: old ones
do not change the equation that is solved, only the path to its solution. How old they may become is measured, not
assumed. At a substep where blocks are made anew, every layer's correction dx is also computed with the old ones, dx',
and at the end the remaining gradient g with its correction. With H the new blocks,

    stale = sum over the layers of (dx' - dx) . H (dx' - dx),    left = g . H^-1 g

are, up to the factor 1/2, the energy [J] that old blocks lose and the energy that one more sweep would gain. While
stale <= SHARE^2 left, the old blocks change the iterate by less than a SHARE of what the solver leaves undone. The
difference grows with the age of the blocks, so stale grows with its square; the interval between refreshes doubles
while there is room for that, and halves when there was not.

With fixed step lengths old blocks can also make the iteration unstable: where a body has stiffened since, the step
overshoots. There the blocks may besides have changed by at most MOST_CHANGE anywhere, a part of the margin
that the step lengths keep.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend

Floats = NDArray[np.float64]

SHARE = 0.1
MOST_CHANGE = 0.05
LONGEST_INTERVAL = 64

# Where blocks are made at every substep, one in so many is used to look whether that is still needed.
PROBE_EVERY = 16

SCHEDULE, _BLOCKS = "blocks_schedule", "blocks_of_layer_"


@dataclass(eq=False)
class KeptBlocks:
    """Blocks of every layer, their age, and how old they may become: one substep's view of the solver's memory.

    Parameters
    ----------
    fixed_steps : Whether step lengths are fixed, so that stability has to be watched.
    blocks : H of layers by number [N/m], shape [n_nodes, 6]; none where they are made at every substep.
    age : Substeps since the refresh; where they are made at every substep, substeps since one of these was a probe.
    interval : Substeps from one refresh to the next.
    refreshes : Whether blocks are made in this substep.
    """

    fixed_steps: bool
    blocks: dict[int, Floats] = field(default_factory=dict)
    # So that the first substep keeps its blocks and the second one compares.
    age: int = PROBE_EVERY - 2
    interval: int = 1
    refreshes: bool = field(init=False)
    _fresh: dict[int, Floats] = field(default_factory=dict, init=False)
    _stale: float = field(default=0.0, init=False)
    _change: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        # For the whole substep, whatever its verdict on the interval.
        self.refreshes = self.interval == 1 or self.age >= self.interval

    @classmethod
    def remembered(cls, memory: dict[str, NDArray], fixed_steps: bool) -> KeptBlocks:
        """As the last substep left them."""
        if SCHEDULE not in memory:
            return cls(fixed_steps)
        blocks = {int(name.removeprefix(_BLOCKS)): H for name, H in memory.items() if name.startswith(_BLOCKS)}
        age, interval = (int(k) for k in memory[SCHEDULE])
        return cls(fixed_steps, blocks, age, interval)

    def into(self, memory: dict[str, NDArray]) -> dict[str, NDArray]:
        """The memory with what the next substep needs."""
        blocks = {f"{_BLOCKS}{number}": H for number, H in self.blocks.items()}
        return {**forget(memory), **blocks, SCHEDULE: np.array([self.age, self.interval])}

    @property
    def holds(self) -> bool:
        """Whether this substep needs the blocks themselves: to use, to keep or to compare them."""
        return bool(self.blocks) or self._keeps

    @property
    def compares(self) -> bool:
        """Whether this substep has made new blocks and had old ones to compare them with."""
        return bool(self.blocks) and 0 in self._fresh

    @property
    def _keeps(self) -> bool:
        return self.interval > 1 or self.age >= PROBE_EVERY - 2

    def get(self, number: int) -> Floats | None:
        """Blocks to use on a layer now; None where they have to be made."""
        return self._fresh.get(number) if self.refreshes else self.blocks.get(number)

    def fresh(self, number: int) -> Floats:
        """Blocks of a layer made in this substep."""
        return self._fresh[number]

    def put(self, backend: Backend, number: int, g: Floats, H: Floats, *, scalar: bool) -> None:
        """Take new blocks of a layer, and compare the corrections that old and new ones make."""
        self._fresh[number] = H
        if number in self.blocks:
            stale, change = backend.compare_blocks(g, self.blocks[number], H, scalar=scalar)
            self._stale += stale
            self._change = max(self._change, change)

    def judge(self, left: float) -> None:
        """Choose the interval, given g . H^-1 g [J] after the substep."""
        stale, change = self._stale / SHARE**2, self._change / MOST_CHANGE if self.fixed_steps else 0.0
        if stale <= left / 4.0 and change <= 0.5:
            self.interval = min(2 * self.interval, LONGEST_INTERVAL)
        elif not (stale <= left and change <= 1.0):
            self.interval //= 2
        if self.interval <= 1:
            self.interval, self.age = 1, -1

    def finish(self) -> None:
        """Grow older by one substep."""
        if self.refreshes and not self._fresh and self.holds:
            # The prediction was good enough and nothing was smoothed: the next substep is in the same place.
            return
        if self.refreshes:
            self.blocks = self._fresh if self._keeps else {}
            if self.interval > 1:
                self.age = 0
        self.age += 1


def forget(memory: dict[str, NDArray]) -> dict[str, NDArray]:
    """The memory without blocks: they belong to one length of the step."""
    return {name: array for name, array in memory.items() if name != SCHEDULE and not name.startswith(_BLOCKS)}


def with_blocks_to_use(memory: dict[str, NDArray]) -> dict[str, NDArray] | None:
    """The memory of a step that uses the blocks which are there; None where there are none."""
    if not any(name.startswith(_BLOCKS) for name in memory):
        return None
    return memory | {SCHEDULE: np.array([1, 2])}


def phase(memory: dict[str, NDArray]) -> tuple[bool, ...]:
    """What a substep does about its blocks: whether it makes, keeps and has some; empty where none are ever kept.

    Substeps of one phase make the same passes, whatever the age of the blocks.
    """
    if SCHEDULE not in memory:
        return ()
    kept = KeptBlocks.remembered(memory, fixed_steps=True)
    return kept.refreshes, kept.holds, bool(kept.blocks)


def aged(memory: dict[str, NDArray]) -> dict[str, NDArray]:
    """The schedule after a substep that has judged nothing, as an entry of the memory."""
    if SCHEDULE not in memory:
        return {}
    age, interval = memory[SCHEDULE]
    return {SCHEDULE: np.array([age + 1, interval])}
