#!/usr/bin/env python3
"""One command a scene: photos, split and starting points, the peer, ours, the plots: `measure.py lego400 --out runs/peers`.

What is done already stays as it is: a second call goes on after the last part that was finished.
"""

import argparse
from pathlib import Path

import opensplat
import ours
from common import ROOT, Problem, call, main, own
from prepare import prepare

# Dataset below the data folder, how it is read, and steps of the peer. OpenSplat adds Gaussians every 500 steps, in the first half of all.
SCENES = {
    "lego400": ("nerf_synthetic/lego", ["--behind", "black"], 3000),
    "fox480": ("instant_ngp/fox", ["--holdout", "every:8", "--longest-side", "480"], 3000),
    "bonsai": ("mipnerf360/bonsai", ["--holdout", "every:8"], 2000),
}


def measure(args):
    dataset, options, steps = SCENES[args.scene]
    source = Path(args.data) / dataset
    if not source.is_dir():
        raise Problem(f"{source}: no such folder; give the folder of the datasets with --data")
    out = Path(args.out) / args.scene
    prepared = out / "photos"
    prepare(source, prepared, options)
    steps = args.steps or steps
    save_every = args.save_every or max(steps // 20, 1)
    done = lambda name: (out / name / "scores.csv").exists()
    if args.only in (None, "opensplat") and not done("opensplat"):
        opensplat.train_and_score(prepared, out / "opensplat", args.scene, steps, save_every, args.lpips_weights)
    if args.only in (None, "ours") and not done("ours"):
        ours.train_and_score(prepared, out / "ours", args.scene, args.seconds, args.every, lpips=args.lpips_weights)
    tables = [str(out / name / "scores.csv") for name in ("opensplat", "ours") if done(name)]
    pages = args.pages or out / "pages"
    print(call([own("nerf-bench"), "--peers", ",".join(tables), "--out", pages]).strip())


def run():
    parser = argparse.ArgumentParser(description="A peer and ours on one scene, one after the other, and their plots.")
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--data", default=ROOT.parent / "shared" / "data", help="folder of the datasets")
    parser.add_argument("--out", default="runs/peers", help="folder of all results")
    parser.add_argument("--pages", help="folder of the page and plots (default: in the folder of the results)")
    parser.add_argument("--only", choices=["opensplat", "ours"])
    parser.add_argument("--steps", type=int, help="steps of the peer")
    parser.add_argument("--save-every", type=int, help="steps between saves of the peer (default: a twentieth)")
    parser.add_argument("--seconds", type=float, default=300, help="training seconds of ours")
    parser.add_argument("--every", type=float, default=30, help="seconds between scored checkpoints of ours")
    parser.add_argument("--lpips-weights", help="SqueezeNet weights, a safetensors file; without, no LPIPS")
    measure(parser.parse_args())


if __name__ == "__main__":
    main(run)
