"""Attach to cosplat: physics of 3D Gaussian Splatting scenes in shared memory, as numpy arrays.

    with cosplat.connect("default") as session:
        for frame in session.frames():
            print(frame.step, frame.positions.max(axis=0))
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from . import wire
from .domain import Domain
from .errors import (
    BadName,
    CosplatError,
    DomainUnusable,
    LaunchFailed,
    Malformed,
    NoServer,
    OtherTransport,
    OtherVersion,
    RecordingDamaged,
    Refused,
    ServerLost,
    StepRefused,
    TimedOut,
    TooManyHeld,
    TransportFailed,
    Unanswered,
)
from .launch import LaunchedSession, launch
from .lockstep import Cause, Done, Participant
from .orders import (
    LAWS,
    Ack,
    Checkpoint,
    ColliderVelocity,
    Force,
    MoveCollider,
    Order,
    Pause,
    Pin,
    Push,
    Release,
    Reset,
    Restore,
    Resume,
    Save,
    SetGravity,
    SetMaterial,
    SetVelocity,
    Step,
    Stop,
)
from .recording import Recording
from .scene import Scene
from .session import Session, connect
from .streams import Contacts, Frame, Journal, Objects, Reader

if TYPE_CHECKING:
    from .env import Env

__version__ = version("cosplat")


def __getattr__(name: str) -> Any:
    # Gymnasium is an extra.
    if name == "Env":
        from .env import Env

        return Env
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "LAWS",
    "Ack",
    "BadName",
    "Cause",
    "Checkpoint",
    "ColliderVelocity",
    "Contacts",
    "CosplatError",
    "Domain",
    "DomainUnusable",
    "Done",
    "Env",
    "Force",
    "Frame",
    "Journal",
    "LaunchFailed",
    "LaunchedSession",
    "Malformed",
    "MoveCollider",
    "NoServer",
    "Objects",
    "Order",
    "OtherTransport",
    "OtherVersion",
    "Participant",
    "Pause",
    "Pin",
    "Push",
    "Reader",
    "Recording",
    "RecordingDamaged",
    "Refused",
    "Release",
    "Reset",
    "Restore",
    "Resume",
    "Save",
    "Scene",
    "ServerLost",
    "Session",
    "SetGravity",
    "SetMaterial",
    "SetVelocity",
    "Step",
    "StepRefused",
    "Stop",
    "TimedOut",
    "TooManyHeld",
    "TransportFailed",
    "Unanswered",
    "connect",
    "launch",
    "wire",
]
