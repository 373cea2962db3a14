//! A scene made ready for studies: its surfaces, in one band where all are alike, and what may stand between them.

use std::path::Path;

use crate::cli::load::Loaded;
use crate::cli::plan::Visibility;
use crate::cli::{Error, grey};
use crate::output::report::SceneFacts;
use crate::scene::{Scene, Surface};
use crate::visibility::{Occluder, Unoccluded, nothing_between};

/// A scene that can be solved.
pub(super) struct Ready {
    loaded: Loaded,
    grey: Option<(Scene, Vec<Surface>)>,
}

impl Ready {
    /// Reads a scene; a user who is not to be left in peace is warned of what is strange about it.
    ///
    /// # Errors
    /// As [`Loaded::read`].
    pub fn read(path: &Path, quiet: bool) -> Result<Ready, Error> {
        let loaded = Loaded::read(path, Visibility::Auto)?;
        if !quiet {
            loaded.warnings().iter().for_each(|warning| eprintln!("wrad: warning: {warning}"));
        }
        let grey = grey::one_band(&loaded.scene, &loaded.surfaces);
        Ok(Ready { loaded, grey })
    }

    /// The scene and its surfaces in the bands that are computed.
    pub fn in_its_bands(&self) -> (&Scene, &[Surface]) {
        match &self.grey {
            Some((scene, surfaces)) => (scene, surfaces),
            None => (&self.loaded.scene, &self.loaded.surfaces),
        }
    }

    /// What may stand between surfaces.
    pub fn occluder(&self) -> Box<dyn Occluder + '_> {
        match nothing_between(&self.loaded.scene) {
            true => Box::new(Unoccluded(&*self.loaded.occluder)),
            false => Box::new(&*self.loaded.occluder),
        }
    }

    /// What a result says of the scene.
    pub fn facts(&self) -> SceneFacts {
        SceneFacts::new(&self.loaded.scene, &self.loaded.surfaces)
    }
}
