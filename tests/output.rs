//! Every format from one solution, through the one entry; set `WRAD_KEEP_OUTPUT=DIR` to look at the files.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use wavelet_radiosity::math::Basis;
use wavelet_radiosity::output::image::ImageOptions;
use wavelet_radiosity::output::{OutputKind, solution_file, write};
use wavelet_radiosity::radiosity::Solution;

use wavelet_radiosity as lib;
#[path = "support/rooms.rs"]
mod rooms;

struct Place {
    path: PathBuf,
    _guard: tempfile::TempDir,
}

fn place(test: &str) -> Place {
    let guard = tempfile::tempdir().unwrap();
    let kept = std::env::var_os("WRAD_KEEP_OUTPUT").map(PathBuf::from);
    let path = kept.unwrap_or_else(|| guard.path().to_owned()).join(test);
    std::fs::create_dir_all(&path).unwrap();
    Place { path, _guard: guard }
}

fn caster(solution: &Solution) -> impl Fn(DVec3, DVec3) -> Option<(u32, DVec2)> + Sync + '_ {
    |origin, direction| rooms::cast(solution, origin, direction)
}

/// Pixels of a PNG: width, height, bytes.
fn read_png(path: &Path) -> (u32, u32, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    (info.width, info.height, bytes)
}

fn mean(bytes: &[u8]) -> f64 {
    bytes.iter().map(|b| f64::from(*b)).sum::<f64>() / bytes.len() as f64
}

#[test]
fn every_format_is_written_whole_and_nothing_is_left_beside() {
    let place = place("formats");
    let solution = rooms::gallery(Basis::M2, 4, 11);
    let cast = caster(&solution);
    let options = ImageOptions { size: Some((64, 48)), samples: 1, ..ImageOptions::default() };
    for name in ["a.glb", "a.ply", "a.vtu", "a.png", "a.exr", "a.wrad"] {
        let path = place.path.join(name);
        write(&solution, &path, &options, &cast).unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() > 500, "{name}");
    }
    let hidden = std::fs::read_dir(&place.path).unwrap().filter(|e| {
        let name = e.as_ref().unwrap().file_name();
        name.to_string_lossy().ends_with(".tmp")
    });
    assert_eq!(hidden.count(), 0);
    let loaded = solution_file::load(&place.path.join("a.wrad")).unwrap();
    assert_eq!(loaded.fields, solution.fields);
    assert!(OutputKind::from_path(Path::new("a.stl")).unwrap_err().to_string().contains(".glb"));
    let error = write(&solution, Path::new("a.stl"), &options, &cast).unwrap_err().to_string();
    assert!(error.contains("a.stl"), "{error}");
}

#[test]
fn pictures_are_exposed_in_the_middle_whatever_the_power_of_the_lamps() {
    let place = place("exposure");
    let mut means = Vec::new();
    for (i, scale) in [1.0, 1e-6, 1e5].into_iter().enumerate() {
        let mut solution = rooms::gallery(Basis::M3, 5, 12);
        for field in &mut solution.fields {
            field.coefficients.iter_mut().for_each(|c| *c *= scale);
        }
        for surface in &mut solution.surfaces {
            surface.exitance_w_m2.iter_mut().for_each(|m| *m *= scale);
        }
        let path = place.path.join(format!("exposed{i}.png"));
        let size = Some(if i == 0 { (640, 480) } else { (64, 48) });
        let options = ImageOptions { size, ..ImageOptions::default() };
        write(&solution, &path, &options, &caster(&solution)).unwrap();
        let (_, _, bytes) = read_png(&path);
        means.push(mean(&bytes));
    }
    assert!(means.iter().all(|m| (70.0..190.0).contains(m)), "{means:?}");
    assert!(means.iter().all(|m| (m - means[0]).abs() < 5.0), "{means:?}");
}

#[test]
fn false_colours_have_a_legend_and_borders_darken_the_picture() {
    let place = place("overlays");
    let solution = rooms::gallery(Basis::M3, 5, 13);
    let cast = caster(&solution);
    let picture = |name: &str, mesh, falsecolor| {
        let path = place.path.join(name);
        let options = ImageOptions { size: Some((640, 480)), mesh, falsecolor, ..ImageOptions::default() };
        write(&solution, &path, &options, &cast).unwrap();
        let (width, height, bytes) = read_png(&path);
        assert_eq!((width, height), (640, 480));
        bytes
    };
    let (plain, lines) = (picture("plain.png", false, false), picture("mesh.png", true, false));
    assert!(mean(&lines) < mean(&plain));
    let legend = picture("false.png", false, true);
    picture("false-mesh.png", true, true);
    // The bar's left and right ends: viridis runs from dark violet to yellow.
    let pixel = |x: usize, y: usize| &legend[3 * (y * 640 + x)..3 * (y * 640 + x) + 3];
    assert!(pixel(20, 434)[2] > 60 && pixel(20, 434)[1] < 30, "{:?}", pixel(20, 434));
    assert!(pixel(620, 434)[0] > 220 && pixel(620, 434)[1] > 200, "{:?}", pixel(620, 434));
}

#[test]
fn scenes_without_cameras_get_a_view_that_shows_them() {
    let place = place("views");
    let mut room = rooms::gallery(Basis::M2, 5, 14);
    room.scene.cameras.clear();
    for (name, solution) in [("auto-room.png", room), ("auto-block.png", rooms::block(Basis::M2, 4, 14))] {
        let path = place.path.join(name);
        let options = ImageOptions { size: Some((320, 240)), ..ImageOptions::default() };
        write(&solution, &path, &options, &caster(&solution)).unwrap();
        let (_, _, bytes) = read_png(&path);
        let dark =
            bytes.chunks(3).filter(|p| p.iter().all(|c| *c < 4)).count() as f64 / (bytes.len() / 3) as f64;
        assert!(dark < 0.75, "{name}: {dark} of it is black");
    }
}
