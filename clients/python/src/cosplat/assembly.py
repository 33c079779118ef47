"""Whole frames of what changed: bodies are put where they are as `docs/wire-format.md` says, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import wire
from .errors import Malformed
from .wire import GaussianState

if TYPE_CHECKING:
    from .streams import Changes


class Assembly:
    """A frame that is kept up to date by what changes."""

    def __init__(self) -> None:
        self._forms: dict[int, tuple[int, NDArray[np.void]]] = {}
        self.gaussians: NDArray[np.void] = np.zeros(0, GaussianState.dtype)
        """All Gaussians, of `wire.GaussianState.dtype`, in the order of `frame`."""
        self._position: tuple[int, int] | None = None

    def apply(self, changes: Changes) -> None:
        """Takes over a message of `changes`, after which `gaussians` is the frame of its step, bit for bit.

        Raises Malformed for one that contradicts itself or builds on another step; then a complete one has to come.
        """
        header, rows = changes.header, changes.rows
        before, self._position = self._position, None
        if changes.is_complete:
            told = int(rows["count"].sum(dtype=np.uint64))
            if told != header.gaussians:
                raise Malformed(f"a complete message has {told} Gaussians, expected {header.gaussians}")
            self.begin(told)
        elif before != (header.epoch, header.since) or len(self.gaussians) != header.gaussians:
            there = "nothing" if before is None else f"step {before[1]}"
            raise Malformed(f"changes of step {header.step} build on step {header.since}, and there is {there}")
        for row in rows:
            object, kind, first = int(row["object"]), int(row["kind"]), int(row["first"])
            if kind == wire.CHANGE_GAUSSIANS:
                self.put(first, changes.gaussians_of(row))
                continue
            if kind == wire.CHANGE_FORM:
                self.keep(object, first, changes.gaussians_of(row))
            elif kind != wire.CHANGE_PLACED:
                raise Malformed(f"change of object {object} is of kind {kind}, expected 1 to 3")
            self.place(object, row["position"], row["rotation"])
        self._position = (header.epoch, header.step)

    def begin(self, count: int) -> None:
        """Forgets all and begins a frame of `count` Gaussians."""
        self._forms.clear()
        self.gaussians = np.zeros(count, GaussianState.dtype)

    def put(self, first: int, gaussians: NDArray[np.void]) -> None:
        """Puts Gaussians of the world frame in their places. Raises Malformed for places beyond the frame."""
        self._check(first, gaussians)
        self.gaussians[first : first + len(gaussians)] = gaussians

    def keep(self, object: int, first: int, own: NDArray[np.void]) -> None:
        """Keeps an object in its own frame, to be placed. Raises Malformed for places beyond the frame."""
        self._check(first, own)
        self._forms[object] = (first, own)

    def place(self, object: int, position: Sequence[float], rotation: Sequence[float]) -> None:
        """Moves an object as a whole: origin [m] and rotation xyzw of its frame. Raises Malformed without its form."""
        if object not in self._forms:
            raise Malformed(f"object {object} is placed, but its form was not told")
        first, own = self._forms[object]
        self.gaussians[first : first + len(own)] = placed(own, position, rotation)

    def _check(self, first: int, gaussians: NDArray[np.void]) -> None:
        if first < 0 or first + len(gaussians) > len(self.gaussians):
            raise Malformed(f"{len(gaussians)} Gaussians from {first} on do not fit a frame of {len(self.gaussians)}")


def placed(own: NDArray[np.void], position: Sequence[float], rotation: Sequence[float]) -> NDArray[np.void]:
    """Gaussians of an object's own frame in the world. Sums go from left to right, so that no bit depends on the program."""
    x, y, z, w = (float(q) for q in rotation)
    r = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    world = own.copy()
    p = own["position"].astype(np.float64)
    for a in range(3):
        world["position"][:, a] = r[a][0] * p[:, 0] + r[a][1] * p[:, 1] + r[a][2] * p[:, 2] + float(position[a])
    m: Any = np.array(r).astype(np.float32)
    xx, xy, xz, yy, yz, zz = (own["covariance"][:, n] for n in range(6))
    half = [
        (
            m[a, 0] * xx + m[a, 1] * xy + m[a, 2] * xz,
            m[a, 0] * xy + m[a, 1] * yy + m[a, 2] * yz,
            m[a, 0] * xz + m[a, 1] * yz + m[a, 2] * zz,
        )
        for a in range(3)
    ]
    for n, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        h = half[a]
        world["covariance"][:, n] = h[0] * m[b, 0] + h[1] * m[b, 1] + h[2] * m[b, 2]
    ax, ay, az, aw = np.array((x, y, z, w)).astype(np.float32)
    bx, by, bz, bw = (own["rotation"][:, n] for n in range(4))
    turned = world["rotation"]
    turned[:, 0] = aw * bx + ax * bw + ay * bz - az * by
    turned[:, 1] = aw * by - ax * bz + ay * bw + az * bx
    turned[:, 2] = aw * bz + ax * by - ay * bx + az * bw
    turned[:, 3] = aw * bw - ax * bx - ay * by - az * bz
    return world
