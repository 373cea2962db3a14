//! Whether a scene keeps its light: then its surfaces receive all together what they send. Rays are cast from where surfaces send light by the
//! solution so far; those that meet nothing, or a side that receives no light, take theirs away. In front of such black backs it may be dark, as on
//! the floor under a box, though a coarse solution does not know: there they take as much of what is reflected as of the hemisphere shows sides
//! that have any light. Where hardly any leaves, the ambient correction makes up for what transport has lost ([`crate::radiosity::add_ambient`]).

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use ccnuma::WorkerPanic;
use glam::{DVec2, DVec3};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::SeedableRng;

use crate::math::Cell;
use crate::math::chance::{seed, uniform};
use crate::radiosity::{Received, Tree};
use crate::scene::{Frame, Surface};
use crate::visibility::{Occluder, OpaqueFaces};

use super::crew::Crew;

/// Light that leaves and is not known of may cost this share of the error asked for.
const UNKNOWN: f64 = 0.1;
/// Of `n` rays at most this many may leave.
const MOST_LEAVE: f64 = 3.0;
/// Where `k` of `n` rays leave, at most `(k + 2√k + 3)/n` of the light does in nineteen of twenty cases: this over `n`, up to [`MOST_LEAVE`].
const MOST_MEANT: f64 = 10.0;
/// What is missing beyond this share was not lost on the way, but never found.
const MOST_LOST: f64 = 0.1;
/// Rays that are cast at first, to find out whether light leaves freely.
const FIRST_RAYS: f64 = 1000.0;
/// What would take more than this is not told.
const MOST_RAYS: f64 = 1e7;
/// Rays that look around from in front of a black back.
const LOOKS: u32 = 32;
/// How far off their surface rays start, as shares of the scene's extent and of its coordinates: beyond rounding, and before its neighbours.
const OFF: (f64, f64) = (1e-11, 64.0 * f64::EPSILON);
/// Rays that leave are counted in such parts of one, so that the sum does not depend on the order.
const PARTS: f64 = 1e6;

/// What transport has lost, or made where it is negative.
#[derive(Clone, Copy)]
pub(super) struct Lost<const N: usize> {
    /// In W per band.
    pub power_w: [f64; N],
    /// As a share of all that surfaces send.
    pub share: f64,
}

/// What transport has lost; `None` where more light leaves than matters to an error of `error`, where nothing is sent, or where so much is missing
/// that it was never found. `emitted_w` is what surfaces emit each, in W per band.
pub(super) fn lost<const N: usize>(
    error: f64,
    emitted_w: &[[f64; N]],
    (surfaces, occluder): (&[Surface], &dyn Occluder),
    trees: &mut [Tree<N>],
    crew: &mut Crew<'_>,
) -> Result<Option<Lost<N>>, WorkerPanic> {
    let Some(lost) = lost_or_left(emitted_w, surfaces, trees, crew)? else { return Ok(None) };
    let gain = Received::indirect(trees).gain();
    let rays = MOST_MEANT * gain / (UNKNOWN * error);
    if rays > MOST_RAYS {
        return Ok(None);
    }
    let mut leak = Leak::new(emitted_w, surfaces, occluder, trees, crew)?;
    let is_little = rays <= FIRST_RAYS || gain * lost.share.abs() <= UNKNOWN * error;
    let keeps = leak.is_small(FIRST_RAYS, trees, crew)? && (is_little || leak.is_small(rays, trees, crew)?);
    Ok(keeps.then_some(lost))
}

/// What transport has lost, and what leaves.
fn lost_or_left<const N: usize>(
    emitted_w: &[[f64; N]],
    surfaces: &[Surface],
    trees: &mut [Tree<N>],
    crew: &mut Crew<'_>,
) -> Result<Option<Lost<N>>, WorkerPanic> {
    let of_tree = |tree: &mut Tree<N>| {
        let received_w = tree.field().power_w(&surfaces[tree.patch.surface as usize]);
        (std::array::from_fn(|n| received_w[n]), tree.unshot_by_band_w())
    };
    let powers_w: Vec<([f64; N], [f64; N])> = crew.map(trees, |_| true, of_tree)?;
    let (mut sent_w, mut received_w, mut unshot_w) = ([0.0; N], [0.0; N], [0.0; N]);
    for ((tree, emitted_w), (of_tree_w, of_tree_unshot_w)) in trees.iter().zip(emitted_w).zip(powers_w) {
        for n in 0..N {
            sent_w[n] += emitted_w[n] + tree.patch.reflectance[n] * of_tree_w[n];
            received_w[n] += of_tree_w[n];
            unshot_w[n] += of_tree_unshot_w[n];
        }
    }
    let power_w: [f64; N] = std::array::from_fn(|n| sent_w[n] - received_w[n] - unshot_w[n]);
    let (all_w, sent_w) = (power_w.iter().sum::<f64>(), sent_w.iter().sum::<f64>());
    let lost = (sent_w > 0.0).then(|| Lost { power_w, share: all_w / sent_w });
    Ok(lost.filter(|lost| lost.share.abs() <= MOST_LOST))
}

/// How far off their surface rays start.
fn off_m<const N: usize>(trees: &[Tree<N>]) -> f64 {
    let corners = || trees.iter().flat_map(|tree| tree.patch.corners.iter().copied());
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    OFF.0 * (high - low).max_element() + OFF.1 * low.abs().max(high.abs()).max_element()
}

/// What a surface sends that emits so much, all bands, in W.
fn sent_w<const N: usize>(tree: &Tree<N>, emitted_w: &[f64; N]) -> f64 {
    let irradiance = tree.root.mean_irradiance();
    let sent = |n: usize| {
        emitted_w[n].max(0.0) + (tree.patch.reflectance[n] * irradiance[n]).max(0.0) * tree.area_m2
    };
    (0..N).map(sent).sum()
}

/// Where light leaves a scene, and how many rays did.
struct Leak<'a, const N: usize> {
    surfaces: &'a [Surface],
    occluder: &'a dyn Occluder,
    /// What surfaces emit, in W per band, and send in all, in W.
    emitted_w: &'a [[f64; N]],
    sent_w: Vec<f64>,
    /// By face: where its sides stand.
    firsts: Vec<u32>,
    sides: Vec<Receiving>,
    layout: Layout,
    /// How far off their surface rays start.
    off_m: f64,
    /// What a ray stands for on average.
    per_ray_w: f64,
    /// How many rays left, each by the share of its light that it took, in parts of one.
    parts: AtomicU64,
}

/// Which sides of a face receive light.
#[derive(Clone, Copy, Default)]
struct Receiving {
    /// Of the front.
    normal: DVec3,
    front: bool,
    back: bool,
}

/// By face where its sides stand, and the sides. Faces of the same corners, such as two back to back, are the first of them.
fn sides(surfaces: &[Surface], faces: &OpaqueFaces) -> (Vec<u32>, Vec<Receiving>) {
    let mut first = HashMap::new();
    let all = 0..faces.len() as u32;
    let firsts: Vec<u32> =
        all.map(|face| *first.entry(corners(faces.vertices(face))).or_insert(face)).collect();
    let mut sides = vec![Receiving::default(); faces.len()];
    for surface in surfaces {
        let (side, normal) = (&mut sides[firsts[surface.face as usize] as usize], surface.frame.normal);
        if side.normal == DVec3::ZERO {
            side.normal = normal;
        }
        let is_front = side.normal.dot(normal) > 0.0;
        side.front |= is_front;
        side.back |= !is_front;
    }
    (firsts, sides)
}

/// What a ray meets.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Met {
    Nothing,
    /// A side that receives light.
    Side,
    /// One that does not.
    BlackBack,
}

/// The corners of a face in an order of their own.
fn corners(vertices: &[DVec3]) -> Vec<[u64; 3]> {
    let mut corners: Vec<[u64; 3]> = vertices.iter().map(|v| v.to_array().map(f64::to_bits)).collect();
    corners.sort_unstable();
    corners
}

impl<'a, const N: usize> Leak<'a, N> {
    fn new(
        emitted_w: &'a [[f64; N]],
        surfaces: &'a [Surface],
        occluder: &'a dyn Occluder,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
    ) -> Result<Self, WorkerPanic> {
        let sent_w =
            crew.map(trees, |_| true, |tree| sent_w(tree, &emitted_w[tree.patch.surface as usize]))?;
        let (firsts, sides) = sides(surfaces, occluder.faces());
        let (layout, off_m) = (Layout::new(surfaces), off_m(trees));
        let (per_ray_w, parts) = (0.0, AtomicU64::new(0));
        Ok(Self { surfaces, occluder, emitted_w, sent_w, firsts, sides, layout, off_m, per_ray_w, parts })
    }

    /// Whether of about so many rays no more leave than may.
    fn is_small(
        &mut self,
        rays: f64,
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
    ) -> Result<bool, WorkerPanic> {
        self.per_ray_w = self.sent_w.iter().sum::<f64>() / rays;
        self.parts = AtomicU64::new(0);
        crew.map(trees, |_| true, |tree| self.look_from(tree))?;
        Ok(!self.is_too_large())
    }

    fn is_too_large(&self) -> bool {
        self.parts.load(Relaxed) as f64 > MOST_LEAVE * PARTS
    }

    /// Casts rays from a surface.
    fn look_from(&self, tree: &Tree<N>) {
        let index = tree.patch.surface as usize;
        let (surface, sent_w) = (&self.surfaces[index], self.sent_w[index]);
        // A whole number that rounding adds to is still that number.
        let rays = (sent_w / self.per_ray_w - 1e-6).ceil();
        if rays.is_nan() || rays <= 0.0 || self.is_too_large() {
            return;
        }
        let mut cast = Cast::new(tree, surface, &self.emitted_w[index], self.layout.seed(surface));
        for _ in 0..rays as u64 {
            let Some((origin, emitted)) = cast.origin() else { continue };
            let reflects = match self.meets(surface.face, origin, cast.direction()) {
                Met::Side => continue,
                Met::Nothing => 1.0,
                Met::BlackBack => {
                    let sees_side = |_: &u32| self.meets(surface.face, origin, cast.direction()) == Met::Side;
                    (0..LOOKS).filter(sees_side).count() as f64 / f64::from(LOOKS)
                }
            };
            let taken = (emitted + reflects * (1.0 - emitted)) * sent_w / (rays * self.per_ray_w);
            self.parts.fetch_add((PARTS * taken).ceil() as u64, Relaxed);
            if self.is_too_large() {
                return;
            }
        }
    }

    fn meets(&self, face: u32, origin: DVec3, direction: DVec3) -> Met {
        let hit = self.occluder.first_hit(origin + self.off_m * direction, direction);
        let Some((met, _)) = hit else { return Met::Nothing };
        let [met, face] = [met, face].map(|face| self.firsts[face as usize]);
        let Receiving { normal, front, back } = self.sides[met as usize];
        // No face meets itself: that is rounding.
        let receives = met == face || if normal.dot(direction) < 0.0 { front } else { back };
        if receives { Met::Side } else { Met::BlackBack }
    }
}

/// Where surfaces lie, told so that it does not change with the scene's place, turn, scale, or order of faces.
struct Layout {
    middle: DVec3,
    /// RMS distance of what there is from there.
    spread_m: f64,
    area_m2: f64,
}

impl Layout {
    fn new(surfaces: &[Surface]) -> Self {
        let area_m2: f64 = surfaces.iter().map(|s| s.area_m2).sum();
        let middle = surfaces.iter().map(|s| s.area_m2 * centre(s)).sum::<DVec3>() / area_m2;
        let square: f64 = surfaces.iter().map(|s| s.area_m2 * centre(s).distance_squared(middle)).sum();
        Self { middle, spread_m: (square / area_m2).sqrt(), area_m2 }
    }

    /// What the rays of a surface are drawn from: hardly two surfaces of a scene have the same, and each has it wherever the scene stands.
    fn seed(&self, surface: &Surface) -> u64 {
        seed([centre(surface).distance(self.middle) / self.spread_m, surface.area_m2 / self.area_m2])
    }
}

/// The middle of a surface's parallelogram.
fn centre(surface: &Surface) -> DVec3 {
    surface.frame.point(DVec2::splat(0.5))
}

/// Rays from all over a surface: more of them where it sends more, and the steeper.
struct Cast<'a> {
    surface: &'a Surface,
    /// The cells of its leaves, what share of what they send is emitted, and what all up to each send in W.
    cells: Vec<(Cell, f64, f64)>,
    random: Pcg32,
}

impl<'a> Cast<'a> {
    /// The same ones for the same seed, seen from the surface.
    fn new<const N: usize>(tree: &Tree<N>, surface: &'a Surface, emitted_w: &[f64; N], seed: u64) -> Self {
        let emitted_w_m2 =
            emitted_w.iter().map(|emitted_w| emitted_w.max(0.0)).sum::<f64>() / surface.area_m2;
        let (mut cells, mut up_to_w) = (Vec::new(), 0.0);
        tree.field().for_each_power(surface, &mut |cell, area_m2, power_w| {
            let reflected =
                power_w.iter().zip(&tree.patch.reflectance).map(|(power_w, rho)| (rho * power_w).max(0.0));
            let (emitted_w, reflected_w) = (emitted_w_m2 * area_m2, reflected.sum::<f64>());
            let sent_w = emitted_w + reflected_w;
            if sent_w > 0.0 {
                up_to_w += sent_w;
                cells.push((*cell, emitted_w / sent_w, up_to_w));
            }
        });
        Self { surface, cells, random: Pcg32::seed_from_u64(seed) }
    }

    /// Where the next ray starts, and what share of what is sent there is emitted; `None` where there is no such place.
    fn origin(&mut self) -> Option<(DVec3, f64)> {
        let at_w = self.cells.last()?.2 * uniform(&mut self.random);
        let index = self.cells.partition_point(|(_, _, up_to_w)| *up_to_w <= at_w);
        let (cell, emitted, _) = *self.cells.get(index).or(self.cells.last())?;
        let surface = self.surface;
        let uv = surface.point_in(&cell, || uniform(&mut self.random))?;
        Some((surface.frame.point(uv), emitted))
    }

    /// The direction of a ray, by Malley: a point of a disc, lifted onto the hemisphere.
    fn direction(&mut self) -> DVec3 {
        let (square, turn) = (uniform(&mut self.random), TAU * uniform(&mut self.random));
        let Frame { u, normal, .. } = self.surface.frame;
        let x = u.normalize();
        let y = normal.cross(x);
        square.sqrt() * (turn.cos() * x + turn.sin() * y) + (1.0 - square).sqrt() * normal
    }
}

#[cfg(test)]
mod tests {
    use ccnuma::Arena;
    use ccnuma::arena::{Backend, Memory};

    use super::*;
    use crate::math::Basis;
    use crate::radiosity::trees;
    use crate::scene::read::read_file;
    use crate::scene::{Face, Material, Scene, surfaces};
    use crate::visibility::Bvh;

    /// Walls, floor and ceiling of the furnished room, and where its ceiling is.
    fn room() -> (Scene, usize) {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let mut scene = read_file(&path).unwrap();
        let outer = |v: &DVec3| [v.x, v.x - 6.0, v.y, v.y - 4.5, v.z, v.z - 2.8].contains(&0.0);
        scene.faces.retain(|face| {
            face.vertices.iter().all(outer) && face.vertices[0].distance(face.vertices[2]) > 3.0
        });
        let ceiling = scene.faces.iter().position(|face| face.vertices.iter().all(|v| v.z == 2.8)).unwrap();
        (scene, ceiling)
    }

    /// Whether a scene keeps its light where 1 W/m² falls everywhere, by so many rays.
    fn keeps(rays: f64, scene: &Scene) -> bool {
        let surfaces = surfaces(scene);
        let mut trees = trees::<3>(&surfaces, Basis::Haar, &Arena::new(Backend::Malloc));
        trees.iter_mut().for_each(|tree| tree.root.add_ambient([1.0; 3]));
        let bvh = Bvh::new(OpaqueFaces::new(scene));
        let mut crew = Crew::new(None, Memory::default(), &surfaces).unwrap();
        let emitted_w: Vec<[f64; 3]> = surfaces.iter().map(emitted).collect();
        let mut leak = Leak::new(&emitted_w, &surfaces, &bvh, &mut trees, &mut crew).unwrap();
        leak.is_small(rays, &mut trees, &mut crew).unwrap()
    }

    fn emitted(surface: &Surface) -> [f64; 3] {
        std::array::from_fn(|n| surface.exitance_w_m2[n] * surface.area_m2)
    }

    #[test]
    fn light_leaves_by_holes_and_at_black_backs() {
        let (closed, ceiling) = room();
        assert!(keeps(1e5, &closed));
        let without = |metres: f64| {
            let mut open = closed.clone();
            open.faces[ceiling].vertices.iter_mut().for_each(|v| v.x = v.x.min(6.0 - metres));
            open
        };
        // Of what is sent 5e-5 leaves by a slit of 1 mm.
        assert!(keeps(1e3, &without(0.001)) && !keeps(1e6, &without(0.001)));
        assert!(!keeps(1e4, &without(0.1)));
        let mut black = closed.clone();
        black.faces[ceiling].vertices.reverse();
        assert!(!keeps(1e3, &black));
    }

    /// A ray from each of many surfaces is not the same ray.
    #[test]
    fn light_leaves_a_room_of_many_faces_without_a_ceiling() {
        let (mut open, ceiling) = room();
        open.faces.remove(ceiling);
        for _ in 0..6 {
            let quarters = |face: &Face| {
                let v = &face.vertices;
                let (middle, side) = (0.5 * (v[0] + v[2]), |i: usize| 0.5 * (v[i] + v[(i + 1) % 4]));
                let corners = move |i: usize| vec![v[i], side(i), middle, side((i + 3) % 4)];
                (0..4).map(|i| Face { vertices: corners(i), ..face.clone() }).collect::<Vec<_>>()
            };
            open.faces = open.faces.iter().flat_map(quarters).collect();
        }
        assert_eq!(open.faces.len(), 5 << 12);
        assert!(!keeps(FIRST_RAYS, &open));
    }

    /// What a lamp sends into a shade that is black inside is lost, though from there nothing else is seen.
    #[test]
    fn lamps_in_black_shades_lose_their_light() {
        let (mut scene, _) = room();
        let square = |z: f64, half: f64| -> Vec<DVec3> {
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            corners.map(|(x, y)| DVec3::new(3.0 + half * x, 2.0 + half * y, z)).to_vec()
        };
        let material = scene.materials.len() as u32;
        scene.materials.push(Material { reflectance: vec![0.0; 3], exitance_w_m2: vec![100.0; 3] });
        // The lamp looks up at the underside of a larger square that looks up too.
        for (z, half) in [(1.0, 0.1), (1.01, 1.0)] {
            scene.faces.push(Face { vertices: square(z, half), material, sides: crate::scene::Sides::One });
        }
        assert!(!keeps(1e4, &scene));
    }

    /// Where 1 W/m² falls everywhere and half of it is reflected, half a W/m² must be emitted; what is off by more than a tenth was never found.
    #[test]
    fn what_is_sent_and_not_received_is_lost() {
        let surfaces = surfaces(&room().0);
        let mut trees = trees::<3>(&surfaces, Basis::Haar, &Arena::new(Backend::Malloc));
        for tree in &mut trees {
            tree.patch.reflectance = [0.5; 3];
            tree.root.add_ambient([1.0; 3]);
        }
        let mut crew = Crew::new(None, Memory::default(), &surfaces).unwrap();
        let area_m2: f64 = surfaces.iter().map(|surface| surface.area_m2).sum();
        for (exitance, lost) in [(0.5, Some(0.0)), (0.55, Some(0.05 / 1.05)), (0.4, None)] {
            let emitted_w: Vec<[f64; 3]> = surfaces.iter().map(|s| [exitance * s.area_m2; 3]).collect();
            let found = lost_or_left(&emitted_w, &surfaces, &mut trees, &mut crew).unwrap();
            assert_eq!(found.is_some(), lost.is_some());
            for (found, lost) in found.iter().zip(lost) {
                assert!((found.share - lost).abs() < 1e-12);
                assert!((found.power_w[1] - (exitance - 0.5) * area_m2).abs() < 1e-9);
            }
        }
    }
}
