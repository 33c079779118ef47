"""Networks with random weights, and what ONNX Runtime makes of them: `python make.py networks` (numpy, onnx, onnxruntime, pillow).

`python make.py --large FOLDER` writes the two shapes that times are compared at, DINOv2's ViT-S/14 and CLIP's ViT-B/16, each with
a picture, and prints ONNX Runtime's seconds on one thread.
"""

import sys
import time
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from PIL import Image


class Graph:
    """Nodes and weights of a network."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.nodes, self.weights = [], []

    def weight(self, array, kind=np.float32):
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.asarray(array, dtype=kind), name))
        return name

    def normal(self, *shape):
        """Weights under which values neither grow nor vanish."""
        scale = 1.0 / np.sqrt(shape[0] if len(shape) == 2 else np.prod(shape[1:]))
        return self.weight(self.random.normal(0, scale, shape))

    def op(self, kind, *inputs, **attributes):
        name = attributes.pop("name", f"v{len(self.nodes)}")
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def linear(self, x, before, after):
        x = self.op("MatMul", x, self.normal(before, after))
        return self.op("Add", x, self.weight(self.random.normal(0, 0.1, after)))

    def norm(self, x, dim):
        gain, bias = self.random.normal(1, 0.1, dim), self.random.normal(0, 0.1, dim)
        return self.op("LayerNormalization", x, self.weight(gain), self.weight(bias), axis=-1, epsilon=1e-6)

    def block(self, x, dim, heads, tokens):
        """A block of a transformer: attention, then two layers."""
        y = self.norm(x, dim)
        parts = []
        for perm in ([0, 2, 1, 3], [0, 2, 3, 1], [0, 2, 1, 3]):
            part = self.linear(y, dim, dim)
            part = self.op("Reshape", part, self.weight([1, tokens, heads, dim // heads], np.int64))
            parts.append(self.op("Transpose", part, perm=perm))
        query, key, value = parts
        score = self.op("MatMul", query, key)
        score = self.op("Mul", score, self.weight((dim // heads) ** -0.5))
        y = self.op("MatMul", self.op("Softmax", score, axis=-1), value)
        y = self.op("Reshape", self.op("Transpose", y, perm=[0, 2, 1, 3]), self.weight([1, tokens, dim], np.int64))
        x = self.op("Add", x, self.linear(y, dim, dim))
        y = self.linear(self.norm(x, dim), dim, 4 * dim)
        erf = self.op("Erf", self.op("Mul", y, self.weight(0.5**0.5)))
        gelu = self.op("Mul", self.op("Mul", y, self.weight(0.5)), self.op("Add", erf, self.weight(1.0)))
        return self.op("Add", x, self.linear(gelu, 4 * dim, dim))

    def save(self, path, inputs, outputs):
        graph = helper.make_graph(self.nodes, "network", inputs, outputs, self.weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model)
        onnx.save(model, path)


def tensor(name, kind, *shape):
    return helper.make_tensor_value_info(name, kind, shape)


def vit(path, size, patch, dim, depth, heads):
    """An image encoder: a token for the picture, then one for each patch."""
    width, height = size
    g = Graph(1)
    x = g.op("Conv", "pixels", g.normal(dim, 3, patch, patch), strides=[patch, patch], dilations=[1, 1], pads=[0, 0, 0, 0])
    cells = (width // patch) * (height // patch)
    x = g.op("Reshape", x, g.weight([1, dim, cells], np.int64))
    x = g.op("Transpose", x, perm=[0, 2, 1])
    x = g.op("Concat", g.weight(g.random.normal(0, 1, (1, 1, dim))), x, axis=1)
    x = g.op("Add", x, g.weight(g.random.normal(0, 0.5, (1, cells + 1, dim))))
    for _ in range(depth):
        x = g.block(x, dim, heads, cells + 1)
    g.nodes.append(helper.make_node("Identity", [g.norm(x, dim)], ["tokens"]))
    g.save(path, [tensor("pixels", TensorProto.FLOAT, 1, 3, height, width)],
           [tensor("tokens", TensorProto.FLOAT, 1, cells + 1, dim)])


def proposer(path, size, masks):
    """Masks: random mixtures of the colours at half the size; a score is how much of the picture a mask has."""
    width, height = size
    g = Graph(2)
    x = g.op("AveragePool", "pixels", kernel_shape=[2, 2], strides=[2, 2], pads=[0, 0, 0, 0])
    x = g.op("Conv", x, g.normal(masks, 3, 1, 1), g.weight(g.random.normal(0, 0.3, masks)),
             strides=[1, 1], dilations=[1, 1], pads=[0, 0, 0, 0], name="masks")
    share = g.op("ReduceMean", g.op("Sigmoid", x), axes=[2, 3], keepdims=0)
    g.nodes.append(helper.make_node("Identity", [share], ["scores"]))
    g.save(path, [tensor("pixels", TensorProto.FLOAT, 1, 3, height, width)],
           [tensor("masks", TensorProto.FLOAT, 1, masks, height // 2, width // 2),
            tensor("scores", TensorProto.FLOAT, 1, masks)])


def text(path, tokens, dim):
    """A text encoder: the vector at the largest token, that of the end, as CLIP has it. Tokens are told apart modulo 61."""
    g = Graph(3)
    x = g.op("Mod", "ids", g.weight(61, np.int64))
    x = g.op("Gather", g.weight(g.random.normal(0, 1, (61, dim))), x, axis=0)
    x = g.op("Add", x, g.weight(g.random.normal(0, 0.5, (1, tokens, dim))))
    x = g.block(x, dim, 2, tokens)
    end = g.op("ArgMax", "ids", axis=1, keepdims=0)
    x = g.op("Gather", x, end, axis=1)
    x = g.op("Reshape", x, g.weight([1, dim], np.int64))
    g.nodes.append(helper.make_node("Identity", [g.linear(x, dim, dim)], ["vector"]))
    g.save(path, [tensor("ids", TensorProto.INT64, 1, tokens)], [tensor("vector", TensorProto.FLOAT, 1, dim)])


MEAN, STD = np.array([0.48, 0.46, 0.41], np.float32), np.array([0.27, 0.26, 0.28], np.float32)


def picture(width, height):
    """Waves of colour, and a disc."""
    y, x = np.mgrid[0:height, 0:width] / height
    waves = [0.5 + 0.4 * np.sin(a * x + b * y) for a, b in ((5, 3), (-4, 7), (9, -2))]
    level = np.stack(waves, -1)
    level[(x - 0.7) ** 2 + (y - 0.5) ** 2 < 0.06] = [0.9, 0.2, 0.1]
    return Image.fromarray((level * 255).astype(np.uint8))


def shown(image):
    level = (np.asarray(image, dtype=np.float32) / 255 - MEAN) / STD
    return level.transpose(2, 0, 1)[None].copy()


def padded(image, size):
    """As SAM has it: the longer side as long as it fits, levels, then zeros to the right and below; and what the picture covers."""
    scale = min(size[0] / image.width, size[1] / image.height)
    covered = [int(side * scale + 0.5) for side in image.size]
    planes = [Image.fromarray(np.asarray(image, dtype=np.float32)[:, :, c]).resize(covered, Image.BILINEAR) for c in range(3)]
    level = (np.stack([np.asarray(p) for p in planes], -1) / np.float32(255) - MEAN) / STD
    level = np.pad(level, ((0, size[1] - covered[1]), (0, size[0] - covered[0]), (0, 0)))
    return level.transpose(2, 0, 1)[None].copy(), covered


def toml(path, kind, network, size, more, fit=()):
    lines = [f'kind = "{kind}"', f'network = "{network}"', *more]
    if size:
        lines += ["", "[picture]", f"size = [{size[0]}, {size[1]}]", "mean = [0.48, 0.46, 0.41]", "std = [0.27, 0.26, 0.28]", *fit]
    path.write_text("\n".join(lines) + "\n")


def session(path):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def small(folder):
    size = (64, 48)
    image = picture(*size)
    image.save(folder / "picture.png")
    image.save(folder / "picture.jpg", quality=90)
    np.save(folder / "jpeg.npy", np.asarray(Image.open(folder / "picture.jpg")))
    for name, other in (("smaller", (20, 12)), ("wider", (70, 20))):
        planes = [Image.fromarray(np.asarray(image, dtype=np.float32)[:, :, c]).resize(other, Image.BILINEAR) for c in range(3)]
        np.save(folder / f"{name}.npy", np.stack([np.asarray(p) for p in planes], -1) / np.float32(255))

    vit(folder / "vit.onnx", size, 8, 32, 2, 4)
    toml(folder / "vit.toml", "image", "vit.onnx", size, ["patch = 8", 'output = "tokens"'])
    tokens = session(folder / "vit.onnx").run(["tokens"], {"pixels": shown(image)})[0]
    patches = tokens[0, 1:].reshape(6, 8, 32)
    np.save(folder / "vit.npy", patches)

    proposer(folder / "masks.onnx", size, 8)
    more = ['output = "masks"', 'scores = "scores"', "least_score = 0.36", "overlap = 0.7"]
    toml(folder / "masks.toml", "masks", "masks.onnx", size, more)
    masks, scores = session(folder / "masks.onnx").run(["masks", "scores"], {"pixels": shown(image)})
    inside = masks[0] > 0
    kept = []
    for n in np.argsort(-scores[0], kind="stable"):
        new = all((inside[n] & o).sum() <= 0.7 * (inside[n] | o).sum() for o in kept)
        if scores[0, n] >= 0.36 and inside[n].any() and new:
            kept.append(inside[n])
    levels = []
    for order in (range(len(kept)), np.argsort([m.sum() for m in kept], kind="stable"),
                  range(len(kept)), np.argsort([-m.sum() for m in kept], kind="stable")):
        flat = np.full(inside.shape[1:], -1, dtype=np.int32)
        for n in reversed(list(order)):
            flat[kept[n]] = n
        levels.append(flat)
    np.save(folder / "masks_s.npy", np.stack(levels))
    # A pixel of masks is two of the picture: four by four of them to a patch.
    fine = patches.repeat(4, 0).repeat(4, 1).astype(np.float64)
    pooled = np.stack([fine[m].mean(0) for m in kept])
    np.save(folder / "masks_f.npy", (pooled / np.linalg.norm(pooled, axis=1, keepdims=True)).astype(np.float32))
    print(len(kept), "masks kept of", len(scores[0]), "scores", scores[0])

    # A picture of another shape, padded: it covers 30 of 64 columns, so nearly 4 of 8 patches and 15 of 32 pixels of masks.
    tall = picture(60, 96)
    tall.save(folder / "tall.png")
    pixels, covered = padded(tall, size)
    assert covered == [30, 48]
    pad = ['fit = "pad"']
    toml(folder / "vit_padded.toml", "image", "vit.onnx", size, ["patch = 8", 'output = "tokens"'], pad)
    tokens = session(folder / "vit.onnx").run(["tokens"], {"pixels": pixels})[0]
    np.save(folder / "vit_padded.npy", tokens[0, 1:].reshape(6, 8, 32)[:, :4].copy())
    toml(folder / "masks_padded.toml", "masks", "masks.onnx", size, ['output = "masks"', 'scores = "scores"', "overlap = 1.0"], pad)
    masks, scores = session(folder / "masks.onnx").run(["masks", "scores"], {"pixels": pixels})
    inside = (masks[0] > 0)[:, :, :15]
    flat = np.full(inside.shape[1:], -1, dtype=np.int32)
    order = [n for n in np.argsort(-scores[0], kind="stable") if inside[n].any()]
    for rank in reversed(range(len(order))):
        flat[inside[order[rank]]] = rank
    np.save(folder / "masks_padded.npy", flat)

    text(folder / "text.onnx", 77, 32)
    toml(folder / "text.toml", "text", "text.onnx", None, ["tokens = 77", 'output = "vector"'])
    # "a photo of a cat" in CLIP's tokens.
    ids = np.zeros((1, 77), np.int64)
    ids[0, :7] = [49406, 320, 1125, 539, 320, 2368, 49407]
    vector = session(folder / "text.onnx").run(["vector"], {"ids": ids})[0][0]
    np.save(folder / "text.npy", vector / np.linalg.norm(vector))


def large(folder):
    for name, size, patch, dim, depth, heads in (("vit_s14", 518, 14, 384, 12, 6), ("vit_b16", 224, 16, 768, 12, 12)):
        vit(folder / f"{name}.onnx", (size, size), patch, dim, depth, heads)
        toml(folder / f"{name}.toml", "image", f"{name}.onnx", (size, size), [f"patch = {patch}", 'output = "tokens"'])
        run, image = session(folder / f"{name}.onnx"), picture(640, 480)
        pictures = folder / "pictures"
        pictures.mkdir(exist_ok=True)
        for n in range(4):
            image.save(pictures / f"{n}.png")
        levels = shown(image.resize((size, size), Image.BILINEAR))
        times = []
        for _ in range(5):
            start = time.process_time()
            run.run(["tokens"], {"pixels": levels})
            times.append(time.process_time() - start)
        print(name, "processor seconds, least and median", round(min(times), 3), round(sorted(times)[2], 3))


if __name__ == "__main__":
    *mode, out = sys.argv[1:]
    Path(out).mkdir(exist_ok=True, parents=True)
    (large if mode == ["--large"] else small)(Path(out))
