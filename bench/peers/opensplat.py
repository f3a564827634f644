#!/usr/bin/env python3
"""OpenSplat on the CPU: train, keep every save with its time, score each: `opensplat.py PREPARED OUT --steps N --save-every N`.

PREPARED is a folder of prepare.py. OUT gets the saves, the log, the held-out views of the last save, and scores.csv.
"""

import re
from pathlib import Path

from common import Child, ROOT, arguments, call, find, main, score, write_rows

PEER = "OpenSplat"
# It composites over black, and so are its Gaussians drawn when they are scored.
BACKGROUND = "black"
PLACES = [ROOT.parent / "OpenSplat" / "build" / "opensplat", ROOT.parent / "opensplat" / "build" / "opensplat"]


def program():
    """The program; None and a line where it is not installed."""
    found = find("opensplat", "OPENSPLAT", PLACES)
    if not found:
        places = ", ".join(str(place) for place in PLACES)
        print(f"skipped: OpenSplat is missing: looked in the variable OPENSPLAT, on the PATH and at {places}")
    return found


class Saves:
    """Files `splat_STEP.ply` as they come: when each began and was whole, seconds since the epoch."""

    def __init__(self, folder):
        self.folder = folder
        self.seen = {}

    def watch(self):
        for path in self.folder.glob("splat_*.ply"):
            status = path.stat()
            # The first sight of a file is when it began, but for the time between two looks.
            began = self.seen[path][0] if path in self.seen else min(status.st_ctime, status.st_mtime)
            self.seen[path] = (began, status.st_mtime)

    def in_order(self):
        step = lambda path: int(re.search(r"_(\d+)$", path.stem).group(1))
        return sorted((step(path), path, *times) for path, times in self.seen.items())


def words(opensplat, prepared, out, steps, save_every):
    """The command line. From 1.2.0 on the input's frame is kept unless told otherwise; before, it had to be asked for."""
    help_text = call([opensplat, "--help"])
    keep = ["--keep-crs"] if "--keep-crs" in help_text else []
    line = [opensplat, prepared / "peer", "-o", out / "splat.ply", "-n", steps, "--save-every", save_every, "--cpu"]
    return line + keep


def train_and_score(prepared, out, scene, steps, save_every, lpips=None):
    """Rows of the curve; None where the program is not installed."""
    opensplat = program()
    if not opensplat:
        return None
    prepared, out = Path(prepared), Path(out)
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("splat*.ply"):
        old.unlink()
    version = call([opensplat, "--version"]).strip().splitlines()[-1]
    saves = Saves(out)
    child = Child(words(opensplat, prepared, out, steps, save_every), out / "log.txt", saves.watch, r"^Step 1:")
    rows, writing = [], 0.0
    for step, path, began, whole in saves.in_order():
        is_last = step == max(step for step, *_ in saves.in_order())
        pictures = out / "heldout" if is_last else None
        count, psnr, ssim, distance = score(path, prepared, BACKGROUND, pictures, lpips)
        # Training time: from the first step on, without the time that earlier saves took to write.
        seconds = began - child.started - (child.first_step or 0.0) - writing
        writing += whole - began
        rows.append({
            "peer": PEER, "scene": scene, "seconds": seconds, "wall_seconds": whole - child.started, "steps": step,
            "gaussians": count, "psnr": psnr, "ssim": ssim, "lpips": distance, "peak_mb": child.peak_mb,
            "program": f"OpenSplat {version}",
        })
        print(f"step {step}, {seconds:.1f} s: {psnr} dB, {count} Gaussians", flush=True)
    write_rows(out / "scores.csv", rows)
    return rows


def run():
    parser = arguments("OpenSplat on the CPU, scored by nerf-static.")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--save-every", type=int, default=100)
    args = parser.parse_args()
    scene = args.scene or Path(args.prepared).name
    train_and_score(args.prepared, args.out, scene, args.steps, args.save_every, args.lpips_weights)


if __name__ == "__main__":
    main(run)
