"""What the scripts beside it share that run `wrad`: the program of a commit, and a run's report."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "target" / "compare"


def stop(message):
    sys.exit(f"error: {message}")


def binary(commit):
    """The wrad of a commit, built below target/compare and kept there, or the one at this path."""
    if Path(commit).is_file():
        return Path(commit).resolve()
    found = subprocess.run(["git", "rev-parse", "--verify", "--short=12", f"{commit}^{{commit}}"], cwd=ROOT, capture_output=True, text=True)
    if found.returncode:
        stop(f"{commit}: expected a commit or the path of a wrad, found neither")
    name = found.stdout.strip()
    kept = KEPT / f"wrad-{name}"
    if not kept.exists():
        KEPT.mkdir(parents=True, exist_ok=True)
        tree = Path(tempfile.mkdtemp(prefix=f"wrad-{name}-"))
        try:
            subprocess.run(["git", "worktree", "add", "--quiet", "--detach", tree, name], cwd=ROOT, check=True)
            build = ["cargo", "build", "--release", "--locked", "--bin", "wrad", "--target-dir", KEPT / "build"]
            subprocess.run(build, cwd=tree, check=True)
            shutil.copy(KEPT / "build/release/wrad", kept)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=False)
    return kept


def report(wrad, options, before=()):
    """The report of a run, and what it wrote to standard error; `before` stands before the program: what it is run under."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "report.json"
        run = subprocess.run([*before, wrad, "solve", *options, "--quiet", "--report", path], capture_output=True, text=True)
        if run.returncode or not path.exists():
            stop(f"{wrad} solve {' '.join(options)} ended with {run.returncode}:\n{run.stderr}")
        return json.loads(path.read_text()), run.stderr
