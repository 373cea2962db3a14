//! What was asked for, could not be had, and was replaced by something weaker: said once each, shown in reports.
//!
//! A library does not print; a command prints what it finds here when it is done.

use std::sync::{Mutex, PoisonError};

static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Notes a weaker replacement, once per text.
pub(crate) fn note(text: String) {
    // A panic while this lock is held leaves the list whole: it is only pushed to.
    let mut warnings = WARNINGS.lock().unwrap_or_else(PoisonError::into_inner);
    if !warnings.contains(&text) {
        warnings.push(text);
    }
}

/// All that was noted so far, in order.
pub fn all() -> Vec<String> {
    WARNINGS.lock().unwrap_or_else(PoisonError::into_inner).clone()
}
