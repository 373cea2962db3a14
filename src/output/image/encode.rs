//! Pictures as files: PNG for the eye, EXR for numbers.

use std::io::{self, Cursor, Write};

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, Text, WritableImage};

use super::borders::Borders;
use super::legend::{HEIGHT, strip};
use super::render::{Look, display, exposure, irradiance_scale, radiance};
use super::shade::{Caster, Shade};
use super::view::View;
use super::{ImageOptions, viewpoint};
use crate::output::colour::srgb;
use crate::radiosity::Solution;
use crate::scene::Camera;

const DEFAULT_HEIGHT: f64 = 768.0;

fn check(options: &ImageOptions, solution: &Solution) -> io::Result<()> {
    options.check(&solution.scene).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e.to_string()))
}

fn camera(shade: &Shade, options: &ImageOptions) -> Camera {
    let cameras = &shade.solution.scene.cameras;
    let named = |name: &String| cameras.iter().find(|c| c.name == *name);
    let found = options.camera.as_ref().map_or(cameras.first(), named);
    found.cloned().unwrap_or_else(|| viewpoint::choose(shade))
}

fn size(camera: &Camera, options: &ImageOptions) -> (u32, u32) {
    let aspect = if camera.aspect.is_finite() { camera.aspect.clamp(0.25, 4.0) } else { 4.0 / 3.0 };
    options.size.unwrap_or(((DEFAULT_HEIGHT * aspect).round() as u32, DEFAULT_HEIGHT as u32))
}

/// Writes a picture in 8-bit sRGB; the exposure or the scale stands in a text chunk.
///
/// # Errors
/// Those of [`ImageOptions::check`], as [`io::ErrorKind::InvalidInput`], and those of `out`.
pub fn write_png(
    solution: &Solution,
    options: &ImageOptions,
    cast: &Caster,
    out: &mut dyn Write,
) -> io::Result<()> {
    check(options, solution)?;
    let shade = Shade::new(solution, cast);
    let camera = camera(&shade, options);
    let (width, height) = size(&camera, options);
    // The legend takes its strip from the picture's height, if it leaves most of it.
    let legend = if options.falsecolor && height >= 3 * HEIGHT { HEIGHT } else { 0 };
    let view = View::new(&camera, width, height - legend);
    let borders = options.mesh.then(|| Borders::new(solution));
    let (look, note) = if options.falsecolor {
        let scale = irradiance_scale(&shade, &view);
        (Look::FalseColour(scale), format!("irradiance in W/m2, mean of the bands, viridis: {scale:?}"))
    } else {
        let exposure = options.exposure.unwrap_or_else(|| exposure(&shade, &view));
        (Look::Exposed(exposure), format!("exposure {exposure:e} on radiance in W/(m2 sr)"))
    };
    let linear = display(&shade, &view, &look, borders.as_ref(), (options.samples, options.threads));
    let mut bytes = dithered(&linear, width as usize);
    if let (Look::FalseColour(scale), true) = (&look, legend > 0) {
        bytes.extend(strip(scale, &solution.scene.bands, width));
    }
    encode_png(&bytes, (width, height), &note, out)
}

/// 8-bit codes, rounded up or down by a fixed pattern of the place (Jimenez's interleaved gradient noise), so that
/// faint gradients show no bands. Black and white stay what they are.
fn dithered(linear: &[f32], width: usize) -> Vec<u8> {
    let code = |(i, value): (usize, &f32)| {
        let (x, y) = ((i / 3 % width) as f64, (i / 3 / width) as f64);
        let noise = (52.982_918_9 * (0.067_110_56 * x + 0.005_837_15 * y).fract()).fract();
        (srgb(f64::from(*value)) * 255.0 + noise) as u8
    };
    linear.iter().enumerate().map(code).collect()
}

fn encode_png(bytes: &[u8], (width, height): (u32, u32), note: &str, out: &mut dyn Write) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.add_text_chunk("Software".to_owned(), concat!("wrad ", env!("CARGO_PKG_VERSION")).to_owned())?;
    encoder.add_text_chunk("Comment".to_owned(), note.to_owned())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(())
}

/// Writes linear radiance in W/(m² sr), 32-bit floating point, one channel per band: `R`, `G`, `B` or the
/// bands' names.
///
/// # Errors
/// As [`write_png`].
pub fn write_exr(
    solution: &Solution,
    options: &ImageOptions,
    cast: &Caster,
    out: &mut dyn Write,
) -> io::Result<()> {
    check(options, solution)?;
    let shade = Shade::new(solution, cast);
    let camera = camera(&shade, options);
    let (width, height) = size(&camera, options);
    let pixels = radiance(&shade, &View::new(&camera, width, height), options.samples, options.threads);
    let bands = solution.scene.bands.len();
    let channels = solution.scene.bands.iter().enumerate().map(|(band, name)| {
        let values: Vec<f32> = pixels.iter().skip(band).step_by(bands).copied().collect();
        AnyChannel::new(channel_name(name, band), FlatSamples::F32(values))
    });
    let mut image =
        Image::from_channels((width as usize, height as usize), AnyChannels::sort(channels.collect()));
    image.layer_data.attributes.software_name = Some(Text::from(concat!("wrad ", env!("CARGO_PKG_VERSION"))));
    image.layer_data.attributes.comments = Some(Text::from("radiance in W/(m2 sr), linear"));
    let mut file = Cursor::new(Vec::new());
    let encoded = image.write().non_parallel().to_buffered(&mut file).map_err(io::Error::other);
    encoded.and_then(|()| out.write_all(file.get_ref()))
}

/// Viewers know `R`, `G`, `B` and `Y`; a name must not be empty nor contain characters the format gives a
/// meaning to.
fn channel_name(band: &str, index: usize) -> Text {
    match band {
        "r" | "g" | "b" | "y" => Text::from(band.to_uppercase().as_str()),
        _ => {
            let plain: String = band.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            Text::from(if plain.is_empty() { format!("band{index}") } else { plain }.as_str())
        }
    }
}

#[cfg(test)]
mod tests {
    use exr::prelude::{ReadChannels, ReadLayers, read};

    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    #[test]
    fn linear_pictures_hold_the_radiance_of_the_solution() {
        let solution = rooms::gallery(Basis::M3, 4, 5);
        let cast = |origin, direction| rooms::cast(&solution, origin, direction);
        let options = ImageOptions { size: Some((33, 21)), samples: 1, ..ImageOptions::default() };
        let mut bytes = Vec::new();
        write_exr(&solution, &options, &cast, &mut bytes).unwrap();
        let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = image.all_attributes().from_buffered(Cursor::new(bytes)).unwrap();
        let layer = &image.layer_data;
        let view = View::new(&solution.scene.cameras[0], 33, 21);
        let (origin, direction) = view.ray(glam::DVec2::new(16.5, 10.5));
        let (surface, uv) = cast(origin, direction).unwrap();
        let mut radiosity = [0.0; 3];
        solution.radiosity(surface as usize, uv, &mut radiosity);
        for (name, band) in [("R", 0), ("G", 1), ("B", 2)] {
            let channel = layer.channel_data.list.iter().find(|c| c.name == *name).unwrap();
            let value = channel.sample_data.value_by_flat_index(10 * 33 + 16).to_f32();
            assert!((f64::from(value) * std::f64::consts::PI / radiosity[band] - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn pictures_do_not_depend_on_threads_and_unknown_cameras_are_named() {
        let solution = rooms::gallery(Basis::M2, 3, 6);
        let cast = |origin, direction| rooms::cast(&solution, origin, direction);
        let render = |threads| {
            let size = Some((40, 30));
            let options = ImageOptions { size, threads, mesh: true, ..ImageOptions::default() };
            let mut bytes = Vec::new();
            write_png(&solution, &options, &cast, &mut bytes).unwrap();
            bytes
        };
        assert_eq!(render(1), render(3));
        let options = ImageOptions { camera: Some("window".to_owned()), ..ImageOptions::default() };
        let error = write_png(&solution, &options, &cast, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("window") && error.contains("door"), "{error}");
    }
}
