#!/usr/bin/env python3
"""The same photos, split and starting points for all programs: `prepare.py SCENE OUT [options of reading a dataset]`.

    OUT/transforms.json, images/   all frames, with the split: what ours trains on and what scores are measured on
    OUT/peer/transforms.json       the training frames alone, with starting points: what a peer trains on
    OUT/peer/points.ply            the centres and colours that our own training starts from
    OUT/start/                     the run of one step that they come from
"""

import argparse
import json
import struct
from pathlib import Path

from common import Problem, call, main, nerf_static, own

# Colour of a Gaussian: 1/2 + C0 dc.
C0 = 0.28209479177387814
TYPES = {"float": "f", "float32": "f", "double": "d", "uchar": "B", "uint8": "B", "int": "i", "uint": "I"}


def prepare(scene, out, options=()):
    """Write all of it, but for what is there already."""
    out = Path(out)
    if not (out / "transforms.json").exists():
        print(call([own("peer_scene"), scene, out, *options]).strip(), flush=True)
    if not (out / "start.ply").exists():
        run = out / "start"
        if not (run / "finished.json").exists():
            words = ["train", out, "--out", run, "--system", "splat", "--steps", "1", "--progress", "off"]
            call([nerf_static(), *words])
        call([nerf_static(), "export", run, "--splats", out / "start.ply"])
    peer = out / "peer"
    peer.mkdir(exist_ok=True)
    points = gaussians(out / "start.ply")
    write_points(peer / "points.ply", points)
    top = json.loads((out / "transforms.json").read_text(encoding="utf-8"))
    trained = set(top["train_filenames"])
    frames = [dict(f, file_path=f"../{f['file_path']}") for f in top["frames"] if f["file_path"] in trained]
    listed = {"camera_model": top["camera_model"], "ply_file_path": "points.ply", "frames": frames}
    (peer / "transforms.json").write_text(json.dumps(listed, indent=1), encoding="utf-8")
    print(f"{peer}: {len(frames)} training frames, {len(points)} starting points")


def gaussians(path):
    """Centre and colour (bytes) of each Gaussian of a binary PLY file."""
    data = path.read_bytes()
    header, found, body = data.partition(b"end_header\n")
    lines = header.decode("ascii", "replace").splitlines()
    if not found or "format binary_little_endian 1.0" not in lines:
        raise Problem(f"{path}: not a binary little-endian PLY file")
    fields = [line.split()[1:] for line in lines if line.startswith("property ")]
    count = int(next(line.split()[2] for line in lines if line.startswith("element vertex ")))
    row = struct.Struct("<" + "".join(TYPES[kind] for kind, _ in fields))
    at = {name: i for i, (_, name) in enumerate(fields)}
    wanted = [at[name] for name in ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2")]
    rows = (row.unpack_from(body, i * row.size) for i in range(count))
    picked = ([values[i] for i in wanted] for values in rows)
    return [(*p[:3], *(max(0, min(255, round(255 * (0.5 + C0 * dc)))) for dc in p[3:])) for p in picked]


def write_points(path, points):
    """Coloured points as a binary PLY file."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    row = struct.Struct("<fffBBB")
    body = b"".join(row.pack(*point) for point in points)
    path.write_bytes("\n".join([*header, "end_header", ""]).encode("ascii") + body)


def run():
    parser = argparse.ArgumentParser(description="The same photos, split and starting points for all programs.")
    parser.add_argument("scene", help="dataset that nerf-static reads")
    parser.add_argument("out", help="folder that is written")
    args, options = parser.parse_known_args()
    prepare(args.scene, args.out, options)


if __name__ == "__main__":
    main(run)
