//! Open Inventor ASCII (V1.0, V2.0, V2.1), VRML 1.0, and the static part of VRML97.
//!
//! Text → tokens (`lexer`) → a graph of nodes (`grammar`, `document`) → a traversal that carries the state
//! (`walk`, `state`) → faces, lights and cameras in world coordinates (`shapes`, `lights`).
//!
//! How nodes are understood: `diffuseColor` is the reflectance and `emissiveColor` the exitance in W/m² of
//! each band; `vertexOrdering` says which side of a face is its front, and a mirroring transformation keeps
//! it; only a face whose ordering is known and whose shape is `SOLID` is one-sided. What has no meaning for
//! radiosity is parsed, skipped and counted.

use std::path::Path;

use self::lexer::Fault;
use self::state::State;
use self::walk::Walker;
use super::{ReadError, decode, name_of};
use crate::scene::{Scene, validate};

mod document;
mod grammar;
mod include;
mod lexer;
mod lights;
mod polygons;
mod schema;
mod shapes;
mod solids;
mod state;
mod statements97;
mod transforms;
mod values;
mod walk;

/// What one file, with all it includes and instances, may grow to.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Faces, lights and cameras together.
    pub faces: usize,
    /// Nodes visited and indices read.
    pub steps: u64,
}

impl Default for Limits {
    /// Eight times the largest scene known to be in use (250,000 triangles): some 1.5 GB and six seconds.
    fn default() -> Self {
        Limits { faces: 2_000_000, steps: 20_000_000 }
    }
}

/// Reads the text of a scene file; `path` is named in messages, and includes are sought beside it. The scene
/// is validated.
pub fn parse(text: &str, path: &Path) -> Result<Scene, ReadError> {
    parse_within(text, path, &Limits::default())
}

/// [`parse`] with other limits.
pub fn parse_within(text: &str, path: &Path, limits: &Limits) -> Result<Scene, ReadError> {
    let document = document(text.to_owned(), path)?;
    let scene =
        Scene { name: name_of(path), bands: ["r", "g", "b"].map(str::to_owned).to_vec(), ..Scene::default() };
    let mut walker = Walker::new(limits, scene);
    walker.including.extend(path.canonicalize());
    let root = walker.add(document);
    walker.document(root, &mut State::default())?;
    let Walker { mut scene, origins, documents, .. } = walker;
    validate::validate_at(&mut scene, &|face| {
        let (document, at) = origins[face];
        documents[document as usize].place(at)
    });
    Ok(scene)
}

/// Reads and parses an included file.
fn load(path: &Path) -> Result<document::Document, ReadError> {
    document(decode(path, std::fs::read(path).map_err(|source| ReadError::io(path, source))?)?, path)
}

fn document(text: String, path: &Path) -> Result<document::Document, ReadError> {
    let text = text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text);
    let error = |text: &str, fault: Fault| {
        ReadError::at(path, text, fault.at, fault.expected, fault.found, fault.remedy)
    };
    let vrml97 = header(&text).map_err(|fault| error(&text, fault))?;
    grammar::parse(text, path, vrml97).map_err(|(text, fault)| error(&text, fault))
}

/// Checks the first line; whether it announces VRML97.
fn header(text: &str) -> Result<bool, Fault> {
    let line = text.lines().next().unwrap_or_default();
    let line = line.split('\r').next().unwrap_or_default();
    let words: Vec<&str> = line.split_whitespace().collect();
    let remedy = match words[..] {
        ["#Inventor", "V1.0" | "V2.0" | "V2.1", "ascii", ..] | ["#VRML", "V1.0", "ascii", ..] => {
            return Ok(false);
        }
        ["#VRML", "V2.0", "utf8", ..] => return Ok(true),
        ["#Inventor", _, "binary", ..] => {
            "convert it to text with `ivcat -o OUT.iv IN.iv` of SGI's Open Inventor (Debian package inventor-clients)"
        }
        ["#Inventor" | "#VRML", ..] => "convert the file to one of these versions",
        _ => "name a scene file, or give it the header of its version",
    };
    let found = match words.is_empty() {
        true => "an empty line".to_owned(),
        false => lexer::Token::Word(line.trim_end()).shown(),
    };
    Err(Fault::new(
        0,
        "`#Inventor V2.1 ascii` (or V2.0, V1.0), `#VRML V1.0 ascii` or `#VRML V2.0 utf8`",
        found,
        remedy,
    ))
}
