"""One line per frame of a session. Argument: SESSION"""

import sys

import cosplat

with cosplat.connect(sys.argv[1] if len(sys.argv) > 1 else "default", timeout=60) as session:
    print(len(session.scene().names), "objects")
    for frame in session.frames():
        highest = frame.positions.max(axis=0)
        print(f"step {frame.step} at {frame.sim_time:.3f} s: {len(frame)} Gaussians, up to {highest} m", flush=True)
