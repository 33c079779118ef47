"""A sweep makes each simulation once, and its table is that of one that was never interrupted."""

import csv
import json
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import PATIENCE, SCENE
from cosplat import BadName, LaunchFailed, Report, Row, SweepFailed, sweep, write_csv

FRICTION: dict[str, list[Any]] = {"colliders.0.friction": [0.0, 0.4], "objects.0.velocity": [[0.5, 0, 0], [1.0, 0, 0]]}


def test_every_combination_has_its_row(tmp_path: Path) -> None:
    table = tmp_path / "table.jsonl"
    rows = sweep(SCENE, FRICTION, duration=0.4, table=table)
    assert [row.point for row in rows] == [
        {"colliders.0.friction": friction, "objects.0.velocity": velocity}
        for friction in (0.0, 0.4)
        for velocity in ([0.5, 0, 0], [1.0, 0, 0])
    ]
    assert all(row.error is None and row.metrics["frames"] == 20 for row in rows)
    far = [row.metrics["left.com"][0] for row in rows]
    # Friction brakes, and who is faster gets farther; it begins at -0.3 m.
    assert far[2] < far[0] < far[1] and far[3] < far[1] and far[0] == pytest.approx(-0.1, abs=0.01)
    assert sorted(Row(**json.loads(line)).id for line in table.open()) == sorted(row.id for row in rows)
    assert sweep(SCENE, [rows[3].point], duration=0.4, table=tmp_path / "other.jsonl", threads=2)[0].metrics[
        "state_hash"
    ] == rows[3].metrics["state_hash"]


def test_what_is_in_the_table_is_not_made_again(tmp_path: Path) -> None:
    table = tmp_path / "table.jsonl"
    first = sweep(SCENE, {"dx": [0.05, 0.06]}, duration=0.1, table=table)
    # Whoever was killed while it wrote leaves half a line.
    with table.open("a") as file:
        file.write('{"id": "12')
    assert sweep(SCENE, {"dx": [0.06, 0.05]}, duration=0.1, table=table, program="/bin/false") == first[::-1]
    more = sweep(SCENE, {"dx": [0.05, 0.06, 0.07]}, duration=0.1, table=table)
    assert more[:2] == first and len(table.read_text().splitlines()) == 3
    # Another duration is another simulation.
    assert sweep(SCENE, {"dx": [0.05]}, duration=0.2, table=table)[0] != first[0]


def test_a_killed_sweep_goes_on_where_it_was(tmp_path: Path) -> None:
    table, script = tmp_path / "table.jsonl", tmp_path / "sweep.py"
    script.write_text(
        f"import cosplat\nSCENE = {SCENE!r}\n"
        f"cosplat.sweep(SCENE, {{'colliders.0.friction': [i / 12 for i in range(12)]}}, duration=0.5, table={str(table)!r}, workers=2)\n"
    )
    process = subprocess.Popen([sys.executable, script])
    deadline = time.monotonic() + PATIENCE
    while not table.exists() or len(table.read_text().splitlines()) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = table.read_text().splitlines()
    subprocess.run([sys.executable, script], check=True)
    lines = table.read_text().splitlines()
    whole = done if done[-1].endswith("}") else done[:-1]
    assert lines[: len(whole)] == whole and len(lines) == 12
    rows = [Row(**json.loads(line)) for line in lines]
    assert len({row.id for row in rows}) == 12 and not any(row.error for row in rows)


def test_a_simulation_that_fails_is_a_row(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "cosplat")
    table = tmp_path / "table.jsonl"
    good, bad = sweep(SCENE, {"dx": [0.05, -1]}, duration=0.1, table=table)
    assert good.error is None and bad.metrics == {}
    assert bad.error and "scene.toml has 1 error:" in bad.error and "dx" in bad.error and "/" not in bad.error
    assert "sweep: 2 of 2 simulations are done" in caplog.text
    # It fails the same way every time.
    assert sweep(SCENE, {"dx": [-1]}, duration=0.1, table=table, program="/bin/false") == [bad]


def test_a_simulation_that_is_killed_is_made_again(tmp_path: Path) -> None:
    table, program = tmp_path / "table.jsonl", tmp_path / "cosplat"
    program.write_text("#!/bin/sh\nkill -9 $$\n")
    program.chmod(0o755)
    with pytest.raises(SweepFailed, match="1 of 1 simulations were ended: .*'dx': 0.05.*signal 9"):
        sweep(SCENE, {"dx": [0.05]}, duration=0.1, table=table, program=program)
    [row] = sweep(SCENE, {"dx": [0.05]}, duration=0.1, table=table)
    assert row.error is None


def test_metrics_are_made_of_the_report(tmp_path: Path) -> None:
    def highest(report: Report) -> dict[str, Any]:
        heights = [frame["objects"][0]["com"][1] for frame in report.frames()]
        return {"highest": max(heights), "gravity": report.point["gravity"], "none": float("nan")}

    rows = sweep(
        SCENE, {"gravity": [[0, -9.81, 0], [0, 1.0, 0]]}, duration=0.2, table=tmp_path / "table.jsonl", metrics=highest
    )
    # It begins at 0.3 m, and is lifted by a t^2 / 2.
    assert rows[0].metrics["highest"] < 0.3 and rows[1].metrics["highest"] == pytest.approx(0.32, abs=1e-3)
    assert rows[1].metrics["gravity"] == [0, 1.0, 0] and rows[1].metrics["none"] is None
    write_csv(rows, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0])[:4] == ["gravity.0", "gravity.1", "gravity.2", "highest"]
    assert float(lines[1]["highest"]) == rows[1].metrics["highest"]


def test_a_scene_file_finds_what_it_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tmp_path / "scenes" / "scene.toml"
    scene.parent.mkdir()
    scene.write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    by_path = sweep("scenes/scene.toml", [{}], duration=0.1, table="table.jsonl")
    # The same text is the same simulation.
    assert sweep(SCENE, [{}], duration=0.1, table="table.jsonl") == by_path
    with pytest.raises(FileNotFoundError):
        sweep("scenes/other.toml", [{}], duration=0.1, table="table.jsonl")


def test_a_table_belongs_to_one_sweep(tmp_path: Path) -> None:
    import fcntl

    table = tmp_path / "table.jsonl"
    with table.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(SweepFailed, match="written by another sweep"):
            sweep(SCENE, [{}], duration=0.1, table=table)
    table.write_text('{"step": 1}\n')
    with pytest.raises(SweepFailed, match="line 1 of .*table.jsonl is no row of a sweep"):
        sweep(SCENE, [{}], duration=0.1, table=table)
    assert table.read_text() == '{"step": 1}\n'
    with pytest.raises(BadName, match="'a=b' is not a key"):
        sweep(SCENE, [{"a=b": 1}], duration=0.1, table=tmp_path / "b.jsonl")
    with pytest.raises(LaunchFailed, match="cannot start /nowhere/cosplat"):
        sweep(SCENE, [{}], duration=0.1, table=tmp_path / "c.jsonl", program="/nowhere/cosplat")


def test_two_nodes_of_ray_give_the_same_table(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    here = sweep(SCENE, FRICTION, duration=0.2, table=tmp_path / "here.jsonl")
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False)
        there = sweep(SCENE, FRICTION, duration=0.2, table=tmp_path / "there.jsonl", on="ray", program=os.environ["COSPLAT"])
        nodes = {node["NodeID"] for node in ray.nodes() if node["Alive"]}
    finally:
        ray.shutdown()
        cluster.shutdown()  # type: ignore[no-untyped-call]
    assert len(nodes) == 2
    for one, other in zip(here, there, strict=True):
        assert (one.id, one.point) == (other.id, other.point)
        assert {**one.metrics, "wall_seconds": 0} == {**other.metrics, "wall_seconds": 0}
