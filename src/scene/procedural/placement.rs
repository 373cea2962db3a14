//! Where a thing stands: from its own coordinates to those of the scene.

use glam::DVec3;

use super::sketch::Polygon;

/// A right-handed orthonormal system of coordinates in another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    origin: DVec3,
    axes: [DVec3; 3],
}

impl Placement {
    /// Upright at `origin`, turned counter-clockwise seen from above.
    pub fn standing(origin: DVec3, degrees: f64) -> Placement {
        // Quarter turns are exact, so that walls stay parallel to the axes.
        let (sin, cos) = match degrees.rem_euclid(360.0) {
            0.0 => (0.0, 1.0),
            90.0 => (1.0, 0.0),
            180.0 => (0.0, -1.0),
            270.0 => (-1.0, 0.0),
            other => other.to_radians().sin_cos(),
        };
        Placement { origin, axes: [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z] }
    }

    /// The plane of a vertical wall: x to the right, y up, z out of the wall towards who looks at it.
    pub fn wall(origin: DVec3, right: DVec3) -> Placement {
        Placement { origin, axes: [right, DVec3::Z, right.cross(DVec3::Z)] }
    }

    /// A point of the scene.
    pub fn point(&self, p: DVec3) -> DVec3 {
        let [x, y, z] = self.axes;
        self.origin + p.x * x + p.y * y + p.z * z
    }

    /// Faces of the scene.
    pub fn faces(&self, mut faces: Vec<Polygon>) -> Vec<Polygon> {
        for vertex in faces.iter_mut().flatten() {
            *vertex = self.point(*vertex);
        }
        faces
    }

    /// A placement given in this one.
    pub fn then(&self, inner: &Placement) -> Placement {
        let turned = |v: DVec3| self.point(v) - self.origin;
        Placement { origin: self.point(inner.origin), axes: inner.axes.map(turned) }
    }
}
