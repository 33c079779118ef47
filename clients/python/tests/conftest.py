"""What every story needs: a domain of its own, a small scene, servers."""

import itertools
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from functools import partial

import cosplat
import pytest
from cosplat import Domain, LaunchedSession
from cosplat.domain import SHARED_MEMORY

# Two blocks fall onto a floor; it steps fast.
SCENE = """
version = 1
name = "two blocks"
frame_rate = 50
dx = 0.05

[[objects]]
name = "left"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [-0.3, 0.3, 0.0]
material = "soft_rubber"

[[objects]]
name = "right"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.3, 0.3, 0.0]
material = "soft_rubber"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"""

PATIENCE = 60.0
"""Longest that any single wait may take before a story is called hung [s]."""

_numbers = itertools.count()

Launch = Callable[..., LaunchedSession]


@pytest.fixture(autouse=True)
def watchdog() -> Iterator[None]:
    """Ends a story that hangs, loudly."""

    def bark(*_: object) -> None:
        raise TimeoutError("the story hangs")

    signal.signal(signal.SIGALRM, bark)
    signal.alarm(int(2 * PATIENCE))
    yield
    signal.alarm(0)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[Domain]:
    """A domain of this story's own, also for the programs that it starts; nothing of it stays."""
    name = f"p{os.getpid()}-{next(_numbers)}"
    monkeypatch.setenv("COSPLAT_DOMAIN", name)
    own = Domain.named(name)
    yield own
    for file in SHARED_MEMORY.glob(f"{own.prefix}*"):
        file.unlink(missing_ok=True)
    shutil.rmtree(own.root, ignore_errors=True)


@pytest.fixture
def launch(domain: Domain) -> Launch:
    """Starts servers in the story's domain; the small scene without another."""
    return partial(cosplat.launch, SCENE, pace="free", domain=domain)


@pytest.fixture
def session(launch: Launch) -> Iterator[LaunchedSession]:
    """A session whose server waits before its first step."""
    with launch(paused=True) as own:
        yield own
