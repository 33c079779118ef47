"""What does not change from step to step: Gaussians at rest, objects, the scene file."""

from __future__ import annotations

import time
import tomllib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import transport, wire
from .errors import Malformed, TimedOut
from .streams import find
from .wire import GaussianRest, ObjectInfo, SceneHeader

if TYPE_CHECKING:
    from .session import Session


class Scene:
    """The scene of one run of a server. It stays valid when the server goes."""

    def __init__(
        self,
        header: SceneHeader,
        gaussians: NDArray[np.void],
        sh: NDArray[np.float32],
        objects: NDArray[np.void],
        features: NDArray[np.float32],
        source: str,
    ) -> None:
        """Raises Malformed when the blocks do not fit the header."""
        if header.sh_degree > 3:
            raise Malformed(f"degree {header.sh_degree} of the spherical harmonics, expected 0 to 3")
        count, coefficients = header.gaussian_count, (header.sh_degree + 1) ** 2
        for what, actual, expected in [
            ("Gaussians", len(gaussians), count),
            ("spherical-harmonics values", sh.size, count * coefficients * 3),
            ("objects", len(objects), header.object_count),
            ("feature values", features.size, count * header.feature_dim),
        ]:
            if actual != expected:
                raise Malformed(f"the scene holds {actual} {what}, its header announces {expected}")
        self.header = header
        """Counts, gravity, grid cell size, frame rate, bounds."""
        self.gaussians = gaussians
        """Gaussians at rest, of `wire.GaussianRest.dtype`."""
        self.sh = sh.reshape(count, coefficients, 3)
        """Spherical harmonics, (n, coefficients, 3)."""
        self.objects = objects
        """Object table, of `wire.ObjectInfo.dtype`."""
        self.features = features.reshape(count, header.feature_dim)
        """Semantic features, (n, length); length 0 where there are none."""
        self.source = source
        """Text of the scene file."""
        self.names = [bytes(name).decode(errors="replace") for name in objects["name"]]
        """Names of the objects, by id."""
        self.colliders = _collider_names(source)
        """Names of the colliders, by number."""

    def object_id(self, object: str | int) -> int:
        """Id of an object by its name. Raises BadName when there is none."""
        return find(self.names, object, "object")

    def collider_number(self, collider: str | int) -> int:
        """Number of a collider by its name. Raises BadName when there is none."""
        return find(self.colliders, collider, "collider")

    def gaussians_of(self, object: str | int) -> slice:
        """Where an object's Gaussians are in `gaussians` and `sh`, and by `index` in a frame."""
        info = self.objects[self.object_id(object)]
        first = int(info["gaussian_first"])
        return slice(first, first + int(info["gaussian_count"]))


def _collider_names(source: str) -> list[str]:
    try:
        return [str(collider["name"]) for collider in tomllib.loads(source).get("colliders", [])]
    except (tomllib.TOMLDecodeError, KeyError, TypeError, AttributeError, RecursionError):
        return []


_BLOCKS: list[tuple[str, type[wire.Record] | str, np.dtype[Any]]] = [
    ("scene/gaussians", GaussianRest, GaussianRest.dtype),
    ("scene/sh", "f32", np.dtype("<f4")),
    ("scene/objects", ObjectInfo, ObjectInfo.dtype),
    ("scene/source", "u8", np.dtype("u1")),
    ("scene/features", "f32", np.dtype("<f4")),
]


class _Block:
    """A block that is waited for."""

    def __init__(self, session: Session, stream: str, payload: type[wire.Record] | str, dtype: np.dtype[Any]) -> None:
        self._session, self._dtype = session, dtype
        service = session.open(lambda node, name: transport.pub_sub(node, name, payload, SceneHeader), stream)
        self._port = transport.subscriber(service, 1, 1)
        self._stream = stream
        self.header: SceneHeader | None = None
        self.data: NDArray[Any] = np.empty(0, dtype)

    def look(self) -> None:
        while (sample := transport.receive(self._port, self._stream, 4)) is not None:
            if self._session.serves(sample.header.node_id.value):
                self.header = transport.header(sample, SceneHeader)
                # Sent once and kept, its memory is not used again: the place need not be kept for it.
                self.data = transport.array(sample, None, self._dtype)


def read(session: Session, epoch: int, timeout: float) -> Scene:
    """The scene of run `epoch` of a server, or of a later one; 0 for the one that is there. Raises TimedOut."""
    deadline = time.monotonic() + timeout
    blocks: dict[str, _Block] = {}
    while True:
        for stream, payload, dtype in _BLOCKS:
            if stream not in blocks and (stream != "scene/features" or _has_features(blocks)):
                blocks[stream] = _Block(session, stream, payload, dtype)
        for block in blocks.values():
            block.look()
        header = blocks["scene/gaussians"].header
        # Blocks belong together when their headers are equal.
        whole = header is not None and all(_equal(block.header, header) for block in blocks.values())
        if header is not None and whole and header.epoch >= epoch and _has_features(blocks) == ("scene/features" in blocks):
            break
        if time.monotonic() >= deadline:
            missing = [stream for stream, block in blocks.items() if block.header is None]
            what = ", ".join(missing) or f"the scene of run {epoch}"
            raise TimedOut(f"session {session.name!r} is served, but {what} did not come within {timeout:.1f} s")
        time.sleep(0.005)
    features = blocks["scene/features"].data if "scene/features" in blocks else np.empty(0, np.float32)
    source = blocks["scene/source"].data.tobytes().decode(errors="replace")
    return Scene(
        header, blocks["scene/gaussians"].data, blocks["scene/sh"].data, blocks["scene/objects"].data, features, source
    )


def _has_features(blocks: dict[str, _Block]) -> bool:
    gaussians = blocks.get("scene/gaussians")
    return gaussians is not None and gaussians.header is not None and gaussians.header.feature_dim > 0


def _equal(a: SceneHeader | None, b: SceneHeader) -> bool:
    # Fields are numbers and small arrays.
    names = SceneHeader.dtype.names or ()
    return a is not None and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)
