"""Irradiance at points by wrad, as anybody runs it: scene, probes in, probes out."""

import csv
import json
import subprocess
from pathlib import Path

import numpy as np

SETTINGS = [("haar", 0.1), ("haar", 0.03), ("m3", 0.1), ("m3", 0.03), ("m3", 0.01), ("m3", 0.006)]
SETTINGS += [("auto", 0.03), ("auto", 0.01)]


class Wrad:
    name = "wrad"
    settings = SETTINGS

    def __init__(self, program, workplace):
        self.program, self.place = program, Path(workplace)
        told = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
        self.version = told.stdout.strip().removeprefix("wrad ")

    def load(self, scene):
        self.scene = scene

    def solve(self, points, setting, threads):
        """Seconds of the whole process, and irradiance per point and band; NaN where a point is on no surface."""
        basis, error = setting
        rows = "\n".join(",".join(f"{v:.17g}" for v in point) for point in points)
        (self.place / "points.csv").write_text("x,y,z,nx,ny,nz\n" + rows + "\n")
        command = f"solve {self.scene} --error {error} --basis {basis} --threads {threads} --pin none --quiet"
        command += f" --probes {self.place}/points.csv --probes-out {self.place}/read.csv --report {self.place}/report.json"
        subprocess.run([self.program, *command.split()], check=True)
        report = json.loads((self.place / "report.json").read_text())
        with open(self.place / "read.csv") as text:
            rows = list(csv.DictReader(text))
        number = lambda row, band: float(row[f"irradiance_{band}"]) if row[f"radiosity_{band}"] else np.nan
        return report["time_s"]["total"], np.array([[number(row, band) for band in "rgb"] for row in rows])
