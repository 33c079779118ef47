"""Writes splats in time as USD: `cosplat export RUN.mcap --usd FILE` sends them to this module. Needs the extra `usd`.

Standard input has a line of JSON that describes the scene; then, for every step, a line with the time and the places of all
objects, and behind it the Gaussians of those that are new, as float32: positions, orientations xyzw, scales, opacities and
spherical harmonics, in the object's own frame.
"""

from __future__ import annotations

import json
import secrets
import sys
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .errors import CosplatError, Malformed

Arrays = dict[str, NDArray[np.float32]]
"""Arrays of one object, by the names of their USD attributes."""

_SUFFIXES = (".usd", ".usdc", ".usda")
_SH = "radiance:sphericalHarmonicsCoefficients"
_SAVE_AT = 128 << 20
"""Bytes of samples that are kept in memory before the file is saved."""


class UsdWriter:
    """A USD file in the making: a node per object with its place in time, and its Gaussians in the object's own frame."""

    def __init__(self, path: Path, up: list[float], frame_rate: float, sh_degree: int, names: list[str]) -> None:
        """Begins a file. Raises CosplatError without the package usd-core, and for a name that no USD file has."""
        try:
            from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt
        except ImportError:
            raise CosplatError("USD needs the package usd-core: pip install 'cosplat[usd]'") from None
        if path.suffix not in _SUFFIXES:
            raise CosplatError(f"{path} ends with {path.suffix!r}, expected one of {', '.join(_SUFFIXES)}")
        self._gf: Any = Gf
        self._vt: Any = Vt
        self._path = path
        # A name that nobody can foretell: what is there under it is ours.
        self._partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.unfinished{path.suffix}")
        # The system says what is in the way; USD says only that something is.
        self._partial.open("xb").close()
        self._stage: Any = Usd.Stage.CreateNew(str(self._partial))
        self._frame_rate = frame_rate
        self._stage.SetTimeCodesPerSecond(frame_rate)
        self._stage.SetFramesPerSecond(frame_rate)
        self._stage.SetStartTimeCode(0)
        UsdGeom.SetStageMetersPerUnit(self._stage, 1)
        UsdGeom.SetStageUpAxis(self._stage, UsdGeom.Tokens.z if up == [0, 0, 1] else UsdGeom.Tokens.y)
        world = UsdGeom.Xform.Define(self._stage, "/World")
        self._stage.SetDefaultPrim(world.GetPrim())
        if up not in ([0, 0, 1], [0, 1, 0]):
            turn = Gf.Rotation(Gf.Vec3d(*up), Gf.Vec3d(0, 1, 0)).GetQuat()
            world.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(turn)
        self._places: list[tuple[Any, Any]] = []
        self._fields: list[Any] = []
        self._last: list[Arrays] = []
        self._told: list[float] = []
        self._now = 0.0
        self._unsaved = 0
        taken: set[str] = set()
        for number, name in enumerate(names):
            word = Tf.MakeValidIdentifier(name or "object")
            word = word if word not in taken else f"{word}_{number}"
            taken.add(word)
            node = UsdGeom.Xform.Define(self._stage, Sdf.Path(f"/World/{word}"))
            node.GetPrim().SetDisplayName(name)
            double = UsdGeom.XformOp.PrecisionDouble
            self._places.append((node.AddTranslateOp(double), node.AddOrientOp(double)))
            field = UsdVol.ParticleField3DGaussianSplat.Define(self._stage, f"/World/{word}/splats").GetPrim()
            field.GetAttribute("radiance:sphericalHarmonicsDegree").Set(sh_degree)
            self._fields.append(field)
            self._last.append({})
            self._told.append(-1.0)

    def add(self, time: float, places: list[tuple[list[float], list[float]]], arrays: list[Arrays | None]) -> None:
        """Adds a step at a time [s]: position and rotation xyzw of every object, and the Gaussians of those that changed."""
        # The simulated time is a sum: a whole frame is told as one.
        code, before = round(time * self._frame_rate, 6), self._now
        is_first = not any(self._last)
        for number, (place, new) in enumerate(zip(places, arrays, strict=True)):
            position, (x, y, z, w) = place
            values = (self._gf.Vec3d(*position), self._gf.Quatd(w, x, y, z))
            for op, value in zip(self._places[number], values, strict=True):
                op.Set(value, code)
            if new is None or not len(new["positions"]):
                continue
            # Between samples all is blended: what stood still until the step before has to say so there.
            if not is_first and self._told[number] < before:
                self._set(number, self._last[number], before)
            if not self._last[number]:
                self._set(number, new, None)
            self._set(number, new, code)
            self._last[number], self._told[number] = new, code
        self._now = code
        self._stage.SetEndTimeCode(code)
        if self._unsaved > _SAVE_AT:
            self.save()

    def _set(self, number: int, arrays: Arrays, code: float | None) -> None:
        field, vt = self._fields[number], self._vt
        kinds = {"orientations": vt.QuatfArray, "opacities": vt.FloatArray}
        reach = 3 * arrays["scales"].max(axis=1, keepdims=True)
        low, high = (arrays["positions"] - reach).min(axis=0), (arrays["positions"] + reach).max(axis=0)
        for name, values in {**arrays, "extent": np.stack([low, high])}.items():
            value = kinds.get(name, vt.Vec3fArray).FromNumpy(np.ascontiguousarray(values, np.float32))
            attribute = field.GetAttribute(name)
            if code is None:
                attribute.Set(value)
            else:
                attribute.Set(value, code)
            self._unsaved += values.nbytes

    def save(self) -> None:
        """Writes what there is to the unfinished file."""
        self._stage.GetRootLayer().Save()
        self._unsaved = 0

    def finish(self) -> None:
        """Completes the file: it gets its name last."""
        self.save()
        self._stage = None
        self._partial.replace(self._path)

    def abandon(self) -> None:
        """Leaves no file."""
        self._stage = None
        self._partial.unlink(missing_ok=True)


def write(source: BinaryIO, path: Path) -> None:
    """Writes the scene that `source` tells to a file; see the module. Raises Malformed when it ends within a step."""
    header = _words(source.readline())
    counts = [entry["count"] for entry in header["objects"]]
    degree = header["sh_degree"]
    names = [entry["name"] for entry in header["objects"]]
    writer = UsdWriter(path, header["up"], header["frame_rate"], degree, names)
    try:
        while line := source.readline():
            step = _words(line)
            places, arrays = [], []
            for entry, count in zip(step["objects"], counts, strict=True):
                places.append((entry["position"], entry["rotation"]))
                arrays.append(_arrays(source, count, degree) if entry["is_new"] else None)
            writer.add(step["time"], places, arrays)
    except BaseException:
        writer.abandon()
        raise
    writer.finish()


def _words(line: bytes) -> dict[str, Any]:
    try:
        words = json.loads(line)
    except ValueError:
        raise Malformed(f"expected a line of JSON, found {line[:40]!r}") from None
    if not isinstance(words, dict):
        raise Malformed(f"expected an object of JSON, found {line[:40]!r}")
    return words


def _arrays(source: BinaryIO, count: int, degree: int) -> Arrays:
    coefficients = (degree + 1) ** 2

    def take(*shape: int) -> NDArray[np.float32]:
        length = 4 * int(np.prod(shape))
        data = source.read(length)
        if len(data) < length:
            raise Malformed(f"the input ends within a step: expected {length} bytes, found {len(data)}")
        return np.frombuffer(data, "<f4").reshape(shape)

    return {
        "positions": take(count, 3),
        "orientations": take(count, 4),
        "scales": take(count, 3),
        "opacities": take(count),
        _SH: take(count * coefficients, 3),
    }


def main() -> None:
    """The other end of `cosplat export --usd`."""
    path = Path(sys.argv[1])
    try:
        write(sys.stdin.buffer, path)
    except (CosplatError, OSError) as error:
        sys.exit(str(error))
    except RuntimeError as error:
        # So usd-core calls what the system refuses, in several lines.
        sys.exit(f"cannot write {path}: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main()
