//! The order of the parts in the file: along a space-filling curve, or at random.

use glam::DVec3;

use super::dice::Dice;
use super::sketch::Part;

/// Cells per axis of the curve, as a power of two.
const LEVELS: u32 = 16;

/// Sorts parts along a Z-order curve (Morton 1966) through the middles of their boxes.
pub(super) fn along_a_curve(parts: &mut [Part]) {
    let (low, high) = bounds(parts.iter());
    // One scale for all axes: cells are cubes.
    let scale = f64::from(1 << LEVELS) / (1.001 * (high - low).max_element()).max(f64::MIN_POSITIVE);
    parts.sort_by_cached_key(|part| {
        let (a, b) = bounds(std::iter::once(part));
        let cell = (0.5 * (a + b) - low) * scale;
        spread(cell.x as u64) | spread(cell.y as u64) << 1 | spread(cell.z as u64) << 2
    });
}

/// Tears parts into faces and puts these in random order.
pub(super) fn shuffle(parts: &mut Vec<Part>, dice: &mut Dice) {
    let single = |part: Part| {
        let Part { name, paint, faces } = part;
        faces.into_iter().enumerate().map(move |(i, face)| Part {
            name: format!("{name}_face{i}"),
            paint,
            faces: vec![face],
        })
    };
    *parts = std::mem::take(parts).into_iter().flat_map(single).collect();
    dice.shuffle(parts);
}

fn bounds<'a>(parts: impl Iterator<Item = &'a Part>) -> (DVec3, DVec3) {
    let vertices = parts.flat_map(|part| part.faces.iter().flatten());
    vertices.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
}

/// The bits of a number with two zeros between each.
fn spread(number: u64) -> u64 {
    (0..=LEVELS).map(|bit| (number >> bit & 1) << (3 * bit)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread() {
        assert_eq!(spread(0b1011), 0b001_000_001_001);
    }
}
