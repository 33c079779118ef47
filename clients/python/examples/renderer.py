"""A renderer of one's own: every splat a dot, the newest frame a PNG. Arguments: SESSION FOLDER"""

import os, struct, sys, zlib
import cosplat, numpy as np

WIDTH, HEIGHT = 640, 480
os.makedirs(sys.argv[2], exist_ok=True)
with cosplat.connect(sys.argv[1]) as session:
    scene = session.scene().header
    center, size = (scene.bounds_min + scene.bounds_max) / 2, np.ptp([scene.bounds_min, scene.bounds_max], axis=0).max()
    up = -scene.gravity / max(np.linalg.norm(scene.gravity), 1e-9)
    forward = np.cross(up, (1, 0, 0)) if abs(up[0]) < 0.9 else np.cross(up, (0, 1, 0))
    view = np.array([np.cross(forward, up), -up, forward])
    for frame in session.frames():
        x, y, depth = view @ ((frame.positions - center) / size).T + [[0], [0], [1.5]]
        column, row = (x / depth * HEIGHT + WIDTH / 2).astype(int), (y / depth * HEIGHT + HEIGHT / 2).astype(int)
        seen = (depth > 0.1) & (0 <= column) & (column < WIDTH) & (0 <= row) & (row < HEIGHT)
        far_to_near = np.flatnonzero(seen)[np.argsort(-depth[seen])]
        picture = np.full((HEIGHT, WIDTH, 3), 32, np.uint8)
        picture[row[far_to_near], column[far_to_near]] = frame.colors[far_to_near, :3]
        rows = b"".join(b"\0" + line.tobytes() for line in picture)
        chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        head = chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0))
        with open(f"{sys.argv[2]}/{frame.step:06}.png", "wb") as file:
            file.write(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))
