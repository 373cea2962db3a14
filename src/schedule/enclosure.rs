//! How much light leaves a scene, and what its surfaces receive all together, therefore: what they send, less that. Rays are cast from where
//! surfaces send light by the solution so far; those that meet nothing, or a side that receives no light, take theirs away. In front of such black
//! backs it may be dark, as on the floor under a box, though a coarse solution does not know: there they take as much of theirs as of the
//! hemisphere shows sides that have any. Where little or none leaves, so that it is well known how much, the ambient correction makes up for what
//! transport has lost ([`crate::radiosity::add_ambient`]).

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use ccnuma::WorkerPanic;
use glam::DVec3;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};

use crate::math::Cell;
use crate::radiosity::Tree;
use crate::scene::{Frame, Surface};
use crate::visibility::{Occluder, OpaqueFaces};

use super::crew::Crew;

/// What is not known of the light that leaves may cost this share of the error asked for.
const UNKNOWN: f64 = 0.1;
/// Of `n` rays at most this many may leave.
const MOST_LEAVE: f64 = 6.0;
/// Where `k` of `n` rays leave, their share is known to `(3 + 2√k)/n` in nineteen of twenty cases: to this over `n`, up to [`MOST_LEAVE`].
const DOUBT: f64 = 8.0;
/// Rays that are cast however little it matters what leaves.
const LEAST_RAYS: f64 = 1000.0;
/// Rays that look around from in front of a black back.
const LOOKS: u32 = 32;
/// How far off their surface rays start, as a share of the greatest coordinate: beyond its rounding, and before its neighbours.
const OFF: f64 = 1e-11;
const SEED: u64 = 1998;
/// Rays that leave are counted in such parts of one, so that the sum does not depend on the order.
const PARTS: f64 = 1000.0;

/// What surfaces send and receive all together, in W per band.
#[derive(Clone, Copy)]
pub(super) struct Balance<const N: usize> {
    /// What they emit and reflect.
    pub sent_w: [f64; N],
    pub received_w: [f64; N],
    /// What they have not sent on yet.
    pub unshot_w: [f64; N],
}

impl<const N: usize> Balance<N> {
    /// Of surfaces that emit `emitted_w`.
    pub fn new(
        emitted_w: [f64; N],
        surfaces: &[Surface],
        trees: &mut [Tree<N>],
        crew: &mut Crew<'_>,
    ) -> Result<Self, WorkerPanic> {
        let received = |tree: &mut Tree<N>| {
            let received_w = tree.field().power_w(&surfaces[tree.patch.surface as usize]);
            (std::array::from_fn(|n| received_w[n]), tree.unshot_by_band_w())
        };
        let powers_w: Vec<([f64; N], [f64; N])> = crew.map(trees, |_| true, received)?;
        let mut balance = Self { sent_w: emitted_w, received_w: [0.0; N], unshot_w: [0.0; N] };
        for (tree, (received_w, unshot_w)) in trees.iter().zip(powers_w) {
            for n in 0..N {
                balance.sent_w[n] += tree.patch.reflectance[n] * received_w[n];
                balance.received_w[n] += received_w[n];
                balance.unshot_w[n] += unshot_w[n];
            }
        }
        Ok(balance)
    }

    /// What all of them should receive beyond what they do where so much leaves.
    pub fn missing_w(&self, leaves_w: &[f64; N]) -> [f64; N] {
        std::array::from_fn(|n| self.sent_w[n] - self.received_w[n] - leaves_w[n])
    }

    /// The share of what is sent that transport has lost, or made if it is negative, where so much leaves; `None` where nothing is sent.
    pub fn lost(&self, leaves_w: &[f64; N]) -> Option<f64> {
        let sent_w: f64 = self.sent_w.iter().sum();
        let lost_w = self.missing_w(leaves_w).iter().sum::<f64>() - self.unshot_w.iter().sum::<f64>();
        (sent_w > 0.0).then(|| lost_w / sent_w)
    }
}

/// How many rays tell what leaves well enough for an error of `error`, where `gain` is `ρ/(1 − ρ)` and a share `lost` is lost or leaves.
pub(super) fn rays(error: f64, gain: f64, lost: f64) -> f64 {
    let unknown = UNKNOWN * error;
    // Of what is too little to matter it need not be known where it is.
    if gain * lost.abs() <= unknown { LEAST_RAYS } else { (DOUBT * gain / unknown).max(LEAST_RAYS) }
}

/// What leaves, in W per band, by about so many rays; `None` where it is more than can be told well.
pub(super) fn leaves_w<const N: usize>(
    rays: f64,
    surfaces: &[Surface],
    occluder: &dyn Occluder,
    trees: &mut [Tree<N>],
    crew: &mut Crew<'_>,
) -> Result<Option<[f64; N]>, WorkerPanic> {
    let sent_w = crew.map(trees, |_| true, sent_w)?;
    let (firsts, sides) = sides(surfaces, occluder.faces());
    let corners = || trees.iter().flat_map(|tree| &tree.patch.corners);
    let leak = Leak {
        firsts,
        sides,
        occluder,
        off_m: OFF * corners().map(|corner| corner.abs().max_element()).fold(0.0, f64::max),
        per_ray_w: sent_w.iter().sum::<f64>() / rays,
        parts: AtomicU64::new(0),
    };
    let of_surface = |tree: &mut Tree<N>| {
        let index = tree.patch.surface as usize;
        leak.leaves_w(tree, &surfaces[index], sent_w[index])
    };
    let parts_w = crew.map(trees, |_| true, of_surface)?;
    let sum_w = std::array::from_fn(|n| parts_w.iter().map(|leaves_w| leaves_w[n]).sum());
    Ok((!leak.is_too_large()).then_some(sum_w))
}

/// What a surface sends, all bands, in W.
fn sent_w<const N: usize>(tree: &mut Tree<N>) -> f64 {
    let irradiance = tree.root.mean_irradiance();
    sent_from_w(tree, tree.area_m2, &irradiance.map(|e| e * tree.area_m2)).iter().sum()
}

/// What a part of a surface sends on which so much falls, in W per band.
fn sent_from_w<const N: usize>(tree: &Tree<N>, area_m2: f64, power_w: &[f64]) -> [f64; N] {
    std::array::from_fn(|n| {
        (area_m2 * tree.exitance_w_m2[n] + tree.patch.reflectance[n] * power_w[n]).max(0.0)
    })
}

/// Where light leaves a scene, and how many rays did.
struct Leak<'a> {
    /// By face: where its sides stand.
    firsts: Vec<u32>,
    sides: Vec<Sides>,
    occluder: &'a dyn Occluder,
    /// How far off their surface rays start.
    off_m: f64,
    /// What a ray stands for on average.
    per_ray_w: f64,
    /// How many rays left, by the square of what they took, in parts of one.
    parts: AtomicU64,
}

/// Which sides of a face receive light.
#[derive(Clone, Copy, Default)]
struct Sides {
    /// Of the front.
    normal: DVec3,
    front: bool,
    back: bool,
}

/// By face where its sides stand, and the sides. Faces of the same corners, such as two back to back, are the first of them.
fn sides(surfaces: &[Surface], faces: &OpaqueFaces) -> (Vec<u32>, Vec<Sides>) {
    let mut first = HashMap::new();
    let all = 0..faces.len() as u32;
    let firsts: Vec<u32> =
        all.map(|face| *first.entry(corners(faces.vertices(face))).or_insert(face)).collect();
    let mut sides = vec![Sides::default(); faces.len()];
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

impl Leak<'_> {
    fn is_too_large(&self) -> bool {
        self.parts.load(Relaxed) as f64 > MOST_LEAVE * PARTS
    }

    /// What leaves of what a surface sends, which is `sent_w` in all, in W per band.
    fn leaves_w<const N: usize>(&self, tree: &Tree<N>, surface: &Surface, sent_w: f64) -> [f64; N] {
        let mut leaves_w = [0.0; N];
        // A whole number that rounding adds to is still that number.
        let rays = (sent_w / self.per_ray_w - 1e-6).ceil();
        if rays.is_nan() || rays <= 0.0 || self.is_too_large() {
            return leaves_w;
        }
        let mut cast = Cast::new(tree, surface);
        for _ in 0..rays as u64 {
            let (origin, power_w) = cast.origin();
            let share = match self.meets(surface.face, origin, cast.direction()) {
                Met::Side => continue,
                Met::Nothing => 1.0,
                Met::BlackBack => {
                    let sees_side = |_: &u32| self.meets(surface.face, origin, cast.direction()) == Met::Side;
                    (0..LOOKS).filter(sees_side).count() as f64 / f64::from(LOOKS)
                }
            };
            let power_w = power_w.map(|power_w| share * power_w / rays);
            let taken = power_w.iter().sum::<f64>() / self.per_ray_w;
            self.parts.fetch_add((PARTS * taken * taken) as u64, Relaxed);
            (0..N).for_each(|n| leaves_w[n] += power_w[n]);
            if self.is_too_large() {
                break;
            }
        }
        leaves_w
    }

    fn meets(&self, face: u32, origin: DVec3, direction: DVec3) -> Met {
        let hit = self.occluder.first_hit(origin + self.off_m * direction, direction);
        let Some((met, _)) = hit else { return Met::Nothing };
        let [met, face] = [met, face].map(|face| self.firsts[face as usize]);
        let Sides { normal, front, back } = self.sides[met as usize];
        // No face meets itself: that is rounding.
        let receives = met == face || if normal.dot(direction) < 0.0 { front } else { back };
        if receives { Met::Side } else { Met::BlackBack }
    }
}

/// Rays from all over a surface: more of them where it sends more, and the steeper.
struct Cast<'a, const N: usize> {
    surface: &'a Surface,
    /// The cells of its leaves, what all up to each send, and how that is divided among the bands.
    cells: Vec<(Cell, f64, [f64; N])>,
    random: Pcg32,
}

impl<'a, const N: usize> Cast<'a, N> {
    /// The same ones seen from the surface, wherever that lies and whichever it is.
    fn new(tree: &Tree<N>, surface: &'a Surface) -> Self {
        let (mut cells, mut sum_w) = (Vec::new(), 0.0);
        tree.field().for_each_power(surface, &mut |cell, area_m2, power_w| {
            let sent_w = sent_from_w(tree, area_m2, power_w);
            let all_w: f64 = sent_w.iter().sum();
            if all_w > 0.0 {
                sum_w += all_w;
                cells.push((*cell, sum_w, sent_w.map(|sent_w| sent_w / all_w)));
            }
        });
        Self { surface, cells, random: Pcg32::seed_from_u64(SEED) }
    }

    fn uniform(&mut self) -> f64 {
        f64::from(self.random.next_u32()) / 2f64.powi(32)
    }

    /// Where the next ray starts, and what the surface sends in W per band if it is all like there.
    fn origin(&mut self) -> (DVec3, [f64; N]) {
        let Some(&(_, sum_w, _)) = self.cells.last() else { return (self.surface.frame.origin, [0.0; N]) };
        let at_w = sum_w * self.uniform();
        let index = self.cells.partition_point(|(_, up_to_w, _)| *up_to_w <= at_w).min(self.cells.len() - 1);
        let (surface, (cell, _, bands)) = (self.surface, self.cells[index]);
        let uv = surface.point_in(&cell, || self.uniform());
        (surface.frame.point(uv), bands.map(|share| share * sum_w))
    }

    /// The direction of a ray, by Malley: a point of a disc, lifted onto the hemisphere.
    fn direction(&mut self) -> DVec3 {
        let (square, turn) = (self.uniform(), TAU * self.uniform());
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
    use crate::scene::{Scene, surfaces};
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

    /// The share of what is sent that leaves where 1 W/m² falls everywhere, by 100,000 rays.
    fn leaves(scene: &Scene) -> Option<f64> {
        let surfaces = surfaces(scene);
        let mut trees = trees::<3>(&surfaces, Basis::Haar, &Arena::new(Backend::Malloc));
        trees.iter_mut().for_each(|tree| tree.root.add_ambient([1.0; 3]));
        let bvh = Bvh::new(OpaqueFaces::new(scene));
        let mut crew = Crew::new(None, Memory::default(), &surfaces).unwrap();
        let balance = Balance::new([0.0; 3], &surfaces, &mut trees, &mut crew).unwrap();
        let area_m2: f64 = surfaces.iter().map(|surface| surface.area_m2).sum();
        assert!((balance.received_w[1] / area_m2 - 1.0).abs() < 1e-12);
        let leaves_w = leaves_w(1e5, &surfaces, &bvh, &mut trees, &mut crew).unwrap()?;
        Some(leaves_w.iter().sum::<f64>() / balance.sent_w.iter().sum::<f64>())
    }

    #[test]
    fn light_leaves_by_holes_and_at_black_backs() {
        let (closed, ceiling) = room();
        assert_eq!(leaves(&closed), Some(0.0));
        let without = |metres: f64| {
            let mut open = closed.clone();
            open.faces[ceiling].vertices.iter_mut().for_each(|v| v.x = v.x.min(6.0 - metres));
            leaves(&open)
        };
        // A slit of 1 mm and 4.5 m² in rooms of 113 m².
        let slit = without(0.001).expect("little leaves");
        assert!((1e-6..1e-4).contains(&slit), "{slit}");
        assert_eq!(without(0.1), None, "much leaves");
        let mut black = closed.clone();
        black.faces[ceiling].vertices.reverse();
        assert_eq!(leaves(&black), None, "a black ceiling");
    }

    #[test]
    fn the_more_it_matters_the_more_rays_are_cast() {
        assert_eq!(rays(0.1, 0.0, 1.0), LEAST_RAYS);
        assert_eq!(rays(0.01, 99.0, 1e-5), LEAST_RAYS);
        assert!((rays(0.01, 99.0, -2e-5) / 792_000.0 - 1.0).abs() < 1e-12);
    }
}
