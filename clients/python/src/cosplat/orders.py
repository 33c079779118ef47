"""Orders to a simulation, in names and SI units, and the answers to them."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from . import wire
from .errors import BadName
from .packing import packer, text

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
    "hencky": (10, ()),
}
"""Constitutive laws: number on the wire, and names of their parameters."""


FIDELITIES: dict[str, int] = {"static": 1, "mpm": 2, "auto": 3, "rigid": 4}
"""How an object can be modelled, with the number on the wire."""


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
    def read_all(data: bytes) -> list[Ack]:
        """The answers of a response."""
        return [
            Ack(sequence, step, status == wire.ACK_ACCEPTED, text(reason))
            for sequence, step, status, reason in _ACK.iter_unpack(data)
        ]


_ACK = packer(wire.Ack)
_COMMAND = packer(wire.Command)

_Triple: TypeAlias = tuple[float, float, float]
_Body: TypeAlias = tuple[int, int, _Triple, _Triple, float, tuple[float, ...]]
"""Kind, number of the object, vector, point, radius and material of a `wire.Command`."""

_ZERO: _Triple = (0.0, 0.0, 0.0)
_NO_MATERIAL = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Order:
    """An order; `at_step` is the step at whose start it takes effect, 0 for the next one."""

    at_step: int = field(default=0, kw_only=True)

    def body(self, scene: Scene) -> _Body:
        """What it says on the wire. Raises BadName for names that the scene does not have."""
        raise NotImplementedError


def encode(orders: Sequence[Order], scene: Scene, first: int) -> bytes:
    """Orders as elements of `wire.Command`, numbered from `first`. Raises BadName, and ValueError for other values."""
    elements = []
    for sequence, order in enumerate(orders, first):
        kind, number, vector, point, radius, material = order.body(scene)
        try:
            element = _COMMAND.pack(kind, number, sequence, order.at_step, *vector, *point, radius, *material)
        except struct.error as error:
            raise ValueError(f"{order} cannot be sent: {error}") from None
        elements.append(element)
    return b"".join(elements)


def _command(
    kind: int, number: int = 0, vector: _Triple = _ZERO, point: _Triple = _ZERO, radius: float = 0.0
) -> _Body:
    return kind, number, vector, point, radius, _NO_MATERIAL


def _vector(what: str, value: Vector) -> _Triple:
    # Most are tuples, and numpy would take ten times as long for them.
    if isinstance(value, tuple) and len(value) == 3:
        x, y, z = value
        if isinstance(x, float | int) and isinstance(y, float | int) and isinstance(z, float | int):
            return x, y, z
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,):
        raise ValueError(f"{what} has shape {array.shape}, expected (3,)")
    x, y, z = array.tolist()
    return x, y, z


@dataclass(frozen=True)
class Push(Order):
    """Impulse [N s] on an object, or on its particles within `radius` [m] of `point` [m]."""

    object: str | int
    impulse: Vector
    point: Vector | None = None
    radius: float = DEFAULT_RADIUS

    def body(self, scene: Scene) -> _Body:
        number, impulse = scene.object_id(self.object), _vector("impulse", self.impulse)
        if self.point is None:
            return _command(wire.COMMAND_IMPULSE, number, impulse)
        return _command(wire.COMMAND_IMPULSE_AT, number, impulse, _vector("point", self.point), self.radius)


@dataclass(frozen=True)
class SetVelocity(Order):
    """Velocity of the centre of mass [m/s] and angular velocity [rad/s] of an object."""

    object: str | int
    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def body(self, scene: Scene) -> _Body:
        return _twist(wire.COMMAND_SET_VELOCITY, scene.object_id(self.object), self)


@dataclass(frozen=True)
class SetMaterial(Order):
    """Another material for an object, or for its region `region`, counted from 1; mass stays as it is.

    `law` is one of LAWS. Units and ranges are those of `docs/scene.md`. With `point` [m] only what is within `radius` [m] of it
    gets the material, or with `half` [m] what is in the box about it with these half edges.
    """

    object: str | int
    law: str
    youngs_modulus: float = 0.0
    poisson_ratio: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    region: int = field(default=0, kw_only=True)
    point: Vector | None = field(default=None, kw_only=True)
    radius: float = field(default=DEFAULT_RADIUS, kw_only=True)
    half: Vector | None = field(default=None, kw_only=True)

    def body(self, scene: Scene) -> _Body:
        if self.law not in LAWS:
            raise BadName(f"law {self.law!r} does not exist: expected one of {', '.join(LAWS)}")
        number, names = LAWS[self.law]
        if set(self.parameters) != set(names):
            given, wanted = sorted(self.parameters), list(names)
            raise BadName(f"law {self.law!r} has the parameters {wanted}, found {given}")
        parameters = [self.parameters[name] for name in names] + [0.0] * (4 - len(names))
        material = (number, self.region, self.youngs_modulus, self.poisson_ratio, *parameters)
        number = scene.object_id(self.object)
        if self.point is None:
            if self.half is not None:
                raise ValueError(f"half is {self.half}, expected none without a point")
            return wire.COMMAND_SET_MATERIAL, number, _ZERO, _ZERO, 0.0, material
        point = _vector("point", self.point)
        if self.half is None:
            return wire.COMMAND_SET_MATERIAL, number, _ZERO, point, self.radius, material
        return wire.COMMAND_SET_MATERIAL, number, _vector("half", self.half), point, 0.0, material


@dataclass(frozen=True)
class SetGravity(Order):
    """New gravity [m/s^2]."""

    gravity: Vector

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_SET_GRAVITY, vector=_vector("gravity", self.gravity))


@dataclass(frozen=True)
class MoveCollider(Order):
    """A collider goes to a pose within one frame: origin [m] and rotation vector [rad]."""

    collider: str | int
    translation: Vector
    rotation: Vector = (0.0, 0.0, 0.0)

    def body(self, scene: Scene) -> _Body:
        translation, rotation = _vector("translation", self.translation), _vector("rotation", self.rotation)
        return _command(wire.COMMAND_MOVE_COLLIDER, scene.collider_number(self.collider), translation, rotation)


@dataclass(frozen=True)
class Pin(Order):
    """Hold an object, or its particles within `radius` [m] of `point` [m]."""

    object: str | int
    point: Vector | None = None
    radius: float = DEFAULT_RADIUS

    def body(self, scene: Scene) -> _Body:
        number = scene.object_id(self.object)
        if self.point is None:
            return _command(wire.COMMAND_PIN, number)
        return _command(wire.COMMAND_PIN, number, point=_vector("point", self.point), radius=self.radius)


@dataclass(frozen=True)
class Release(Order):
    """Let go what is pinned of an object."""

    object: str | int

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_RELEASE, scene.object_id(self.object))


@dataclass(frozen=True)
class Grab(Order):
    """Hold the particles of an object within `radius` [m] of `point` [m] by a spring that pulls the point `to` [m].

    It pulls nowhere without `to`. After `steps` steps without a `Drag` it is let go.
    """

    object: str | int
    point: Vector
    to: Vector | None = None
    radius: float = DEFAULT_RADIUS
    steps: int = 60

    def body(self, scene: Scene) -> _Body:
        point = _vector("point", self.point)
        to = point if self.to is None else _vector("to", self.to)
        number, material = scene.object_id(self.object), (0, self.steps, *_NO_MATERIAL[2:])
        return wire.COMMAND_GRAB, number, to, point, self.radius, material


@dataclass(frozen=True)
class Drag(Order):
    """Pull what the sender holds of an object `to` a point [m], where the spring's end is when the step ends."""

    object: str | int
    to: Vector

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_DRAG, scene.object_id(self.object), _vector("to", self.to))


@dataclass(frozen=True)
class LetGo(Order):
    """Let go what the sender holds of an object."""

    object: str | int

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_LET_GO, scene.object_id(self.object))


def _posed(kind: int, of: SetPose | BringIn, scene: Scene) -> _Body:
    kept = (of.position is None) * wire.POSE_KEEP_PLACE + (of.rotation is None) * wire.POSE_KEEP_ROTATION
    position = _ZERO if of.position is None else _vector("position", of.position)
    rotation = _ZERO if of.rotation is None else _vector("rotation", of.rotation)
    return kind, scene.object_id(of.object), position, rotation, 0.0, (0, kept, *_NO_MATERIAL[2:])


@dataclass(frozen=True)
class SetPose(Order):
    """Put an object elsewhere, at rest: its centre of mass [m] and its rotation vector since rest [rad].

    What is None it keeps. Refused where it would overlap with another object or a collider.
    """

    object: str | int
    position: Vector | None = None
    rotation: Vector | None = None

    def body(self, scene: Scene) -> _Body:
        return _posed(wire.COMMAND_SET_POSE, self, scene)


@dataclass(frozen=True)
class SetFidelity(Order):
    """Model an object as one of FIDELITIES; `static` is one body that stands where it is."""

    object: str | int
    fidelity: str

    def body(self, scene: Scene) -> _Body:
        if self.fidelity not in FIDELITIES:
            raise BadName(f"fidelity {self.fidelity!r} does not exist: expected one of {', '.join(FIDELITIES)}")
        number, material = scene.object_id(self.object), (0, FIDELITIES[self.fidelity], *_NO_MATERIAL[2:])
        return wire.COMMAND_SET_FIDELITY, number, _ZERO, _ZERO, 0.0, material


@dataclass(frozen=True)
class Remove(Order):
    """Take an object out of the world; it keeps its number."""

    object: str | int

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_REMOVE, scene.object_id(self.object))


@dataclass(frozen=True)
class BringIn(Order):
    """Bring an object in that was removed or is absent from the beginning: centre of mass [m], rotation vector [rad].

    Without them it comes where it was, and as it was turned.
    """

    object: str | int
    position: Vector | None = None
    rotation: Vector | None = None

    def body(self, scene: Scene) -> _Body:
        return _posed(wire.COMMAND_BRING_IN, self, scene)


@dataclass(frozen=True)
class Undo(Order):
    """Back to the state right before the newest edit; the step count goes on."""

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_UNDO)


@dataclass(frozen=True)
class Redo(Order):
    """Back to the state that the newest undo left; the step count goes on."""

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_REDO)


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

    def body(self, scene: Scene) -> _Body:
        force, torque = _vector("force", self.force), _vector("torque", self.torque)
        number = scene.object_id(self.object)
        if self.point is None:
            return _command(wire.COMMAND_FORCE, number, force, torque)
        if any(torque):
            raise ValueError(f"torque is {list(torque)}, expected none together with a point")
        return _command(wire.COMMAND_FORCE_AT, number, force, _vector("point", self.point), self.radius)


@dataclass(frozen=True)
class ColliderVelocity(Order):
    """A collider moves with a velocity [m/s] and spin [rad/s] during one step; then it stands."""

    collider: str | int
    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)

    def body(self, scene: Scene) -> _Body:
        return _twist(wire.COMMAND_COLLIDER_VELOCITY, scene.collider_number(self.collider), self)


def _twist(kind: int, number: int, of: SetVelocity | ColliderVelocity) -> _Body:
    return _command(kind, number, _vector("linear", of.linear), _vector("angular", of.angular))


@dataclass(frozen=True)
class _Numbered(Order):
    number: int
    kind: ClassVar[int]

    def body(self, scene: Scene) -> _Body:
        return _command(self.kind, self.number)


@dataclass(frozen=True)
class Cancel(Order):
    """Drop the orders that wait for their step, at once: those of this session's client number, or those `of_all` clients.

    Files and steps that somebody waits for are not made either, and that one is told so.
    """

    of_all: bool = False

    def body(self, scene: Scene) -> _Body:
        return _command(wire.COMMAND_CANCEL, int(self.of_all))


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

    def body(self, scene: Scene) -> _Body:
        return _command(self.kind)


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
