//! What a source is expected to make a receiver cost, before anything is known of either: what it would bring if nothing stood in between,
//! against what is small enough to be left alone.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::candidates::Candidates;
use super::gather::{Points, Tolerance, norm};
use super::receiver::Patch;
use super::{Rules, Scratch, Source};
use crate::math::polygon;
use crate::visibility::Occluder;

impl<const N: usize> Patch<N> {
    /// The cost to be expected of `source`, in no particular unit, for a surface of `area_m2`. Links that are divided until each carries no
    /// more than the threshold are as many as the root of what is to be carried, more or less: of the powers 0.5, 0.7, 1, and 1.3 it is
    /// the one that ordered the recorded tasks of two scenes best.
    pub fn expected_cost(&self, source: &impl Source<N>, area_m2: f64, rules: &Rules) -> f64 {
        if source.surface() == self.surface || !source.reaches(self.frame.normal, &self.corners) {
            return 0.0;
        }
        let (centre, radius) = self.sphere();
        let estimate = source.estimate_w_m2(centre, radius, self.frame.normal);
        let carried_w_m = self.weight(rules.least_reflectance) * estimate * area_m2.sqrt();
        (carried_w_m / rules.threshold_w_m).sqrt()
    }

    /// The irradiance norm in W/m² that `source` would cause in the middle of the surface if nothing stood in between, to a fifth.
    pub fn unshaded_w_m2(
        &self,
        source: &impl Source<N>,
        occluder: &dyn Occluder,
        scratch: &mut Scratch,
    ) -> f64 {
        self.unshaded_at(self.sphere().0, source, occluder, scratch)
    }

    /// The L2 norm in W/m of the irradiance that `source` would cause around the foot of the perpendicular from it if nothing stood in between:
    /// that of `E₀ / (1 + r²/h²)²`, a spot of Lambert's at height `h`, as wide as the source at least. 0 where the foot is not on the
    /// surface.
    pub fn unshaded_spot_w_m(
        &self,
        source: &impl Source<N>,
        occluder: &dyn Occluder,
        scratch: &mut Scratch,
    ) -> f64 {
        let Some((middle, reach_m)) = source.place() else { return 0.0 };
        let uv = self.frame.uv(middle);
        if !self.holds(uv) {
            return 0.0;
        }
        let foot = self.frame.point(uv);
        let height_m = foot.distance(middle).max(reach_m);
        let spot_m2 = (PI / 3.0 * height_m * height_m).min(self.frame.area_m2);
        self.unshaded_at(foot, source, occluder, scratch) * spot_m2.sqrt()
    }

    fn unshaded_at(
        &self,
        point: DVec3,
        source: &impl Source<N>,
        occluder: &dyn Occluder,
        scratch: &mut Scratch,
    ) -> f64 {
        if source.surface() == self.surface || !source.reaches(self.frame.normal, &self.corners) {
            return 0.0;
        }
        let point = std::slice::from_ref(&point);
        let (normal, face) = (self.frame.normal, self.face);
        let points = Points { position: point, eye: point, normal, face, hull: point };
        let tolerance = Tolerance { relative: 0.2, absolute_w_m2: 0.0 };
        let mut irradiance = [[0.0; N]];
        source.gather(&points, occluder, Candidates::Free, tolerance, &mut irradiance, &mut [0.0], scratch);
        norm(&irradiance[0])
    }

    /// Whether a point of the plane, by its parameters, lies on the polygon. Most do not lie on its parallelogram.
    fn holds(&self, uv: DVec2) -> bool {
        let outline = || -> Vec<DVec2> { self.corners.iter().map(|corner| self.frame.uv(*corner)).collect() };
        uv.min_element() >= 0.0 && uv.max_element() <= 1.0 && polygon::contains(&outline(), uv)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ccnuma::Arena;
    use ccnuma::arena::Backend;

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::{Tree, trees};
    use crate::scene::{read::inventor, surfaces};
    use crate::transport::{Oracle, SampleRules};

    #[test]
    fn what_is_near_and_faces_the_source_costs_most() {
        let square = |corner: &str, up: bool| {
            let faces = if up { "0 1 2 3" } else { "3 2 1 0" };
            let faces = faces.replace(' ', ", ");
            format!(
                "Separator {{ ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }} Translation {{ translation {corner} }}
                 Coordinate3 {{ point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] }} IndexedFaceSet {{ coordIndex [ {faces}, -1 ] }} }}\n"
            )
        };
        let text = format!(
            "#Inventor V2.1 ascii\nSeparator {{ Material {{ diffuseColor .5 .5 .5 emissiveColor 1 1 1 }}\n{}{}{}{} }}",
            square("0 0 9", false),
            square("0 0 7", true),
            square("0 0 1", true),
            square("0 0 3", false),
        );
        let scene = inventor::parse(&text, Path::new("squares.iv")).unwrap();
        let arena = Arena::new(Backend::Malloc);
        let trees = trees::<1>(&surfaces(&scene), Basis::M2, &arena);
        let packet = Tree::exitance_packet(&trees[0]);
        let rules = |threshold_w_m| Rules {
            oracle: Oracle::Energy,
            threshold_w_m,
            reference_w_m2: 1.0,
            least_reflectance: 0.5,
            point_w_m2: f64::INFINITY,
            samples: SampleRules::new(Basis::M2),
        };
        let cost =
            |tree: usize, tau| trees[tree].patch.expected_cost(&packet, trees[tree].area_m2, &rules(tau));
        assert!(cost(1, 0.01) > cost(2, 0.01) && cost(2, 0.01) > 0.0);
        assert_eq!((cost(3, 0.01), cost(0, 0.01)), (0.0, 0.0), "one looks away, one is the source");
        assert!((cost(1, 0.01) / cost(1, 0.04) - 2.0).abs() < 1e-9);
    }
}
