//! Repeated measurements: their median, and how far they spread.

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
}
