//! A scene made ready for studies: its surfaces, in one band where the others follow from it, and what may stand between them.

use std::path::Path;

use crate::cli::Error;
use crate::cli::bands::Collapsed;
use crate::cli::load::Loaded;
use crate::cli::plan::Visibility;
use crate::output::report::SceneFacts;
use crate::scene::{Scene, Surface};
use crate::visibility::{Occluder, Unoccluded, nothing_between};

/// A scene that can be solved.
pub(super) struct Ready {
    loaded: Loaded,
    collapsed: Option<(Scene, Vec<Surface>)>,
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
        let collapsed = Collapsed::new(&loaded.scene, &loaded.surfaces);
        // One shines as it does in the file, as references beside the scene demand; of several, some do not.
        let collapsed = collapsed
            .filter(|bands| bands.count() == 1)
            .map(|bands| bands.apply(&loaded.scene, &loaded.surfaces));
        Ok(Ready { loaded, collapsed })
    }

    /// The scene and its surfaces in the bands that are computed.
    pub fn in_its_bands(&self) -> (&Scene, &[Surface]) {
        match &self.collapsed {
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
