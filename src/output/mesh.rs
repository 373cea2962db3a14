//! A solution as a triangle mesh: adaptive, watertight within each surface, one value per vertex and band.
//!
//! Vertices are shared by all elements of a surface that meet there and carry the mean of their
//! polynomials, so that linear interpolation shows no seams; vertices of different surfaces are never
//! shared, for normals and values differ. Positions in metres, irradiance `E` and radiosity `M + ρE` in
//! W/m². Triangles are counter-clockwise seen from the front.

use glam::{DVec2, DVec3};

use super::Error;
use super::tiling::{Tile, Tiling};
use crate::math::Basis;
use crate::radiosity::{Field, Solution};
use crate::scene::Surface;

/// A triangle mesh with one value per vertex and band.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Names of the bands.
    pub bands: Vec<String>,
    /// Positions in metres.
    pub positions: Vec<DVec3>,
    /// Unit normals of the fronts.
    pub normals: Vec<DVec3>,
    /// Irradiance in W/m²: vertices × bands, band fastest.
    pub irradiance_w_m2: Vec<f64>,
    /// Radiosity in W/m²: vertices × bands, band fastest.
    pub radiosity_w_m2: Vec<f64>,
    /// Corners of the triangles, indices of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// The element each triangle is part of, an index into `elements`.
    pub triangle_element: Vec<u32>,
    /// The leaves of the solution.
    pub elements: Vec<Element>,
    /// Mean irradiance of the leaves in W/m²: elements × bands, band fastest.
    pub element_irradiance_w_m2: Vec<f64>,
}

/// A leaf of the solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Index into [`Solution::surfaces`].
    pub surface: u32,
    /// Index into [`crate::scene::Scene::faces`].
    pub face: u32,
    /// How often the surface was halved on the way to it, in both directions together.
    pub level: u32,
    /// The area of its part of the polygon.
    pub area_m2: f64,
}

impl Mesh {
    /// The mesh of a solution.
    ///
    /// # Errors
    /// [`Error::Request`] if there are more vertices than a 32-bit index can tell apart.
    pub fn new(solution: &Solution) -> Result<Mesh, Error> {
        let mut mesh = Mesh { bands: solution.scene.bands.clone(), ..Mesh::default() };
        for (index, (surface, field)) in solution.surfaces.iter().zip(&solution.fields).enumerate() {
            mesh.add_surface(index as u32, surface, field);
            if mesh.positions.len() > u32::MAX as usize {
                let text = "the mesh has more than 2³² vertices, too many for its formats; \
                            solve with a larger --error, or write a .wrad or an image";
                return Err(Error::Request(text.to_owned()));
            }
        }
        Ok(mesh)
    }

    /// The area of a triangle in m².
    pub fn triangle_area_m2(&self, triangle: [u32; 3]) -> f64 {
        let [a, b, c] = triangle.map(|i| self.positions[i as usize]);
        0.5 * (b - a).cross(c - a).length()
    }

    fn add_surface(&mut self, index: u32, surface: &Surface, field: &Field) {
        let tiling = Tiling::new(surface, field);
        let base = self.positions.len();
        let (first_element, bands) = (self.elements.len() as u32, self.bands.len());
        for leaf in &tiling.leaves {
            let halvings = -(leaf.cell.size.x.log2() + leaf.cell.size.y.log2());
            let level = halvings.round() as u32;
            self.elements.push(Element { surface: index, face: surface.face, level, area_m2: 0.0 });
            self.element_irradiance_w_m2.extend_from_slice(&leaf.coefficients[..bands]);
        }
        self.positions.extend(tiling.points.iter().map(|uv| surface.frame.point(*uv)));
        self.average_vertices(&tiling, field);
        for tile in &tiling.tiles {
            let element = first_element + tile.leaf;
            let start = self.triangles.len();
            self.triangulate(tile, &tiling, base, surface, field);
            self.triangle_element.resize(self.triangles.len(), element);
            let area: f64 = self.triangles[start..].iter().map(|t| self.triangle_area_m2(*t)).sum();
            self.elements[element as usize].area_m2 += area;
        }
        self.normals.resize(self.positions.len(), surface.frame.normal);
        for at in base * bands..self.irradiance_w_m2.len() {
            let band = at % bands;
            let radiosity =
                surface.exitance_w_m2[band] + surface.reflectance[band] * self.irradiance_w_m2[at];
            self.radiosity_w_m2.push(radiosity);
        }
    }

    /// Appends the irradiance of the tiling's points: the mean over the tiles that meet there.
    fn average_vertices(&mut self, tiling: &Tiling, field: &Field) {
        let bands = self.bands.len();
        let mut sums = vec![0.0; tiling.points.len() * bands];
        let mut counts = vec![0u32; tiling.points.len()];
        let mut value = vec![0.0; bands];
        for tile in &tiling.tiles {
            for corner in &tile.corners {
                let corner = *corner as usize;
                let leaf = &tiling.leaves[tile.leaf as usize];
                leaf.irradiance(field.basis, tiling.points[corner], &mut value);
                counts[corner] += 1;
                for (sum, v) in sums[corner * bands..].iter_mut().zip(&value) {
                    *sum += v;
                }
            }
        }
        let mean = |(i, sum): (usize, &f64)| sum / f64::from(counts[i / bands].max(1));
        self.irradiance_w_m2.extend(sums.iter().enumerate().map(mean));
    }

    /// A triangle, two for a constant cell, else a fan around the middle: it takes any number of points on
    /// the border.
    fn triangulate(&mut self, tile: &Tile, tiling: &Tiling, base: usize, surface: &Surface, field: &Field) {
        let id = |i: usize| base as u32 + tile.corners[i % tile.corners.len()];
        match tile.corners.len() {
            0..3 => {}
            3 => self.triangles.push([id(0), id(1), id(2)]),
            4 if field.basis == Basis::Haar && turns_everywhere(tile, tiling) => {
                self.triangles.extend([[id(0), id(1), id(2)], [id(0), id(2), id(3)]]);
            }
            n => {
                let centre = self.positions.len() as u32;
                self.positions.push(surface.frame.point(tile.centre));
                let mut value = vec![0.0; self.bands.len()];
                tiling.leaves[tile.leaf as usize].irradiance(field.basis, tile.centre, &mut value);
                self.irradiance_w_m2.extend(value);
                self.triangles.extend((0..n).map(|i| [id(i), id(i + 1), centre]));
            }
        }
    }
}

/// Whether no corner of the tile is straight, so that a fan from a corner has no flat triangles.
fn turns_everywhere(tile: &Tile, tiling: &Tiling) -> bool {
    let n = tile.corners.len();
    let point = |i: usize| -> DVec2 { tiling.points[tile.corners[i % n] as usize] };
    (0..n).all(|i| (point(i + 1) - point(i)).perp_dot(point(i + 2) - point(i + 1)) > 0.0)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::output::rooms;

    fn check_watertight(mesh: &Mesh, solution: &Solution) {
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        for t in &mesh.triangles {
            for i in 0..3 {
                *edges.entry((t[i], t[(i + 1) % 3])).or_default() += 1;
            }
        }
        assert!(edges.values().all(|n| *n == 1), "an edge is used twice in the same direction");
        let surface_of: HashMap<u32, u32> = mesh
            .triangles
            .iter()
            .zip(&mesh.triangle_element)
            .flat_map(|(t, e)| t.map(|v| (v, mesh.elements[*e as usize].surface)))
            .collect();
        for (a, b) in edges.keys().filter(|(a, b)| !edges.contains_key(&(*b, *a))) {
            let surface = &solution.surfaces[surface_of[a] as usize];
            let middle = (mesh.positions[*a as usize] + mesh.positions[*b as usize]) * 0.5;
            let metric = |d: DVec2| (d.x * surface.frame.u + d.y * surface.frame.v).length_squared();
            let uv = surface.frame.uv(middle);
            let near = crate::math::polygon::nearest_on_boundary(&surface.outline, uv, metric);
            let distance = metric(near - uv).sqrt();
            assert!(distance < 1e-9, "open edge inside surface {}: {uv} is {distance} m off", surface_of[a]);
        }
    }

    fn check(solution: &Solution) {
        let mesh = Mesh::new(solution).unwrap();
        let mut areas = vec![0.0; solution.surfaces.len()];
        for element in &mesh.elements {
            areas[element.surface as usize] += element.area_m2;
        }
        for (i, (area, surface)) in areas.iter().zip(&solution.surfaces).enumerate() {
            let off = (area - surface.area_m2).abs() / surface.area_m2;
            assert!(off < 1e-9, "surface {i}: {area} against {}", surface.area_m2);
        }
        check_watertight(&mesh, solution);
    }

    #[test]
    fn surfaces_are_covered_once_and_have_no_cracks() {
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            for seed in 0..8 {
                check(&rooms::gallery(basis, 5, seed));
            }
        }
    }

    #[test]
    fn so_are_stars_of_any_shape_in_any_plane() {
        for seed in 0..150u64 {
            let mut random = rooms::Random(seed * 77 + 5);
            let n = 3 + (random.next() * 14.0) as usize;
            let turn = glam::DQuat::from_scaled_axis(DVec3::new(3.0, 2.0, 1.0) * random.next());
            let corners: Vec<[f64; 3]> = (0..n)
                .map(|i| {
                    // Some on round numbers: there corners meet the borders of cells.
                    let radius = if seed % 3 == 0 { 1.0 } else { 0.2 + random.next() };
                    let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
                    (turn * DVec3::new(radius * cos, radius * sin, 0.3)).to_array()
                })
                .collect();
            let materials = [([0.5; 3], [0.0; 3])];
            let scene = rooms::scene("star", &[(&corners, 0)], &materials);
            check(&rooms::solution(scene, [Basis::Haar, Basis::M3][seed as usize % 2], 6, seed));
        }
    }

    #[test]
    fn so_are_faces_in_parts() {
        let at = |i: usize, z: f64| {
            let corners = [[1.1, 0.4], [2.3, 0.9], [1.8, 2.1], [0.6, 1.6]];
            [corners[i % 4][0], corners[i % 4][1], z]
        };
        let walls: Vec<[[f64; 3]; 4]> =
            (0..4).map(|i| [at(i, 0.0), at(i + 1, 0.0), at(i + 1, 1.0), at(i, 1.0)]).collect();
        let floor = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.0, 3.0, 0.0]];
        let mut polygons: Vec<(&[[f64; 3]], u32)> = vec![(&floor, 0)];
        polygons.extend(walls.iter().map(|wall| (&wall[..], 0)));
        for basis in [Basis::Haar, Basis::M2, Basis::M3] {
            let scene = rooms::scene("contact", &polygons, &[([0.5; 3], [0.0; 3])]);
            let surfaces = crate::scene::surfaces(&scene);
            let solution = rooms::on_surfaces(scene, surfaces, basis, 6, &mut rooms::Random(3));
            assert_eq!(solution.surfaces.iter().filter(|surface| surface.face == 0).count(), 2);
            check(&solution);
        }
    }

    #[test]
    fn vertices_carry_the_function_and_normals_the_front() {
        let solution = rooms::gallery(Basis::M3, 6, 1);
        let mesh = Mesh::new(&solution).unwrap();
        let mut sum = 0.0;
        for (v, position) in mesh.positions.iter().enumerate() {
            for band in 0..3 {
                let truth = rooms::light(*position, band);
                sum += (mesh.irradiance_w_m2[3 * v + band] / truth - 1.0).powi(2);
            }
        }
        let rms = (sum / mesh.irradiance_w_m2.len() as f64).sqrt();
        assert!(rms < 5e-3, "vertices differ from the function by {rms}");
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[t[0] as usize]) > 0.0);
        }
    }
}
