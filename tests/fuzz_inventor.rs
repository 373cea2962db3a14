//! Mutated scene files: whatever is done to a real file, the reader neither panics, hangs nor grows without
//! bound, and what it accepts keeps every promise of a validated scene.
//!
//! `WRAD_FUZZ_SECONDS` sets how long (5), `WRAD_FUZZ_SEED` where the sequence of inputs starts. A failure
//! prints the seed of its input: started with it, the same input comes first.

use std::fmt::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use wavelet_radiosity::scene::read::inventor::{Limits, parse_within};
use wavelet_radiosity::scene::{Cut, Face, Scene, cut, describe, planar, validate};

/// No input may take longer.
const LONGEST: Duration = Duration::from_secs(10);
/// The process may not grow beyond this.
const LARGEST_KIB: u64 = 1 << 20;
/// Longer seed files are cut to a random piece of this length, header kept: small inputs are tried more
/// often.
const LONGEST_SEED: usize = 20_000;
const HEADERS: [&str; 3] = ["#Inventor V2.1 ascii\n", "#VRML V1.0 ascii\n", "#VRML V2.0 utf8\n"];
/// Pieces that mean something to the grammar or break what is taken for granted.
const PIECES: &[&str] = &[
    "{",
    "}",
    "[",
    "]",
    "(",
    ")",
    "|",
    "~",
    "=",
    ",",
    "\"",
    "\\\"",
    "#",
    "\n",
    "\r",
    ".",
    "DEF a ",
    "USE a ",
    "DEF a DEF a",
    "NULL",
    " -1 ",
    " 0 ",
    " 1e30 ",
    " 1e-30 ",
    " 1e308 ",
    " -1e308 ",
    " nan ",
    " inf ",
    " 1.#QNAN ",
    " 0x7fffffff ",
    " 99999999999999999999 ",
    " -3 ",
    " 1e400 ",
    "é",
    "\u{0}",
    "\u{feff}",
    "Separator { ",
    "Array { numElements1 1000000 numElements2 9999999 ",
    "MultipleCopy { matrix [ ",
    "Switch { whichChild -3 ",
    "Sphere { ",
    "Complexity { value 99 } ",
    "Scale { scaleFactor 0 -1 1e9 } ",
    "MaterialBinding { value PER_VERTEX_INDEXED } ",
    "ShapeHints { vertexOrdering CLOCKWISE shapeType SOLID } ",
    "coordIndex [ 0 1 2 3 1 2 0 ",
    "numVertices [ 9 -1 ",
    "point [ 0 0 0 1 0 0 1 1 1 0 1 0 ",
    "QuadMesh { verticesPerColumn 3 verticesPerRow 4 } ",
    "File { name \"includefile.iv\" } ",
    "fields [ SFNode x ] x ",
    "isA [ \"Cube\" ] ",
    "alternateRep ",
    "PROTO P [ field SFNode c NULL ] { ",
    "ROUTE a.b TO a.c ",
    "IS c ",
    "children [ ",
    "SpotLight { cutOffAngle ",
    "PerspectiveCamera { heightAngle ",
];

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// A real file: where it lies, and its text.
struct Seed {
    path: PathBuf,
    bytes: Vec<u8>,
}

fn seeds() -> Vec<Seed> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![root.join("scenes"), root.join("tests/data"), root.join("../shared/scenes/iv")];
    let mut seeds = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "iv" || e == "wrl") {
                let bytes = std::fs::read(&path).unwrap();
                seeds.push(Seed { path, bytes });
            }
        }
    }
    seeds.sort_by(|a, b| a.path.cmp(&b.path));
    seeds
}

fn mutated(random: &mut Random, seeds: &[Seed]) -> (PathBuf, String) {
    let seed = &seeds[random.below(seeds.len())];
    let mut bytes = piece(random, &seed.bytes, LONGEST_SEED);
    // Few mutations more often than many, so that many inputs get past the grammar.
    let most = 1 + random.below(8);
    for _ in 0..1 + random.below(most) {
        mutate(random, &mut bytes, seeds);
    }
    let mut text: String = String::from_utf8_lossy(&bytes).into_owned();
    if !text.starts_with('#') || random.below(8) == 0 {
        text.insert_str(0, HEADERS[random.below(3)]);
    }
    (seed.path.clone(), text)
}

/// At most `longest` bytes from a random place, cut at lines where there are any.
fn piece(random: &mut Random, bytes: &[u8], longest: usize) -> Vec<u8> {
    if bytes.len() <= longest {
        return bytes.to_vec();
    }
    let start = random.below(bytes.len() - longest);
    let start = start + bytes[start..start + longest].iter().position(|b| *b == b'\n').unwrap_or(0);
    bytes[start..(start + longest).min(bytes.len())].to_vec()
}

fn mutate(random: &mut Random, bytes: &mut Vec<u8>, seeds: &[Seed]) {
    let at = random.below(bytes.len() + 1);
    let end = (at + 1 + random.below(64)).min(bytes.len());
    match random.below(9) {
        0 if at < end => bytes[at] = random.next() as u8,
        1 => drop(bytes.drain(at..end)),
        2 => {
            let copy = bytes[at..end].to_vec();
            bytes.splice(at..at, copy);
        }
        3 | 4 => drop(bytes.splice(at..at, PIECES[random.below(PIECES.len())].bytes())),
        // A word replaced by a piece.
        5 | 6 => {
            let start = bytes[..at].iter().rposition(u8::is_ascii_whitespace).map_or(0, |i| i + 1);
            let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map_or(bytes.len(), |i| at + i);
            drop(bytes.splice(start..end, PIECES[random.below(PIECES.len())].bytes()));
        }
        // A line dropped.
        7 => {
            let start = bytes[..at].iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
            let end = bytes[at..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| at + i + 1);
            drop(bytes.drain(start..end));
        }
        // Lines of another file.
        _ => {
            let other = &seeds[random.below(seeds.len())];
            let other = piece(random, &other.bytes, 400);
            bytes.splice(at..at, other);
        }
    }
}

/// What every validated scene promises.
fn check(scene: &mut Scene) {
    for material in &scene.materials {
        assert!(material.reflectance.iter().all(|rho| (0.0..1.0).contains(rho)));
        assert!(material.exitance_w_m2.iter().all(|m| m.is_finite() && *m >= 0.0));
    }
    for face in &scene.faces {
        let extent = planar::diameter(&face.vertices);
        let plane = planar::plane(&face.vertices).expect("a face has an area");
        assert!(face.vertices.iter().all(|v| v.is_finite()) && plane.area_m2 > 0.0);
        let size = face.vertices.iter().map(|v| v.length()).fold(0.0, f64::max);
        assert!(plane.deviation(&face.vertices) <= 1e-9 * extent + 1e-14 * size, "{face:?}");
    }
    let Cut { surfaces, covered, .. } = cut(scene);
    assert!(surfaces.len() + covered >= scene.faces.len());
    for surface in &surfaces {
        let frame = &surface.frame;
        assert!(surface.area_m2 > 0.0 && surface.area_m2 <= frame.area_m2 * (1.0 + 1e-6), "{surface:?}");
        assert!(frame.u.cross(frame.v).dot(frame.normal) > 0.0, "{surface:?}");
        assert!(surface.outline.len() >= 3, "{surface:?}");
        assert!(
            surface.outline.iter().all(|p| (0.0..=1.0).contains(&p.x) && (0.0..=1.0).contains(&p.y)),
            "{surface:?}"
        );
    }
    assert!(!describe(scene).is_empty());
    // Far from the origin rounding alone can move a face across a threshold.
    let resolved = |face: &Face| {
        let size = face.vertices.iter().map(|v| v.length()).fold(0.0, f64::max);
        planar::diameter(&face.vertices) > 1e-6 * size
    };
    if scene.faces.iter().all(resolved) {
        let faces = scene.faces.len();
        validate(scene);
        assert_eq!(faces, scene.faces.len(), "validating twice changes nothing");
    }
}

fn from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name)
        .map_or(default, |value| value.parse().unwrap_or_else(|_| panic!("{name} is no number")))
}

fn peak_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    line.split_whitespace().next().and_then(|kib| kib.parse().ok()).unwrap_or(0)
}

#[test]
fn mutated_files_do_no_harm() {
    let seeds = seeds();
    let first = from_environment("WRAD_FUZZ_SEED", 1);
    let time = Duration::from_secs(from_environment("WRAD_FUZZ_SECONDS", 5));
    let limits = Limits { faces: 20_000, steps: 200_000 };
    let current = AtomicU64::new(first);
    let (done, is_done) = channel::<()>();
    let (mut inputs, mut accepted, start) = (0u64, 0u64, Instant::now());
    std::thread::scope(|scope| {
        let current = &current;
        // Ends the process when one input takes too long: a hang cannot be unwound.
        scope.spawn(move || {
            let mut seen = (u64::MAX, Instant::now());
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(Duration::from_millis(200)) {
                let now = current.load(Ordering::Relaxed);
                if now != seen.0 {
                    seen = (now, Instant::now());
                } else if seen.1.elapsed() > LONGEST {
                    eprintln!("an input took over {LONGEST:?}; WRAD_FUZZ_SEED={now} repeats it");
                    std::process::abort();
                }
            }
        });
        let _done = done;
        while start.elapsed() < time {
            let seed = first + inputs;
            current.store(seed, Ordering::Relaxed);
            let (path, text) = mutated(&mut Random(seed), &seeds);
            let outcome = catch_unwind(AssertUnwindSafe(|| match parse_within(&text, &path, &limits) {
                Ok(mut scene) => {
                    check(&mut scene);
                    true
                }
                Err(error) => {
                    let mut shown = String::new();
                    write!(shown, "{error}").unwrap();
                    assert_eq!(shown.lines().count(), 1, "{shown}");
                    false
                }
            }));
            match outcome {
                Ok(good) => accepted += u64::from(good),
                Err(_) => panic!("{}: WRAD_FUZZ_SEED={seed} repeats it:\n{text}", path.display()),
            }
            assert!(peak_kib() < LARGEST_KIB, "memory; WRAD_FUZZ_SEED={seed} repeats it");
            inputs += 1;
        }
    });
    println!("{inputs} inputs, {accepted} accepted, peak {} MiB", peak_kib() / 1024);
    assert!(accepted > 0 && accepted < inputs, "mutations should leave some files good");
}
