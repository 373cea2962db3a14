//! What stands along the outline of a face, by stretches.

use glam::DVec2;

use crate::math::polygon;

/// A foot may show faces that are lit from the inside along this share of its outline: those of a corner it
/// stands in. With more it is rather the outer shell of a room.
const LIT_INSIDE: f64 = 0.6;

/// The outline of a face and what stands along it.
pub struct Rim<'a> {
    outline: &'a [DVec2],
    /// Without bridge edges.
    edges: Vec<(DVec2, DVec2)>,
    tolerance: f64,
    /// Where walls stand that show a black back to the inside.
    dark: Vec<Stretch>,
    /// Where walls stand that are lit from the inside.
    lit: Vec<Stretch>,
}

/// A part of an edge: its number, and from where to where along it.
type Stretch = (usize, f64, f64);

impl<'a> Rim<'a> {
    /// The rim of a polygon in metres, counter-clockwise, on which nothing stands yet.
    pub fn new(outline: &'a [DVec2], tolerance: f64) -> Rim<'a> {
        let all: Vec<(DVec2, DVec2)> = polygon::edges(outline).collect();
        let edges = all.iter().filter(|(a, b)| !all.contains(&(*b, *a))).copied().collect();
        Rim { outline, edges, tolerance, dark: Vec::new(), lit: Vec::new() }
    }

    /// Whether walls stand along the whole rim that show their black backs to the inside, and not too many
    /// that do not. Of a face as small as the tolerance that cannot be told.
    pub fn is_dark_inside(&mut self) -> bool {
        let length: f64 = self.edges.iter().map(|(a, b)| a.distance(*b)).sum();
        let slack = 4.0 * self.tolerance * self.edges.len() as f64;
        let dark = union_m(&mut self.dark);
        dark >= 0.5 * length && dark >= length - slack && union_m(&mut self.lit) <= LIT_INSIDE * length
    }

    /// Takes a wall from `a` to `b` in, `normal` being that of its only lit side; `None` if a part of it
    /// stands inside the outline, away from the rim.
    pub fn add(&mut self, (a, b): (DVec2, DVec2), normal: Option<DVec2>) -> Option<()> {
        let length = a.distance(b);
        let mut stops = vec![0.0, length];
        for (i, (p, q)) in self.edges.iter().enumerate() {
            let (edge, extent) = ((*q - *p).normalize_or_zero(), p.distance(*q));
            let (off_a, off_b) = (edge.perp_dot(a - *p), edge.perp_dot(b - *p));
            if off_a.abs().max(off_b.abs()) <= self.tolerance {
                let (s, t) = (edge.dot(a - *p), edge.dot(b - *p));
                let (from, to) = (s.min(t).max(0.0), s.max(t).min(extent));
                if to - from > self.tolerance {
                    let dark = normal.is_some_and(|normal| normal.dot(-edge.perp()) > 0.0);
                    if dark { &mut self.dark } else { &mut self.lit }.push((i, from, to));
                }
                stops.extend([from, to].map(|at| (*p + at * edge - a).dot((b - a) / length)));
            } else if off_a * off_b < 0.0 {
                stops.push(length * off_a / (off_a - off_b));
            }
        }
        stops.retain(|at| (0.0..=length).contains(at));
        stops.sort_by(f64::total_cmp);
        let stands_free = |pair: &[f64]| {
            let middle = a + (b - a) * (0.5 * (pair[0] + pair[1]) / length);
            let near = polygon::nearest_on_boundary(self.outline, middle, |d| d.length_squared());
            pair[1] - pair[0] > self.tolerance
                && near.distance(middle) > self.tolerance
                && polygon::contains(self.outline, middle)
        };
        (!stops.windows(2).any(stands_free)).then_some(())
    }
}

/// The length of the union of stretches.
fn union_m(stretches: &mut [Stretch]) -> f64 {
    stretches.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (mut total, mut done) = (0.0, (usize::MAX, 0.0));
    for (edge, from, to) in stretches.iter() {
        let reached = if done.0 == *edge { done.1 } else { f64::NEG_INFINITY };
        total += (to - from.max(reached)).max(0.0);
        done = (*edge, to.max(reached));
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];

    fn with_walls(lit: usize) -> Rim<'static> {
        let mut rim = Rim::new(&SQUARE, 1e-6);
        for (i, (a, b)) in polygon::edges(&SQUARE).enumerate() {
            let middle = a.lerp(b, 0.4);
            rim.add((a, middle), Some(-(b - a).perp())).unwrap();
            rim.add((b, middle), Some(-(b - a).perp())).unwrap();
            if i < lit {
                rim.add((a, b), Some((b - a).perp())).unwrap();
            }
        }
        rim
    }

    #[test]
    fn a_foot_may_stand_in_a_corner_but_not_fill_a_room() {
        assert!(with_walls(0).is_dark_inside() && with_walls(2).is_dark_inside());
        assert!(!with_walls(3).is_dark_inside());
        assert!(!Rim::new(&SQUARE, 1e-6).is_dark_inside());
        assert!(!Rim::new(&SQUARE, 0.5).is_dark_inside(), "nothing stands on it, however small it is");
    }

    #[test]
    fn what_stands_inside_shows() {
        let mut rim = with_walls(0);
        assert!(rim.add((DVec2::new(1.0, 0.5), DVec2::new(3.0, 0.5)), None).is_some());
        assert!(rim.add((DVec2::new(0.9, 0.5), DVec2::new(3.0, 0.5)), None).is_none());
    }
}
