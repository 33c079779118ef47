"""Attach to cosplat: physics of 3D Gaussian Splatting scenes in shared memory, as numpy arrays.

    with cosplat.connect("default") as session:
        for frame in session.frames():
            print(frame.step, frame.positions.max(axis=0))
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from . import wire
from .assembly import Assembly
from .domain import Domain
from .errors import (
    BadName,
    CosplatError,
    DomainUnusable,
    LaunchFailed,
    Malformed,
    NoServer,
    OtherProcess,
    OtherTransport,
    OtherVersion,
    RecordingDamaged,
    Refused,
    ServerLost,
    StepRefused,
    SweepFailed,
    TimedOut,
    TooManyHeld,
    TransportFailed,
    Unanswered,
    WrongToken,
)
from .launch import LaunchedSession, launch
from .lockstep import Cause, Done, Participant, Submitted
from .orders import (
    FIDELITIES,
    LAWS,
    Ack,
    BringIn,
    Cancel,
    Checkpoint,
    ColliderVelocity,
    Drag,
    Force,
    Grab,
    LetGo,
    MoveCollider,
    Order,
    Pause,
    Pin,
    Push,
    Redo,
    Release,
    Remove,
    Reset,
    Restore,
    Resume,
    Save,
    SetFidelity,
    SetGravity,
    SetMaterial,
    SetPose,
    SetVelocity,
    Step,
    Stop,
    Undo,
)
from .recording import Recording
from .scene import Scene
from .session import Session, connect
from .streams import Changes, ChangesReader, Contacts, Frame, Journal, Objects, Reader
from .sweep import Report, Row, sweep, write_csv

if TYPE_CHECKING:
    from .env import Env
    from .vector import VectorEnv

__version__ = version("cosplat")


def __getattr__(name: str) -> Any:
    # Gymnasium is an extra.
    if name == "Env":
        from .env import Env

        return Env
    if name == "VectorEnv":
        from .vector import VectorEnv

        return VectorEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Ack",
    "Assembly",
    "BadName",
    "BringIn",
    "Cancel",
    "Cause",
    "Changes",
    "ChangesReader",
    "Checkpoint",
    "ColliderVelocity",
    "Contacts",
    "CosplatError",
    "Domain",
    "DomainUnusable",
    "Done",
    "Drag",
    "Env",
    "FIDELITIES",
    "Force",
    "Frame",
    "Grab",
    "Journal",
    "LaunchedSession",
    "LaunchFailed",
    "LAWS",
    "LetGo",
    "Malformed",
    "MoveCollider",
    "NoServer",
    "Objects",
    "Order",
    "OtherProcess",
    "OtherTransport",
    "OtherVersion",
    "Participant",
    "Pause",
    "Pin",
    "Push",
    "Reader",
    "Recording",
    "RecordingDamaged",
    "Redo",
    "Refused",
    "Release",
    "Remove",
    "Report",
    "Reset",
    "Restore",
    "Resume",
    "Row",
    "Save",
    "Scene",
    "ServerLost",
    "Session",
    "SetFidelity",
    "SetGravity",
    "SetMaterial",
    "SetPose",
    "SetVelocity",
    "Step",
    "StepRefused",
    "Stop",
    "Submitted",
    "SweepFailed",
    "TimedOut",
    "TooManyHeld",
    "TransportFailed",
    "Unanswered",
    "Undo",
    "VectorEnv",
    "WrongToken",
    "connect",
    "launch",
    "sweep",
    "wire",
    "write_csv",
]
