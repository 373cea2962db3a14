//! Saved solutions (`.wrad`): a header of 24 bytes, then the solution in postcard's binary form.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `WRADSOL` and a line feed, which a transfer in text mode would spoil |
//! | 4 | version of the form, little-endian |
//! | 8 | length of what follows the header |
//! | 4 | CRC-32 of what follows the header |
//!
//! Bytes from anywhere can be read: they give a solution every other room can rely on, or an error.

use std::io::{self, Write};
use std::path::Path;

use super::{Error, validate};
use crate::radiosity::Solution;

const MAGIC: &[u8; 8] = b"WRADSOL\n";
/// Raised whenever `Solution` or what it holds changes.
const VERSION: u32 = 1;
const HEADER: usize = 24;

const SOLVE_AGAIN: &str = "save it again with `wrad solve … --out FILE.wrad`";

/// Writes a solution.
///
/// # Errors
/// Those of `out`.
pub fn write_solution(solution: &Solution, out: &mut dyn Write) -> io::Result<()> {
    let payload = postcard::to_stdvec(solution).map_err(io::Error::other)?;
    out.write_all(MAGIC)?;
    out.write_all(&VERSION.to_le_bytes())?;
    out.write_all(&(payload.len() as u64).to_le_bytes())?;
    out.write_all(&crc32fast::hash(&payload).to_le_bytes())?;
    out.write_all(&payload)
}

/// Saves a solution, whole or not at all.
///
/// # Errors
/// [`Error::Io`].
pub fn save(solution: &Solution, path: &Path) -> Result<(), Error> {
    super::write_atomically(path, |out| write_solution(solution, out))
}

/// Loads a solution.
///
/// # Errors
/// [`Error::Io`], or [`Error::Solution`] where the file is not one, is damaged, of another version, or
/// contradicts itself.
pub fn load(path: &Path) -> Result<Solution, Error> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    read_solution(&bytes).map_err(|(problem, remedy)| Error::Solution {
        path: path.to_owned(),
        problem,
        remedy,
    })
}

/// The solution in `bytes`, or what is wrong with them and what to do.
fn read_solution(bytes: &[u8]) -> Result<Solution, (String, &'static str)> {
    if bytes.len() < MAGIC.len() || &bytes[..MAGIC.len()] != MAGIC {
        let problem = "not a saved solution: it does not begin as one".to_owned();
        return Err((problem, "name a .wrad file, or give a scene to a command that takes scenes"));
    }
    let Some((header, payload)) = bytes.split_at_checked(HEADER) else {
        return Err((format!("cut off after {} bytes, in the header", bytes.len()), SOLVE_AGAIN));
    };
    let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
    let version = u32_at(8);
    if version != VERSION {
        let problem = format!("saved in version {version} of the form; this program reads version {VERSION}");
        return Err((problem, "save it again with this version of wrad"));
    }
    let length = u64::from_le_bytes(std::array::from_fn(|i| header[12 + i]));
    if length != payload.len() as u64 {
        let problem =
            format!("damaged: {} bytes after the header where {length} were written", payload.len());
        return Err((problem, "copy it again from where it was saved"));
    }
    if crc32fast::hash(payload) != u32_at(20) {
        return Err((
            "damaged: its checksum does not match".to_owned(),
            "copy it again from where it was saved",
        ));
    }
    decode(payload).map_err(|problem| (problem, SOLVE_AGAIN))
}

fn decode(payload: &[u8]) -> Result<Solution, String> {
    let (solution, rest) =
        postcard::take_from_bytes::<Solution>(payload).map_err(|e| format!("not a solution inside: {e}"))?;
    if !rest.is_empty() {
        return Err(format!("not a solution inside: {} bytes are left over", rest.len()));
    }
    validate::check(&solution)?;
    Ok(solution)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    fn saved() -> Vec<u8> {
        let mut bytes = Vec::new();
        write_solution(&rooms::gallery(Basis::M2, 3, 7), &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn what_is_saved_is_loaded_again() {
        let solution = rooms::gallery(Basis::M3, 4, 8);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.wrad");
        save(&solution, &path).unwrap();
        let loaded = load(&path).unwrap();
        assert_eq!(loaded.fields, solution.fields);
        assert_eq!(loaded.surfaces, solution.surfaces);
        assert_eq!(loaded.scene.cameras, solution.scene.cameras);
        assert_eq!(loaded.error_estimate, solution.error_estimate);
    }

    #[test]
    fn every_truncation_and_version_is_refused_by_name() {
        let bytes = saved();
        for length in (0..64).chain((64..bytes.len()).step_by(97)) {
            assert!(read_solution(&bytes[..length]).is_err(), "{length} bytes");
        }
        let mut other = bytes.clone();
        other[8] = 99;
        let (problem, remedy) = read_solution(&other).unwrap_err();
        assert!(problem.contains("version 99") && remedy.contains("save it again"));
        let (problem, _) = read_solution(b"#Inventor V2.1 ascii").unwrap_err();
        assert!(problem.starts_with("not a saved solution"));
        let missing = load(Path::new("/nowhere/a.wrad")).unwrap_err().to_string();
        assert!(missing.contains("/nowhere/a.wrad: cannot read"), "{missing}");
    }

    proptest! {
        /// The checksum is bypassed: what passes the checks can be meshed and looked at without panic or
        /// endless work.
        #[test]
        fn mutated_solutions_are_refused_or_safe(
            changes in proptest::collection::vec((0.0..1.0f64, any::<u8>()), 1..4),
        ) {
            let mut payload = saved().split_off(HEADER);
            for (place, value) in changes {
                let at = (place * payload.len() as f64) as usize;
                payload[at] = value;
            }
            if let Ok(solution) = decode(&payload) {
                let mesh = crate::output::Mesh::new(&solution);
                prop_assert!(mesh.is_ok());
                let mut values = vec![0.0; solution.scene.bands.len()];
                for i in 0..solution.surfaces.len() {
                    solution.radiosity(i, glam::DVec2::splat(0.4), &mut values);
                }
            }
        }
    }
}
