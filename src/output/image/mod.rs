//! Pictures of a solution: one ray per sample finds a surface, the solution is read there; no further light
//! is computed.
//!
//! What a pixel shows is the radiance `B/π` in W/(m² sr), or in false colours the irradiance in W/m². Backs
//! that take no part in the exchange, and rays that meet nothing, are black.

mod borders;
mod encode;
mod legend;
mod render;
mod shade;
mod view;
mod viewpoint;

pub use encode::{write_exr, write_png};
pub use shade::Caster;
pub use view::View;

use super::Error;
use crate::scene::Scene;

/// The most pixels a picture may have: 2²⁸, a gigabyte or so on the way.
const MAX_PIXELS: u64 = 1 << 28;

/// What picture to make.
#[derive(Clone, Debug)]
pub struct ImageOptions {
    /// The camera's name; without one the scene's first camera, or an automatic view if it has none.
    pub camera: Option<String>,
    /// Width and height in pixels; without them 768 high in the camera's proportions.
    pub size: Option<(u32, u32)>,
    /// Samples per pixel and dimension.
    pub samples: u32,
    /// The factor from radiance to display values (0.18 is middle grey); automatic without one.
    pub exposure: Option<f64>,
    /// Whether to draw the borders of the elements.
    pub mesh: bool,
    /// Whether to show irradiance in false colours, with a legend.
    pub falsecolor: bool,
    /// How many threads cast rays.
    pub threads: usize,
}

impl Default for ImageOptions {
    fn default() -> ImageOptions {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        let (mesh, falsecolor) = (false, false);
        ImageOptions { camera: None, size: None, samples: 3, exposure: None, mesh, falsecolor, threads }
    }
}

impl ImageOptions {
    /// Whether a picture of `scene` can be made with these options: ask before a long solve.
    ///
    /// # Errors
    /// [`Error::Request`]: an unknown camera (the known ones are listed), no pixels or too many, an
    /// exposure that is not positive.
    pub fn check(&self, scene: &Scene) -> Result<(), Error> {
        let refuse = |text: String| Err(Error::Request(text));
        if let Some(name) = &self.camera
            && scene.cameras.iter().all(|c| c.name != *name)
        {
            let known: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
            return refuse(if known.is_empty() {
                format!(
                    "the scene has no camera named '{name}': it has none at all; \
                     leave out --camera for an automatic view"
                )
            } else {
                format!("the scene has no camera named '{name}'; it has {}", known.join(", "))
            });
        }
        let (width, height) = self.size.unwrap_or((1, 1));
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
            return refuse(format!(
                "a picture of {width} x {height} pixels cannot be made; 1 to {MAX_PIXELS} pixels can"
            ));
        }
        match self.exposure {
            Some(e) if !(e.is_finite() && e > 0.0) => {
                refuse(format!("the exposure is {e}; it must be positive"))
            }
            _ => Ok(()),
        }
    }
}
