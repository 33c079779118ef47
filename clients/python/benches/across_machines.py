"""Two hosts on one machine, joined by iceoryx2's tunnel over Zenoh: what arrives, at which rate, with which loss.

Needs root, `ip`, `unshare`, and `iox2` with its Zenoh tunnel. Arguments: IOX2 COSPLAT SCENE... Each host has a network namespace,
shared memory, a clock that counts from its own start, and a domain of its own. It prints a table in Markdown.
"""

import argparse
import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cosplat
from cosplat import remote

ADDRESSES = {"a": "10.77.7.1", "b": "10.77.7.2"}
SECONDS = 10.0
CLOCK_AHEAD = 100_000

CONFIGURATION = """
[global]
root-path = "{root}"
prefix = "{prefix}"

[defaults.publish-subscribe]
publisher-history-size = 1
subscriber-max-buffer-size = 64
subscriber-max-borrowed-samples = 9
subscriber-expired-connection-buffer = 128
"""


def run(*command: str) -> None:
    subprocess.run(command, check=True)


def on_host(host: str, arguments: Sequence[str], **options: Any) -> "subprocess.Popen[str]":
    """This script on a host, as the first process of it."""
    # Shared memory, and the time since the start, are what two machines do not have in common.
    inside = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
    clock = ["--time", "--monotonic", str(CLOCK_AHEAD), "--boottime", str(CLOCK_AHEAD)] if host == "b" else []
    command = ["ip", "netns", "exec", f"cosplat-{host}", "unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"]
    command += [*clock, "bash", "-c", inside, host, sys.executable, __file__, "--host", host, *arguments]
    return subprocess.Popen(command, text=True, **options)


def tunnel(iox2: str, domain: cosplat.Domain, host: str, poll: int) -> "subprocess.Popen[bytes]":
    """The tunnel of a host; services that come from the other one are made with what its configuration says."""
    folder = domain.root / "tunnel"
    (folder / "config").mkdir(parents=True)
    (folder / "config/iceoryx2.toml").write_text(CONFIGURATION.format(root=domain.root, prefix=domain.prefix))
    zenoh: dict[str, Any] = {"mode": "peer", "scouting": {"multicast": {"enabled": False}}}
    zenoh["listen" if host == "a" else "connect"] = {"endpoints": [f"tcp/{ADDRESSES['a']}:7447"]}
    (folder / "zenoh.json5").write_text(json.dumps(zenoh))
    command = [iox2, "link", "tunnel", "zenoh", "--zenoh-config", "zenoh.json5", "--poll", str(poll)]
    environment = {**os.environ, "PATH": f"{Path(iox2).parent}:{os.environ['PATH']}"}
    with (folder / "log").open("wb") as log:
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)


def host_a(arguments: argparse.Namespace, domain: cosplat.Domain) -> None:
    """The server, its tunnel and its gateway, until standard input ends."""
    launched = cosplat.launch(
        arguments.scenes[0], session="far", pace="realtime", paused=True, program=arguments.cosplat, domain=domain
    )
    command = [sys.executable, "-m", "cosplat.gateway", "far", "--listen", f"{ADDRESSES['a']}:7400"]
    environment = {**os.environ, "COSPLAT_DOMAIN": str(domain.root)}
    with launched as session, subprocess.Popen(command, env=environment) as gateway:
        joined = tunnel(arguments.iox2, domain, "a", arguments.poll)
        sys.stdin.read()
        for process in (joined, gateway):
            process.terminate()
            process.wait()


def host_b(arguments: argparse.Namespace, domain: cosplat.Domain) -> None:
    """A reader, and orders by the gateway."""
    domain.join("setup")
    joined = tunnel(arguments.iox2, domain, "b", arguments.poll)
    try:
        print(json.dumps(measure(domain)), flush=True)
    finally:
        joined.terminate()
        joined.wait()


def measure(domain: cosplat.Domain) -> dict[str, Any]:
    """What arrives within SECONDS."""
    deadline = time.monotonic() + 60
    while True:
        try:
            session = remote.connect(ADDRESSES["a"], 7400, timeout=20, domain=domain)
            break
        except cosplat.NoServer:
            assert time.monotonic() < deadline, "the gateway does not come"
            time.sleep(0.2)
    with session:
        gravity = tuple(session.scene().header.gravity)
        frames, objects = session.frames(64), session.objects(64)
        session.send(cosplat.Resume())
        begin = time.perf_counter()
        round_trips, ages, steps, states = [], [], [], 0
        while time.perf_counter() - begin < SECONDS:
            if (frame := frames.next(0.5)) is not None:
                # The machine is one, so that the two clocks differ by what the host was given.
                ages.append(time.monotonic() - CLOCK_AHEAD - frame.header.publish_ns * 1e-9)
                steps.append(frame.step)
                count = len(frame)
                del frame
            while objects.next(0) is not None:
                states += 1
            if len(steps) % 10 == 0:
                start = time.perf_counter()
                session.send(cosplat.SetGravity(gravity))
                round_trips.append(time.perf_counter() - start)
        span = steps[-1] - steps[0] + 1
    return {
        "gaussians": count,
        "frames": len(steps),
        "steps": span,
        "objects": states,
        "seconds": time.perf_counter() - begin,
        "age_ms": sorted(ages)[len(ages) // 2] * 1e3,
        "order_ms": sorted(round_trips)[len(round_trips) // 2] * 1e3,
    }


def both_hosts(arguments: argparse.Namespace, scene: str) -> dict[str, Any]:
    """What the reader on one host measured of the server on the other."""
    for host in ADDRESSES:
        run("ip", "netns", "add", f"cosplat-{host}")
    try:
        run("ip", "link", "add", "cosplat-a", "type", "veth", "peer", "name", "cosplat-b")
        for host, address in ADDRESSES.items():
            run("ip", "link", "set", f"cosplat-{host}", "netns", f"cosplat-{host}")
            inside = ["ip", "-n", f"cosplat-{host}"]
            run(*inside, "addr", "add", f"{address}/24", "dev", f"cosplat-{host}")
            run(*inside, "link", "set", f"cosplat-{host}", "up")
            run(*inside, "link", "set", "lo", "up")
        words = ["--poll", str(arguments.poll), arguments.iox2, arguments.cosplat, scene]
        b = on_host("b", words, stdout=subprocess.PIPE)
        # What was sent before the other end was there does not come again.
        time.sleep(5)
        a = on_host("a", words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        told, _ = b.communicate(timeout=180)
        a.communicate(timeout=60)
        measured: dict[str, Any] = json.loads(told)
        return measured
    finally:
        for host in ADDRESSES:
            run("ip", "netns", "del", f"cosplat-{host}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", choices=list(ADDRESSES), help="be one of the hosts; the script starts them")
    parser.add_argument("--poll", type=int, default=5, help="how often the tunnels look [ms]")
    parser.add_argument("iox2", help="the program iox2")
    parser.add_argument("cosplat", help="the program cosplat")
    parser.add_argument("scenes", nargs="+", metavar="scene")
    arguments = parser.parse_args()
    if arguments.host is None:
        print("| scene | Gaussians | steps/s | frames/s | MB/s | frames lost | objects lost | age of a frame [ms] | answer to an order [ms] |")
        print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
        # For gateway and reader alike.
        os.environ["COSPLAT_TOKEN"] = secrets.token_hex(16)
        for scene in arguments.scenes:
            m = both_hosts(arguments, scene)
            rates = [m[what] / m["seconds"] for what in ("steps", "frames")]
            losses = [max(0, m["steps"] - m[what]) / m["steps"] for what in ("frames", "objects")]
            print(
                f"| {Path(scene).name} | {m['gaussians']} | {rates[0]:.0f} | {rates[1]:.0f} | {rates[1] * m['gaussians'] * 64e-6:.0f} "
                f"| {losses[0]:.1%} | {losses[1]:.1%} | {m['age_ms']:.0f} | {m['order_ms']:.1f} |",
                flush=True,
            )
        return
    with tempfile.TemporaryDirectory(prefix=f"cosplat-host-{arguments.host}-") as folder:
        os.environ["COSPLAT_DOMAIN"] = folder
        {"a": host_a, "b": host_b}[arguments.host](arguments, cosplat.Domain.from_env())


if __name__ == "__main__":
    main()
