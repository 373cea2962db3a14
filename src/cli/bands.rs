//! Bands that follow from others: where surfaces reflect two bands alike and all that shines does so in one proportion, one of them is
//! computed for both.

use crate::radiosity::{Node, Solution};
use crate::scene::{Light, Scene, Surface};

/// How far, relatively, proportions of light may be apart: what rounding makes of equal ones.
const ROUNDING: f64 = 1e-12;

/// Which bands of a scene are computed, and how all follow from these.
pub(super) struct Collapsed {
    /// By computed band: the scene's, and how many times its light shines, so that the norm over bands is that over all.
    computed: Vec<(usize, f64)>,
    /// By band of the scene: the number of the computed one, and how many times that it is.
    follows: Vec<(usize, f64)>,
}

impl Collapsed {
    /// `None` where every band must be computed.
    pub fn new(scene: &Scene, surfaces: &[Surface]) -> Option<Self> {
        let count = scene.bands.len();
        let spectra = surfaces.iter().map(|s| &s.exitance_w_m2).chain(scene.lights.iter().map(spectrum));
        let spectra: Vec<&Vec<f64>> = spectra.collect();
        let total = |band: usize| spectra.iter().map(|spectrum| spectrum[band]).sum();
        let totals: Vec<f64> = (0..count).map(total).collect();
        let mut bands: Vec<usize> = (0..count).collect();
        bands.sort_by(|a, b| totals[*b].total_cmp(&totals[*a]));
        // By computed band: all that follow from the first, and how many times that they are.
        let mut groups: Vec<Vec<(usize, f64)>> = Vec::new();
        for band in bands {
            let times = |first: usize| {
                let times = if totals[first] > 0.0 { totals[band] / totals[first] } else { 0.0 };
                let reflected_alike = || surfaces.iter().all(|s| s.reflectance[first] == s.reflectance[band]);
                let shines_alike = || spectra.iter().all(|s| is_equal(s[band], times * s[first]));
                (totals[band] == 0.0 || reflected_alike() && shines_alike()).then_some(times)
            };
            match groups.iter_mut().find_map(|group| times(group[0].0).map(|times| (group, times))) {
                Some((group, times)) => group.push((band, times)),
                None => groups.push(vec![(band, 1.0)]),
            }
        }
        if groups.len() == count {
            return None;
        }
        let norm = |group: &[(usize, f64)]| group.iter().map(|(_, times)| times * times).sum::<f64>().sqrt();
        let (mut computed, mut follows) = (Vec::new(), vec![(0, 0.0); count]);
        for (number, group) in groups.iter().enumerate() {
            let brighter = norm(group) / norm(&groups[0]);
            computed.push((group[0].0, brighter));
            group.iter().for_each(|(band, times)| follows[*band] = (number, times / brighter));
        }
        Some(Self { computed, follows })
    }

    /// How many bands are computed.
    pub fn count(&self) -> usize {
        self.computed.len()
    }

    /// The scene and its surfaces in these bands.
    pub fn apply(&self, scene: &Scene, surfaces: &[Surface]) -> (Scene, Vec<Surface>) {
        let (mut scene, mut surfaces) = (scene.clone(), surfaces.to_vec());
        let reflected =
            |all: &mut Vec<f64>| *all = self.computed.iter().map(|(band, _)| all[*band]).collect();
        let shone = |all: &mut Vec<f64>| {
            *all = self.computed.iter().map(|(band, times)| times * all[*band]).collect()
        };
        scene.bands = self.computed.iter().map(|(band, _)| scene.bands[*band].clone()).collect();
        for material in &mut scene.materials {
            reflected(&mut material.reflectance);
            shone(&mut material.exitance_w_m2);
        }
        scene.lights.iter_mut().for_each(|light| shone(spectrum_mut(light)));
        for surface in &mut surfaces {
            reflected(&mut surface.reflectance);
            shone(&mut surface.exitance_w_m2);
        }
        (scene, surfaces)
    }

    /// Makes a solution in these bands one of `scene`, in all of its.
    pub fn undo(&self, solution: &mut Solution, scene: &Scene, surfaces: &[Surface]) {
        let (few, many) = (self.computed.len(), self.follows.len());
        solution.scene = scene.clone();
        solution.surfaces = surfaces.to_vec();
        for field in &mut solution.fields {
            field.bands = many;
            let all = field.coefficients.chunks_exact(few);
            field.coefficients =
                all.flat_map(|c| self.follows.iter().map(|(number, times)| times * c[*number])).collect();
            for node in &mut field.nodes {
                if let Node::Leaf(start) = node {
                    *start = *start / few as u32 * many as u32;
                }
            }
        }
    }
}

fn is_equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= ROUNDING * a.max(b)
}

fn spectrum(light: &Light) -> &Vec<f64> {
    match light {
        Light::Point { intensity_w_sr: spectrum, .. }
        | Light::Spot { intensity_w_sr: spectrum, .. }
        | Light::Directional { irradiance_w_m2: spectrum, .. } => spectrum,
    }
}

fn spectrum_mut(light: &mut Light) -> &mut Vec<f64> {
    match light {
        Light::Point { intensity_w_sr: spectrum, .. }
        | Light::Spot { intensity_w_sr: spectrum, .. }
        | Light::Directional { irradiance_w_m2: spectrum, .. } => spectrum,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DVec2;

    use super::*;
    use crate::math::Basis;
    use crate::scene;
    use crate::schedule::{Options, Silent, solve};
    use crate::transport::Oracle;
    use crate::visibility::{Bvh, OpaqueFaces};

    const ERROR: f64 = 0.05;

    /// A box of six walls that reflect as these, under a lamp that shines as this, twice as bright in one half.
    fn lit_box(walls: [&str; 2], lamp: [f64; 3]) -> Scene {
        let [floor, rest] = walls;
        let [r, g, b] = lamp;
        let (r2, g2, b2) = (2.0 * r, 2.0 * g, 2.0 * b);
        let text = format!(
            "#Inventor V2.1 ascii
            ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }}
            Coordinate3 {{ point [ 0 0 0, 2 0 0, 2 3 0, 0 3 0, 0 0 2, 2 0 2, 2 3 2, 0 3 2, \
                .5 1 1.99, 1 1 1.99, 1 2 1.99, .5 2 1.99, 1.5 1 1.99, 1.5 2 1.99 ] }}
            Material {{ diffuseColor {floor} }}
            IndexedFaceSet {{ coordIndex [ 0, 1, 2, 3, -1 ] }}
            Material {{ diffuseColor {rest} }}
            IndexedFaceSet {{ coordIndex [ 4, 5, 1, 0, -1, 5, 6, 2, 1, -1, 6, 7, 3, 2, -1, 7, 4, 0, 3, -1,
                7, 6, 5, 4, -1 ] }}
            Material {{ diffuseColor 0 0 0 emissiveColor {r} {g} {b} }}
            IndexedFaceSet {{ coordIndex [ 11, 10, 9, 8, -1 ] }}
            Material {{ diffuseColor 0 0 0 emissiveColor {r2} {g2} {b2} }}
            IndexedFaceSet {{ coordIndex [ 10, 13, 12, 9, -1 ] }}"
        );
        scene::read::inventor::parse(&text, Path::new("box.iv")).unwrap()
    }

    fn solution(scene: &Scene, surfaces: &[Surface], basis: Basis) -> Solution {
        let options = Options { error: ERROR, basis, oracle: Oracle::Energy, direct_only: false };
        let occluder = Bvh::new(OpaqueFaces::new(scene));
        solve(scene, surfaces, &occluder, &options, &mut Silent).solution
    }

    /// RMS distance of two solutions over the RMS of the second, at points of every surface.
    fn distance(one: &Solution, all: &Solution) -> f64 {
        let (mut square, mut norm) = (0.0, 0.0);
        for (one, all) in one.fields.iter().zip(&all.fields) {
            for point in 0..16 {
                let uv = (DVec2::new((point % 4) as f64, (point / 4) as f64) + 0.5) / 4.0;
                let (mut of_one, mut of_all) = ([0.0; 3], [0.0; 3]);
                one.irradiance(uv, &mut of_one);
                all.irradiance(uv, &mut of_all);
                square += of_one.iter().zip(&of_all).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                norm += of_all.iter().map(|b| b * b).sum::<f64>();
            }
        }
        (square / norm).sqrt()
    }

    #[test]
    fn bands_in_one_proportion_are_computed_once_and_come_out_the_same() {
        let grey = ["0.5 0.5 0.5", "0.7 0.7 0.7"];
        let same = 1e-12;
        for (walls, lamp, bands, apart) in [
            (grey, [10.0, 10.0, 10.0], 1, same),
            (grey, [10.0, 7.1, 3.3], 1, same),
            (["0.5 0.5 0.2", "0.7 0.7 0.3"], [10.0, 30.0, 3.3], 2, same),
            (["0.5 0.2 0.5", "0.7 0.3 0.7"], [10.0, 30.0, 3.3], 2, same),
            (["0.1 0.2 0.3", "0.7 0.6 0.5"], [10.0, 0.0, 3.3], 2, same),
            // How much a dark band would be reflected counts no more.
            (["0.1 0.2 0.3", "0.7 0.6 0.5"], [0.0, 0.0, 3.3], 1, 0.5 * ERROR),
        ] {
            let scene = lit_box(walls, lamp);
            let surfaces = scene::surfaces(&scene);
            let collapsed = Collapsed::new(&scene, &surfaces).unwrap();
            assert_eq!(collapsed.count(), bands, "{walls:?} {lamp:?}");
            let (few, few_surfaces) = collapsed.apply(&scene, &surfaces);
            for basis in [Basis::Haar, Basis::M3] {
                let mut one = solution(&few, &few_surfaces, basis);
                assert!(one.fields.iter().all(|field| field.bands == bands));
                collapsed.undo(&mut one, &scene, &surfaces);
                let all = solution(&scene, &surfaces, basis);
                let found = distance(&one, &all);
                println!("{bands} bands for {walls:?} under {lamp:?} in {basis:?}: {found:.1e} apart");
                assert!(found <= apart, "{found}");
            }
        }
    }

    #[test]
    fn bands_that_surfaces_reflect_or_lights_give_apart_are_all_computed() {
        let apart = |scene: &Scene| Collapsed::new(scene, &scene::surfaces(scene)).is_none();
        assert!(apart(&lit_box(["0.5 0.4 0.3", "0.7 0.7 0.7"], [10.0, 10.0, 10.0])));
        let mut scene = lit_box(["0.5 0.5 0.5", "0.7 0.7 0.7"], [10.0, 5.0, 2.0]);
        assert!(!apart(&scene));
        let intensity_w_sr = vec![1.0, 2.0, 4.0];
        scene.lights.push(Light::Point { position: glam::DVec3::ONE, intensity_w_sr });
        assert!(apart(&scene));
    }

    #[test]
    fn a_dark_scene_takes_one_band() {
        let scene = lit_box(["0.5 0.4 0.3", "0.7 0.7 0.7"], [0.0; 3]);
        assert_eq!(Collapsed::new(&scene, &scene::surfaces(&scene)).unwrap().count(), 1);
    }
}
