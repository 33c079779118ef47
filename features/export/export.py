"""Networks of usual checkpoints for `cosplat features`: an ONNX file and a TOML file each (torch, transformers, onnx, onnxscript).

    python export.py clip openai/clip-vit-large-patch14 clip --size 336x252    clip.onnx, and clip_text.onnx for words
    python export.py dino facebook/dinov2-small dino --size 700x518
    python export.py sam facebook/sam-vit-base sam --points 16

A checkpoint is a name or a folder, as transformers takes it. `--size` is what pictures are stretched to: choose the shape of your
pictures, in whole patches. SAM takes 1024x1024 alone, in which a picture keeps its shape: the rest is zeros.
"""

import argparse

import torch
import transformers

CLIP = [0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]
IMAGENET = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]


class ClipPatches(torch.nn.Module):
    """A vector for each patch in the space of the words: the value path of the last block alone (MaskCLIP, ECCV 2022)."""

    def __init__(self, model):
        super().__init__()
        self.vision, self.projection = model.vision_model, model.visual_projection

    def forward(self, pixels):
        x = self.vision.embeddings(pixels, interpolate_pos_encoding=True)
        x = self.vision.pre_layrnorm(x)
        *blocks, last = self.vision.encoder.layers
        for block in blocks:
            x = block(x, None)
            x = x[0] if isinstance(x, tuple) else x
        x = last.self_attn.out_proj(last.self_attn.v_proj(last.layer_norm1(x)))
        return self.projection(self.vision.post_layernorm(x))


class ClipText(torch.nn.Module):
    """The vector of a text: that of the token at its end, the largest there is."""

    def __init__(self, model):
        super().__init__()
        self.text, self.projection = model.text_model, model.text_projection

    def forward(self, ids):
        x = self.text(input_ids=ids).last_hidden_state
        end = ids.argmax(-1)
        return self.projection(x[torch.arange(1), end])


class DinoPatches(torch.nn.Module):
    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, pixels):
        return self.model(pixels).last_hidden_state


class SamMasks(torch.nn.Module):
    """Three masks for each point of a grid, with the quality that SAM expects of them."""

    def __init__(self, model, points):
        super().__init__()
        self.model, side = model, model.config.vision_config.image_size
        steps = (torch.arange(points) + 0.5) * side / points
        y, x = torch.meshgrid(steps, steps, indexing="ij")
        self.register_buffer("points", torch.stack([x, y], -1).reshape(1, points * points, 1, 2))

    def forward(self, pixels):
        out = self.model(pixel_values=pixels, input_points=self.points, multimask_output=True)
        masks, scores = out.pred_masks, out.iou_scores
        count = masks.shape[1] * masks.shape[2]
        return masks.reshape(1, count, *masks.shape[3:]), scores.reshape(1, count)


def save(module, out, given, inputs, outputs, lines):
    with torch.no_grad():
        torch.onnx.export(module.eval(), (given,), f"{out}.onnx", input_names=inputs, output_names=outputs,
                          opset_version=18, external_data=False, dynamo=True)
    with open(f"{out}.toml", "w") as file:
        file.write("\n".join([f'network = "{out.split("/")[-1]}.onnx"', *lines, ""]))


def picture(size, levels, *more):
    mean, std = levels
    return ["", "[picture]", f"size = [{size[0]}, {size[1]}]", f"mean = {mean}", f"std = {std}", *more]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["clip", "dino", "sam"])
    parser.add_argument("checkpoint")
    parser.add_argument("out", help="name of the files, without an end")
    parser.add_argument("--size", default="224x224")
    parser.add_argument("--points", type=int, default=16, help="points along a side of SAM's grid")
    args = parser.parse_args()
    size = [int(side) for side in args.size.split("x")]
    pixels = torch.zeros(1, 3, size[1], size[0])
    if args.kind == "clip":
        model = transformers.CLIPModel.from_pretrained(args.checkpoint, attn_implementation="eager")
        lines = ['kind = "image"', 'output = "tokens"', f"patch = {model.config.vision_config.patch_size}"]
        save(ClipPatches(model), args.out, pixels, ["pixels"], ["tokens"], lines + picture(size, CLIP))
        tokens = model.config.text_config.max_position_embeddings
        ids = torch.zeros(1, tokens, dtype=torch.int64)
        save(ClipText(model), f"{args.out}_text", ids, ["ids"], ["vector"], ['kind = "text"', f"tokens = {tokens}", 'output = "vector"'])
    elif args.kind == "dino":
        model = transformers.AutoModel.from_pretrained(args.checkpoint, attn_implementation="eager")
        lines = ['kind = "image"', 'output = "tokens"', f"patch = {model.config.patch_size}"]
        save(DinoPatches(model), args.out, pixels, ["pixels"], ["tokens"], lines + picture(size, IMAGENET))
    else:
        model = transformers.SamModel.from_pretrained(args.checkpoint, attn_implementation="eager")
        side = model.config.vision_config.image_size
        lines = ['kind = "masks"', 'output = "masks"', 'scores = "scores"', "least_score = 0.88", "overlap = 0.7"]
        pixels = torch.zeros(1, 3, side, side)
        lines += picture([side, side], IMAGENET, 'fit = "pad"')
        save(SamMasks(model, args.points), args.out, pixels, ["pixels"], ["masks", "scores"], lines)


if __name__ == "__main__":
    main()
