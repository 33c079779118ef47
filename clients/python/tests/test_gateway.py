"""Orders come from another machine by a gateway, and whatever comes leaves it standing."""

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import PATIENCE
from cosplat import (
    BadName,
    Domain,
    LaunchedSession,
    Malformed,
    NoServer,
    OtherVersion,
    Push,
    Refused,
    Resume,
    SetGravity,
    SetMaterial,
    SetVelocity,
    StepRefused,
    Stop,
    Unanswered,
    remote,
    wire,
)
from cosplat.gateway import MAX_CONNECTIONS, MAX_LINE, Gateway
from cosplat.remote import Remote
from cosplat.wire import SceneHeader


@pytest.fixture
def gateway(session: LaunchedSession) -> Iterator[tuple[str, int]]:
    """A gateway of the session, in a thread of its own."""
    with Gateway(session, "127.0.0.1", 0) as own:
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                own.serve(0.02)

        thread = threading.Thread(target=serve)
        thread.start()
        yield own.address
        ended.set()
        thread.join()


def say(address: tuple[str, int], request: bytes) -> list[bytes]:
    with socket.create_connection(address, PATIENCE) as connection:
        connection.sendall(request)
        connection.shutdown(socket.SHUT_WR)
        return connection.makefile("rb").readlines()


def test_orders_from_afar_are_those_of_a_session(gateway: tuple[str, int], session: LaunchedSession) -> None:
    with Remote(*gateway) as remote:
        assert remote.send() == []
        material = {"yield_stress_pa": 1e3, "hardening_pa": 0.0}
        orders = [
            Push("left", np.array([0, 1, 0])),
            SetGravity((0, 0, 0), at_step=3),
            SetMaterial("right", "von_mises", 1e5, 0.3, material),
        ]
        assert [(ack.step, ack.accepted, ack.reason) for ack in remote.send(*orders)] == [(1, True, ""), (3, True, ""), (1, True, "")]
        with pytest.raises(Refused, match="impulse is NaN, expected a finite number") as error:
            remote.send(Push("left", (np.nan, 0, 0)), Push("right", (0, 1, 0)))
        assert [ack.accepted for ack in error.value.acks] == [False, True]
        with pytest.raises(BadName, match="object 'middle' does not exist: the scene has left, right"):
            remote.send(Push("middle", (0, 0, 0)))
        with pytest.raises(BadName, match="order 'Stop' is not taken from afar"):
            remote.send(Stop())
        with pytest.raises(Malformed, match=r"impulse has shape \(2,\), expected \(3,\)"):
            remote.send(Push("left", (0, 1)))
        remote.send(Resume())
    journal = session.journal()
    message = journal.next(PATIENCE)
    assert message and [command.command.kind for command in message.commands] == [1, 4, 1]


@pytest.mark.parametrize(
    "request_line",
    [
        b"",
        b"no JSON",
        b"\xff\xfe",
        b"[" * 5000,
        b"{}",
        b'{"orders": 3}',
        b'{"ask": "passwords"}',
        b'"ask"',
        b'{"orders": ["Push"]}',
        b'{"orders": [{"order": "Push"}]}',
        b'{"orders": [{"order": "Push", "object": {}, "impulse": [0, 0, 0]}]}',
        b'{"orders": [{"order": "Push", "object": 7, "impulse": [0, 0, 0]}]}',
        b'{"orders": [{"order": "Push", "object": 0, "impulse": "up"}]}',
        b'{"orders": [{"order": "Push", "object": 0, "impulse": [0, 0, 0], "at_step": -1}]}',
        b'{"orders": [{"order": "Push", "object": 0, "impulse": [0, 0, 0], "mass": 1}]}',
        b'{"orders": [{"order": "SetMaterial", "object": 0, "law": [], "parameters": 3}]}',
        b'{"orders": [{"order": "__class__"}]}',
        json.dumps({"orders": [{"order": "Pause"}] * 33}).encode(),
    ],
)
def test_what_is_no_order_is_refused_in_a_sentence(gateway: tuple[str, int], request_line: bytes) -> None:
    wrong, right = say(gateway, request_line + b'\n{"orders": [{"order": "Pause"}]}\n')
    error = json.loads(wrong)["error"]
    assert error["kind"] in ("Malformed", "BadName") and error["words"]
    assert json.loads(right)["acks"][0][2] is True


def test_floods_end_at_a_bound(gateway: tuple[str, int]) -> None:
    try:
        answers = say(gateway, b"x" * (4 * MAX_LINE))
        assert json.loads(answers[0])["error"]["kind"] == "Malformed"
    except OSError:
        # It hung up on what was still on its way.
        pass
    crowd = [socket.create_connection(gateway, PATIENCE) for _ in range(MAX_CONNECTIONS)]
    last = say(gateway, b"")
    assert not last or "no more are taken" in json.loads(last[0])["error"]["words"]
    for one in crowd:
        one.close()
    while True:
        try:
            with Remote(*gateway) as remote:
                remote.send(Resume())
                break
        except Exception as error:
            # The crowd is leaving.
            assert "no more are taken" in str(error) or isinstance(error, Unanswered)


def test_a_session_from_afar_has_frames_and_scene(
    gateway: tuple[str, int], session: LaunchedSession, domain: Domain
) -> None:
    # In the same domain the streams are there without a tunnel.
    with remote.connect(*gateway, domain=domain) as far:
        here, there = session.scene(), far.scene()
        assert far.name == session.name and far.hello == session.hello
        for name in ("gaussians", "sh", "objects", "features"):
            assert np.array_equal(getattr(here, name), getattr(there, name))
        assert (here.source, here.names, here.colliders) == (there.source, there.names, there.colliders)
        assert all(np.array_equal(getattr(here.header, n), getattr(there.header, n)) for n in SceneHeader.dtype.names or ())
        frames, objects = far.frames(64), far.objects(64)
        far.send(SetVelocity("left", (1, 0, 0)), Resume())
        for step in range(1, 10):
            assert frames.at(step).step == step
        assert objects.at(9)["left"].linear_velocity[0] > 0.5
        with pytest.raises(StepRefused, match="lock-step is not carried"):
            far.participate("robot")


def test_another_layout_is_refused_from_afar(
    gateway: tuple[str, int], domain: Domain, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire, "SCHEMA_HASH", 1)
    with pytest.raises(OtherVersion, match="this package has 0000000000000001"):
        remote.connect(*gateway, domain=domain)


def test_the_program_says_where_it_listens(session: LaunchedSession) -> None:
    command = [sys.executable, "-m", "cosplat.gateway", session.name, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout
        words = program.stdout.readline().split()
        with Remote(words[-3], int(words[-1])) as remote:
            assert remote.send(Resume())[0].accepted
        program.terminate()
    with pytest.raises(NoServer, match="no gateway at 127.0.0.1"):
        Remote("127.0.0.1", int(words[-1]))
    wrong = subprocess.run([*command[:-1], "here"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "expected ADDRESS:PORT" in wrong.stderr
