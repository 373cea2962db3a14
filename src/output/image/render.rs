//! Rows of samples, shared out to threads. Pictures do not depend on the number of threads.

use std::sync::{Mutex, PoisonError};

use glam::DVec2;

use super::borders::Borders;
use super::legend::Scale;
use super::shade::{Hit, Shade};
use super::view::View;
use crate::output::colour::{automatic_exposure, luminance, quantile, tone};

/// Samples per dimension of the first look that sets exposure and scales.
const PREVIEW: u32 = 96;

/// How a sample becomes a colour.
pub(super) enum Look {
    /// Radiance times an exposure, through the tone curve.
    Exposed(f64),
    /// Irradiance on a scale of colours.
    FalseColour(Scale),
}

/// The exposure for a view.
pub(super) fn exposure(shade: &Shade, view: &View) -> f64 {
    automatic_exposure(preview(shade, view, |s, hit, scratch| s.luminance(hit, scratch)))
}

/// A scale for the irradiance in view.
pub(super) fn irradiance_scale(shade: &Shade, view: &View) -> Scale {
    let mut values = preview(shade, view, |s, hit, scratch| s.mean_irradiance(hit, scratch));
    Scale::up_to(quantile(&mut values, 0.995), quantile(&mut values, 1.0))
}

fn preview(shade: &Shade, view: &View, value: fn(&Shade, Hit, &mut [f64]) -> f64) -> Vec<f64> {
    let (width, height) = view.size();
    let (nx, ny) = (width.min(PREVIEW), height.min(PREVIEW));
    let step = DVec2::new(f64::from(width) / f64::from(nx), f64::from(height) / f64::from(ny));
    let mut scratch = shade.scratch();
    let mut values = Vec::with_capacity((nx * ny) as usize);
    for y in 0..ny {
        for x in 0..nx {
            let at = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * step;
            let (origin, direction) = view.ray(at);
            values.extend(shade.hit(origin, direction).map(|hit| value(shade, hit, &mut scratch)));
        }
    }
    values
}

/// The picture in linear display values 0 to 1, three per pixel.
pub(super) fn display(
    shade: &Shade,
    view: &View,
    look: &Look,
    borders: Option<&Borders>,
    (samples, threads): (u32, usize),
) -> Vec<f32> {
    rows(view, 3, threads, |y, row| {
        let mut scratch = shade.scratch();
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let mut sum = [0.0; 3];
            for_each_sample(x, y, samples, |at, weight| {
                let (origin, direction) = view.ray(at);
                let Some(hit) = shade.hit(origin, direction) else { return };
                let mut colour = match look {
                    Look::Exposed(exposure) => {
                        shade.radiance(hit, &mut scratch);
                        tone(shade.to_rgb.rgb(&scratch).map(|c| c * exposure))
                    }
                    Look::FalseColour(scale) => scale.colour(shade.mean_irradiance(hit, &mut scratch)),
                };
                if let Some(borders) = borders {
                    colour = ink(colour, borders.coverage(view, at, hit));
                }
                for (s, c) in sum.iter_mut().zip(colour) {
                    *s += weight * c;
                }
            });
            pixel.copy_from_slice(&sum.map(|c| c as f32));
        }
    })
}

/// Darkens light colours and lightens dark ones, so that lines show on both.
fn ink(colour: [f64; 3], coverage: f64) -> [f64; 3] {
    let light = luminance(colour);
    // Around the turning point lines would vanish: it lies where shadows are, and the blend stays strong on
    // both sides.
    let target = if light > 0.04 { 0.12 * light } else { 0.16 };
    let share = 0.6 * coverage;
    colour.map(|c| c + (target - c) * share)
}

/// The picture in W/(m² sr), one value per band and pixel.
pub(super) fn radiance(shade: &Shade, view: &View, samples: u32, threads: usize) -> Vec<f32> {
    let bands = shade.scratch().len();
    rows(view, bands, threads, |y, row| {
        let (mut scratch, mut sum) = (shade.scratch(), shade.scratch());
        for (x, pixel) in row.chunks_exact_mut(bands).enumerate() {
            sum.fill(0.0);
            for_each_sample(x, y, samples, |at, weight| {
                let (origin, direction) = view.ray(at);
                if let Some(hit) = shade.hit(origin, direction) {
                    shade.radiance(hit, &mut scratch);
                    for (s, v) in sum.iter_mut().zip(&scratch) {
                        *s += weight * v;
                    }
                }
            });
            for (out, value) in pixel.iter_mut().zip(&sum) {
                *out = *value as f32;
            }
        }
    })
}

fn for_each_sample(x: usize, y: usize, samples: u32, mut visit: impl FnMut(DVec2, f64)) {
    let n = f64::from(samples.max(1));
    for j in 0..samples.max(1) {
        for i in 0..samples.max(1) {
            let offset = (DVec2::new(f64::from(i), f64::from(j)) + 0.5) / n;
            visit(DVec2::new(x as f64, y as f64) + offset, 1.0 / (n * n));
        }
    }
}

/// Fills a picture row by row; each thread takes the next row when it is done with one.
fn rows(view: &View, channels: usize, threads: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let (width, height) = view.size();
    let length = width as usize * channels;
    let mut pixels = vec![0.0; length * height as usize];
    if length > 0 {
        let left = Mutex::new(pixels.chunks_exact_mut(length).enumerate());
        let work = || {
            // The guard is dropped before the row is filled.
            let next = || left.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((y, row)) = next() {
                fill(y, row);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads.clamp(1, height as usize) {
                // What helpers that cannot be had leave, the others do.
                let _ = std::thread::Builder::new().spawn_scoped(scope, work);
            }
            work();
        });
    }
    pixels
}
