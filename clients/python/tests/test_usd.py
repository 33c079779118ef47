"""What is exported as USD is where it was, as usd-core reads it."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cosplat
import numpy as np
from cosplat import Domain, LaunchedSession, Recording, Resume
from numpy.typing import NDArray
from test_recording import record

SCENE = """
version = 1
name = "a rigid and a soft block"
frame_rate = 50
dx = 0.05

[[objects]]
name = "hard block"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [-0.3, 0.3, 0.0]
angular_velocity = [1.0, 4.0, 2.0]
material = "soft_rubber"
fidelity = "rigid"

[[objects]]
name = "soft"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.3, 0.12, 0.0]
material = "soft_rubber"

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.4
"""


def start(scene: str, domain: Domain, duration: str) -> LaunchedSession:
    """A paused session that makes as many seconds."""
    return cosplat.launch(scene, pace="free", domain=domain, paused=True, arguments=["--duration", duration])


def turned(q: Any, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points turned by a quaternion of pxr."""
    v, w = np.array(q.GetImaginary()), q.GetReal()
    cross = np.cross(v, points)
    rotated: NDArray[np.float64] = points + 2 * (w * cross + np.cross(v, cross))
    return rotated


def export(run: Path, file: Path) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "COSPLAT_PYTHON": sys.executable}
    command = [os.environ["COSPLAT"], "export", str(run), "--usd", str(file), "--json"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


def test_every_gaussian_of_every_step_is_where_it_was(domain: Domain, tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    run = tmp_path / "run.mcap"
    with start(SCENE, domain, "0.3") as session:
        recorder = record(session, run)
        session.send(Resume())
        assert recorder.wait(60) == 0
    done = export(run, tmp_path / "run.usdc")
    assert done.returncode == 0, done.stderr
    assert '"steps":16' in done.stdout and '"deforming":["soft"]' in done.stdout, done.stdout
    stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
    assert (stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (15, 50)
    with Recording(run) as recording:
        scene = recording.scene()
        for number, name in enumerate(["hard_block", "soft"]):
            node = UsdGeom.Xformable(stage.GetPrimAtPath(f"/World/{name}"))
            field = stage.GetPrimAtPath(f"/World/{name}/splats")
            assert field.GetTypeName() == "ParticleField3DGaussianSplat"
            positions = field.GetAttribute("positions")
            # Until it touches the floor the soft one is rigid, too.
            samples = positions.GetNumTimeSamples()
            assert samples == 1 if number == 0 else 8 <= samples <= 16
            translate, orient = node.GetOrderedXformOps()
            for code, step in enumerate(recording.steps.tolist()):
                frame = recording.frame(step)
                mine = frame.object_ids == number
                state = recording.objects(step)[scene.names[number]]
                place = np.array(translate.Get(code))
                assert np.abs(place - state.com).max() < 1e-6
                found = turned(orient.Get(code), np.array(positions.Get(code), np.float64)) + place
                assert np.abs(found - frame.positions[mine]).max() < 1e-6
                # Axes and scales give the covariance back.
                axes = np.array([q.GetImaginary() for q in field.GetAttribute("orientations").Get(code)], np.float64)
                real = np.array([q.GetReal() for q in field.GetAttribute("orientations").Get(code)])
                scales = np.array(field.GetAttribute("scales").Get(code), np.float64)
                q = orient.Get(code)
                basis = []
                for unit in np.eye(3):
                    cross = np.cross(axes, unit)
                    basis.append(turned(q, unit + 2 * (real[:, None] * cross + np.cross(axes, cross))))
                columns = np.stack(basis, 2) * scales[:, None, :]
                found = columns @ columns.transpose(0, 2, 1)
                upper = found[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
                expected = frame.covariances[mine]
                assert np.abs(upper - expected).max() < 1e-5 * np.abs(expected).max()


def test_what_cannot_be_written_is_said_and_leaves_no_file(domain: Domain, tmp_path: Path) -> None:
    run = tmp_path / "run.mcap"
    with start(SCENE, domain, "0.1") as session:
        recorder = record(session, run)
        session.send(Resume())
        assert recorder.wait(60) == 0
    done = export(run, tmp_path / "run.obj")
    assert done.returncode == 1 and "expected one of .usd, .usdc, .usda" in done.stderr, done.stderr
    (tmp_path / "file").touch()
    done = export(run, tmp_path / "file" / "run.usd")
    assert done.returncode == 1 and "Not a directory" in done.stderr, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "run.mcap"]


def test_whole_frames_have_whole_times_and_no_name_can_be_foretold(tmp_path: Path) -> None:
    from cosplat.usd import UsdWriter
    from pxr import Usd

    # Somebody else's link under the name that an unfinished file had.
    (tmp_path / "precious").write_text("precious")
    (tmp_path / ".run.unfinished.usda").symlink_to("precious")
    writer = UsdWriter(tmp_path / "run.usda", [0.0, 1.0, 0.0], 60.0, 0, ["block"])
    place = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    # What a sum of 120 sixtieths comes to.
    time = 0.0
    for _ in range(121):
        writer.add(time, [place], [None])
        time += 1 / 60
    writer.finish()
    assert Usd.Stage.Open(str(tmp_path / "run.usda")).GetEndTimeCode() == 120
    assert (tmp_path / "precious").read_text() == "precious"
