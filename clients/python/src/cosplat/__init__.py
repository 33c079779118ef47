"""Attach to cosplat: physics of 3D Gaussian Splatting scenes in shared memory, as numpy arrays.

    with cosplat.connect("default") as session:
        for frame in session.frames():
            print(frame.step, frame.positions.max(axis=0))
"""

from importlib.metadata import version

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
    TimedOut,
    TooManyHeld,
    TransportFailed,
    Unanswered,
)
from .launch import LaunchedSession, launch
from .orders import (
    LAWS,
    Ack,
    Checkpoint,
    MoveCollider,
    Order,
    Pause,
    Pin,
    Push,
    Release,
    Reset,
    Resume,
    SetGravity,
    SetMaterial,
    SetVelocity,
    Stop,
)
from .recording import Recording
from .scene import Scene
from .session import Session, connect
from .streams import Frame, Journal, Objects, Reader

__version__ = version("cosplat")

__all__ = [
    "LAWS",
    "Ack",
    "BadName",
    "Checkpoint",
    "CosplatError",
    "Domain",
    "DomainUnusable",
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
    "Pause",
    "Pin",
    "Push",
    "Reader",
    "Recording",
    "RecordingDamaged",
    "Refused",
    "Release",
    "Reset",
    "Resume",
    "Scene",
    "ServerLost",
    "Session",
    "SetGravity",
    "SetMaterial",
    "SetVelocity",
    "Stop",
    "TimedOut",
    "TooManyHeld",
    "TransportFailed",
    "Unanswered",
    "connect",
    "launch",
    "wire",
]
