"""Times wrad, Mitsuba 3 and Radiance on the same points in the same run, and writes a CSV and a README; started by scripts/peers/run.

True is a fine solution by wrad in M3, which is itself compared with the Monte Carlo probes beside the scene. Runs of different programs are
interleaved; after a run longer than --longest the finer ones of its curve are left out."""

import argparse
import csv
import math
import os
import statistics
import sys
import tempfile
from datetime import date
from pathlib import Path

import numpy as np

import scenes
from with_mitsuba import Mitsuba
from with_radiance import Radiance
from with_wrad import Wrad

LEVELS = [0.02, 0.01, 0.005]
COLUMNS = ["scene", "program", "setting", "threads", "seconds", "runs", "points", "rms", "median"]


def arguments():
    parser = argparse.ArgumentParser(prog="scripts/peers/run", description=__doc__)
    parser.add_argument("scene", nargs="*", help="scenes, each with NAME.probes.csv beside it [default: the reference scenes]")
    parser.add_argument("--points", type=int, default=10_000, help="points spread over all surfaces by area [%(default)s]")
    parser.add_argument("--threads", default="1,2", help="[%(default)s]")
    parser.add_argument("--repeat", type=int, default=1, help="repetitions, of which the median counts [%(default)s]")
    parser.add_argument("--truth", type=float, default=0.003, help="error asked of the solution taken for true [%(default)s]")
    parser.add_argument("--longest", type=float, default=60, help="seconds [%(default)s]")
    parser.add_argument("--wrad", default="target/release/wrad", help="[%(default)s]")
    parser.add_argument("--out", help="directory [results/<date>-<host>-<commit>/peers]")
    return parser.parse_args()


def deviation(values, truth):
    """RMS |e - t| / RMS t, and the median over points of the worst band's |e - t|, over mean t."""
    off = np.abs(values - truth)
    return math.sqrt((off**2).sum() / (truth**2).sum()), float(np.median(off.max(axis=1)) / truth.mean())


def reference(scene):
    """Probes, their irradiance, and its noise, of the file beside a scene."""
    with open(Path(scene).with_suffix(".probes.csv")) as text:
        rows = list(csv.DictReader(text))
    columns = lambda *names: np.array([[float(row[name]) for name in names] for row in rows])
    true, errors = columns("E_r", "E_g", "E_b"), columns("se_r", "se_g", "se_b")
    return columns("x", "y", "z", "nx", "ny", "nz"), true, math.sqrt((errors**2).sum() / (true**2).sum())


def curve_of(program, setting):
    """Settings that get finer one after the other: all of a peer's, one basis of wrad's."""
    return f"wrad {setting[0]}" if program == "wrad" else program


def measure(scene, options, wrad, peers):
    """Rows of the CSV for one scene, and what is known of its truth."""
    threads = [int(n) for n in options.threads.split(",")]
    faces = scenes.read(scene)
    wrad.load(scene)
    for peer in peers:
        peer.load(faces)
    probes, irradiance, noise = reference(scene)
    points = scenes.points(faces, options.points)
    seconds, read = wrad.solve(np.vstack([probes, points]), ("m3", options.truth), max(threads))
    at_probes = deviation(read[: len(probes)], irradiance)
    true = read[len(probes) :]
    on_surfaces = ~np.isnan(true).any(axis=1)
    points, true = points[on_surfaces], true[on_surfaces]
    say(f"{Path(scene).stem}: truth in {seconds:.1f} s, {100 * at_probes[0]:.2f} % off at the probes; {len(points)} points")
    runs, too_long = {}, set()
    longest = max(len(program.settings) for program in [wrad, *peers])
    order = [(p, p.settings[i]) for i in range(longest) for p in [wrad, *peers] if i < len(p.settings)]
    for _ in range(options.repeat):
        for program, setting in order:
            for count in threads:
                curve = (curve_of(program.name, setting), count)
                if curve in too_long and (program.name, setting, count) not in runs:
                    continue
                seconds, values = program.solve(points, setting, count)
                if seconds > options.longest:
                    too_long.add(curve)
                times, _ = runs.setdefault((program.name, setting, count), ([], deviation(values, true)))
                times.append(seconds)
                rms = 100 * deviation(values, true)[0]
                say(f"  {program.name} {setting} on {count}: {seconds:.2f} s, {rms:.2f} %")
    name = Path(scene).stem
    rows = []
    for (program, setting, count), (times, (rms, median)) in runs.items():
        text = " ".join(str(part) for part in setting) if isinstance(setting, tuple) else str(setting)
        rows.append([name, program, text, count, statistics.median(times), len(times), len(points), rms, median])
    truth = f"{name}: {100 * at_probes[0]:.2f} % RMS, {100 * at_probes[1]:.2f} % median; noise of the probes {100 * noise:.2f} %"
    return rows, truth


def seconds_to(curve, level, random):
    """Seconds to an error, straight in logarithms between runs, after "". What was there from the first is "< ", what was not reached "> ";
    but what is random goes on as 1/√n."""
    curve = sorted(curve, reverse=True)  # (error, seconds), from coarse to fine
    (first, least), (last, most) = curve[0], curve[-1]
    if first <= level:
        return "< ", least
    for (e0, s0), (e1, s1) in zip(curve, curve[1:]):
        if e0 > level >= e1 > 0:
            return "", s0 * (s1 / s0) ** (math.log(level / e0) / math.log(e1 / e0))
    return ("", most * (last / level) ** 2) if random else ("> ", most)


def table(rows, error):
    """Seconds at equal errors, RMS or median, in Markdown: the best of wrad's bases, and how many times longer peers take."""
    text = f"| scene | threads | {error} | wrad | mitsuba | times wrad | radiance | times wrad |\n|---|---:|---:|---:|---:|---:|---:|---:|\n"
    for scene, count in dict.fromkeys((row[0], row[3]) for row in rows):
        curves = {}
        for row in rows:
            if (row[0], row[3]) == (scene, count):
                curves.setdefault(curve_of(row[1], row[2].split()), []).append((row[COLUMNS.index(error)], row[4]))
        for level in LEVELS:
            reached = {name: seconds_to(curve, level, name == "mitsuba") for name, curve in curves.items()}
            ours = [(s, sign) for name, (sign, s) in reached.items() if name.startswith("wrad") and sign != "> "]
            best, early = min(ours, default=(None, ""))
            cells = [scene, str(count), f"{100 * level:g} %", f"{early}{best:.2f} s" if ours else "–"]
            for peer in ("mitsuba", "radiance"):
                sign, taken = reached.get(peer, ("", None))
                cells.append(f"{sign}{taken:.2f} s" if taken else "–")
                # At least so many times, where we were there earlier or they later; unknown where both were earlier.
                known = taken and ours and not (early and sign == "< ")
                cells.append(f"{'> ' if early else sign}{taken / best:.1f}" if known else "–")
            text += "| " + " | ".join(cells) + " |\n"
    return text


def processor():
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return "unknown processor"


def readme(options, programs, truths, rows, loads):
    versions = "".join(f"* {program.name} {program.version}\n" for program in programs)
    load = ", ".join(f"{load:.1f}" for load in loads)
    return f"""# wrad beside its peers

    scripts/peers/run {' '.join(options.scene)} --points {options.points} --threads {options.threads} --repeat {options.repeat} --truth {options.truth:g} --longest {options.longest:g}

{versions}* {processor()}, {os.cpu_count()} CPUs; load (one minute's mean) before, between and after scenes: {load}. What is measured runs on
  one thread or two: a load beyond that is others', and falls on all programs alike, for their runs are interleaved.

Irradiance at {options.points} points spread over all surfaces by area, less those covered by what stands on them. wrad: the whole process, from
reading the scene to writing the points. mitsuba: path tracing at the points with next-event estimation, scene loaded and kernels compiled
beforehand; beyond its finest run its error goes on as 1/√time. radiance: rtrace -I -ab 8 with the ambient cache. Errors are RMS |E − E*| / RMS E*
over points and bands; true is wrad's own solution in M3 to {options.truth:g}. Off the Monte Carlo probes that solution is:

{''.join(f'* {truth}' + chr(10) for truth in truths)}
Errors of that size or below are not to be trusted. Seconds to equal RMS errors, interpolated in logarithms; < was
reached by the coarsest run, > not by the finest:

{table(rows, 'rms')}
The same for median errors, which few bad points do not change:

{table(rows, 'median')}"""


def installed(workplace):
    """The peers that are here."""
    for peer in (Mitsuba, Radiance):
        try:
            yield peer(workplace)
        except ImportError as problem:
            say(f"left out: {problem}; scripts/peers/run --install installs it")


def say(text):
    print(text, file=sys.stderr, flush=True)


def main():
    options = arguments()
    options.scene = options.scene or [f"scenes/{name}.iv" for name in ("cornell-box", "l-gallery", "furnished-room")]
    rows, truths, loads = [], [], [os.getloadavg()[0]]
    with tempfile.TemporaryDirectory() as workplace:
        wrad = Wrad(options.wrad, workplace)
        peers = list(installed(workplace))
        for scene in options.scene:
            measured, truth = measure(scene, options, wrad, peers)
            rows, truths, loads = rows + measured, truths + [truth], loads + [os.getloadavg()[0]]
    commit = wrad.version.partition("(")[2].rstrip(")") or "unknown"
    out = Path(options.out or f"results/{date.today()}-{os.uname().nodename}-{commit}/peers")
    out.mkdir(parents=True, exist_ok=True)
    with open(out / "comparison.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    (out / "README.md").write_text(readme(options, [wrad, *peers], truths, rows, loads))
    print(table(rows, "rms") + f"written to {out}")


if __name__ == "__main__":
    main()
