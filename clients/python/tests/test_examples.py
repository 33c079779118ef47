"""The examples run as they are, each in a process of its own."""

import subprocess
import sys
from pathlib import Path

import numpy as np
from conftest import PATIENCE, Launch
from cosplat import Domain, Resume

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name: str, *arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, str(EXAMPLES / name), *arguments], stdout=subprocess.PIPE, text=True)


def test_the_first_loop_prints_a_line_per_frame(launch: Launch) -> None:
    with launch(paused=True, arguments=["--duration", "0.5"]) as session:
        loop = run("frames.py", session.name)
        while session.status().frame_readers == 0:
            assert loop.poll() is None
        session.send(Resume())
        output, _ = loop.communicate(timeout=PATIENCE)
    lines = output.splitlines()
    assert loop.returncode == 0 and lines[0] == "2 objects"
    assert lines[1].startswith("step ") and lines[-1].startswith("step 25 at 0.500 s: 10092 Gaussians, up to [")


def test_the_renderer_draws_the_frames_it_sees(launch: Launch, tmp_path: Path) -> None:
    lines = (EXAMPLES / "renderer.py").read_text().splitlines()
    assert len(lines) <= 30 and max(map(len, lines)) <= 130, "it is to stay small"
    folder = tmp_path / "pictures"
    with launch(paused=True, arguments=["--duration", "0.5"]) as session:
        renderer = run("renderer.py", session.name, str(folder))
        while not (folder / "000000.png").exists():
            assert renderer.poll() is None
        session.send(Resume())
        assert renderer.wait(PATIENCE) == 0
    # The first is of the paused server, the last of step 25; what lies between depends on the machine.
    pictures = sorted(file.name for file in folder.iterdir())
    assert pictures[0] == "000000.png" and pictures[-1] == "000025.png"
    for name in (pictures[0], pictures[-1]):
        data = (folder / name).read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n" and data[16:24] == (640).to_bytes(4, "big") + (480).to_bytes(4, "big")
    assert (folder / pictures[0]).read_bytes() != (folder / pictures[-1]).read_bytes(), "the blocks fall"


def test_the_controller_brings_the_box_to_its_mark(domain: Domain) -> None:
    results = [run("push_to_target.py") for _ in range(2)]
    outputs = [controller.communicate(timeout=PATIENCE)[0] for controller in results]
    assert [controller.returncode for controller in results] == [0, 0]
    assert "mm from the mark after" in outputs[0]
    # The same path to the last bit: the line ends with the state's hash.
    assert outputs[0] == outputs[1]


def test_the_bridge_to_rerun_logs_splats_and_objects(launch: Launch, tmp_path: Path) -> None:
    target = tmp_path / "run.rrd"
    with launch(paused=True, arguments=["--duration", "0.2"]) as session:
        bridge = run("rerun_bridge.py", session.name, str(target))
        while session.status().frame_readers == 0:
            assert bridge.poll() is None
        session.send(Resume())
        assert bridge.wait(PATIENCE) == 0
    data = target.read_bytes()
    assert data[:3] == b"RRF"
    for entity in (b"/world/splats", b"/world/left", b"/energy/right"):
        assert entity in data or entity[1:] in data


def test_ellipsoids_give_their_covariances_back() -> None:
    sys.path.insert(0, str(EXAMPLES))
    from rerun_bridge import ellipsoids

    random = np.random.default_rng(1)
    roots = random.normal(size=(1000, 3, 3)) * [1.0, 0.1, 0.01]
    covariances = roots @ roots.transpose(0, 2, 1)
    flat = covariances[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].astype(np.float32)
    scales, (x, y, z, w) = (parts := ellipsoids(flat))[0], parts[1].T
    turns = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    again = turns * scales[:, None, :] ** 2 @ turns.transpose(0, 2, 1)
    # Six digits of the input, relative to the largest variance.
    assert np.abs(again - covariances).max() < 1e-5 * covariances.max()
