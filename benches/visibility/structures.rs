//! The structures that are compared, each as a function that counts the blocked segments of bundles.

use std::rc::Rc;

use glam::DVec3;
use wavelet_radiosity::scene::Scene;
use wavelet_radiosity::transport::candidates::LIST_LIMIT;
use wavelet_radiosity::visibility::{Brute, Bsp, Bvh, Occluder, OpaqueFaces, Shaft};

use crate::peers::Obvhs;
use crate::workload::Bundle;

type CountBlocked = Box<dyn Fn(&[Bundle]) -> usize>;

/// A way to answer.
pub struct Structure {
    pub name: &'static str,
    pub bytes: usize,
    pub count_blocked: CountBlocked,
}

type Shared = Rc<dyn Occluder>;

/// All of them, or the one of this name: `brute` only when named, for it takes long.
pub fn structures(scene: &Scene, only: Option<&str>) -> Vec<Structure> {
    let faces = || OpaqueFaces::new(scene);
    let bvh = std::cell::LazyCell::new(|| -> Shared { Rc::new(Bvh::new(faces())) });
    let bsp = std::cell::LazyCell::new(|| -> Shared { Rc::new(Bsp::new(faces())) });
    let structure = |name, occluder: &Shared, count: fn(&dyn Occluder, &[Bundle]) -> usize| {
        let (bytes, occluder) = (occluder.bytes(), Rc::clone(occluder));
        Structure { name, bytes, count_blocked: Box::new(move |bundles| count(&*occluder, bundles)) }
    };
    let all: [(&str, &dyn Fn(&'static str) -> Structure); 7] = [
        ("bvh", &|name| structure(name, &bvh, one_by_one)),
        ("bvh-bundles", &|name| structure(name, &bvh, by_bundles)),
        ("bvh+lists", &|name| structure(name, &bvh, by_lists)),
        ("bsp", &|name| structure(name, &bsp, one_by_one)),
        ("bsp+lists", &|name| structure(name, &bsp, by_lists)),
        ("obvhs", &|name| {
            let obvhs = Obvhs::new(&faces());
            Structure {
                name,
                bytes: obvhs.bytes(),
                count_blocked: Box::new(move |bundles| obvhs.count_blocked(bundles)),
            }
        }),
        ("brute", &|name| structure(name, &(Rc::new(Brute(faces())) as Shared), one_by_one)),
    ];
    let wanted = |name: &str| only.map_or(name != "brute", |only| only == name);
    all.into_iter().filter(|(name, _)| wanted(name)).map(|(name, make)| make(name)).collect()
}

fn one_by_one(occluder: &dyn Occluder, bundles: &[Bundle]) -> usize {
    let count = |bundle: &Bundle| -> usize {
        let blocked = |from, to| occluder.blocker(from, to, bundle.skip).is_some() as usize;
        bundle.from.iter().map(|from| bundle.to.iter().map(|to| blocked(*from, *to)).sum::<usize>()).sum()
    };
    bundles.iter().map(count).sum()
}

/// All segments with the same origin at once, the last blocker first.
fn by_bundles(occluder: &dyn Occluder, bundles: &[Bundle]) -> usize {
    let mut last = u32::MAX;
    let mut count = |from: DVec3, bundle: &Bundle| {
        occluder.blocked(from, &bundle.to, bundle.skip, &mut last).count_ones() as usize
    };
    bundles.iter().map(|bundle| bundle.from.iter().map(|from| count(*from, bundle)).sum::<usize>()).sum()
}

/// As the solver does it: where the shaft holds few faces, these only, the last blocker first.
fn by_lists(occluder: &dyn Occluder, bundles: &[Bundle]) -> usize {
    let (mut count, mut list) = (0, Vec::new());
    for bundle in bundles {
        list.clear();
        let [a, b] = &bundle.hulls;
        let shaft = Shaft::between(a, Some(bundle.normals[0]), b, Some(bundle.normals[1]));
        let listed = occluder.candidates(&shaft, bundle.skip, LIST_LIMIT, &mut list);
        if !listed {
            count += by_bundles(occluder, std::slice::from_ref(bundle));
            continue;
        }
        for from in &bundle.from {
            for to in &bundle.to {
                if let Some(found) = list.iter().position(|f| occluder.faces().blocks(*f, *from, *to - *from))
                {
                    list.swap(0, found);
                    count += 1;
                }
            }
        }
    }
    count
}
