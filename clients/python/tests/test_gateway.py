"""Orders come from another machine by a gateway, and whatever comes leaves it standing."""

import contextlib
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
    Pause,
    Push,
    Refused,
    Resume,
    SetGravity,
    SetMaterial,
    SetVelocity,
    StepRefused,
    Stop,
    TransportFailed,
    Unanswered,
    WrongToken,
    remote,
    wire,
)
from cosplat.gateway import MAX_CONNECTIONS, MAX_LINE, MAX_SCENES, MAX_STRANGERS, Gateway
from cosplat.remote import MAX_ANSWER, Remote
from cosplat.wire import SceneHeader


@pytest.fixture
def gateway(session: LaunchedSession) -> Iterator[Gateway]:
    """A gateway of the session, in a thread of its own."""
    with Gateway(session, "127.0.0.1", 0) as own:
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                own.serve(0.02)

        thread = threading.Thread(target=serve)
        thread.start()
        yield own
        ended.set()
        thread.join()


def reach(gateway: Gateway) -> Remote:
    return Remote(*gateway.address, token=gateway.token, timeout=PATIENCE)


def line(gateway: Gateway, **request: object) -> bytes:
    """A request with the right token."""
    return json.dumps({"token": gateway.token, **request}).encode() + b"\n"


def say(gateway: Gateway, request: bytes) -> list[bytes]:
    """Sends this, and no more; what came back until the gateway hung up."""
    with socket.create_connection(gateway.address, PATIENCE) as connection:
        # It may have hung up before all of it was sent, and before what it said was read.
        with contextlib.suppress(OSError):
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
        answers: list[bytes] = []
        with contextlib.suppress(OSError):
            answers.extend(connection.makefile("rb"))
        return answers


def test_orders_from_afar_are_those_of_a_session(gateway: Gateway, session: LaunchedSession) -> None:
    with reach(gateway) as remote:
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
        b"{}",
        b'{"orders": 3}',
        b'{"ask": "passwords"}',
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
def test_what_is_no_order_is_refused_in_a_sentence(gateway: Gateway, request_line: bytes) -> None:
    wrong, right = say(gateway, line(gateway, **json.loads(request_line)) + line(gateway, orders=[{"order": "Pause"}]))
    error = json.loads(wrong)["error"]
    assert error["kind"] in ("Malformed", "BadName") and error["words"]
    assert json.loads(right)["acks"][0][2] is True


# What a browser sends for `fetch("http://127.0.0.1:7400", { method: "POST", mode: "no-cors", body })` on another site.
CROSS_SITE = """POST / HTTP/1.1\r
Host: 127.0.0.1:7400\r
Connection: keep-alive\r
Content-Length: {length}\r
Content-Type: text/plain;charset=UTF-8\r
Origin: http://evil.example\r
Sec-Fetch-Site: cross-site\r
\r
{body}"""


@pytest.mark.parametrize("shows", ["no", "a wrong", "half of the", "the right"])
@pytest.mark.parametrize("way", ["POST", "a line", "preface", "list"])
def test_orders_of_another_site_are_hung_up_on(gateway: Gateway, session: LaunchedSession, way: str, shows: str) -> None:
    token = {"no": {}, "a wrong": {"token": "0" * 32}, "half of the": {"token": gateway.token[:16]}}.get(shows, {"token": gateway.token})
    order = {**token, "orders": [{"order": "SetGravity", "gravity": [0, 9, 0]}]}
    # A request behind the wrong one is right: it is not heard, whatever it shows.
    body = json.dumps(order) + "\n" + line(gateway, orders=[{"order": "SetGravity", "gravity": [0, 9, 0]}]).decode()
    sent = {
        "POST": CROSS_SITE.format(length=len(body), body=body),
        "a line": body,
        "preface": "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + body,
        "list": "[" + json.dumps(order) + "]\n" + body,
    }[way]
    journal = session.journal()
    answers = [json.loads(answer) for answer in say(gateway, sent.encode())]
    if way == "a line" and shows == "the right":
        assert [list(answer) for answer in answers] == [["acks"], ["acks"]]
        return
    kind = "WrongToken" if way == "a line" else "Malformed"
    # At most the reason comes, and then the end.
    assert [answer["error"]["kind"] for answer in answers] in ([], [kind])
    with reach(gateway) as remote:
        remote.send(Push("left", (0, 0, 0)), Resume())
    message = journal.next(PATIENCE)
    assert message and [command.command.kind for command in message.commands] == [wire.COMMAND_IMPULSE]


@pytest.mark.parametrize(
    "request_line", [b"", b"no JSON", b"\xff\xfe", b"[" * 5000, b'{"a":' * 5000, b'"ask"', b"7", b"null", b"9" * 5000, b'{"token": "\\ud800"}']
)
def test_what_shows_no_token_is_hung_up_on(gateway: Gateway, request_line: bytes) -> None:
    answers = say(gateway, request_line + b"\n" + line(gateway, orders=[{"order": "Pause"}]))
    assert [json.loads(answer)["error"]["kind"] for answer in answers] in ([], ["Malformed"], ["WrongToken"])


def test_a_token_is_asked_for_in_each_request(gateway: Gateway, monkeypatch: pytest.MonkeyPatch) -> None:
    pause = {"orders": [{"order": "Pause"}]}
    right, wrong = say(gateway, line(gateway, **pause) + json.dumps(pause).encode() + b"\n" + line(gateway, **pause))
    assert "acks" in json.loads(right) and json.loads(wrong)["error"]["kind"] == "WrongToken"
    monkeypatch.delenv("COSPLAT_TOKEN", raising=False)
    with pytest.raises(WrongToken, match="there is no token: give `token`, or set COSPLAT_TOKEN"):
        Remote(*gateway.address)
    with Remote(*gateway.address, token="0" * 32) as remote, pytest.raises(WrongToken, match="missing or wrong"):
        remote.send(Resume())
    monkeypatch.setenv("COSPLAT_TOKEN", gateway.token)
    with Remote(*gateway.address) as remote:
        assert remote.send(Resume())[0].accepted
    monkeypatch.setenv("COSPLAT_TOKEN", "short")
    with pytest.raises(WrongToken, match="the token has 5 characters, expected at least 16"):
        Remote(*gateway.address)


def test_floods_end_at_a_bound(gateway: Gateway) -> None:
    answers = say(gateway, b"x" * (4 * MAX_LINE))
    assert not answers or json.loads(answers[0])["error"]["kind"] == "Malformed"
    crowd = [reach(gateway) for _ in range(MAX_CONNECTIONS)]
    for one in crowd:
        one.send(Pause())
    with reach(gateway) as last, pytest.raises(TransportFailed, match="16 connections are open, and no more are taken"):
        last.send(Pause())
    for one in crowd:
        one.close()
    with reach(gateway) as remote:
        remote.send(Resume())


def test_who_is_silent_takes_no_place_of_others(gateway: Gateway, monkeypatch: pytest.MonkeyPatch) -> None:
    # As if they had been silent for long.
    monkeypatch.setattr("cosplat.gateway.SILENCE", 0.0)
    strangers = [socket.create_connection(gateway.address, PATIENCE) for _ in range(2 * MAX_STRANGERS)]
    crowd = [reach(gateway) for _ in range(MAX_CONNECTIONS + 3)]
    for one in crowd:
        one.send(Pause())
    strangers += [socket.create_connection(gateway.address, PATIENCE) for _ in range(2 * MAX_STRANGERS)]
    for stranger in strangers[: 2 * MAX_STRANGERS]:
        with contextlib.suppress(ConnectionError):
            assert stranger.recv(1) == b""
    # Of those that lost their places none notices.
    for one in crowd:
        one.send(Pause())
        one.close()
    for stranger in strangers:
        stranger.close()


def test_who_takes_no_answer_holds_up_nobody(gateway: Gateway, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosplat.gateway.PATIENCE", 1.0)
    asked = line(gateway, ask="hello") * 500
    slow = [socket.socket() for _ in range(MAX_CONNECTIONS)]
    for one in slow:
        # Small buffers: what the gateway sends stays with it.
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        one.connect(gateway.address)
        one.settimeout(0.1)
        with contextlib.suppress(OSError):
            for _ in range(200):
                one.sendall(asked)
    # They have all places for as long as an answer may take to be taken, and no longer.
    while True:
        try:
            with reach(gateway) as remote:
                remote.send(Pause())
                break
        except TransportFailed as error:
            assert "no more are taken" in str(error)
    # Nor do slow readers of the scene.
    for one in slow:
        one.close()
    slow = [socket.create_connection(gateway.address, PATIENCE) for _ in range(MAX_SCENES)]
    for one in slow:
        one.sendall(line(gateway, ask="scene"))
    with reach(gateway) as remote:
        remote.send(Pause())
    for one in slow:
        one.close()


def test_who_asks_too_slowly_is_hung_up_on(gateway: Gateway, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosplat.gateway.PATIENCE", 0.5)
    with socket.create_connection(gateway.address, PATIENCE) as silent, socket.create_connection(gateway.address, PATIENCE) as slow:
        slow.settimeout(0.05)
        with contextlib.suppress(ConnectionError):
            while True:
                slow.sendall(b" ")
                with contextlib.suppress(TimeoutError):
                    assert slow.recv(1) == b""
                    break
        assert silent.recv(1) == b""


def answered(answer: bytes) -> tuple[str, int]:
    """The address of a gateway that says this, whatever it is asked, once."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with listener, listener.accept()[0] as connection:
            connection.recv(MAX_LINE)
            with contextlib.suppress(OSError):
                connection.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    address: tuple[str, int] = listener.getsockname()
    return address


@pytest.mark.parametrize(
    "answer",
    [
        b"[" * 100_000 + b"\n",
        b"x" * (MAX_ANSWER + 10),
        b"7\n",
        b"null\n",
        b'{"acks": 3}\n',
        b'{"acks": [], "scene": 3}\n',
        b'{"session": "a", "hello": {"server_version": 3}}\n',
        b'{"scene": {}, "sizes": [1000000000000000000, 0, 0, 0, 0]}\n',
        b'{"scene": {}, "sizes": [1e400, 0, 0, 0, 0]}\n',
        b'{"scene": {}, "sizes": [-1, 0, 0, 0, 0]}\n' + b"x" * 1000,
        b'{"scene": {"step": 1e400}, "sizes": []}\n',
        b'{"error": 3}\n',
    ],
)
def test_a_gateway_that_says_nonsense_is_told_so(answer: bytes) -> None:
    for ask in (Remote.hello, Remote.scene, lambda remote: remote.send(Pause(), Pause())):
        with Remote(*answered(answer), token="0" * 32) as remote, pytest.raises((Malformed, Unanswered)):
            ask(remote)


def test_a_connection_outlives_its_gateway(session: LaunchedSession) -> None:
    with Gateway(session, "127.0.0.1", 0) as first:
        address, token = first.address, first.token
        remote = reach(first)
    with pytest.raises(NoServer, match="no gateway at 127.0.0.1"):
        remote.send(Pause())
    with Gateway(session, *address, token) as second:

        def serve_twice() -> None:
            second.serve(PATIENCE)
            second.serve(PATIENCE)

        # It accepts, and then it reads.
        thread = threading.Thread(target=serve_twice)
        thread.start()
        remote.send(Pause())
        thread.join()
    remote.close()
    with pytest.raises(NoServer, match="is closed"):
        remote.send(Pause())


def test_a_session_from_afar_has_frames_and_scene(
    gateway: Gateway, session: LaunchedSession, domain: Domain
) -> None:
    # In the same domain the streams are there without a tunnel.
    with remote.connect(*gateway.address, token=gateway.token, domain=domain) as far:
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
    gateway: Gateway, domain: Domain, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire, "SCHEMA_HASH", 1)
    with pytest.raises(OtherVersion, match="this package has 0000000000000001"):
        remote.connect(*gateway.address, token=gateway.token, domain=domain)


def test_the_program_says_where_it_listens(session: LaunchedSession, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COSPLAT_TOKEN", raising=False)
    command = [sys.executable, "-m", "cosplat.gateway", session.name, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout
        *_, address, _, port, _, _, _, token = program.stdout.readline().split()
        with Remote(address, int(port), token=token) as remote:
            assert remote.send(Resume())[0].accepted
        program.terminate()
    with pytest.raises(NoServer, match="no gateway at 127.0.0.1"):
        Remote("127.0.0.1", int(port), token=token)
    monkeypatch.setenv("COSPLAT_TOKEN", "f" * 32)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout
        *_, address, _, port, _, _, _, _, variable = program.stdout.readline().split()
        assert variable == "COSPLAT_TOKEN"
        with Remote(address, int(port)) as remote:
            assert remote.send(Resume())[0].accepted
        program.terminate()
    monkeypatch.setenv("COSPLAT_TOKEN", "f")
    short = subprocess.run(command, capture_output=True, text=True)
    assert short.returncode == 1 and "the token has 1 characters, expected at least 16" in short.stderr
    monkeypatch.delenv("COSPLAT_TOKEN")
    wrong = subprocess.run([*command[:-1], "here"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "expected ADDRESS:PORT" in wrong.stderr
