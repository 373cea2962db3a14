"""Irradiance at points by Mitsuba 3: path tracing from each point, with next-event estimation at the point and at every bounce."""

import glob
import os
import time

import numpy as np

import scenes

LANES = 1 << 23  # paths under way at once
SETTINGS = [4, 16, 64, 256]  # paths for each point


def find_llvm():
    """Points Dr.Jit to an LLVM that it works with (14 to 16 abort on AVX-512)."""
    for version in ("19", "20", "21", "22", "18", "17"):
        for path in glob.glob(f"/usr/lib/*/libLLVM-{version}.so*") + glob.glob(f"/usr/lib/*/libLLVM.so.{version}*"):
            os.environ.setdefault("DRJIT_LIBLLVM_PATH", path)
            return


def diffuse(face):
    """What a face is made of; it is black from behind."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": face.reflectance.tolist()}}


class Mitsuba:
    name = "mitsuba"
    settings = SETTINGS

    def __init__(self, _workplace):
        find_llvm()
        import drjit
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        self.mi, self.dr, self.version = mitsuba, drjit, mitsuba.__version__

    def load(self, faces):
        mi = self.mi
        scene = {"type": "scene"}
        for number, (face, back) in enumerate(scenes.sheets(faces)):
            triangles = face.triangles()
            bsdf = diffuse(face)
            # Of two meshes in one place a ray meets either, and every other time the black back of the wrong one.
            if back is not None:
                assert not face.exitance.any() and not back.exitance.any(), f"{face.name}: emits from a sheet"
                bsdf = {"type": "twosided", "front": bsdf, "reverse": diffuse(back)}
            properties = mi.Properties()
            properties["bsdf"] = mi.load_dict(bsdf)
            if face.exitance.any():
                radiance = {"type": "rgb", "value": (face.exitance / np.pi).tolist()}
                properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
            mesh = mi.Mesh(face.name, len(face.corners), len(triangles), props=properties)
            parameters = mi.traverse(mesh)
            parameters["vertex_positions"] = face.corners.ravel().astype(np.float32)
            parameters["faces"] = triangles.ravel().astype(np.uint32)
            parameters.update()
            scene[f"face{number}"] = mesh
        self.scene = mi.load_dict(scene)
        self.integrator = mi.load_dict({"type": "path", "max_depth": 64, "rr_depth": 5})

    def solve(self, points, paths, threads):
        """Seconds, and irradiance per point and band. A small pass before that compiles the kernels."""
        self.dr.set_thread_count(threads)
        self._pass(points[:16], min(paths, LANES // len(points)), 0)
        start = time.perf_counter()
        each = min(paths, LANES // len(points))
        total = np.zeros((len(points), 3))
        for number in range(paths // each):
            total += self._pass(points, each, number)
        return time.perf_counter() - start, total / (paths // each)

    def _pass(self, points, paths, seed):
        mi, dr = self.mi, self.dr
        count = len(points)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count * paths)
        index = dr.arange(mi.UInt32, count * paths) // paths
        column = lambda i: dr.gather(mi.Float, mi.Float(points[:, i].astype(np.float32)), index)
        at = dr.zeros(mi.SurfaceInteraction3f, count * paths)
        at.p = mi.Point3f(column(0), column(1), column(2))
        at.n = mi.Normal3f(column(3), column(4), column(5))
        at.sh_frame = mi.Frame3f(at.n)
        seen, weight = self.scene.sample_emitter_direction(at, sampler.next_2d(), True)
        direct = weight * dr.maximum(0, dr.dot(seen.d, at.n))
        out = at.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        ray = mi.RayDifferential3f(at.spawn_ray(out))
        incident, _, _ = self.integrator.sample(self.scene, sampler, ray)
        # What emitters send here is in `direct`. (hide_emitters would look through them.)
        first = self.scene.ray_intersect(ray)
        both = direct + dr.pi * (incident - first.emitter(self.scene).eval(first))
        mean = [dr.block_sum(both[band], paths) / paths for band in range(3)]
        return np.stack([np.array(band) for band in mean], axis=1)
