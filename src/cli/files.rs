//! Are the files of a run usable together? Asked before anything is computed.

use std::path::{Path, PathBuf};

use super::Error;

/// Refuses results that would overwrite an input or each other, and places that do not exist.
///
/// # Errors
/// [`Error::Input`] naming the file.
pub(super) fn check(inputs: &[&Path], results: &[&Path]) -> Result<(), Error> {
    let refuse = |path: &Path, why: &str| Err(Error::Input(format!("{}: {why}", path.display())));
    let inputs: Vec<PathBuf> = inputs.iter().map(|path| place(path)).collect();
    let mut taken = Vec::new();
    for path in results {
        if path.as_os_str().is_empty() {
            return Err(Error::Input("a result needs the name of a file; an empty one was given".to_owned()));
        }
        if path.is_dir() {
            return refuse(path, "this is a directory; name a file in it");
        }
        let directory = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        if !directory.is_dir() {
            return refuse(path, "its directory does not exist; create it first");
        }
        let place = place(path);
        if inputs.contains(&place) {
            return refuse(path, "the result would overwrite the input; choose another name");
        }
        if taken.contains(&place) && !is_device(path) {
            return refuse(path, "two results have this name; choose another for one of them");
        }
        taken.push(place);
    }
    Ok(())
}

/// The path without links and detours, so that two names of a file are equal.
fn place(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => {
            let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
            parent.canonicalize().map_or_else(|_| path.to_owned(), |parent| parent.join(name))
        }
        _ => path.to_owned(),
    })
}

fn is_device(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| !found.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn collisions_and_missing_places_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        std::fs::write(at("scene.iv"), "").unwrap();
        let refused = |inputs: &[&Path], results: &[&Path]| check(inputs, results).unwrap_err().to_string();
        assert!(check(&[&at("scene.iv")], &[&at("a.png"), &at("b.png")]).is_ok());
        assert!(refused(&[&at("scene.iv")], &[&at("./scene.iv")]).contains("overwrite the input"));
        assert!(refused(&[], &[&at("a.png"), &at("../").join(at("a.png"))]).contains("two results"));
        assert!(refused(&[], &[&at("none/a.png")]).contains("create it first"));
        assert!(refused(&[], &[directory.path()]).contains("is a directory"));
        assert!(refused(&[], &[Path::new("")]).contains("empty"));
    }
}
