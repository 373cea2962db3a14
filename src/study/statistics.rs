//! Repeated measurements: their median, and how far they spread; and what lies between measurements.

use serde::Serialize;

/// What several measurements of one thing say.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The middle one; of an even number, the mean of the two in the middle.
    pub median: f64,
    /// The least.
    pub least: f64,
    /// The greatest.
    pub greatest: f64,
    /// How many there are.
    pub count: usize,
}

impl Spread {
    /// Of measurements in any order; `None` of none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len();
        let (least, greatest) = (*sorted.first()?, *sorted.last()?);
        let median = 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
        Some(Self { median, least, greatest, count })
    }

    /// Half the range, relative to the median.
    pub fn relative(&self) -> f64 {
        0.5 * (self.greatest - self.least) / self.median
    }
}

/// The value at `x` on the first stretch of a curve that holds it, straight in logarithms; `None` where no stretch does.
pub fn interpolate(curve: impl Iterator<Item = (f64, f64)>, x: f64) -> Option<f64> {
    let curve: Vec<(f64, f64)> = curve.collect();
    curve.windows(2).find_map(|ends| {
        let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
        let share = (x / x0).ln() / (x1 / x0).ln();
        (0.0..=1.0).contains(&share).then(|| y0 * (y1 / y0).powf(share))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_stands_in_the_middle() {
        let of = |values: &[f64]| Spread::of(values).unwrap();
        let spread = Spread { median: 2.0, least: 1.0, greatest: 4.0, count: 3 };
        assert_eq!(of(&[4.0, 1.0, 2.0]), spread);
        assert_eq!(of(&[4.0, 1.0, 2.0, 3.0]).median, 2.5);
        assert_eq!(of(&[5.0]).relative(), 0.0);
        assert_eq!(spread.relative(), 0.75);
        assert_eq!(Spread::of(&[]), None);
    }

    #[test]
    fn between_measurements_curves_are_straight_in_logarithms() {
        let curve = [(0.1, 1.0), (0.01, 10.0), (0.001, 1000.0)];
        let at = |x| interpolate(curve.into_iter(), x);
        assert!((at(0.1).unwrap() - 1.0).abs() < 1e-12);
        assert!((at(0.1 / 10f64.sqrt()).unwrap() - 10f64.sqrt()).abs() < 1e-9);
        assert!((at(0.001 * 10f64.sqrt()).unwrap() - 100.0).abs() < 1e-9);
        assert_eq!((at(0.2), at(0.0005)), (None, None));
    }
}
