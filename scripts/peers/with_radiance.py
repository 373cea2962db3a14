"""Irradiance at points by Radiance: rtrace -I with the ambient cache."""

import os
import subprocess
import time
from pathlib import Path

import numpy as np

# Accuracy, divisions and supersamples of the ambient calculation.
SETTINGS = [(0.3, 256, 64), (0.2, 256, 64), (0.1, 256, 64), (0.05, 512, 128)]


BEHIND = 1e-4  # metres


def values(numbers):
    return " ".join(f"{number:.9g}" for number in numbers)


def polygon(material, name, corners):
    return f"{material} polygon {name}\n0\n0\n{corners.size} {values(corners.ravel())}\n"


class Radiance:
    name = "radiance"
    settings = SETTINGS

    def __init__(self, workplace):
        import pyradiance

        home = Path(pyradiance.__file__).parent
        self.place = Path(workplace)
        self.bin = home / "bin"
        self.environment = dict(os.environ, RAYPATH=str(home / "lib"))
        told = subprocess.run([self.bin / "rtrace", "-version"], capture_output=True, text=True, env=self.environment)
        self.version = told.stdout.strip().removeprefix("RADIANCE ")

    def load(self, faces):
        text = "void plastic black\n0\n0\n5 0 0 0 0 0\n"
        for number, face in enumerate(faces):
            if face.exitance.any():
                text += f"void light m{number}\n0\n0\n3 {values(face.exitance / np.pi)}\n"
                # Rays from behind pass through a light: something black closes it.
                text += polygon("black", f"b{number}", face.corners[::-1] - BEHIND * face.normal)
            else:
                text += f"void plastic m{number}\n0\n0\n5 {values(face.reflectance)} 0 0\n"
            text += polygon(f"m{number}", f"f{number}", face.corners)
        self.octree = self.place / "scene.oct"
        (self.place / "scene.rad").write_text(text)
        with open(self.octree, "wb") as out:
            subprocess.run([self.bin / "oconv", self.place / "scene.rad"], stdout=out, env=self.environment, check=True)

    def solve(self, points, setting, threads):
        """Seconds, and irradiance per point and band."""
        accuracy, divisions, supersamples = setting
        cache = self.place / "ambient"
        cache.unlink(missing_ok=True)
        command = f"-n {threads} -h -I+ -ab 8 -aa {accuracy} -ad {divisions} -as {supersamples} -ar 256"
        command += f" -lw 1e-6 -lr 12 -ds 0.05 -dj 0 -dt 0 -dc 1 -faa -af {cache} {self.octree}"
        start = time.perf_counter()
        done = subprocess.run(
            [self.bin / "rtrace", *command.split()],
            input="\n".join(values(point) for point in points).encode(),
            capture_output=True,
            env=self.environment,
            check=True,
        )
        seconds = time.perf_counter() - start
        return seconds, np.array(done.stdout.split(), dtype=float).reshape(-1, 3)
