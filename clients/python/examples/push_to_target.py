"""Pushes a box to a mark on the floor in lock-step: a force for every step, from what the step before led to."""

import sys

import cosplat
import numpy as np

SCENE = """
version = 1
name = "a box to push"
frame_rate = 100
dx = 0.05

[[objects]]
name = "box"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [0.0, 0.1, 0.0]
material = { preset = "rigid", density_kg_m3 = 300 }

[[colliders]]
name = "floor"
normal = [0.0, 1.0, 0.0]
surface = "separate"
friction = 0.3
"""
TARGET = np.array([0.4, -0.2])

with cosplat.launch(SCENE, participants=["controller"]) as session:
    objects = session.objects(depth=64)
    with session.participate("controller") as controller:
        force = np.zeros(3)
        for _ in range(400):
            done = controller.step(cosplat.Force("box", force))
            box = objects.at(done.step)["box"]
            error, velocity = TARGET - box.com[[0, 2]], box.linear_velocity[[0, 2]]
            # A spring and a damper, 2 Hz, and what friction takes.
            direction = error / max(float(np.linalg.norm(error)), 1e-9)
            pull = box.mass * (158 * error - 18 * velocity + 0.3 * 9.81 * direction)
            force = np.array([pull[0], 0.0, pull[1]])
            if np.linalg.norm(error) < 0.005 and np.linalg.norm(velocity) < 0.02:
                break
print(f"{np.linalg.norm(error) * 1000:.1f} mm from the mark after {done.sim_time:.2f} s, state {done.state_hash:016x}")
sys.exit(bool(np.linalg.norm(error) >= 0.005))
