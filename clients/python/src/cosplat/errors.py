"""What can go wrong, in sentences with expected and actual values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .lockstep import Done
    from .orders import Ack


class CosplatError(Exception):
    """Whatever this package raises by itself."""


class BadName(CosplatError, ValueError):
    """A text is no name of a session, domain or object."""


class DomainUnusable(CosplatError, OSError):
    """The folder where processes meet cannot be used."""


class NoServer(CosplatError, ConnectionError):
    """Nobody serves the session; the sentence names the sessions that are served."""


class OtherVersion(CosplatError):
    """The server has another wire version or layout: take both sides from the same release."""


class OtherTransport(CosplatError):
    """The server uses another release of iceoryx2."""


class OtherProcess(CosplatError, RuntimeError):
    """A forked child used what its parent is attached to: connect in the child."""


class TimedOut(CosplatError, TimeoutError):
    """Something did not come in time."""


class ServerLost(CosplatError, ConnectionError):
    """The server gives no sign of life and did not say that it ends."""


class TooManyHeld(CosplatError):
    """The program holds as many messages of a stream as it may: let go of arrays, or copy them."""


class Malformed(CosplatError):
    """Header and payload of a message contradict each other."""


class WrongToken(CosplatError, PermissionError):
    """A gateway does not know the token of a request, or there is none."""


class TransportFailed(CosplatError):
    """iceoryx2 failed; the sentence holds its words."""


class Unanswered(CosplatError):
    """Commands were sent and no answer came: those that the server looked at take effect; the journal tells which."""


class Refused(CosplatError):
    """The server refused commands; those that it accepted in the same request take effect."""

    def __init__(self, acks: Sequence[Ack], done: Done | None = None) -> None:
        self.acks = list(acks)
        """Answers to all commands of the request, in order."""
        self.done = done
        """In lock-step what came of the steps, which are made all the same."""
        reasons = [ack.reason for ack in acks if not ack.accepted]
        super().__init__("; ".join(reasons))


class StepRefused(CosplatError):
    """The server refused a request for steps, with all of its orders."""


class LaunchFailed(CosplatError):
    """A server of one's own did not start; the sentence holds its words."""


class SweepFailed(CosplatError):
    """Simulations of a sweep were ended from outside, or its table cannot be used; what is done is in the table."""


class RecordingDamaged(CosplatError, ValueError):
    """A file is no recording, or one that is damaged."""
