//! `File`, `WWWInline` and `Inline` nodes: other files, sought beside the one that names them.
//!
//! A missing file is counted and the traversal goes on, as Inventor does; a file that is there but faulty is
//! an error in that file; a file that includes itself is an error at the node that closes the circle.

use std::path::{Path, PathBuf};

use super::state::State;
use super::walk::{Here, Walker};
use crate::scene::read::ReadError;

const MISSING: &str = "included file missing, left out";

/// Visits the file named by the node.
pub(super) fn visit(walker: &mut Walker, here: Here, state: &mut State) -> Result<(), ReadError> {
    // Dear, because every visit asks the file system.
    walker.charge(here, 100)?;
    let node = here.node;
    let names = [node.strings("name"), node.strings("url")].concat();
    let Some(name) = names.iter().find(|name| !name.is_empty()) else { return Ok(()) };
    if name.contains("://") {
        walker.scene.findings.skip("include of a remote file");
        return Ok(());
    }
    let Some(path) = find(&here.document.path, name) else {
        walker.scene.findings.repair(MISSING, || format!("{}: {name}", here.place()));
        return Ok(());
    };
    if walker.including.contains(&path) {
        return Err(here.error(
            "a file that does not include itself",
            format!("`{}`, which is being read already", path.display()),
            "break the circle of includes",
        ));
    }
    let number = match walker.included.get(&path) {
        Some(number) => *number,
        None => {
            let document = super::load(&path)?;
            let number = walker.add(document);
            walker.included.insert(path.clone(), number);
            number
        }
    };
    walker.including.push(path);
    walker.document(number, state)?;
    walker.including.pop();
    Ok(())
}

/// The canonical path of a regular file called `name` beside `from`.
fn find(from: &Path, name: &str) -> Option<PathBuf> {
    let beside = from.parent().unwrap_or(Path::new("")).join(name);
    let path = beside.canonicalize().ok()?;
    path.is_file().then_some(path)
}
