//! Real scene files: all of Coin's compliance models, SGI's models and converted interiors load or give one
//! clear error.
//!
//! The files lie beside the project in `../shared`; without them these tests say so and pass.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use wavelet_radiosity::scene::read::{ReadError, read_file};
use wavelet_radiosity::scene::{Scene, cut, describe, planar, surfaces};

fn shared(folder: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/scenes/iv")).join(folder);
    if !path.is_dir() {
        println!("skipped: {} is missing", path.display());
        return None;
    }
    Some(path)
}

/// All scene files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path));
        } else if path.extension().is_some_and(|e| e == "iv" || e == "wrl") {
            all.push(path);
        }
    }
    all.sort();
    all
}

fn load(path: &Path) -> Scene {
    read_file(path).unwrap_or_else(|error| panic!("{error}"))
}

fn repairs(scene: &Scene, rule: &str) -> u64 {
    scene.findings.repairs.get(rule).map_or(0, |finding| finding.count)
}

#[test]
fn the_reference_scenes_load_clean() {
    for (name, faces, covered) in [("cornell-box", 17, 0), ("furnished-room", 67, 8), ("l-gallery", 22, 0)] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.iv"));
        let scene = load(&path);
        assert_eq!((&*scene.name, scene.faces.len()), (name, faces));
        // All faces are one-sided.
        let cut = cut(&scene);
        let with_surface = cut.surfaces.iter().map(|s| s.face).collect::<BTreeSet<u32>>().len();
        // What is covered in pairs is a bottom and the part of a floor under it.
        assert!(cut.cut_sides > 0 && cut.covered == covered && with_surface == faces - covered / 2);
        let lit: f64 = cut.surfaces.iter().map(|s| s.area_m2).sum();
        let all: f64 = scene.faces.iter().filter_map(|f| planar::plane(&f.vertices)).map(|p| p.area_m2).sum();
        assert!(if covered == 0 { (lit / all - 1.0).abs() < 1e-9 } else { lit < all });
        assert!(scene.findings.repairs.is_empty(), "{:?}", scene.findings.repairs);
    }
}

/// One of every node that is interpreted, against a recorded description.
#[test]
fn everything_reads_as_recorded() {
    // Cargo runs tests in the package's folder, so the places in findings are the same everywhere.
    for name in ["everything.iv", "everything.wrl"] {
        let path = Path::new("tests/data").join(name);
        let found = describe(&load(&path));
        let recorded = path.with_file_name(format!("{name}.txt"));
        let expected = std::fs::read_to_string(&recorded).unwrap_or_default();
        assert_eq!(found, expected, "{name} differs from {}:\n{found}", recorded.display());
    }
}

/// Polygons as counted in the files by an independent program, plus those of tessellated cylinder sides (12
/// each) and spheres (72 each), plus pieces of non-planar faces, less duplicates.
#[test]
fn interiors_have_the_polygons_of_their_files() {
    let Some(folder) = shared("") else { return };
    for (name, polygons, cylinders, spheres, split, twice) in [
        ("office_b90", 899, 114, 77, 0, 0),
        ("corridor", 468, 2, 1, 0, 1),
        ("hospital", 2814, 41, 61, 24, 6),
        ("classroom_kul", 5250, 0, 0, 576, 16),
        ("soda", 10_951, 575, 274, 0, 0),
    ] {
        let scene = load(&folder.join(name).with_extension("iv"));
        let expected = polygons + 12 * cylinders + 72 * spheres + split - twice;
        assert_eq!(scene.faces.len(), expected, "{name}\n{}", describe(&scene));
        assert_eq!(repairs(&scene, "non-planar face split into planar pieces"), split as u64, "{name}");
        assert_eq!(repairs(&scene, "face drawn twice dropped"), twice as u64, "{name}");
    }
}

#[test]
fn sgi_models_load_whole() {
    let Some(folder) = shared("inventor-data") else { return };
    let mut loaded = 0;
    for path in files(&folder).into_iter().filter(|path| !path.starts_with(folder.join("binary"))) {
        let scene = load(&path);
        assert!(!scene.faces.is_empty(), "{}", path.display());
        assert_eq!(
            repairs(&scene, "face with a coordinate index out of range dropped"),
            0,
            "{}",
            path.display()
        );
        assert_eq!(repairs(&scene, "included file missing, left out"), 0, "{}", path.display());
        loaded += 1;
    }
    assert_eq!(loaded, 28);
    for (name, faces, lights) in
        [("faceSet", 6, 0), ("triangleStripSet", 18, 0), ("robotcop", 11_221, 0), ("lavalamp", 1450, 1)]
    {
        let scene = load(&folder.join(name).with_extension("iv"));
        assert_eq!((scene.faces.len(), scene.lights.len()), (faces, lights), "{name}");
    }
}

#[test]
fn correct_files_load_and_incorrect_ones_give_one_clear_error() {
    let Some(folder) = shared("coin/io") else { return };
    for path in files(&folder.join("correct")) {
        load(&path);
    }
    // Where each error is reported.
    for (name, place) in [
        ("bug029-3.iv", "10:11"),
        ("bug039.iv", "11:35"),
        ("bug055-2.wrl", "10:12"),
        ("bug055-3.wrl", "8:1"),
        ("bug055-5.iv", "10:3"),
        ("bug055-6.iv", "11:20"),
        ("bug055-7.wrl", "10:21"),
        ("bug055-8.wrl", "11:1"),
        ("bug055.wrl", "9:12"),
        ("bug199-error-1.iv", "4:11"),
        ("bug199-error-1.wrl", "4:11"),
        ("bug199-error-2.iv", "4:11"),
        ("bug199-error-2.wrl", "4:11"),
        ("bug199-error-3.iv", "5:6"),
        ("bug199-error-3.wrl", "4:11"),
    ] {
        let path = folder.join("incorrect").join(name);
        let error = read_file(&path).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}:{place}: expected ", path.display())), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    assert_eq!(files(&folder.join("incorrect")).len(), 15);
}

#[test]
fn binary_files_give_an_error_that_says_how_to_convert_them() {
    let Some(folder) = shared("inventor-data/binary") else { return };
    for path in files(&folder) {
        let error = read_file(&path).unwrap_err().to_string();
        assert!(error.contains("found `#Inventor V2.1 binary`; convert it to text with `ivcat"), "{error}");
    }
}

#[test]
fn every_other_file_loads_or_gives_one_error_and_makes_sound_surfaces() {
    let Some(folder) = shared("") else { return };
    let mut failed = Vec::new();
    for path in files(&folder) {
        match read_file(&path) {
            Ok(scene) => {
                for surface in surfaces(&scene) {
                    let sound = surface.area_m2 > 0.0
                        && surface.area_m2 <= surface.frame.area_m2 * (1.0 + 1e-9)
                        && (surface.frame.normal.length() - 1.0).abs() < 1e-9;
                    assert!(sound, "{}: {surface:?}", path.display());
                }
            }
            Err(ReadError::Content(error)) => failed.push(error.path),
            Err(error) => panic!("{error}"),
        }
    }
    assert!(
        failed.iter().all(|path| path.parent().unwrap().ends_with("incorrect")
            || path.parent().unwrap().ends_with("binary"))
    );
    assert_eq!(failed.len(), 16);
}

#[test]
fn three_megabytes_read_in_half_a_second() {
    let Some(folder) = shared("") else { return };
    let best = (0..3)
        .map(|_| {
            let start = Instant::now();
            load(&folder.join("soda.iv"));
            start.elapsed()
        })
        .min();
    assert!(best.unwrap() < Duration::from_millis(500), "{best:?}");
}
