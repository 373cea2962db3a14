//! The structures that are compared, each as a function that counts the blocked segments of bundles.

use std::rc::Rc;

use glam::DVec3;
use wavelet_radiosity::scene::Scene;
use wavelet_radiosity::transport::candidates::LIST_LIMIT;
use wavelet_radiosity::visibility::{Brute, Bvh, Occluder, OpaqueFaces, Shaft};

use crate::workload::Bundle;

type CountBlocked = Box<dyn Fn(&[Bundle]) -> usize>;

/// A way to answer.
pub struct Structure {
    pub name: &'static str,
    pub bytes: usize,
    pub count_blocked: CountBlocked,
}

/// All of them, or the one of this name: `brute` only when named, for it takes long.
pub fn structures(scene: &Scene, only: Option<&str>) -> Vec<Structure> {
    let wanted = |name: &str| only.is_none_or(|only| only == name);
    let bvh = Rc::new(Bvh::new(OpaqueFaces::new(scene)));
    let mut found = Vec::new();
    let mut add = |name: &'static str, occluder: &Rc<Bvh>, count: fn(&dyn Occluder, &[Bundle]) -> usize| {
        if wanted(name) {
            let (bytes, occluder) = (occluder.bytes(), Rc::clone(occluder));
            found.push(Structure { name, bytes, count_blocked: Box::new(move |b| count(&*occluder, b)) });
        }
    };
    if only == Some("brute") {
        let brute = Brute(OpaqueFaces::new(scene));
        let bytes = brute.bytes();
        return vec![Structure {
            name: "brute",
            bytes,
            count_blocked: Box::new(move |b| one_by_one(&brute, b)),
        }];
    }
    add("bvh", &bvh, one_by_one);
    add("bvh bundles", &bvh, by_bundles);
    add("bvh+lists", &bvh, by_lists);
    found
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
