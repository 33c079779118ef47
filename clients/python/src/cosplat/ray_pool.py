"""Simulations of a sweep where Ray has room for them. Needs the extra `ray`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping

import ray

from .launch import program_path
from .sweep import Outcome, Task


def run_on_ray(tasks: Mapping[str, Task], program: str | os.PathLike[str] | None) -> Iterator[tuple[str, Outcome]]:
    """Simulates on the cluster that this process is connected to, else on the one that RAY_ADDRESS names, else on this machine.

    Each takes as many of Ray's processors as it has threads. What was lost with a node is made again on another one.
    """
    if not ray.is_initialized():
        ray.init()
    named = None if program is None else os.fspath(program)
    running = {}
    try:
        for key, task in tasks.items():
            running[ray.remote(num_cpus=task.threads)(_run).remote(task, named)] = key
        while running:
            [ready], _ = ray.wait(list(running), num_returns=1)
            key = running.pop(ready)
            try:
                yield key, ray.get(ready)
            except (ray.exceptions.WorkerCrashedError, ray.exceptions.NodeDiedError, ray.exceptions.OutOfMemoryError) as error:
                yield key, Outcome({}, str(error).strip(), True)
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _run(task: Task, program: str | None) -> Outcome:
    # Found on the machine that runs it.
    return task.run(program_path(program))
