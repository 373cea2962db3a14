//! Other people's structures on the same segments: `obvhs` here, and a file for the driver of Embree in `scripts/peers`. Both take triangles
//! and single precision; what lies within a ten-thousandth of an end does not count for them.

use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::Ray;
use obvhs::triangle::Triangle;
use wavelet_radiosity::visibility::OpaqueFaces;

use crate::workload::Bundle;

const END: f32 = 1e-4;

fn single(p: DVec3) -> Vec3A {
    Vec3A::new(p.x as f32, p.y as f32, p.z as f32)
}

/// The faces cut in triangles.
fn triangles(faces: &OpaqueFaces) -> Vec<Triangle> {
    let pieces = (0..faces.len() as u32).flat_map(|face| faces.pieces(face));
    let fan = |piece: &[DVec3]| -> Vec<Triangle> {
        let [first, rest @ ..] = piece else { return Vec::new() };
        let pairs = rest.windows(2);
        pairs.map(|p| Triangle { v0: single(*first), v1: single(p[0]), v2: single(p[1]) }).collect()
    };
    pieces.flat_map(fan).collect()
}

/// The compressed wide hierarchy of obvhs, its triangles in the order of its leaves.
pub struct Obvhs {
    bvh: CwBvh,
    triangles: Vec<Triangle>,
}

impl Obvhs {
    pub fn new(faces: &OpaqueFaces) -> Self {
        let unordered = triangles(faces);
        let bvh = build_cwbvh_from_tris(&unordered, BvhBuildParams::slow_build(), &mut Duration::default());
        let triangles = bvh.primitive_indices.iter().map(|i| unordered[*i as usize]).collect();
        Self { bvh, triangles }
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&*self.bvh.nodes) + size_of_val(&*self.triangles)
    }

    pub fn count_blocked(&self, bundles: &[Bundle]) -> usize {
        let blocked = |from: DVec3, to: DVec3| {
            let ray = Ray::new(single(from), single(to - from), END, 1.0 - END);
            !self.bvh.ray_traverse_miss(ray, |ray, i| self.triangles[i].intersect(ray))
        };
        let of_point =
            |bundle: &Bundle, from: DVec3| bundle.to.iter().filter(|to| blocked(from, **to)).count();
        bundles.iter().map(|b| b.from.iter().map(|from| of_point(b, *from)).sum::<usize>()).sum()
    }
}

/// Writes triangles and segments: two counts as 32-bit integers, then coordinates as 32-bit floats, all little-endian.
pub fn write(path: &Path, faces: &OpaqueFaces, bundles: &[Bundle]) -> std::io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    let triangles = triangles(faces);
    let segments: usize = bundles.iter().map(|b| b.from.len() * b.to.len()).sum();
    for count in [triangles.len(), segments] {
        out.write_all(&(count as u32).to_le_bytes())?;
    }
    let mut put = |p: Vec3A| p.to_array().iter().try_for_each(|x| out.write_all(&x.to_le_bytes()));
    for triangle in &triangles {
        [triangle.v0, triangle.v1, triangle.v2].into_iter().try_for_each(&mut put)?;
    }
    for bundle in bundles {
        for (from, to) in bundle.from.iter().flat_map(|from| bundle.to.iter().map(move |to| (from, to))) {
            put(single(*from))?;
            put(single(*to))?;
        }
    }
    out.flush()
}
