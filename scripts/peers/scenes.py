"""The reference scenes for programs that do not read Open Inventor, and points on them.

Reads what the scenes of this project hold and nothing else: one Material, Coordinate3 and IndexedFaceSet of one polygon in each named
Separator; metres, reflectance, exitance in W/m² per band."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FACE = re.compile(
    r"DEF\s+(?P<name>\S+)\s+Separator\s*\{\s*Material\s*\{\s*diffuseColor(?P<rho>[^e}]*?)emissiveColor(?P<exitance>[^}]*)\}"
    r"\s*Coordinate3\s*\{\s*point\s*\[(?P<points>[^\]]*)\]\s*\}\s*IndexedFaceSet\s*\{\s*coordIndex\s*\[(?P<index>[^\]]*)\]"
)


@dataclass
class Face:
    name: str
    reflectance: np.ndarray
    exitance: np.ndarray
    corners: np.ndarray  # counter-clockwise seen from the front

    @property
    def normal(self):
        rolled = np.roll(self.corners, -1, axis=0)
        area = np.cross(self.corners, rolled).sum(axis=0)
        return area / np.linalg.norm(area)

    def triangles(self):
        """Ears of the polygon, cut off one by one."""
        left, normal = list(range(len(self.corners))), self.normal
        found = []
        while len(left) > 3:
            ear = next(i for i in range(len(left)) if self._is_ear(left, i, normal))
            found.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
            del left[ear]
        return np.array(found + [left])

    def _is_ear(self, left, at, normal):
        a, b, c = (self.corners[left[i % len(left)]] for i in (at - 1, at, at + 1))
        if np.dot(np.cross(b - a, c - b), normal) <= 0:
            return False
        others = [self.corners[i] for i in left if not any(np.array_equal(self.corners[i], p) for p in (a, b, c))]
        inside = lambda p: all(np.dot(np.cross(v - u, p - u), normal) >= 0 for u, v in ((a, b), (b, c), (c, a)))
        return not any(inside(p) for p in others)


def read(path):
    """The faces of a scene file."""
    numbers = lambda text: np.array(text.replace(",", " ").split(), dtype=float)
    text = Path(path).read_text()
    faces = []
    for match in FACE.finditer(text):
        points, index = numbers(match["points"]).reshape(-1, 3), numbers(match["index"]).astype(int)
        assert (index[:-1] >= 0).all() and index[-1] == -1, f"{path}: {match['name']}: one polygon is expected"
        faces.append(Face(match["name"], numbers(match["rho"]), numbers(match["exitance"]), points[index[:-1]]))
    expected = text.count("IndexedFaceSet")
    assert len(faces) == expected, f"{path}: {len(faces)} of {expected} faces were understood"
    return faces


def sheets(faces):
    """Faces one by one, each with the face that lies on it back to back, if there is one, which then does not come by itself."""
    place = lambda face: sorted(face.corners.tolist())
    found = []
    for face in faces:
        under = (i for i, (f, b) in enumerate(found) if b is None and place(f) == place(face) and f.normal @ face.normal < 0)
        at = next(under, None)
        if at is None:
            found.append((face, None))
        else:
            found[at] = (found[at][0], face)
    return found


def points(faces, count, seed=1998):
    """Rows x, y, z, nx, ny, nz spread over the faces by area; some may be covered by what stands on their face."""
    random = np.random.default_rng(seed)
    corners, normals = [], []
    for face in faces:
        triangles = face.triangles()
        corners.append(face.corners[triangles])
        normals.append(np.tile(face.normal, (len(triangles), 1)))
    corners, normals = np.concatenate(corners), np.concatenate(normals)
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    of = random.choice(len(areas), count, p=areas / areas.sum())
    u, v = random.random((2, count, 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    at = corners[of, 0] + u * edges[of, 0] + v * edges[of, 1]
    return np.hstack([at, normals[of]])
