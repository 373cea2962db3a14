//! Home nodes of receivers: a spatial partition. Surfaces in the order of a space-filling curve are cut into one piece per node, each with the
//! node's share of the work, so that neighbours, which look at the same blockers and emitters, share a node.

use glam::DVec3;

use crate::radiosity::Tree;

/// The home of every tree, by position in the machine's table. `work` is expected per tree, `workers` counts each node's.
pub fn homes<const N: usize>(trees: &[Tree<N>], work: &[u64], workers: &[usize]) -> Vec<usize> {
    homes_along(&along_the_curve(trees), work, workers)
}

/// As [`homes`], of receivers whose order along the curve is known.
pub fn homes_along(order: &[usize], work: &[u64], workers: &[usize]) -> Vec<usize> {
    let total: u128 = work.iter().map(|work| u128::from(*work)).sum();
    let all_workers: usize = workers.iter().sum();
    let mut homes = vec![0; order.len()];
    let (mut node, mut staff, mut before) = (0, workers[0], 0);
    for &tree in order {
        // A tree goes where its middle lies.
        let middle = before + u128::from(work[tree]) / 2;
        while node + 1 < workers.len() && middle * all_workers as u128 >= total * staff as u128 {
            node += 1;
            staff += workers[node];
        }
        homes[tree] = node;
        before += u128::from(work[tree]);
    }
    homes
}

/// Trees by the Morton code of their surface's middle.
pub(super) fn along_the_curve<const N: usize>(trees: &[Tree<N>]) -> Vec<usize> {
    let middle = |tree: &Tree<N>| {
        let corners = &tree.patch.corners;
        corners.iter().sum::<DVec3>() / corners.len() as f64
    };
    let middles: Vec<DVec3> = trees.iter().map(middle).collect();
    let low = middles.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = middles.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let side = (high - low).max_element().max(f64::MIN_POSITIVE);
    let mut order: Vec<usize> = (0..trees.len()).collect();
    order.sort_by_cached_key(|tree| (morton((middles[*tree] - low) / side), *tree));
    order
}

/// The Morton code of a point of the unit cube, 21 bits per axis.
fn morton(point: DVec3) -> u64 {
    let cells = (1 << 21) as f64;
    let axis = |x: f64| (x * cells).clamp(0.0, cells - 1.0) as u64;
    let (x, y, z) = (axis(point.x), axis(point.y), axis(point.z));
    (0..21).fold(0, |code, bit| {
        let digit = |a: u64| (a >> bit) & 1;
        code | (digit(x) << (3 * bit + 2)) | (digit(y) << (3 * bit + 1)) | (digit(z) << (3 * bit))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Basis;
    use crate::radiosity::trees;
    use crate::scene::{read::read_file, surfaces};

    #[test]
    fn nodes_get_their_share_of_the_work_and_neighbours_stay_together() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/furnished-room.iv");
        let trees = trees::<3>(&surfaces(&read_file(&path).unwrap()), Basis::Haar);
        let work: Vec<u64> = (0..trees.len() as u64).map(|i| 100 + (i * 37) % 50).collect();
        let homes = homes(&trees, &work, &[2, 0, 1, 1]);
        let share = |node| -> u64 { (0..work.len()).filter(|i| homes[*i] == node).map(|i| work[i]).sum() };
        let total: u64 = work.iter().sum();
        for (node, expected) in [(0, 0.5), (1, 0.0), (2, 0.25), (3, 0.25)] {
            let found = share(node) as f64 / total as f64;
            assert!((found - expected).abs() < 0.05, "node {node} has {found} of the work, not {expected}");
        }
        let order = along_the_curve(&trees);
        assert!(
            order.windows(2).all(|pair| homes[pair[0]] <= homes[pair[1]]),
            "nodes hold stretches of the curve"
        );
    }

    #[test]
    fn the_curve_visits_octant_by_octant() {
        let code = |x: f64, y: f64, z: f64| morton(DVec3::new(x, y, z));
        let octants = [
            code(0.1, 0.1, 0.1),
            code(0.4, 0.4, 0.4),
            code(0.1, 0.1, 0.9),
            code(0.1, 0.9, 0.1),
            code(0.9, 0.1, 0.1),
        ];
        assert!(octants.is_sorted(), "{octants:?}");
        assert_eq!(code(1.0, 1.0, 1.0), (1 << 63) - 1);
    }
}
