"""Servers of one's own, and the domain that they meet in."""

import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

import cosplat
import pytest
from conftest import SCENE, Launch
from cosplat import BadName, Domain, DomainUnusable, LaunchFailed


def test_the_server_ends_with_its_session(launch: Launch) -> None:
    with launch() as session:
        assert session.process.poll() is None
    assert session.process.returncode == 0
    assert session.domain.sessions() == {}


def test_a_scene_may_be_a_file(domain: Domain, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    with cosplat.launch(path, paused=True) as session:
        assert session.scene().names == ["left", "right"]


def test_what_the_server_says_is_in_the_error(domain: Domain) -> None:
    with pytest.raises(LaunchFailed, match=r"(?s)ended with status \d: .*unobtainium"):
        cosplat.launch(SCENE.replace("soft_rubber", "unobtainium"))
    with pytest.raises(LaunchFailed, match="cannot start /nowhere"):
        cosplat.launch(SCENE, program="/nowhere")


def test_the_server_ends_with_a_killed_launcher(domain: Domain) -> None:
    script = "import cosplat, sys; s = cosplat.launch(sys.argv[1]); print(s.process.pid, flush=True); input()"
    launcher = subprocess.Popen(
        [sys.executable, "-c", script, SCENE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert launcher.stdout
    server = int(launcher.stdout.readline())
    launcher.kill()
    launcher.communicate()
    # It is no child of ours any more: its entry goes when it ends.
    while Path(f"/proc/{server}/stat").exists() and ") Z " not in Path(f"/proc/{server}/stat").read_text():
        signal.sigtimedwait([], 0.01)


def test_domains_have_the_names_of_the_wire_format() -> None:
    user = os.getuid()
    assert (Domain.named("x").root, Domain.named("x").prefix) == (Path(f"/tmp/cosplat-{user}-x"), f"cosplat-{user}-x_")
    assert Domain.named("").root == Path(f"/tmp/cosplat-{user}")
    assert Domain.named("/tmp/abc").prefix == "abc_"
    for name in ("a b", "a/b", "x" * 13):
        with pytest.raises(BadName, match="expected 1 to 12"):
            Domain.named(name)
    with pytest.raises(BadName, match="is not a session name"):
        cosplat.connect("a/b")


def test_a_folder_that_is_neither_empty_nor_a_domain_is_refused(tmp_path: Path) -> None:
    root = tmp_path / "home"
    root.mkdir(mode=0o700)
    (root / ".bashrc").touch()
    with pytest.raises(DomainUnusable, match=r"holds '\.bashrc' and is no domain"):
        Domain(root).join("test")
    assert [file.name for file in root.iterdir()] == [".bashrc"]


def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path) -> None:
    root = tmp_path / "open"
    root.mkdir(mode=0o755)
    with pytest.raises(DomainUnusable, match="has mode 755, expected 700"):
        Domain(root).join("test")
    (tmp_path / "link").symlink_to(root)
    with pytest.raises(DomainUnusable, match="is a link or a file"):
        Domain(tmp_path / "link").join("test")


def locks(domain: Domain) -> list[str]:
    return sorted(file.name for file in domain.root.glob("*.lock"))


def test_a_launched_server_leaves_no_lock(launch: Launch, domain: Domain) -> None:
    for _ in range(2):
        with launch(paused=True) as session:
            assert locks(domain) == [f"session-{session.name}.lock"]
        assert locks(domain) == []
    with pytest.raises(LaunchFailed):
        launch(arguments=["--rate", "none"])
    assert locks(domain) == []
    # A name that is chosen may be used again, and its lock has the epoch.
    with launch(session="chosen", paused=True) as first:
        epoch = first.hello.epoch
    assert locks(domain) == ["session-chosen.lock"]
    with launch(session="chosen", paused=True) as second:
        assert second.hello.epoch > epoch


def test_locks_of_launchers_that_were_killed_go_with_the_next_launch(launch: Launch, domain: Domain) -> None:
    script = "import cosplat, os, sys; cosplat.launch(sys.argv[1], paused=True); os.kill(os.getpid(), 9)"
    killed = subprocess.Popen([sys.executable, "-c", script, SCENE])
    killed.wait()
    [left] = locks(domain)
    assert left.startswith(f"session-python-{killed.pid}-")
    with (domain.root / left).open() as lock:
        # Held for as long as its server lives.
        fcntl.flock(lock, fcntl.LOCK_EX)
        with launch(paused=True) as session:
            assert locks(domain) == sorted([left, f"session-{session.name}.lock"])
    with launch(paused=True) as session:
        assert locks(domain) == [f"session-{session.name}.lock"]
