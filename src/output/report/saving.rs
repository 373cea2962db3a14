//! What a rule spared that skipped something: a count, and the time that it would have taken, by this run's own means.

use serde::{Deserialize, Serialize};

use super::Known;

/// What one rule spared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saving {
    /// How many.
    pub spared: u64,
    /// Of what: `pairs`, `rays`, `transfers`, `bands`, `surfaces`.
    pub unit: String,
    /// Seconds of this run, on as many workers, or why no fair estimate can be made.
    pub seconds_estimated: Known<f64>,
    /// Which way the estimate may be wrong.
    pub bound: Option<Bound>,
    /// How it was estimated.
    pub how: Option<String>,
    /// Relative L2 error of radiosity that is estimated to come of it, by itself: in squares a part of the result's.
    /// `None` for rules other than `coarse` and `clusters`, or where the run was cut short.
    pub error_estimate: Option<f64>,
}

/// Which way an estimate may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// Either.
    About,
    /// It may be less.
    AtMost,
}

impl std::fmt::Display for Bound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::About => "about",
            Self::AtMost => "at most",
        })
    }
}

impl Saving {
    /// With an estimate in seconds, and how it was made.
    pub fn of(spared: u64, unit: &str, (bound, seconds, how): (Bound, f64, &str)) -> Saving {
        Saving {
            spared,
            unit: unit.to_owned(),
            seconds_estimated: Known::Value(seconds),
            bound: Some(bound),
            how: Some(how.to_owned()),
            error_estimate: None,
        }
    }

    /// Without one, for this reason.
    pub fn uncertain(spared: u64, unit: &str, reason: &str) -> Saving {
        Saving {
            spared,
            unit: unit.to_owned(),
            seconds_estimated: Known::unavailable(reason),
            bound: None,
            how: None,
            error_estimate: None,
        }
    }

    /// The same, with the error that comes of it.
    pub fn erring(self, error_estimate: f64) -> Saving {
        Saving { error_estimate: Some(error_estimate), ..self }
    }
}
