//! The rule of the house: a room imports only rooms above it, and nothing in `src` is unsafe.

use std::path::{Path, PathBuf};

/// The rooms from the top down; each may import those before it.
const ROOMS: [&str; 9] =
    ["math", "scene", "visibility", "transport", "radiosity", "schedule", "study", "output", "cli"];

/// All source files below `folder`.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn source_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The code of a file: line comments blanked, and everything from the tests at its foot on left out, for tests may borrow
/// from any room.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    text.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// The first segments of all paths that start at `root`, groups in braces included.
fn imports(code: &str, root: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices(root) {
        let starts_a_word = !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let rest = code[at + root.len()..].trim_start();
        if starts_a_word {
            match rest.strip_prefix('{') {
                Some(group) => found.extend(group_heads(group)),
                None => found.extend(word(rest)),
            }
        }
    }
    found
}

fn word(text: &str) -> Option<String> {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    (end > 0).then(|| text[..end].to_owned())
}

/// The first words of the entries of a group whose brace is open.
fn group_heads(group: &str) -> Vec<String> {
    let (mut heads, mut depth, mut start) = (Vec::new(), 0, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' | ',' if depth == 0 => {
                heads.extend(word(group[start..at].trim_start()));
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            '}' => depth -= 1,
            _ => {}
        }
    }
    heads
}

#[test]
fn rooms_import_only_rooms_above_them() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for path in sources(&source_folder()) {
        let inside = path.strip_prefix(source_folder()).unwrap().to_owned();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy().into_owned();
        let room = first.trim_end_matches(".rs");
        if room == "lib" || room == "main" {
            continue;
        }
        let place = ROOMS.iter().position(|known| *known == room);
        let place = place.unwrap_or_else(|| panic!("{}: {room} is no room of the house", inside.display()));
        for import in imports(&code(&path), "crate::") {
            match ROOMS.iter().position(|known| *known == import) {
                Some(imported) if imported <= place => seen += 1,
                Some(_) => {
                    wrong.push(format!("{}: {room} imports {import}, which is below it", inside.display()))
                }
                None => wrong.push(format!("{}: crate::{import} is no room", inside.display())),
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(seen > 50, "only {seen} imports were recognised: has their form changed?");
}

#[test]
fn nothing_in_the_library_is_unsafe() {
    let library = std::fs::read_to_string(source_folder().join("lib.rs")).unwrap();
    assert!(library.contains("#![forbid(unsafe_code)]"));
    for path in sources(&source_folder()) {
        let words = code(&path);
        let mut words = words.split(|c: char| !c.is_alphanumeric() && c != '_');
        assert!(words.all(|word| word != "unsafe"), "{}: unsafe stands only in numa", path.display());
    }
}

#[test]
fn every_file_opens_with_its_job() {
    for path in sources(&source_folder()) {
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("//! "), "{}: a file opens with its one job", path.display());
    }
}

#[test]
fn imports_are_recognised_in_all_their_forms() {
    let code = "use crate::math::{Basis, cell::Cell};\nuse crate::{scene::{self, Face}, output};\n\
                let x = crate::visibility::Bvh::new(); use mycrate::study;";
    assert_eq!(imports(code, "crate::"), ["math", "scene", "output", "visibility"]);
}
