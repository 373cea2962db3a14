//! A view: which ray belongs to which point of the picture.

use glam::{DVec2, DVec3};

use crate::scene::{Camera, Projection};

/// A camera made ready for a picture of some size.
#[derive(Clone, Copy, Debug)]
pub struct View {
    eye: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Half the width and height of the picture: at distance 1 (perspective) or everywhere (parallel).
    half: DVec2,
    parallel: bool,
    pixels: DVec2,
}

impl View {
    /// The view of `camera` in `width` × `height` pixels. Its angle is the vertical one, or in upright
    /// pictures the horizontal one, so that turning a picture upright does not crop it (as Inventor's
    /// viewers do).
    pub fn new(camera: &Camera, width: u32, height: u32) -> View {
        let pixels = DVec2::new(f64::from(width), f64::from(height));
        let (extent, parallel) = match camera.projection {
            Projection::Perspective(angle) => ((0.5 * angle).tan(), false),
            Projection::Orthographic(height) => (0.5 * height, true),
        };
        let half = extent * pixels / pixels.min_element();
        let right = camera.direction.cross(camera.up).normalize_or(DVec3::X);
        let up = right.cross(camera.direction);
        View { eye: camera.position, forward: camera.direction, right, up, half, parallel, pixels }
    }

    /// The ray (origin, unit direction) through a point in pixels from the upper left corner.
    pub fn ray(&self, at: DVec2) -> (DVec3, DVec3) {
        let p = (2.0 * at / self.pixels - DVec2::ONE) * self.half;
        let offset = p.x * self.right - p.y * self.up;
        if self.parallel {
            (self.eye + offset, self.forward)
        } else {
            (self.eye, (self.forward + offset).normalize())
        }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.pixels.x as u32, self.pixels.y as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_go_where_the_camera_points() {
        let camera = Camera {
            name: String::new(),
            position: DVec3::new(1.0, 2.0, 3.0),
            direction: DVec3::NEG_Z,
            up: DVec3::Y,
            projection: Projection::Perspective(std::f64::consts::FRAC_PI_2),
            aspect: 1.0,
        };
        let view = View::new(&camera, 200, 100);
        let (origin, direction) = view.ray(DVec2::new(100.0, 50.0));
        assert_eq!((origin, direction), (camera.position, DVec3::NEG_Z));
        let (_, corner) = view.ray(DVec2::new(200.0, 0.0));
        assert!((corner - DVec3::new(2.0, 1.0, -1.0).normalize()).length() < 1e-12);
        let upright = View::new(&camera, 100, 200);
        let (_, corner) = upright.ray(DVec2::new(100.0, 0.0));
        assert!((corner - DVec3::new(1.0, 2.0, -1.0).normalize()).length() < 1e-12);
        let parallel = Camera { projection: Projection::Orthographic(4.0), ..camera };
        let (origin, direction) = View::new(&parallel, 100, 100).ray(DVec2::new(50.0, 0.0));
        assert_eq!((origin, direction), (DVec3::new(1.0, 4.0, 3.0), DVec3::NEG_Z));
    }
}
