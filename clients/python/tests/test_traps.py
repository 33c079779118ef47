"""The seven traps of reading the wire by hand, stepped on one by one; docs/attach-a-client.md lists them."""

import gc
import os

import cosplat
import numpy as np
import pytest
from conftest import PATIENCE, Launch
from cosplat import Domain, Frame, LaunchedSession, NoServer, OtherTransport, OtherVersion, Resume, TooManyHeld, wire
from stranger import Stranger, hello


def next_frame(reader: cosplat.Reader[Frame]) -> Frame:
    frame = reader.next(PATIENCE)
    assert frame is not None
    return frame


def test_1_an_array_has_the_length_of_the_frame(session: LaunchedSession) -> None:
    frame = next_frame(session.frames())
    count = session.scene().header.gaussian_count
    assert len(frame) == frame.header.count == count
    assert frame.items.nbytes == 64 * count
    # Reads every byte that the array spans.
    assert len(frame.items.tobytes()) == 64 * count
    assert np.isfinite(frame.positions).all()


def test_2_an_array_keeps_its_frame_from_reuse(launch: Launch) -> None:
    with launch(paused=True, arguments=["--frame-slots", "4"]) as session:
        reader = session.frames(64)
        session.send(Resume())
        # The smallest view that there can be: an array of an array of an array.
        height = next_frame(reader).positions[5:6, 1][:1]
        then = height.copy()
        last = 0
        # Many times as many frames as the pool has.
        while last < 100:
            last = next_frame(reader).step
        assert height == then
        assert next_frame(reader).positions[5, 1] != then


def test_2_an_array_keeps_its_frame_when_its_reader_goes(launch: Launch) -> None:
    with launch(paused=True, arguments=["--frame-slots", "4"]) as session:
        reader = session.frames()
        height = next_frame(reader).positions[5:6, 1]
        then = height.copy()
        reader.close()
        session.send(Resume())
        for frame in session.frames():
            if frame.step >= 100:
                break
        assert height == then and frame.positions[5, 1] != then


def test_3_a_write_is_an_error_and_no_crash(session: LaunchedSession) -> None:
    frame = next_frame(session.frames())
    for array in (frame.items, frame.positions, frame.colors[2:], session.scene().gaussians, session.scene().sh):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = array[0]
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
    own = frame.copy()
    own.positions[:] = 7
    assert (own.positions == 7).all() and not (frame.positions == 7).all()


def test_4_rebinding_a_frame_holds_no_more_than_two(launch: Launch) -> None:
    with launch(paused=True) as session:
        reader = session.frames(64)
        session.send(Resume())
        frame = header = None
        for _ in range(100):
            frame, header = (new := next_frame(reader)), new.header
            del new
        assert frame is not None and header is not None and frame.step == header.step


def test_4_who_holds_too_much_is_told_and_goes_on(launch: Launch) -> None:
    with launch(pace="realtime", paused=True) as session:
        reader = session.frames(64)
        session.send(Resume())
        held = [next_frame(reader) for _ in range(8)]
        with pytest.raises(TooManyHeld, match="8 messages of 'frame' are held already"):
            reader.next(PATIENCE)
        held[0] = held[0].copy()
        assert next_frame(reader).step == held[-1].step + 1


def test_4_frames_in_circles_are_let_go(launch: Launch) -> None:
    with launch(paused=True) as session:
        reader = session.frames(64)
        session.send(Resume())
        gc.disable()
        try:
            for _ in range(20):
                circle: list[object] = [next_frame(reader)]
                circle.append(circle)
                del circle
        finally:
            gc.enable()


def test_5_types_have_the_names_that_services_compare(session: LaunchedSession) -> None:
    # Every service opens, so every name, size and alignment is that of the server; their fields are in test_wire.py.
    session.frames(), session.objects(), session.journal(), session.status(), session.scene()
    assert wire.GaussianState.type_name == "cosplat.v1.GaussianState"


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"wire_version": 2}, r"cosplat 9.9.9 \(process 4711\) with wire version 2, this package has 1"),
        ({"schema_hash": 0xABC}, f"layout hash 0000000000000abc, this package has {wire.SCHEMA_HASH:016x}"),
    ],
)
def test_5_another_layout_is_refused(domain: Domain, other: dict[str, int], words: str) -> None:
    with Stranger(domain, "other", hello(**other)), pytest.raises(OtherVersion, match=words):
        cosplat.connect("other", timeout=PATIENCE)


def test_6_no_server_is_said_with_those_that_there_are(session: LaunchedSession) -> None:
    with pytest.raises(NoServer) as error:
        cosplat.connect("nobody", timeout=0.0)
    assert "cosplat serve SCENE.toml --session nobody" in str(error.value)
    assert f"served there: {session.name!r} (process {session.process.pid})" in str(error.value)


def test_6_another_release_of_iceoryx2_is_said(session: LaunchedSession) -> None:
    # What another release leaves: files that ours does not understand, and a mark with its version.
    for file in (session.domain.root / "services").iterdir():
        mode = file.stat().st_mode
        file.chmod(0o600)
        file.write_text("another format")
        file.chmod(mode)
    mark = f"/dev/shm/{session.domain.prefix}{0:040}_node.0_9_3.global_mgmt"
    os.close(os.open(mark, os.O_CREAT, 0o600))
    with pytest.raises(OtherTransport, match="uses iceoryx2 0.10.0, .* there are traces of 0.9.3"):
        cosplat.connect(session.name, timeout=0.0)
    session.process.kill()
    session.process.wait()


def test_7_a_frame_without_gaussians_has_empty_arrays(domain: Domain) -> None:
    with Stranger(domain, "empty", hello()) as stranger, cosplat.connect("empty", timeout=PATIENCE) as session:
        reader = session.frames()
        stranger.publish(step=3, elements=0)
        frame = next_frame(reader)
        assert (frame.step, len(frame)) == (3, 0)
        assert frame.positions.shape == (0, 3)
        assert not frame.positions.flags.writeable
