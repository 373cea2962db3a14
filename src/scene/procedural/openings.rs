//! Walls with windows and doors, in the wall's coordinates: x right, y up, z out of the wall. A wall with openings is one
//! polygon: doors are notches in its lower edge, windows holes joined to an edge by a bridge.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, dvec2};

use super::sketch::Polygon;

/// An opening in a wall.
#[derive(Clone, Debug)]
pub(super) struct Opening {
    /// Left jamb upward, top, right jamb downward: clockwise. The sill closes it.
    contour: Vec<DVec2>,
    /// Which edge of the wall it is joined to.
    join: Join,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Join {
    /// It stands on the lower edge.
    Door,
    Lower,
    Upper,
}

impl Opening {
    /// A rectangle from `(x0, y0)` to `(x1, y1)`, joined to the lower edge; a door if its sill is at 0.
    pub fn rectangle(x0: f64, x1: f64, y0: f64, y1: f64) -> Opening {
        let contour = [(x0, y0), (x0, y1), (x1, y1), (x1, y0)].map(DVec2::from).to_vec();
        Opening { contour, join: if y0 > 0.0 { Join::Lower } else { Join::Door } }
    }

    /// With a round arch of `segments` above jambs that end at `spring`; without jambs where that is the sill.
    pub fn arched(x0: f64, x1: f64, y0: f64, spring: f64, segments: usize) -> Opening {
        let mut contour = arc(0.5 * (x0 + x1), spring, 0.5 * (x1 - x0), segments);
        if spring > y0 {
            contour.insert(0, dvec2(x0, y0));
            contour.push(dvec2(x1, y0));
        }
        Opening { contour, join: if y0 > 0.0 { Join::Lower } else { Join::Door } }
    }

    /// The same rectangle joined to the upper edge of its wall.
    pub fn hung(self) -> Opening {
        Opening { join: Join::Upper, ..self }
    }

    /// The faces of the hole's sides, `depth` deep behind the wall's plane: jambs, top, and sill or threshold.
    pub fn reveals(&self, depth: f64) -> Vec<Polygon> {
        let n = self.contour.len();
        (0..n)
            .map(|i| {
                let (p, q) = (self.contour[i], self.contour[(i + 1) % n]);
                vec![p.extend(0.0), p.extend(-depth), q.extend(-depth), q.extend(0.0)]
            })
            .collect()
    }

    /// [`Opening::reveals`] without the last: what is over the head of who walks through.
    pub fn intrados(&self, depth: f64) -> Vec<Polygon> {
        let mut faces = self.reveals(depth);
        faces.pop();
        faces
    }

    /// What closes the hole `depth` behind the wall's plane, looking out.
    pub fn pane(&self, depth: f64) -> Polygon {
        self.contour.iter().rev().map(|p| p.extend(-depth)).collect()
    }

    /// A frame on the wall around jambs and top: the profile (away from the hole, out of the wall) starts at the hole's edge and
    /// ends at the wall. Its feet are closed, except those of a door, which stand on something.
    pub fn frame(&self, profile: &[(f64, f64)]) -> Vec<Polygon> {
        let rails: Vec<Polygon> = profile
            .iter()
            .map(|(w, z)| self.widened(*w).into_iter().map(|p| p.extend(*z)).collect())
            .collect();
        let mut faces = Vec::new();
        for pair in rails.windows(2) {
            for i in 0..self.contour.len() - 1 {
                faces.push(vec![pair[0][i], pair[0][i + 1], pair[1][i + 1], pair[1][i]]);
            }
        }
        if self.join != Join::Door {
            let foot = |i: usize| rails.iter().map(move |rail| rail[i]);
            faces.push(foot(0).collect());
            faces.push(foot(self.contour.len() - 1).rev().collect());
        }
        faces
    }

    /// The contour moved outward by `w`, the feet staying at their height.
    fn widened(&self, w: f64) -> Vec<DVec2> {
        let n = self.contour.len();
        let left = |i: usize| (self.contour[i + 1] - self.contour[i]).normalize().perp();
        let moved = |i: usize| match i {
            // The feet slide along their level, so that all edges stay parallel and the faces between them planar.
            0 => self.contour[0] + dvec2(w / left(0).x, 0.0),
            _ if i == n - 1 => self.contour[i] + dvec2(w / left(i - 1).x, 0.0),
            _ => {
                let (a, b) = (left(i - 1), left(i));
                self.contour[i] + (a + b) * (w / (1.0 + a.dot(b)))
            }
        };
        (0..n).map(moved).collect()
    }

    /// The rectangle around it: least and greatest corner.
    pub fn bounds(&self) -> (DVec2, DVec2) {
        let first = self.contour[0];
        self.contour.iter().fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)))
    }
}

/// A half circle over its diameter at height `y`, from left to right.
fn arc(x: f64, y: f64, radius: f64, segments: usize) -> Vec<DVec2> {
    let at = |i: usize| {
        let (sin, cos) = (PI * i as f64 / segments as f64).sin_cos();
        // The feet exactly at the height of the springing.
        dvec2(x - radius * cos, if i == 0 || i == segments { y } else { y + radius * sin })
    };
    (0..=segments).map(at).collect()
}

/// The wall from `(x0, 0)` to `(x1, height)` around its openings, which are sorted from left to right among those of the same
/// edge.
pub(super) fn wall(x0: f64, x1: f64, height: f64, openings: &[Opening]) -> Polygon {
    let mut outline = vec![dvec2(x0, 0.0)];
    for opening in openings.iter().filter(|o| o.join != Join::Upper) {
        let first = opening.contour[0];
        if opening.join == Join::Lower {
            let foot = dvec2(first.x, 0.0);
            outline.push(foot);
            outline.extend(&opening.contour);
            outline.extend([first, foot]);
        } else {
            outline.extend(&opening.contour);
        }
    }
    outline.extend([dvec2(x1, 0.0), dvec2(x1, height)]);
    for opening in openings.iter().rev().filter(|o| o.join == Join::Upper) {
        let n = opening.contour.len();
        // From the right end of the top, clockwise.
        let corner = opening.contour[n - 2];
        let head = dvec2(corner.x, height);
        outline.push(head);
        outline.extend((0..n).map(|i| opening.contour[(n - 2 + i) % n]));
        outline.extend([corner, head]);
    }
    outline.push(dvec2(x0, height));
    outline.into_iter().map(|p| p.extend(0.0)).collect()
}

/// The same faces seen from behind a wall of some thickness: mirrored in the wall's plane and moved back.
pub(super) fn behind(face: &Polygon, thickness: f64) -> Polygon {
    face.iter().rev().map(|p| *p - DVec3::Z * thickness).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(face: &Polygon) -> f64 {
        let n = face.len();
        0.5 * (0..n).map(|i| face[i].truncate().perp_dot(face[(i + 1) % n].truncate())).sum::<f64>()
    }

    #[test]
    fn openings_take_their_area_from_the_wall() {
        let openings = [
            Opening::rectangle(1.0, 2.0, 0.0, 2.0),
            Opening::rectangle(3.0, 4.0, 1.0, 2.0),
            Opening::arched(5.0, 6.0, 1.0, 1.5, 8),
            Opening::rectangle(3.0, 4.0, 3.0, 4.0).hung(),
            Opening::rectangle(5.0, 6.0, 3.0, 4.0).hung(),
        ];
        let holes: f64 = openings.iter().map(|o| area(&o.pane(0.0))).sum();
        let face = wall(0.0, 8.0, 5.0, &openings);
        assert!((area(&face) - (40.0 - holes)).abs() < 1e-12);
        assert!((area(&behind(&face, 0.2)) + (40.0 - holes)).abs() < 1e-12);
    }

    #[test]
    fn reveals_look_into_the_hole_and_frames_away_from_the_wall() {
        for opening in [Opening::rectangle(1.0, 2.0, 1.0, 2.0), Opening::arched(1.0, 2.0, 1.0, 1.5, 6)] {
            let (low, high) = opening.bounds();
            let middle = (0.5 * (low + high)).extend(-0.1);
            for face in opening.reveals(0.2) {
                let normal = (face[1] - face[0]).cross(face[2] - face[0]);
                assert!(normal.dot(middle - face[0]) > 0.0);
            }
            let front =
                &opening.frame(&[(0.0, 0.0), (0.0, 0.1), (0.1, 0.1), (0.1, 0.0)])[opening.contour.len() - 1];
            assert!((front[1] - front[0]).cross(front[2] - front[0]).z > 0.0);
        }
    }
}
