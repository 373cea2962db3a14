//! A scale of false colours, and the bar below the picture that explains it.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// The height of the strip that holds the bar and its labels, in pixels.
pub(super) const HEIGHT: u32 = 64;
const BAR: (usize, usize) = (10, 16);
const TEXT: [f64; 3] = [225.0; 3];

/// A linear scale from zero: viridis, which is even to the eye and readable in grey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    top: f64,
    step: f64,
    /// Whether there are values above `top`.
    clipped: bool,
}

impl Scale {
    /// A scale that ends at or a little above `value`, with a step of 1, 2 or 5 times a power of ten;
    /// `greatest` is the greatest value.
    pub fn up_to(value: f64, greatest: f64) -> Scale {
        if !(value.is_finite() && value > 0.0) {
            return Scale { top: 1.0, step: 0.2, clipped: false };
        }
        let power = 10f64.powf((value / 4.0).log10().floor());
        let rough = value / 4.0 / power;
        let step = power
            * if rough < 2.0 {
                1.0
            } else if rough < 5.0 {
                2.0
            } else {
                5.0
            };
        // Half steps keep the scale from ending far above the values.
        let top = (value / (0.5 * step) - 1e-9).ceil() * 0.5 * step;
        Scale { top, step, clipped: greatest > top }
    }

    /// The linear colour of a value.
    pub fn colour(&self, value: f64) -> [f64; 3] {
        self.code(value / self.top).map(|c| {
            let c = c / 255.0;
            if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        })
    }

    fn code(&self, share: f64) -> [f64; 3] {
        let colour = colorous::VIRIDIS.eval_continuous(share.clamp(0.0, 1.0));
        [colour.r, colour.g, colour.b].map(f64::from)
    }

    fn ticks(&self) -> Vec<f64> {
        let count = (self.top / self.step + 1e-9).floor() as u32;
        (0..=count).map(|i| f64::from(i) * self.step).collect()
    }

    fn label(&self, tick: f64) -> String {
        let digits = -self.step.log10().floor();
        if tick == 0.0 {
            "0".to_owned()
        } else if self.top >= 1e5 || digits > 4.0 {
            format!("{tick:.1e}")
        } else {
            format!("{tick:.*}", digits.max(0.0) as usize)
        }
    }
}

/// Draws the strip: a bar over the whole width, ticks with numbers, and what is shown in which unit.
pub(super) fn strip(scale: &Scale, bands: &[String], width: u32) -> Vec<u8> {
    let mut canvas = Canvas::new(width as usize, HEIGHT as usize);
    let margin = 16.min(width as usize / 8);
    let length = (width as usize).saturating_sub(2 * margin).max(1);
    for x in 0..length {
        let colour = scale.code((x as f64 + 0.5) / length as f64);
        for y in BAR.0..BAR.0 + BAR.1 {
            canvas.blend(margin + x, y, colour, 1.0);
        }
    }
    let mut free = 0;
    for tick in scale.ticks() {
        let x = margin + (tick / scale.top * length as f64).round() as usize;
        for y in BAR.0 + BAR.1..BAR.0 + BAR.1 + 5 {
            canvas.blend(x.min(margin + length - 1), y, TEXT, 1.0);
        }
        let label = scale.label(tick);
        let half = text_width(&label) / 2;
        let start = x.saturating_sub(half).min((width as usize).saturating_sub(2 * half));
        if start >= free {
            canvas.text(start, BAR.0 + BAR.1 + 5, &label);
            free = start + 2 * half + 8;
        }
    }
    canvas.text(margin, HEIGHT as usize - 17, &title(scale, bands, width as usize));
    canvas.bytes
}

/// The longest form of the title that fits.
fn title(scale: &Scale, bands: &[String], width: usize) -> String {
    let what = match bands.len() {
        1 => "irradiance, W/m\u{b2}".to_owned(),
        n if n <= 4 => format!("irradiance, W/m\u{b2}, mean of bands {}", bands.join(" ")),
        n => format!("irradiance, W/m\u{b2}, mean of {n} bands"),
    };
    let clipped = if scale.clipped { "; brighter is clipped" } else { "" };
    let forms =
        [format!("{what}{clipped}"), what, "irradiance, W/m\u{b2}".to_owned(), "W/m\u{b2}".to_owned()];
    forms.into_iter().find(|form| text_width(form) + 32 <= width).unwrap_or_default()
}

fn text_width(text: &str) -> usize {
    text.chars().count() * get_raster_width(FontWeight::Regular, RasterHeight::Size16)
}

/// A small picture in sRGB codes.
struct Canvas {
    width: usize,
    height: usize,
    bytes: Vec<u8>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Canvas {
        let background = [18, 18, 20];
        Canvas { width, height, bytes: background.repeat(width * height) }
    }

    fn blend(&mut self, x: usize, y: usize, colour: [f64; 3], share: f64) {
        if x < self.width && y < self.height {
            let at = 3 * (y * self.width + x);
            for (byte, c) in self.bytes[at..at + 3].iter_mut().zip(colour) {
                *byte = (f64::from(*byte) + (c - f64::from(*byte)) * share).round() as u8;
            }
        }
    }

    fn text(&mut self, x: usize, y: usize, text: &str) {
        let advance = text_width(" ");
        for (i, character) in text.chars().enumerate() {
            let raster = |c| get_raster(c, FontWeight::Regular, RasterHeight::Size16);
            let Some(glyph) = raster(character).or_else(|| raster('?')) else { continue };
            for (row, line) in glyph.rows().enumerate() {
                for (column, ink) in line.iter().enumerate() {
                    self.blend(x + i * advance + column, y + row, TEXT, f64::from(*ink) / 255.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_end_near_the_value_with_round_steps() {
        for exponent in -8..9 {
            for mantissa in [1.0, 1.3, 1.9, 2.4, 3.7, 4.9, 6.6, 7.9, 9.99] {
                let value = mantissa * 10f64.powi(exponent);
                let scale = Scale::up_to(value, value);
                assert!(scale.top >= value * 0.999_999 && scale.top <= 1.3 * value, "{value}: {scale:?}");
                let ticks = scale.ticks();
                assert!((3..=10).contains(&ticks.len()), "{value}: {ticks:?}");
                let mut labels: Vec<String> = ticks.iter().map(|t| scale.label(*t)).collect();
                labels.dedup();
                assert_eq!(labels.len(), ticks.len(), "{labels:?}");
            }
        }
        assert_eq!(Scale::up_to(0.0, 0.0).top, 1.0);
    }

    #[test]
    fn every_width_has_a_strip() {
        let scale = Scale::up_to(7.3, 9.0);
        for width in [1, 2, 17, 100, 640] {
            assert_eq!(strip(&scale, &["r".to_owned()], width).len(), (3 * width * HEIGHT) as usize);
        }
    }
}
