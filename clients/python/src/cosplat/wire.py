"""Wire types of cosplat; `docs/wire-format.md` says what they mean.

Written from the Rust types by `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings`; a test keeps it equal to
them. `X.dtype` is the layout of X in shared memory, for arrays; an X is one of them, read.
"""

# ruff: noqa: E501
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


def _dtype(size: int, **fields: tuple[Any, int]) -> np.dtype[np.void]:
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": size,
        }
    )


class Record:
    """A wire type, read."""

    __slots__ = ()

    type_name: ClassVar[str]
    """Name that iceoryx2 compares."""
    alignment: ClassVar[int]
    """Alignment in shared memory [byte]."""
    dtype: ClassVar[np.dtype[np.void]]
    """Layout, without reserved fields."""
    nested: ClassVar[dict[str, type[Record]]] = {}
    """Fields that are wire types themselves."""

    @classmethod
    def read(cls, element: np.void) -> Self:
        """An element of an array of `dtype`, copied."""
        element = element.copy()
        values = list(element.item())
        for name, kind in cls.nested.items():
            values[(cls.dtype.names or ()).index(name)] = kind.read(element[name])
        return cls(*values)


SCHEMA_HASH = 0x9d9272eb044a0f5b
"""Hash of the layout of all types: a server with another one in its hello is not read."""
CHANGE_PLACED = 1
"""All of the object is as its own frame had it last, at another place."""
CHANGE_GAUSSIANS = 2
"""The object's Gaussians follow, in the world frame."""
CHANGE_FORM = 3
"""The object's Gaussians follow, in its own frame, and its place: what `CHANGE_PLACED` refers to from now on."""
COMMAND_IMPULSE = 1
"""`Command::kind`: add `vector` [N s] to the momentum of `object`."""
COMMAND_IMPULSE_AT = 2
"""Impulse `vector` [N s] on the particles of `object` within `radius` of `point`."""
COMMAND_SET_VELOCITY = 3
"""Give `object` the velocity `vector` [m/s] and the spin `point` [rad/s]."""
COMMAND_SET_MATERIAL = 4
"""Give `object`, or one region of it, the material `material`; mass stays. With a `radius` only what is within it of `point`, with `vector` only what is in the box about `point` with these half edges [m]."""
COMMAND_SET_GRAVITY = 5
"""Set gravity to `vector` [m/s^2]."""
COMMAND_PAUSE = 6
"""Stop stepping before the next step."""
COMMAND_RESUME = 7
"""Step again."""
COMMAND_RESET = 8
"""Back to the initial state."""
COMMAND_STOP = 9
"""Shut the server down cleanly."""
COMMAND_MOVE_COLLIDER = 10
"""Move collider number `object` so that at the end of the frame its origin is at `vector` [m], turned by the rotation vector `point` [rad]."""
COMMAND_PIN = 11
"""Hold the particles of `object` that are within `radius` of `point` now; all of them when `radius` is 0."""
COMMAND_RELEASE = 12
"""Let go what `COMMAND_PIN` holds of `object`."""
COMMAND_CHECKPOINT = 13
"""Write a checkpoint of the state before `apply_at_step`; the answer's `reason` is the file's path."""
COMMAND_FORCE = 14
"""Force `vector` [N] and torque `point` [N m] about the centre of mass on `object` during the step."""
COMMAND_FORCE_AT = 15
"""Force `vector` [N] during the step on the particles of `object` within `radius` of `point`."""
COMMAND_COLLIDER_VELOCITY = 16
"""Move collider number `object` with velocity `vector` [m/s] and spin `point` [rad/s] during the step; then it stands."""
COMMAND_SAVE = 17
"""Keep the state in the server's memory as snapshot number `object`, in place of a former one of that number."""
COMMAND_RESTORE = 18
"""Back to the state of snapshot number `object`; the step count goes on."""
COMMAND_STEP = 19
"""Make `object` steps while the server is paused, 1 to 1,000,000; answered when the last frame was sent."""
COMMAND_SEEK = 20
"""Have a replay go to `apply_at_step`, or to the first recorded step behind it; servers that simulate refuse it."""
COMMAND_GRAB = 21
"""Hold the particles of `object` that are within `radius` of `point` by a spring that pulls the point to `vector` [m], for `material.region` steps without `COMMAND_DRAG`, 0 for 60."""
COMMAND_DRAG = 22
"""Pull what the sender holds of `object` to `vector` [m], where the spring's end is when the step ends."""
COMMAND_LET_GO = 23
"""Let go what the sender holds of `object`."""
COMMAND_SET_POSE = 24
"""Put `object` at rest with its centre of mass at `vector` [m], turned since rest by the rotation vector `point` [rad]; `material.region` is 0 or `POSE_*` flags."""
COMMAND_SET_FIDELITY = 25
"""Model `object` as `material.region` says: 1 as one body that stands, 2 as matter, 3 with as little as allowed, 4 as one body."""
COMMAND_REMOVE = 26
"""Take `object` out of the world; it keeps its number."""
COMMAND_BRING_IN = 27
"""Bring `object` in that was removed or is absent from the beginning, at a pose as of `COMMAND_SET_POSE`."""
COMMAND_UNDO = 28
"""Back to the state right before the newest edit; the step count goes on."""
COMMAND_REDO = 29
"""Back to the state that the newest `COMMAND_UNDO` left; the step count goes on."""
COMMAND_CANCEL = 30
"""Drop the orders that wait for their step, at once: `object` 0 those of the sender's `client` number, 1 those of all."""
POSE_KEEP_PLACE = 1
"""Flag of a pose: the object keeps its place, and `vector` is not read."""
POSE_KEEP_ROTATION = 2
"""Flag of a pose: the object keeps its rotation, and `point` is not read."""
ACK_ACCEPTED = 1
"""The command takes effect at `applied_at_step`."""
ACK_REFUSED = 2
"""The command is refused and changes nothing; see `reason`."""
MAX_COMMANDS = 32
"""Commands that one request and one journal message hold at most."""
CONTACT_OBJECT = 1
"""`other` is an object."""
CONTACT_COLLIDER = 2
"""`other` is a collider."""
FRAME_FLAG_RESET = 1
"""The state was set back to the initial one in this step."""
FRAME_FLAG_PAUSED = 2
"""The server was paused when it sent this frame: no step follows before it is resumed. A pause that comes later is told by `status` alone."""
FRAME_FLAG_LAST = 4
"""This is the last frame of the session."""
FRAME_FLAG_RESTORED = 8
"""The state was set back to that of a snapshot in this step."""
WIRE_VERSION = 1
"""Major version of the wire contract; part of every service and type name."""
SCENE_FILE_ASSET = 1
"""`SceneFile::kind`: a splat or mesh that the scene file names."""
SCENE_FILE_CHECKPOINT = 2
"""`SceneFile::kind`: the checkpoint that the server began with."""
SERVER_RUNNING = 1
"""The server is stepping."""
SERVER_PAUSED = 2
"""The server is paused."""
SERVER_STOPPING = 3
"""The server is shutting down."""
SERVER_WAITING = 4
"""The server waits for participants in lock-step."""
STEP_ATTACH = 1
"""The sender takes part from now on, and every step waits for it. Without commands."""
STEP_ADVANCE = 2
"""The sender permits `frames` steps; the answer comes after the last frame was sent."""
STEP_DETACH = 3
"""The sender takes part no more. Without commands."""
UNTIL_CONTACT = 1
"""Answer at the end of a step in which `pair` touches."""
UNTIL_EVENT = 2
"""Answer at the end of a step with an event: particles left the domain, an object fell apart, the state was set back."""
UNTIL_QUARANTINE = 4
"""Answer at the end of a step in which particles were frozen because their state stayed bad."""
ANY = 4294967295
"""Any object or collider."""
MAX_STEPS = 1000000
"""Most steps in a request."""
RETURN_COMPLETE = 1
"""All was done as asked."""
RETURN_CONTACT = 2
"""The pair touches."""
RETURN_EVENT = 3
"""An event; `reason` says which."""
RETURN_QUARANTINE = 4
"""Particles were frozen."""
RETURN_TERMINATE = 5
"""The server ends, and no step follows."""
RETURN_TIMEOUT = 6
"""`timeout_ns` is over; `reason` names who was waited for."""
RETURN_REFUSED = 7
"""The request is refused, all of its commands with it; `reason` says why."""


@dataclass(slots=True)
class Hello(Record):
    """Who serves the session. Service and type name carry no version, and this layout never changes."""

    type_name = "cosplat.Hello"
    alignment = 8
    dtype = _dtype(
        64,
        wire_version=("<u4", 0),
        pid=("<u4", 4),
        schema_hash=("<u8", 8),
        epoch=("<u8", 16),
        server_version=("S24", 24),
        recorded_first=("<u8", 48),
        recorded_last=("<u8", 56),
    )

    wire_version: int
    """The server's `WIRE_VERSION`."""
    pid: int
    """The server's process id."""
    schema_hash: int
    """Hash of the server's layout table."""
    epoch: int
    """Grows with every start of a server."""
    server_version: bytes
    """Release of the server, UTF-8, zero-padded."""
    recorded_first: int
    """First step of the recording that the server replays; 0 where it simulates."""
    recorded_last: int
    """Last step of that recording; 0 where it simulates."""


@dataclass(slots=True)
class GaussianState(Record):
    """One Gaussian: one cache line."""

    type_name = "cosplat.v1.GaussianState"
    alignment = 64
    dtype = _dtype(
        64,
        position=(("<f4", (3,)), 0),
        color=(("u1", (4,)), 12),
        covariance=(("<f4", (6,)), 16),
        object=("<u4", 40),
        index=("<u4", 44),
        rotation=(("<f4", (4,)), 48),
    )

    position: NDArray[np.float32]
    """Centre [m], world frame."""
    color: NDArray[np.uint8]
    """Base colour and opacity, RGBA, 0..=255, not premultiplied."""
    covariance: NDArray[np.float32]
    """Covariance xx xy xz yy yz zz [m^2], world frame."""
    object: int
    """Object id."""
    index: int
    """Index of this Gaussian in the `scene` blocks."""
    rotation: NDArray[np.float32]
    """World-from-asset rotation (polar part of F times the placement), unit quaternion xyzw: evaluate the spherical harmonics of the `scene` blocks in the view direction turned back by it."""


@dataclass(slots=True)
class FrameHeader(Record):
    """User header of `frame`."""

    type_name = "cosplat.v1.FrameHeader"
    alignment = 8
    dtype = _dtype(
        80,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        dt=("<f8", 16),
        epoch=("<u8", 24),
        state_hash=("<u8", 32),
        publish_ns=("<u8", 40),
        count=("<u4", 48),
        substeps=("<u4", 52),
        flags=("<u4", 56),
    )

    step: int
    """Step count; consecutive frames differ by 1, anything else is a gap."""
    sim_time: float
    """Simulated time at the end of the step [s]."""
    dt: float
    """Size of the last substep [s]."""
    epoch: int
    """Identifies the published scene; a client that sees a new epoch re-reads it."""
    state_hash: int
    """Hash of the complete simulation state."""
    publish_ns: int
    """`CLOCK_MONOTONIC` when the frame was sent [ns]."""
    count: int
    """Gaussians in this frame."""
    substeps: int
    """Substeps in this step."""
    flags: int
    """`FRAME_FLAG_*`."""


@dataclass(slots=True)
class ChangeSlot(Record):
    """64 bytes of a `changes` message: rows first, then Gaussians."""

    type_name = "cosplat.v1.ChangeSlot"
    alignment = 64
    dtype = _dtype(
        64,
        words=(("<u8", (8,)), 0),
    )

    words: NDArray[np.uint64]
    """As many whole slots as the `ObjectChange` rows take, one after the other; then one `GaussianState` each."""


@dataclass(slots=True)
class ObjectChange(Record):
    """How one object has changed."""

    type_name = "cosplat.v1.ObjectChange"
    alignment = 8
    dtype = _dtype(
        80,
        object=("<u4", 0),
        kind=("<u4", 4),
        first=("<u4", 8),
        count=("<u4", 12),
        slot=("<u4", 16),
        position=(("<f8", (3,)), 24),
        rotation=(("<f8", (4,)), 48),
    )

    object: int
    """Object id."""
    kind: int
    """`CHANGE_*`."""
    first: int
    """Its first Gaussian in the frame."""
    count: int
    """Its Gaussians."""
    slot: int
    """The slot of its first Gaussian in this message; 0 for `CHANGE_PLACED`."""
    position: NDArray[np.float64]
    """Where its own frame has its origin [m]; zeros for `CHANGE_GAUSSIANS`."""
    rotation: NDArray[np.float64]
    """World-from-own rotation, unit quaternion xyzw; zeros for `CHANGE_GAUSSIANS`."""


@dataclass(slots=True)
class ChangesHeader(Record):
    """User header of `changes`."""

    type_name = "cosplat.v1.ChangesHeader"
    alignment = 8
    dtype = _dtype(
        80,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        dt=("<f8", 16),
        epoch=("<u8", 24),
        state_hash=("<u8", 32),
        publish_ns=("<u8", 40),
        since=("<u8", 48),
        count=("<u4", 56),
        objects=("<u4", 60),
        gaussians=("<u4", 64),
        substeps=("<u4", 68),
        flags=("<u4", 72),
    )

    step: int
    """Step count, as in `frame`."""
    sim_time: float
    """Simulated time at the end of the step [s]."""
    dt: float
    """Size of the last substep [s]."""
    epoch: int
    """As in `frame`."""
    state_hash: int
    """Hash of the complete simulation state, as in `frame`."""
    publish_ns: int
    """`CLOCK_MONOTONIC` when the message was sent [ns]."""
    since: int
    """The step of the message that this one builds on; its own step where it is complete by itself."""
    count: int
    """Slots in this message."""
    objects: int
    """`ObjectChange` rows in it."""
    gaussians: int
    """Gaussians of the whole frame."""
    substeps: int
    """Substeps in this step."""
    flags: int
    """`FRAME_FLAG_*`."""


@dataclass(slots=True)
class ObjectState(Record):
    """One object."""

    type_name = "cosplat.v1.ObjectState"
    alignment = 8
    dtype = _dtype(
        216,
        id=("<u4", 0),
        fidelity=("<u4", 4),
        mass=("<f8", 8),
        com=(("<f8", (3,)), 16),
        rotation=(("<f8", (4,)), 40),
        linear_velocity=(("<f8", (3,)), 72),
        angular_velocity=(("<f8", (3,)), 96),
        inertia=(("<f8", (6,)), 120),
        radius=("<f8", 168),
        kinetic_energy=("<f8", 176),
        elastic_energy=("<f8", 184),
        contact_impulse=(("<f8", (3,)), 192),
    )

    id: int
    """Object id."""
    fidelity: int
    """How it is modelled at present: 1 static, 2 MPM, 3 asleep, 4 rigid, 6 nothing is left of it, 7 removed."""
    mass: float
    """Mass [kg]."""
    com: NDArray[np.float64]
    """Centre of mass [m]."""
    rotation: NDArray[np.float64]
    """Rotation since rest, unit quaternion xyzw."""
    linear_velocity: NDArray[np.float64]
    """Velocity of the centre of mass [m/s]."""
    angular_velocity: NDArray[np.float64]
    """Angular velocity [rad/s]."""
    inertia: NDArray[np.float64]
    """Inertia about the centre of mass xx xy xz yy yz zz [kg m^2]."""
    radius: float
    """Effective radius [m]."""
    kinetic_energy: float
    """Kinetic energy [J]."""
    elastic_energy: float
    """Elastic energy [J]."""
    contact_impulse: NDArray[np.float64]
    """Impulse from colliders and other objects during the step [N s]."""


@dataclass(slots=True)
class ObjectsHeader(Record):
    """User header of `objects`."""

    type_name = "cosplat.v1.ObjectsHeader"
    alignment = 8
    dtype = _dtype(
        40,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        epoch=("<u8", 16),
        count=("<u4", 24),
        state_hash=("<u8", 32),
    )

    step: int
    """Step count, as in `frame`."""
    sim_time: float
    """Simulated time [s]."""
    epoch: int
    """As in `frame`."""
    count: int
    """Objects in this message."""
    state_hash: int
    """Hash of the complete simulation state, as in `frame`; here also of steps whose frame was skipped."""


@dataclass(slots=True)
class Contact(Record):
    """A pair that touched during a step."""

    type_name = "cosplat.v1.Contact"
    alignment = 8
    dtype = _dtype(
        88,
        object=("<u4", 0),
        other=("<u4", 4),
        kind=("<u4", 8),
        point=(("<f8", (3,)), 16),
        normal=(("<f8", (3,)), 40),
        impulse=(("<f8", (3,)), 64),
    )

    object: int
    """Object id; of two objects the lower one."""
    other: int
    """Object id or number of a collider."""
    kind: int
    """What `other` is, `CONTACT_*`."""
    point: NDArray[np.float64]
    """Where they touch [m], world frame: mean weighted by normal impulses."""
    normal: NDArray[np.float64]
    """Unit normal that points from `other` to `object`."""
    impulse: NDArray[np.float64]
    """Impulse that `object` received from `other` during the step [N s]."""


@dataclass(slots=True)
class ContactsHeader(Record):
    """User header of `contacts`."""

    type_name = "cosplat.v1.ContactsHeader"
    alignment = 8
    dtype = _dtype(
        32,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        epoch=("<u8", 16),
        count=("<u4", 24),
        total=("<u4", 28),
    )

    step: int
    """Step count, as in `frame`."""
    sim_time: float
    """Simulated time [s]."""
    epoch: int
    """As in `frame`."""
    count: int
    """Contacts in this message."""
    total: int
    """Contacts in the step; more than `count` when the message holds only the strongest."""


@dataclass(slots=True)
class GaussianRest(Record):
    """One Gaussian at rest (block `scene/gaussians`)."""

    type_name = "cosplat.v1.GaussianRest"
    alignment = 4
    dtype = _dtype(
        48,
        position=(("<f4", (3,)), 0),
        opacity=("<f4", 12),
        scale=(("<f4", (3,)), 16),
        object=("<u4", 28),
        rotation=(("<f4", (4,)), 32),
    )

    position: NDArray[np.float32]
    """Centre [m]."""
    opacity: float
    """Opacity, 0..=1."""
    scale: NDArray[np.float32]
    """Standard deviations along the local axes [m]."""
    object: int
    """Object id."""
    rotation: NDArray[np.float32]
    """World-from-local rotation, unit quaternion xyzw."""


@dataclass(slots=True)
class ObjectInfo(Record):
    """One object (block `scene/objects`)."""

    type_name = "cosplat.v1.ObjectInfo"
    alignment = 8
    dtype = _dtype(
        144,
        id=("<u4", 0),
        fidelity=("<u4", 4),
        particle_count=("<u4", 8),
        gaussian_first=("<u4", 12),
        gaussian_count=("<u4", 16),
        law=("<u4", 20),
        youngs_modulus=("<f8", 24),
        poisson_ratio=("<f8", 32),
        density=("<f8", 40),
        name=("S64", 48),
        material=("S32", 112),
    )

    id: int
    """Object id."""
    fidelity: int
    """How the scene asks for it: 1 static, 2 MPM, 3 automatic, 4 rigid."""
    particle_count: int
    """Particles of the object."""
    gaussian_first: int
    """Index of its first Gaussian."""
    gaussian_count: int
    """Gaussians of the object."""
    law: int
    """Constitutive law, as in `MaterialSpec`."""
    youngs_modulus: float
    """Young's modulus [Pa]."""
    poisson_ratio: float
    """Poisson's ratio."""
    density: float
    """Density [kg/m^3]."""
    name: bytes
    """Name, UTF-8, zero-padded."""
    material: bytes
    """Material name, UTF-8, zero-padded."""


@dataclass(slots=True)
class SceneFile(Record):
    """One file that the server read beside the scene file (block `scene/files`). With them the run can be simulated again."""

    type_name = "cosplat.v1.SceneFile"
    alignment = 8
    dtype = _dtype(
        8216,
        kind=("<u4", 0),
        length=("<u8", 8),
        hash=("<u8", 16),
        name=("S4096", 24),
        path=("S4096", 4120),
    )

    kind: int
    """`SCENE_FILE_*`."""
    length: int
    """Length of its content when the server read it [byte]."""
    hash: int
    """XXH3 of its content then, 64 bits, seed 0."""
    name: bytes
    """As the scene file names it; the file name of a checkpoint. UTF-8, zero-padded."""
    path: bytes
    """Absolute path on the server's machine, UTF-8, zero-padded."""


@dataclass(slots=True)
class SceneHeader(Record):
    """User header of every `scene` block."""

    type_name = "cosplat.v1.SceneHeader"
    alignment = 8
    dtype = _dtype(
        104,
        epoch=("<u8", 0),
        scene_hash=("<u8", 8),
        frame_rate=("<f8", 16),
        dx=("<f8", 24),
        gravity=(("<f8", (3,)), 32),
        bounds_min=(("<f4", (3,)), 56),
        bounds_max=(("<f4", (3,)), 68),
        gaussian_count=("<u4", 80),
        particle_count=("<u4", 84),
        object_count=("<u4", 88),
        sh_degree=("<u4", 92),
        feature_dim=("<u4", 96),
    )

    epoch: int
    """Identifies this publication of the scene."""
    scene_hash: int
    """Hash of the scene; equal for equal scenes, also after a restart."""
    frame_rate: float
    """Published frames per simulated second [1/s]."""
    dx: float
    """Grid cell size [m]."""
    gravity: NDArray[np.float64]
    """Initial gravity [m/s^2]."""
    bounds_min: NDArray[np.float32]
    """Box to look at [m]: what moves, at rest, without outliers, down to a floor nearby; smallest corner."""
    bounds_max: NDArray[np.float32]
    """Largest corner [m]."""
    gaussian_count: int
    """Gaussians in the scene."""
    particle_count: int
    """Particles in the scene."""
    object_count: int
    """Objects in the scene."""
    sh_degree: int
    """Spherical-harmonics degree, 0..=3 (block `scene/sh`: `[gaussian][coefficient][rgb]` f32)."""
    feature_dim: int
    """Semantic feature length, 0 = none (block `scene/features`: `[gaussian][feature_dim]` f32)."""


@dataclass(slots=True)
class MaterialSpec(Record):
    """Law and parameters of a material; `docs/wire-format.md` lists the laws."""

    type_name = "cosplat.v1.MaterialSpec"
    alignment = 8
    dtype = _dtype(
        56,
        law=("<u4", 0),
        region=("<u4", 4),
        youngs_modulus=("<f8", 8),
        poisson_ratio=("<f8", 16),
        parameters=(("<f8", (4,)), 24),
    )

    law: int
    """Constitutive law, 1 to 10."""
    region: int
    """0 for the whole object, `n` for its region `n`, counted from 1. Of `COMMAND_GRAB` a number of steps, of `COMMAND_SET_POSE` and `COMMAND_BRING_IN` flags, of `COMMAND_SET_FIDELITY` a level."""
    youngs_modulus: float
    """Young's modulus [Pa]; not read for fluid and rigid matter."""
    poisson_ratio: float
    """Poisson's ratio; not read for fluid and rigid matter."""
    parameters: NDArray[np.float64]
    """What else the law needs, in the order of `docs/wire-format.md`; the rest zero."""


@dataclass(slots=True)
class Command(Record):
    """One order. Fields that a kind does not name are zero."""

    type_name = "cosplat.v1.Command"
    alignment = 8
    dtype = _dtype(
        136,
        kind=("<u4", 0),
        object=("<u4", 4),
        sequence=("<u8", 8),
        apply_at_step=("<u8", 16),
        vector=(("<f8", (3,)), 24),
        point=(("<f8", (3,)), 48),
        radius=("<f8", 72),
        material=(MaterialSpec.dtype, 80),
    )
    nested = {"material": MaterialSpec}

    kind: int
    """`COMMAND_*`."""
    object: int
    """Object id, or another number; see the kinds."""
    sequence: int
    """The sender's running number."""
    apply_at_step: int
    """Step at whose start it takes effect; 0 or a past step means the next one."""
    vector: NDArray[np.float64]
    """Main vector; see the kinds."""
    point: NDArray[np.float64]
    """Point [m], or the second vector; see the kinds."""
    radius: float
    """Radius [m]."""
    material: MaterialSpec
    """For `COMMAND_SET_MATERIAL`; of other kinds `region` alone, where they say so."""


@dataclass(slots=True)
class CommandHeader(Record):
    """User header of a request with commands."""

    type_name = "cosplat.v1.CommandHeader"
    alignment = 8
    dtype = _dtype(
        16,
        client=("<u8", 0),
        pid=("<u4", 8),
        count=("<u4", 12),
    )

    client: int
    """Random number that identifies the sender for the life of its process."""
    pid: int
    """Sender's process id."""
    count: int
    """Commands in the request."""


@dataclass(slots=True)
class Ack(Record):
    """Answer to one command; a response holds one per command of the request, in the same order."""

    type_name = "cosplat.v1.Ack"
    alignment = 8
    dtype = _dtype(
        192,
        sequence=("<u8", 0),
        applied_at_step=("<u8", 8),
        status=("<u4", 16),
        reason=("S168", 24),
    )

    sequence: int
    """Sequence of the command answered."""
    applied_at_step: int
    """Step at whose start it takes effect."""
    status: int
    """`ACK_*`."""
    reason: bytes
    """For refusals a sentence with expected and actual values, for checkpoints the path; UTF-8, zero-padded."""


@dataclass(slots=True)
class StepRequest(Record):
    """User header of a request on `step`; the payload is the commands that go with it."""

    type_name = "cosplat.v1.StepRequest"
    alignment = 8
    dtype = _dtype(
        96,
        client=("<u8", 0),
        pid=("<u4", 8),
        count=("<u4", 12),
        kind=("<u4", 16),
        frames=("<u4", 20),
        until=("<u4", 24),
        pair_kind=("<u4", 28),
        pair=(("<u4", (2,)), 32),
        timeout_ns=("<u8", 40),
        participant=("S48", 48),
    )

    client: int
    """Number that orders the commands of a step and stands in the journal; see `docs/wire-format.md`."""
    pid: int
    """Sender's process id."""
    count: int
    """Commands in the request."""
    kind: int
    """`STEP_*`."""
    frames: int
    """Steps asked for, 1 to 1,000,000; 0 for `STEP_ATTACH` and `STEP_DETACH`."""
    until: int
    """Sum of `UNTIL_*`: what brings the answer before the last of these steps."""
    pair_kind: int
    """For `UNTIL_CONTACT`: what `pair[1]` is, `CONTACT_*`; 0 for either."""
    pair: NDArray[np.uint32]
    """For `UNTIL_CONTACT`: object and other; `ANY` for whichever."""
    timeout_ns: int
    """Wall time after which the answer comes with the steps made until then [ns]; 0 for no limit."""
    participant: bytes
    """Name, 1 to 48 of the characters a-z A-Z 0-9 - _ . , zero-padded."""


@dataclass(slots=True)
class StepDone(Record):
    """User header of an answer on `step`; the payload is one `Ack` per command, in the same order."""

    type_name = "cosplat.v1.StepDone"
    alignment = 8
    dtype = _dtype(
        192,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        epoch=("<u8", 16),
        state_hash=("<u8", 24),
        step_ns=("<u8", 32),
        frames=("<u4", 40),
        cause=("<u4", 44),
        count=("<u4", 48),
        contact_kind=("<u4", 52),
        contact=(("<u4", (2,)), 56),
        reason=("S128", 64),
    )

    step: int
    """Steps completed by the server; the frame of this step was sent."""
    sim_time: float
    """Simulated time at the end of it [s]."""
    epoch: int
    """As in `frame`."""
    state_hash: int
    """Hash of the state after it, as in `frame`."""
    step_ns: int
    """Wall time that the server spent on the steps of this request, publishing included [ns]."""
    frames: int
    """Steps made for this request."""
    cause: int
    """`RETURN_*`."""
    count: int
    """Answers in the payload."""
    contact_kind: int
    """For `RETURN_CONTACT`: what `contact[1]` is, `CONTACT_*`."""
    contact: NDArray[np.uint32]
    """For `RETURN_CONTACT`: object and other."""
    reason: bytes
    """For all causes but `RETURN_COMPLETE` a sentence; UTF-8, zero-padded."""


@dataclass(slots=True)
class AppliedCommand(Record):
    """One entry of `journal`: a command as it was applied."""

    type_name = "cosplat.v1.AppliedCommand"
    alignment = 8
    dtype = _dtype(
        152,
        step=("<u8", 0),
        client=("<u8", 8),
        command=(Command.dtype, 16),
    )
    nested = {"command": Command}

    step: int
    """Step at whose start it took effect."""
    client: int
    """Who sent it."""
    command: Command
    """The command."""


@dataclass(slots=True)
class JournalHeader(Record):
    """User header of `journal`."""

    type_name = "cosplat.v1.JournalHeader"
    alignment = 8
    dtype = _dtype(
        32,
        step=("<u8", 0),
        epoch=("<u8", 8),
        first=("<u8", 16),
        count=("<u4", 24),
    )

    step: int
    """Step at whose start the commands took effect."""
    epoch: int
    """As in `frame`."""
    first: int
    """Commands journalled in this epoch before this message; a jump shows that messages were lost."""
    count: int
    """Commands in this message."""


@dataclass(slots=True)
class Status(Record):
    """Newest status of the server."""

    type_name = "cosplat.v1.Status"
    alignment = 8
    dtype = _dtype(
        448,
        step=("<u8", 0),
        sim_time=("<f8", 8),
        heartbeat_ns=("<u8", 16),
        epoch=("<u8", 24),
        steps_per_second=("<f8", 32),
        real_time_factor=("<f8", 40),
        modelled_fraction=("<f8", 48),
        dt=("<f8", 56),
        kinetic_energy=("<f8", 64),
        elastic_energy=("<f8", 72),
        potential_energy=("<f8", 80),
        linear_momentum=(("<f8", (3,)), 88),
        angular_momentum=(("<f8", (3,)), 112),
        frames_published=("<u8", 136),
        frames_skipped=("<u8", 144),
        rollbacks=("<u8", 152),
        particles_left=("<u8", 160),
        particles_quarantined=("<u8", 168),
        commands_accepted=("<u8", 176),
        commands_refused=("<u8", 184),
        state_hash=("<u8", 192),
        dt_limit=("<u4", 200),
        dt_object=("<u4", 204),
        server_state=("<u4", 208),
        pid=("<u4", 212),
        frame_readers=("<u4", 216),
        has_changes=("<u4", 220),
        spring_work=("<f8", 224),
        edit_energy=("<f8", 232),
        edit_mass=("<f8", 240),
        step_seconds=("<f8", 248),
        phase_shares=(("<f8", (10,)), 256),
        cost_shares=(("<f8", (3,)), 336),
        cost_substeps=(("<f8", (3,)), 360),
        cost_dt=(("<f8", (3,)), 384),
        cost_objects=(("<u4", (3,)), 408),
        cost_limits=(("<u4", (3,)), 420),
        cost_points=(("<u4", (3,)), 432),
    )

    step: int
    """Steps completed."""
    sim_time: float
    """Simulated time [s]."""
    heartbeat_ns: int
    """`CLOCK_MONOTONIC` of this update [ns]; a client that sees it stand still calls the server dead."""
    epoch: int
    """Identifies the published scene."""
    steps_per_second: float
    """Steps per wall second, mean over about the last second [1/s]."""
    real_time_factor: float
    """Simulated seconds per wall second, same window."""
    modelled_fraction: float
    """Particle-substeps executed / those of full MPM, since start."""
    dt: float
    """Smallest substep of the last step [s]."""
    kinetic_energy: float
    """Kinetic energy [J]."""
    elastic_energy: float
    """Elastic energy [J]."""
    potential_energy: float
    """Potential energy [J]."""
    linear_momentum: NDArray[np.float64]
    """Linear momentum [kg m/s]."""
    angular_momentum: NDArray[np.float64]
    """Angular momentum about the origin [kg m^2/s]."""
    frames_published: int
    """Frames published."""
    frames_skipped: int
    """Frames not published because no memory was free."""
    rollbacks: int
    """Substeps rolled back."""
    particles_left: int
    """Particles that left the domain."""
    particles_quarantined: int
    """Particles quarantined."""
    commands_accepted: int
    """Commands accepted."""
    commands_refused: int
    """Commands refused."""
    state_hash: int
    """Hash of the state after the last step."""
    dt_limit: int
    """What limited `dt`: 0 frame, 1 sound speed, 2 velocity, 3 deformation."""
    dt_object: int
    """Object that limited `dt`; `u32::MAX` = none."""
    server_state: int
    """`SERVER_*`."""
    pid: int
    """Server's process id."""
    frame_readers: int
    """Readers of `frame` and of `changes`."""
    has_changes: int
    """Whether the server sends `changes` to those who read it: 1, else 0."""
    spring_work: float
    """Work that springs of clients did on what they hold, since start [J]."""
    edit_energy: float
    """Energy that edits brought into the world, since start [J]."""
    edit_mass: float
    """Mass that edits brought into the world, since start [kg]."""
    step_seconds: float
    """Wall time of a step, mean over about the last second; 0 while nothing is known [s]."""
    phase_shares: NDArray[np.float64]
    """Shares of it, 0..=1: particles, grid, contact on the grid, coupling, solids, their contact, measuring them, rigid bodies, sort, publish; what is left to 1 is between them."""
    cost_shares: NDArray[np.float64]
    """Shares of the processor time of all objects, 0..=1, of the three that take most, the dearest first, over the same steps."""
    cost_substeps: NDArray[np.float64]
    """Their substeps per step."""
    cost_dt: NDArray[np.float64]
    """The smallest of these; 0 where there are none [s]."""
    cost_objects: NDArray[np.uint32]
    """Which objects they are; `u32::MAX` = none."""
    cost_limits: NDArray[np.uint32]
    """What limited `cost_dt`, as `dt_limit`."""
    cost_points: NDArray[np.uint32]
    """Most points of their surfaces that touched something where a step ended; 0 where that is not known."""
