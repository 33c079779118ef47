"""Shows a session in Rerun: splats, objects, status. Arguments: SESSION, and a file .rrd in place of a viewer."""

import sys

import cosplat
import numpy as np
import rerun as rr
from numpy.typing import NDArray


def ellipsoids(covariances: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Standard deviations (n, 3) and orientations xyzw (n, 4) of covariances xx xy xz yy yz zz (n, 6)."""
    variances, axes = np.linalg.eigh(covariances[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3).astype(np.float64))
    # An axis may point either way: the three are to be right-handed.
    axes[:, :, 0] *= np.linalg.det(axes)[:, None]
    x, y, z = axes[:, 0, 0], axes[:, 1, 1], axes[:, 2, 2]
    signs = np.stack([axes[:, 2, 1] - axes[:, 1, 2], axes[:, 0, 2] - axes[:, 2, 0], axes[:, 1, 0] - axes[:, 0, 1]], 1)
    squares = np.stack([1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z], 1)
    quaternions = np.sqrt(np.maximum(squares, 0)) / 2
    quaternions[:, :3] = np.copysign(quaternions[:, :3], signs)
    return np.sqrt(np.maximum(variances, 0)), quaternions


def main() -> None:
    session_name, target = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
    rr.init("cosplat", spawn=target is None)
    if target is not None:
        rr.save(target)
    with cosplat.connect(session_name) as session:
        names = session.scene().names
        objects = session.objects(64)
        for frame in session.frames():
            rr.set_time("simulation", duration=frame.sim_time)
            rr.set_time("step", sequence=frame.step)
            scales, quaternions = ellipsoids(frame.covariances)
            splats = rr.GaussianSplats3D(frame.positions, scales=scales, quaternions=quaternions, colors=frame.colors)
            rr.log("world/splats", splats)
            # Messages of a step come before its frame: what is newer belongs to the next picture.
            while (states := objects.next(0)) is not None and states.step < frame.step:
                pass
            for name, state in zip(names, states.states if states else [], strict=False):
                rr.log(f"world/{name}", rr.Transform3D(translation=state["com"], quaternion=state["rotation"]))
                rr.log(f"energy/{name}", rr.Scalars(float(state["kinetic_energy"])))


if __name__ == "__main__":
    main()
