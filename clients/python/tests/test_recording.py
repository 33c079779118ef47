"""Recordings give back what was published."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import SCENE, Launch
from cosplat import BadName, Domain, Frame, LaunchedSession, Objects, Push, Recording, RecordingDamaged, Resume, Stop
from cosplat import launch as launch_scene


def record(session: LaunchedSession, path: Path) -> "subprocess.Popen[bytes]":
    """A recorder that is attached."""
    command = [os.environ["COSPLAT"], "record", "--session", session.name, "-o", str(path)]
    readers = session.status().frame_readers
    recorder = subprocess.Popen(command, env={**os.environ, "COSPLAT_DOMAIN": str(session.domain.root)})
    while session.status().frame_readers == readers:
        time.sleep(0.01)
    return recorder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the recording is that all tests read."""
    return tmp_path_factory.mktemp("recordings")


def test_frames_and_objects_come_back_bit_for_bit(launch: Launch, folder: Path) -> None:
    path = folder / "run.mcap"
    with launch(paused=True) as session:
        reader, states = session.frames(64), session.objects(64)
        recorder = record(session, path)
        session.send(Push("left", (0.25, 1, 0), at_step=5), Resume(), Stop(at_step=31))
        frames: dict[int, Frame] = {}
        objects: dict[int, Objects] = {}
        for frame in reader:
            frames[frame.step] = frame.copy()
            while (message := states.next(0)) is not None:
                objects[message.step] = message
        scene = session.scene()
        assert recorder.wait(60) == 0
    with Recording(path) as recording:
        assert recording.steps.tolist() == list(frames) == list(range(31)) and len(recording) == 31
        assert recording.gaps() == [] and recording.run_count == 1
        assert recording.hashes.tolist() == [frame.state_hash for frame in frames.values()]
        assert recording.sim_times.tolist() == [frame.sim_time for frame in frames.values()]
        for step in (30, 0, 17):
            back, then = recording.frame(step), frames[step]
            assert back.items.tobytes() == then.items.tobytes()
            assert (back.step, back.sim_time, back.header.substeps) == (step, then.sim_time, then.header.substeps)
            assert recording.objects(step)["left"].com.tobytes() == objects[step]["left"].com.tobytes()
        for back in recording.frames():
            assert back.items.tobytes() == frames[back.step].items.tobytes()
        [entry] = recording.journal()
        assert (entry.step, entry.command.vector.tolist(), entry.command.object) == (5, [0.25, 1.0, 0.0], 0)
        again = recording.scene()
        assert again.names == scene.names == recording.names and again.source == scene.source
        assert np.array_equal(again.sh, scene.sh) and np.array_equal(again.gaussians, scene.gaussians)
        assert np.array_equal(again.header.bounds_max, scene.header.bounds_max)
        with pytest.raises(BadName, match="step 31 is not in .*run.mcap, whose run has 0 to 30"):
            recording.frame(31)


def test_a_file_has_a_run_for_every_start_of_its_server(launch: Launch, tmp_path: Path) -> None:
    path = tmp_path / "runs.mcap"
    with launch(session="twice", paused=True) as first:
        recorder = record(first, path)
        first.send(Resume())
        while first.status().step < 20:
            time.sleep(0.01)
        first.process.kill()
        first.process.wait()
    with launch(session="twice", paused=True, arguments=["--duration", "0.1"]) as second:
        while second.status().frame_readers == 0:
            time.sleep(0.01)
        second.send(Resume())
        assert recorder.wait(60) == 0
        epoch = second.hello.epoch
    with Recording(path) as recording, Recording(path, run=0) as before:
        assert (recording.run_count, recording.epoch) == (2, epoch)
        assert recording.steps.tolist() == [0, 1, 2, 3, 4, 5]
        assert before.epoch < epoch and before.steps.max() >= 20
        # The same scene and no command: the same bits.
        assert before.hashes[:6].tolist() == recording.hashes.tolist()
        assert before.frame(3).items.tobytes() == recording.frame(3).items.tobytes()
        assert np.array_equal(before.scene().gaussians, recording.scene().gaussians)
    with pytest.raises(BadName, match="has 2 runs, asked for number 2"):
        Recording(path, run=2)


def test_damage_and_other_files_are_said(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"no recording")
    with pytest.raises(RecordingDamaged, match="damaged or no recording"):
        Recording(other)
    whole = (folder / "run.mcap").read_bytes()
    other.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingDamaged):
        Recording(other)
    # One byte of the Gaussians of a step in the middle.
    at = len(whole) // 2
    other.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    with pytest.raises(RecordingDamaged), Recording(other) as recording:
        for _ in recording.frames():
            pass
    with pytest.raises(OSError, match="nowhere"):
        Recording(tmp_path / "nowhere.mcap")
    shutil.rmtree(folder)


def test_a_body_is_told_once_and_comes_back_bit_for_bit(domain: Domain, tmp_path: Path) -> None:
    # One that tumbles on the floor, where every bit of its turn matters.
    text = SCENE.replace('material = "soft_rubber"', 'material = "rigid"\nrotation_deg = [20, 0, 35]', 1)
    path = tmp_path / "body.mcap"
    with launch_scene(text, pace="free", domain=domain, paused=True) as session:
        reader = session.frames(64)
        recorder = record(session, path)
        session.send(Resume(), Stop(at_step=41))
        frames = {frame.step: frame.copy() for frame in reader}
        assert recorder.wait(60) == 0
    with Recording(path) as recording:
        assert recording.steps.tolist() == list(range(41))
        for back in recording.frames():
            assert back.items.tobytes() == frames[back.step].items.tobytes()
        for step in (40, 13):
            assert recording.frame(step).items.tobytes() == frames[step].items.tobytes()
        assert sum(1 for _ in recording._messages(["/gaussians/0"])) <= 4
