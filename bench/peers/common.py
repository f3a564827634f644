"""What the scripts of all programs share: where programs lie, a child with its time and memory, scores, rows."""

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

COLUMNS = [
    "peer", "scene", "seconds", "wall_seconds", "steps", "gaussians", "psnr", "ssim", "lpips", "peak_mb", "program",
]


class Problem(Exception):
    """One line for the person: what is wrong, where, what to do."""


def find(name, variable, places=()):
    """The program that the environment variable names, else the one on the PATH, else the first of `places`; None without."""
    named = os.environ.get(variable)
    if named:
        return named if Path(named).is_file() else None
    found = shutil.which(name)
    return found or next((str(place) for place in places if Path(place).is_file()), None)


# Our programs: where they are built, and how.
BUILT = {
    "nerf-static": ("nerf-static", "-p apps"),
    "nerf-bench": ("nerf-bench", "-p bench"),
    "peer_scene": ("examples/peer_scene", "-p bench --example peer_scene"),
}


def own(name):
    """One of our programs."""
    place, how = BUILT[name]
    built = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / place
    variable = name.upper().replace("-", "_")
    found = find(name, variable, [built])
    if not found:
        raise Problem(
            f"{name} is missing: looked in the variable {variable}, on the PATH and at {built}; "
            f"build it with `cargo build --release {how}`"
        )
    return found


def nerf_static():
    """The program that trains and scores."""
    return own("nerf-static")


def call(words):
    """Run a program to its end and return what it printed; a failure shows its last line."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()
        line = next((line for line in said if line.startswith("error")), said[-1])
        raise Problem(f"`{words[0]} {words[1]}` failed with code {done.returncode}: {line}")
    return done.stdout


class Child:
    """A program that runs to its end while `watch` is called again and again; its time and the memory it had at most."""

    def __init__(self, words, log, watch, first_step, every=0.05):
        self.started = time.time()
        # Seconds since the start at which a line of the output first matched `first_step`.
        self.first_step = None
        pattern = re.compile(first_step)
        with open(log, "w", encoding="utf-8") as out:
            child = subprocess.Popen(
                [str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
            )

            def read():
                for line in child.stdout:
                    if self.first_step is None and pattern.search(line):
                        self.first_step = time.time() - self.started
                    out.write(line)

            reader = threading.Thread(target=read)
            reader.start()
            while True:
                # The operating system counts the memory of this child alone.
                pid, status, usage = os.wait4(child.pid, os.WNOHANG)
                watch()
                if pid:
                    break
                time.sleep(every)
            child.returncode = os.waitstatus_to_exitcode(status)
            self.wall = time.time() - self.started
            reader.join()
        # Kilobytes on Linux, bytes on macOS.
        self.peak_mb = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
        if child.returncode != 0:
            last = Path(log).read_text(encoding="utf-8").strip().splitlines()[-1:] or ["nothing"]
            raise Problem(f"`{words[0]}` ended with code {child.returncode}: {last[0]} (all of it in {log})")


def score(file, scene, background, out=None, lpips=None):
    """Gaussians, PSNR, SSIM and LPIPS (None where not measured) of a file of Gaussians, by `nerf-static eval`."""
    words = [nerf_static(), "eval", file, "--scene", scene, "--background", background, "--progress", "off"]
    words += ["--out", out] if out else []
    words += ["--lpips-weights", lpips] if lpips else []
    return read_scores(call(words))


def read_scores(text):
    """The count of Gaussians and the means in what `eval` prints."""
    count = re.search(r": (\d+) Gaussians", text)
    mean = re.search(r"^mean +(\S+) +(\S+) +\S+ +(\S+)$", text, re.MULTILINE)
    if not mean:
        raise Problem(f"`nerf-static eval` printed no means, but: {text.strip()[:200]!r}")
    number = lambda word: None if word == "n/a" else float(word)
    return (int(count.group(1)) if count else None, *(number(word) for word in mean.groups()))


def write_rows(path, rows):
    """Rows of a curve as CSV."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for row in rows:
            writer.writerow({key: shown(row.get(key)) for key in COLUMNS})
    print(f"{len(rows)} rows in {path}")


def shown(value):
    """A number with as many digits as mean something; nothing where there is none."""
    if isinstance(value, float):
        return f"{value:.4f}".rstrip("0").rstrip(".")
    return "" if value is None else value


def arguments(description):
    """The words that the script of every program takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("prepared", help="folder of prepare.py")
    parser.add_argument("out", help="folder of the results")
    parser.add_argument("--scene", help="name in the table (default: that of PREPARED)")
    parser.add_argument("--lpips-weights", help="SqueezeNet weights, a safetensors file")
    return parser


def main(run):
    """Run a script: a problem is one line and code 1."""
    try:
        sys.exit(run())
    except Problem as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
