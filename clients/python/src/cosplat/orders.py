"""Orders to a simulation, in names and SI units, and the answers to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import wire
from .errors import BadName

if TYPE_CHECKING:
    from .scene import Scene

Vector: TypeAlias = ArrayLike
"""Three numbers: a tuple, list or array."""

DEFAULT_RADIUS = 0.05
"""Radius of a push or pin at a point that names none [m]."""

LAWS: dict[str, tuple[int, tuple[str, ...]]] = {
    "fixed_corotated": (1, ()),
    "neo_hookean": (2, ()),
    "von_mises": (3, ("yield_stress_pa", "hardening_pa")),
    "drucker_prager": (4, ("friction_angle_deg", "cohesion")),
    "snow": (5, ("critical_compression", "critical_stretch", "hardening")),
    "foam": (6, ("yield_stress_pa", "viscosity_pa_s", "exponent")),
    "plasticine": (7, ("yield_stress_pa", "softening")),
    "fluid": (8, ("bulk_modulus_pa", "viscosity_pa_s")),
    "rigid": (9, ()),
}
"""Constitutive laws: number on the wire, and names of their parameters."""


class Ack(NamedTuple):
    """The answer to one order."""

    sequence: int
    """The sender's running number of the order."""
    step: int
    """Step at whose start it takes effect."""
    accepted: bool
    """Whether it takes effect."""
    reason: str
    """For refusals why, with expected and actual values; for checkpoints the path of the file."""

    @staticmethod
    def read(element: np.void) -> Ack:
        """An answer from the wire."""
        ack = wire.Ack.read(element)
        accepted = ack.status == wire.ACK_ACCEPTED
        return Ack(ack.sequence, ack.applied_at_step, accepted, ack.reason.decode(errors="replace"))


@dataclass(frozen=True)
class Order:
    """An order; `at_step` is the step at whose start it takes effect, 0 for the next one."""

    at_step: int = field(default=0, kw_only=True)

    def fill(self, command: np.void, scene: Scene) -> None:
        """Writes the order into a zeroed `wire.Command`. Raises BadName for names that the scene does not have."""
        raise NotImplementedError


def _vector(what: str, value: Vector) -> NDArray[np.float64]:
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (3,):
        raise ValueError(f"{what} has shape {vector.shape}, expected (3,)")
    return vector


@dataclass(frozen=True)
class Push(Order):
    """Impulse [N s] on an object, or on its particles within `radius` [m] of `point` [m]."""

    object: str | int
    impulse: Vector
    point: Vector | None = None
    radius: float = DEFAULT_RADIUS

    def fill(self, command: np.void, scene: Scene) -> None:
        command["object"] = scene.object_id(self.object)
        command["vector"] = _vector("impulse", self.impulse)
        command["kind"] = wire.COMMAND_IMPULSE
        if self.point is not None:
            command["kind"] = wire.COMMAND_IMPULSE_AT
            command["point"] = _vector("point", self.point)
            command["radius"] = self.radius


@dataclass(frozen=True)
class SetVelocity(Order):
    """Velocity of the centre of mass [m/s] and angular velocity [rad/s] of an object."""

    object: str | int
    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_SET_VELOCITY
        command["object"] = scene.object_id(self.object)
        command["vector"] = _vector("linear", self.linear)
        command["point"] = _vector("angular", self.angular)


@dataclass(frozen=True)
class SetMaterial(Order):
    """Another material for an object, or for its region `region`, counted from 1; mass stays as it is.

    `law` is one of LAWS. Units and ranges are those of `docs/scene.md`.
    """

    object: str | int
    law: str
    youngs_modulus: float = 0.0
    poisson_ratio: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    region: int = field(default=0, kw_only=True)

    def fill(self, command: np.void, scene: Scene) -> None:
        if self.law not in LAWS:
            raise BadName(f"law {self.law!r} does not exist: expected one of {', '.join(LAWS)}")
        number, names = LAWS[self.law]
        if set(self.parameters) != set(names):
            given, wanted = sorted(self.parameters), list(names)
            raise BadName(f"law {self.law!r} has the parameters {wanted}, found {given}")
        command["kind"] = wire.COMMAND_SET_MATERIAL
        command["object"] = scene.object_id(self.object)
        material = command["material"]
        material["law"], material["region"] = number, self.region
        material["youngs_modulus"], material["poisson_ratio"] = self.youngs_modulus, self.poisson_ratio
        for index, name in enumerate(names):
            material["parameters"][index] = self.parameters[name]


@dataclass(frozen=True)
class SetGravity(Order):
    """New gravity [m/s^2]."""

    gravity: Vector

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_SET_GRAVITY
        command["vector"] = _vector("gravity", self.gravity)


@dataclass(frozen=True)
class MoveCollider(Order):
    """A collider goes to a pose within one frame: origin [m] and rotation vector [rad]."""

    collider: str | int
    translation: Vector
    rotation: Vector = (0.0, 0.0, 0.0)

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_MOVE_COLLIDER
        command["object"] = scene.collider_number(self.collider)
        command["vector"] = _vector("translation", self.translation)
        command["point"] = _vector("rotation", self.rotation)


@dataclass(frozen=True)
class Pin(Order):
    """Hold an object, or its particles within `radius` [m] of `point` [m]."""

    object: str | int
    point: Vector | None = None
    radius: float = DEFAULT_RADIUS

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_PIN
        command["object"] = scene.object_id(self.object)
        if self.point is not None:
            command["point"] = _vector("point", self.point)
            command["radius"] = self.radius


@dataclass(frozen=True)
class Release(Order):
    """Let go what is pinned of an object."""

    object: str | int

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_RELEASE
        command["object"] = scene.object_id(self.object)


@dataclass(frozen=True)
class Force(Order):
    """Force [N] and torque [N m] on an object during one step; with `point` [m] on its particles within `radius` [m] of it.

    A force that lasts is ordered for every step. Torque turns about the centre of mass, and goes without a point.
    """

    object: str | int
    force: Vector
    torque: Vector = (0.0, 0.0, 0.0)
    point: Vector | None = None
    radius: float = DEFAULT_RADIUS

    def fill(self, command: np.void, scene: Scene) -> None:
        torque = _vector("torque", self.torque)
        command["object"] = scene.object_id(self.object)
        command["vector"] = _vector("force", self.force)
        if self.point is None:
            command["kind"] = wire.COMMAND_FORCE
            command["point"] = torque
            return
        if torque.any():
            raise ValueError(f"torque is {torque.tolist()}, expected none together with a point")
        command["kind"] = wire.COMMAND_FORCE_AT
        command["point"] = _vector("point", self.point)
        command["radius"] = self.radius


@dataclass(frozen=True)
class ColliderVelocity(Order):
    """A collider moves with a velocity [m/s] and spin [rad/s] during one step; then it stands."""

    collider: str | int
    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = wire.COMMAND_COLLIDER_VELOCITY
        command["object"] = scene.collider_number(self.collider)
        command["vector"] = _vector("linear", self.linear)
        command["point"] = _vector("angular", self.angular)


@dataclass(frozen=True)
class _Numbered(Order):
    number: int
    kind: ClassVar[int]

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = self.kind
        command["object"] = self.number


class Save(_Numbered):
    """Keep the state in the server's memory as snapshot `number`; 16 of them at most."""

    kind = wire.COMMAND_SAVE


class Restore(_Numbered):
    """Back to the state of snapshot `number`; the step count goes on."""

    kind = wire.COMMAND_RESTORE


class Step(_Numbered):
    """Make `number` steps while the server is paused, 1 to 1,000,000; answered when the last frame was sent."""

    kind = wire.COMMAND_STEP


class _Plain(Order):
    kind: ClassVar[int]

    def fill(self, command: np.void, scene: Scene) -> None:
        command["kind"] = self.kind


class Checkpoint(_Plain):
    """Write the state to a file on the server's side; the answer's `reason` is its path."""

    kind = wire.COMMAND_CHECKPOINT


class Pause(_Plain):
    """Stop stepping; with `at_step` the step before is the last."""

    kind = wire.COMMAND_PAUSE


class Resume(_Plain):
    """Step again."""

    kind = wire.COMMAND_RESUME


class Reset(_Plain):
    """Back to the initial state."""

    kind = wire.COMMAND_RESET


class Stop(_Plain):
    """Shut the server down."""

    kind = wire.COMMAND_STOP
