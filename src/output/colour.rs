//! From bands to a display's colours: three linear channels, exposure, tone curve, sRGB.

/// Weights that turn one value per band into linear red, green and blue.
///
/// One band is grey. Bands named r, g, b are themselves. Any others are shared out evenly in three groups,
/// in the order of the scene, or from long to short if their names are wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct ToRgb(Vec<[f64; 3]>);

impl ToRgb {
    /// The weights for bands of these names.
    pub fn new(bands: &[String]) -> ToRgb {
        let n = bands.len();
        let named = |name: &str| bands.iter().position(|b| b.eq_ignore_ascii_case(name));
        let mut weights = vec![[0.0; 3]; n];
        if let (Some(r), Some(g), Some(b)) = (named("r"), named("g"), named("b")) {
            for (channel, band) in [r, g, b].into_iter().enumerate() {
                weights[band][channel] = 1.0;
            }
            return ToRgb(weights);
        }
        let wavelengths: Vec<f64> =
            bands.iter().filter_map(|b| b.trim_end_matches("nm").trim().parse().ok()).collect();
        let ascending = wavelengths.len() == n && wavelengths.is_sorted();
        // At least one band each: with fewer than three bands, groups overlap.
        let groups = [0, 1, 2].map(|channel| channel * n / 3..((channel + 1) * n).div_ceil(3));
        for (channel, group) in groups.into_iter().enumerate() {
            let share = 1.0 / group.len() as f64;
            for i in group {
                weights[if ascending { n - 1 - i } else { i }][channel] = share;
            }
        }
        ToRgb(weights)
    }

    /// Linear red, green and blue of one value per band.
    pub fn rgb(&self, values: &[f64]) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (weights, value) in self.0.iter().zip(values) {
            for (channel, weight) in out.iter_mut().zip(weights) {
                *channel += weight * value;
            }
        }
        out
    }
}

/// Luminance of linear Rec. 709 channels, in their unit.
pub fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// The sRGB code, 0 to 1, of a linear value; clamps.
pub fn srgb(linear: f64) -> f64 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// [`srgb`] in 8 bits; not a number is black.
pub fn srgb8(linear: f64) -> u8 {
    (srgb(linear) * 255.0).round() as u8
}

/// The `share`-quantile of positive values (0.5: the median); 0 if there are none.
pub fn quantile(values: &mut Vec<f64>, share: f64) -> f64 {
    values.retain(|v| *v > 0.0 && v.is_finite());
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// The factor that brings typical luminances a little above middle grey, as lit rooms look: 0.25 over their
/// logarithmic mean, the darkest and the brightest twentieth left out (a lamp in view, a dark corner). 1 if
/// nothing is lit.
pub fn automatic_exposure(mut luminances: Vec<f64>) -> f64 {
    let low = quantile(&mut luminances, 0.05);
    let high = quantile(&mut luminances, 0.95);
    let kept: Vec<f64> = luminances.into_iter().filter(|l| (low..=high).contains(l)).collect();
    if kept.is_empty() {
        return 1.0;
    }
    let mean_log = kept.iter().map(|l| l.ln()).sum::<f64>() / kept.len() as f64;
    0.25 / mean_log.exp()
}

/// The tone curve: Narkowicz's rational fit of a film's response, on luminance: a soft foot, contrast in
/// the middle, a soft shoulder. Hue is kept; a colour too bright for the display fades towards white.
pub fn tone(rgb: [f64; 3]) -> [f64; 3] {
    // Brings middle grey, 0.18, out at 0.2.
    const GAIN: f64 = 0.78;
    let rgb = rgb.map(|c| c.max(0.0));
    let l = luminance(rgb);
    if l <= 0.0 {
        return [0.0; 3];
    }
    // Beyond this everything is white, and the squares below stay finite.
    let x = (GAIN * l).min(1e6);
    let target = (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0);
    let scaled = rgb.map(|c| c / l * target);
    let brightest = scaled.iter().fold(0.0f64, |a, b| a.max(*b));
    if brightest <= 1.0 {
        return scaled;
    }
    let keep = (1.0 - target) / (brightest - target);
    scaled.map(|c| target + (c - target) * keep)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn any_number_of_bands_becomes_a_colour_and_equal_bands_grey() {
        assert_eq!(ToRgb::new(&names(&["y"])).rgb(&[2.0]), [2.0; 3]);
        assert_eq!(ToRgb::new(&names(&["B", "G", "R"])).rgb(&[1.0, 2.0, 3.0]), [3.0, 2.0, 1.0]);
        let wavelengths = names(&["450", "500nm", "550", "600", "650", "700"]);
        assert_eq!(ToRgb::new(&wavelengths).rgb(&[1., 1., 2., 2., 3., 3.]), [3.0, 2.0, 1.0]);
        for n in 1..10 {
            let bands: Vec<String> = (0..n).map(|i| format!("band{i}")).collect();
            let grey = ToRgb::new(&bands).rgb(&vec![0.7; n]);
            assert!(grey.iter().all(|c| (c - 0.7).abs() < 1e-12), "{n} bands: {grey:?}");
        }
        assert_eq!(ToRgb::new(&[]).rgb(&[]), [0.0; 3]);
    }

    #[test]
    fn tones_rise_with_light_stay_in_range_and_keep_middle_grey() {
        let grey = tone([0.18; 3])[0];
        assert!((grey - 0.2).abs() < 0.01, "{grey}");
        let mut last = 0.0;
        for i in 1..200 {
            let out = tone([0.05 * i as f64, 0.02 * i as f64, 0.01 * i as f64]);
            assert!(out.iter().all(|c| (0.0..=1.0 + 1e-12).contains(c)), "{out:?}");
            assert!(luminance(out) >= last);
            last = luminance(out);
        }
        assert_eq!((srgb8(0.0), srgb8(1.0), srgb8(f64::NAN), srgb8(0.214)), (0, 255, 0, 127));
    }

    #[test]
    fn exposure_ignores_a_lamp() {
        let mut luminances = vec![2.0; 1000];
        luminances.extend([1e4; 20]);
        assert!((automatic_exposure(luminances) - 0.125).abs() < 1e-12);
        assert_eq!(automatic_exposure(vec![0.0, f64::NAN]), 1.0);
    }
}
