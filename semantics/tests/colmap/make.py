"""Writes a COLMAP model as text and as binary, and where its cameras see some points.

Run by hand with pycolmap 4.2.1: `python make.py .` in this folder.
"""

import json
import sys
from pathlib import Path

import numpy
import pycolmap

folder = Path(sys.argv[1])
model = pycolmap.Reconstruction()
cameras = [
    pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[600.0, 580.0, 310.0, 250.0], camera_id=1),
    pycolmap.Camera(model="SIMPLE_PINHOLE", width=320, height=200, params=[300.0, 150.0, 110.0], camera_id=2),
]
for camera in cameras:
    model.add_camera_with_trivial_rig(camera)
random = numpy.random.default_rng(7)
points = random.uniform(-0.5, 0.5, (4, 3))
seen = {}
for number in range(6):
    camera = cameras[number % 2]
    axis = random.normal(size=3)
    angle = random.uniform(0.2, 1.2)
    rotation = pycolmap.Rotation3d(axis / numpy.linalg.norm(axis) * angle)
    pose = pycolmap.Rigid3d(rotation, numpy.array([0.1 * number, -0.2, 4.0]))
    image = pycolmap.Image(name=f"shots/view {number}.jpg", camera_id=camera.camera_id, image_id=number + 1)
    # Keypoints fill the second line of an image in the text form.
    image.points2D = [pycolmap.Point2D(random.uniform(0, 200, 2)) for _ in range(3 * (number % 3))]
    model.add_image_with_trivial_frame(image, pose)
    pixels = [camera.img_from_cam(pose * point).tolist() for point in points]
    seen[f"view {number}"] = [camera.width, camera.height, pixels]
for form, write in [("text", model.write_text), ("binary", model.write_binary)]:
    (folder / form).mkdir(exist_ok=True)
    write(str(folder / form))
(folder / "seen.json").write_text(json.dumps({"points": points.tolist(), "seen": seen}))
