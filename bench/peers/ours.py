#!/usr/bin/env python3
"""Our own side, with the same photos and the same scoring: `ours.py PREPARED OUT --seconds S --every S`.

One training of S seconds. Its checkpoints are kept as they come, as a peer's saves are, and scored when it has ended: so all metrics
are on the curve, and measuring takes nothing from the training. Checkpoints are not counted as training time.
"""

import json
import os
import shutil
from pathlib import Path

from common import Child, Problem, arguments, call, main, nerf_static, read_scores, score, write_rows

PEER = "wildfield"


class Checkpoints:
    """Keeps every checkpoint of a run, which itself keeps the newest alone: each in a run folder of its own."""

    def __init__(self, run, kept):
        self.run, self.kept = run, kept
        self.seen = {}

    def watch(self):
        for path in (self.run / "checkpoint").glob("step-*.json"):
            if path.name in self.seen:
                continue
            copy = self.kept / path.stem
            (copy / "checkpoint").mkdir(parents=True, exist_ok=True)
            try:
                # Written whole under other names and renamed: what is there is whole, and a second name for it is free.
                for part in (path, path.with_suffix(".safetensors")):
                    os.link(part, copy / "checkpoint" / part.name)
                for name in ("config.toml", "heldout.txt"):
                    shutil.copy(self.run / name, copy / name)
                self.seen[path.name] = (copy, path.stat().st_mtime)
            except FileNotFoundError:
                # The next one came meanwhile.
                shutil.rmtree(copy, ignore_errors=True)

    def in_order(self):
        return [self.seen[name] for name in sorted(self.seen)]


def score_checkpoint(copy, prepared, system, background, pictures, lpips):
    """Scores of one checkpoint: Gaussians as a file, which is how those of peers are scored; of another system, the run's own."""
    if system != "splat":
        options = ["--lpips-weights", lpips] if lpips else []
        return read_scores(call([nerf_static(), "eval", copy, "--progress", "off", *options]))
    file = copy / "splat.ply"
    call([nerf_static(), "export", copy, "--splats", file])
    return score(file, prepared, background, pictures, lpips)


def train_and_score(prepared, out, scene, seconds, every, system="splat", options=(), lpips=None):
    """Rows of the curve."""
    prepared, out = Path(prepared), Path(out)
    if out.exists():
        raise Problem(f"{out}: is there already; remove it or choose another folder")
    run, kept = out / "run", out / "checkpoints"
    out.mkdir(parents=True)
    words = [nerf_static(), "train", prepared, "--out", run, "--system", system, "--seconds", seconds, "--progress", "lines"]
    words += ["--checkpoint-minutes", every / 60, *options]
    checkpoints = Checkpoints(run, kept)
    child = Child(words, out / "log.txt", checkpoints.watch, r"^training (for|to) ")
    # Black or white borders of photos are the background; where there is none, pictures are drawn on white.
    black = 'background = "black"' in (run / "config.toml").read_text(encoding="utf-8")
    rows, found = [], checkpoints.in_order()
    for copy, written in found:
        meta = json.loads(next((copy / "checkpoint").glob("step-*.json")).read_text(encoding="utf-8"))
        pictures = out / "heldout" if copy == found[-1][0] else None
        scores = score_checkpoint(copy, prepared, system, "black" if black else "white", pictures, lpips)
        count, psnr, ssim, distance = scores
        rows.append({
            "peer": PEER, "scene": scene, "seconds": float(meta["seconds"]), "wall_seconds": written - child.started,
            "steps": meta["step"], "gaussians": count, "psnr": psnr, "ssim": ssim, "lpips": distance,
            "peak_mb": child.peak_mb, "program": f"{call([nerf_static(), '--version']).strip()} {system}",
        })
        print(f"step {meta['step']}, {meta['seconds']:.1f} s: {psnr} dB, {count} Gaussians", flush=True)
    write_rows(out / "scores.csv", rows)
    return rows


def run():
    parser = arguments("Our own training, scored as a peer's is.")
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--every", type=float, default=30, help="seconds between checkpoints that are scored")
    parser.add_argument("--system", default="splat")
    args, options = parser.parse_known_args()
    scene = args.scene or Path(args.prepared).name
    train_and_score(args.prepared, args.out, scene, args.seconds, args.every, args.system, options, args.lpips_weights)


if __name__ == "__main__":
    main(run)
