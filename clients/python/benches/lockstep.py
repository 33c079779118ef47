"""Steps in lock-step from Python beside the same from Rust, in turn and in one run. Argument: the program COSPLAT-BENCH

The Rust side is `cosplat-bench lockstep`; this script asks the same of the same scenes, and as there its servers have one processor and
it has another. It prints a table in Markdown.
"""

import argparse
import ctypes
import json
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cosplat
import iceoryx2 as iox2
from cosplat import Domain, SetGravity, transport, wire
from cosplat.domain import SHARED_MEMORY

SCENE = """
version = 1
name = "a block that floats"
gravity = [0.0, 0.0, 0.0]
frame_rate = 60
dx = 0.05

[[objects]]
name = "block"
shape = {{ kind = "box", size = [{size}, {size}, {size}] }}
material = "{material}"
"""
SCENES = {
    "64 particles": {"size": 0.1, "material": "soft_rubber"},
    "8 particles": {"size": 0.05, "material": "soft_rubber"},
    "a rigid body": {"size": 0.05, "material": "rigid"},
}
COMMANDS = 4
WARM_UP = 50

Times = dict[str, float]


class Bare:
    """The binding of iceoryx2 alone: requests of the same size to a server that answers at once."""

    def __init__(self, domain: Domain) -> None:
        node = domain.join("bench")
        types = (wire.Command, wire.StepRequest, wire.Ack, wire.StepDone)
        self._service = self._open(lambda: transport.requests(node, "cosplat/bench/echo", *types))
        self._port = transport.sender(self._service, wire.MAX_COMMANDS)
        self._listener = self._open(lambda: transport.event(node, "cosplat/bench/echo/answered")).listener_builder().create()
        self._notifier = self._open(lambda: transport.event(node, "cosplat/bench/echo/asked")).notifier_builder().create()
        self._head = bytes(wire.StepRequest.dtype.itemsize)
        self._commands = bytes(wire.Command.dtype.itemsize * COMMANDS)
        while self._service.dynamic_config.number_of_servers == 0:
            time.sleep(0.01)

    def __call__(self) -> None:
        request = self._port.loan_slice_uninit(COMMANDS)
        ctypes.memmove(request.payload_ptr, self._commands, len(self._commands))
        ctypes.memmove(request.user_header_ptr, self._head, len(self._head))
        pending = request.assume_init().send()
        self._notifier.notify()
        while (response := pending.receive()) is None:
            self._listener.timed_wait(SHORT)
        assert response.header.number_of_elements == COMMANDS

    @staticmethod
    def _open(how: Callable[[], Any]) -> Any:
        deadline = time.monotonic() + 30
        while True:
            try:
                return how()
            except transport.Absent:
                if time.monotonic() > deadline:
                    raise
            time.sleep(0.01)


SHORT = iox2.Duration.from_millis(50)


def of_python(bench: str, scene: Path, rounds: int) -> Times:
    """What `cosplat-bench lockstep` measures, from Python."""
    domain = Domain.named(f"pystep{os.getpid() % 100_000}")
    try:
        return steps(bench, scene, rounds, domain)
    finally:
        for file in SHARED_MEMORY.glob(f"{domain.prefix}*"):
            file.unlink(missing_ok=True)
        shutil.rmtree(domain.root, ignore_errors=True)


def steps(bench: str, scene: Path, rounds: int, domain: Domain) -> Times:
    """The same in a domain of its own."""
    orders = [SetGravity((0, 0, 0))] * COMMANDS
    environment = {**os.environ, "COSPLAT_DOMAIN": str(domain.root)}
    allowed = sorted(os.sched_getaffinity(0))
    # A child begins where its parent may run.
    os.sched_setaffinity(0, allowed[-1:])
    launched = cosplat.launch(scene, participants=["bench"], threads=1, program=bench, domain=domain)
    with launched as session, session.participate("bench") as participant:
        echo = subprocess.Popen([bench, "lockstep", "--echo"], env=environment)
        os.sched_setaffinity(0, allowed[:1])
        try:
            bare = Bare(domain)
            times: dict[str, list[float]] = {"bare": [], "whole": [], "beside": []}
            for round in range(rounds + WARM_UP):
                begin = time.perf_counter()
                bare()
                middle = time.perf_counter()
                done = participant.step(*orders)
                whole = time.perf_counter() - middle
                if round >= WARM_UP:
                    for what, seconds in zip(times, (middle - begin, whole, whole - done.server_seconds), strict=True):
                        times[what].append(seconds * 1e6)
        finally:
            echo.kill()
            echo.wait()
        begin = time.perf_counter()
        for _ in range(rounds):
            participant.step()
        per_second = rounds / (time.perf_counter() - begin)
    os.sched_setaffinity(0, allowed)
    return {**{what: statistics.median(values) for what, values in times.items()}, "per_second": per_second}


def of_rust(bench: str, scene: Path, rounds: int) -> Times:
    """The same from Rust."""
    command = [bench, "lockstep", "--json", "--rounds", str(rounds), "--scene", str(scene)]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return {
        "bare": report["bare_us"]["p50"],
        "whole": report["whole_us"]["p50"],
        "beside": report["lockstep_us"]["p50"],
        "per_second": report["steps_per_second"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bench", help="the program cosplat-bench")
    parser.add_argument("--rounds", type=int, default=500, help="steps of a block")
    parser.add_argument("--blocks", type=int, default=9, help="blocks of each side, in turn; medians are printed")
    arguments = parser.parse_args()
    print("| scene | measured | Rust | Python | Python over Rust, median of blocks (least, largest) |")
    print("| --- | --- | ---: | ---: | ---: |")
    for name, values in SCENES.items():
        with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
            file.write(SCENE.format(**values))
            file.flush()
            pairs = []
            for block in range(arguments.blocks):
                # Whoever is first is so every other time.
                sides = [of_rust, of_python] if block % 2 else [of_python, of_rust]
                results = {side: side(arguments.bench, Path(file.name), arguments.rounds) for side in sides}
                pairs.append((results[of_rust], results[of_python]))
        for what, words, digits in (
            ("per_second", "steps per second, without commands", 0),
            ("whole", f"round trip with {COMMANDS} commands [us]", 0),
            ("beside", "the same less the step's own time [us]", 1),
            ("bare", "bare iceoryx2 request and response [us]", 1),
        ):
            rust, python = ([pair[side][what] for pair in pairs] for side in (0, 1))
            ratios = sorted(b / a for a, b in zip(rust, python, strict=True))
            middle = statistics.median(ratios)
            print(
                f"| {name} | {words} | {statistics.median(rust):.{digits}f} | {statistics.median(python):.{digits}f} "
                f"| {middle:.2f} ({ratios[0]:.2f}, {ratios[-1]:.2f}) |",
                flush=True,
            )


if __name__ == "__main__":
    main()
