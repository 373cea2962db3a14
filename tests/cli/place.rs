//! Where commands run: a directory with a small scene in it.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

pub const CORNELL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.iv");

/// A directory with a small scene in it: a box with a lamp below its ceiling.
pub struct Place {
    directory: TempDir,
}

impl Place {
    pub fn new() -> Place {
        let place = Place { directory: tempfile::tempdir().unwrap() };
        place.put("box.iv", &box_scene("0.7 0.5 0.3", true));
        place
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    pub fn put(&self, name: &str, text: &str) {
        std::fs::write(self.at(name), text).unwrap();
    }

    pub fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wrad"));
        command.current_dir(self.directory.path()).args(arguments.split_whitespace()).stdin(Stdio::null());
        command
    }

    /// Runs in the directory: exit code, standard output, standard error.
    pub fn run(&self, arguments: &str) -> (i32, String, String) {
        let Output { status, stdout, stderr } = self.command(arguments).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (status.code().unwrap(), text(stdout), text(stderr))
    }

    /// Files in the directory, hidden ones included.
    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.directory.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// A unit box seen from inside; with a lamp, its lower half is hidden from the ceiling by a shelf.
pub fn box_scene(reflectance: &str, furnished: bool) -> String {
    let points = "0 0 0, 1 0 0, 1 1 0, 0 1 0, 0 0 1, 1 0 1, 1 1 1, 0 1 1, \
                  0.3 0.3 0.5, 0.7 0.3 0.5, 0.7 0.7 0.5, 0.3 0.7 0.5";
    let walls = "0 1 2 3 -1 4 7 6 5 -1 0 4 5 1 -1 2 6 7 3 -1 0 3 7 4 -1 1 5 6 2 -1";
    let shelf = if furnished { "8 9 10 11 -1 8 11 10 9 -1" } else { "" };
    format!(
        "#Inventor V2.1 ascii\nSeparator {{\n\
         ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID }}\n\
         Coordinate3 {{ point [ {points} ] }}\n\
         Material {{ diffuseColor {reflectance} }}\n\
         IndexedFaceSet {{ coordIndex [ {walls} {shelf} ] }}\n\
         Translation {{ translation 0 0 -0.001 }}\n\
         Material {{ diffuseColor 0 0 0 emissiveColor 10 10 10 }}\n\
         Coordinate3 {{ point [ 0.4 0.4 1, 0.4 0.6 1, 0.6 0.6 1, 0.6 0.4 1 ] }}\n\
         IndexedFaceSet {{ coordIndex [ 0 1 2 3 -1 ] }}\n\
         }}\n"
    )
}

pub const PROBES: &str =
    "name,x,y,z,nx,ny,nz\nfloor,0.1,0.5,0,0,0,1\nwall,0,0.5,0.7,3,0,0\nfree,0.5,0.5,0.25,0,0,1\n";
