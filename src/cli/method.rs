//! The solver by its name: shooting or gathering, and which links it keeps.

use crate::schedule::Batches;

use super::Error;
use super::choice::choose;
use super::workers::Workers;

impl Workers {
    /// The same by the solver `method`.
    ///
    /// # Errors
    /// [`Error::Input`]: an unknown name, or a schedule that gathering does not go with.
    pub fn with_method(self, method: &str) -> Result<Self, Error> {
        let gathers = choose("--method", method, &[("shoot", false), ("gather", true)], &[])?;
        if !gathers {
            return Ok(self);
        }
        if self.batches != Batches::Fitted {
            return Err(Error::Input(format!(
                "--method gather: --schedule {} is about surfaces that shoot one after the other; \
                 use stealing or sequential",
                self.schedule
            )));
        }
        Ok(Self { batches: Batches::All, ..self })
    }
}
