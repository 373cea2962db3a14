//! The formats a result can be written in, told by the extension of the file's name.

use std::path::Path;

use super::Error;

/// The list of formats for people.
pub(super) const SUPPORTED: &str = ".glb (mesh for viewers), .ply (mesh with radiosity), \
     .vtu (mesh for ParaView), .png (picture), .exr (picture, linear radiance), .wrad (saved solution)";

/// A format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// Binary glTF 2.0: a mesh with vertex colours for viewers.
    Glb,
    /// Stanford polygon file, binary: a mesh with colours and radiosity.
    Ply,
    /// VTK unstructured grid, XML with appended binary data: a mesh with all quantities.
    Vtu,
    /// A picture, tone mapped to sRGB.
    Png,
    /// A picture of linear radiance, 32-bit floating point.
    Exr,
    /// The whole solution, to be rendered or measured later.
    Wrad,
}

impl OutputKind {
    /// The format that `path`'s extension stands for, upper or lower case. Touches no file: ask before a
    /// long solve.
    ///
    /// # Errors
    /// [`Error::UnknownFormat`], listing the supported extensions.
    pub fn from_path(path: &Path) -> Result<OutputKind, Error> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("glb") => Ok(OutputKind::Glb),
            Some("ply") => Ok(OutputKind::Ply),
            Some("vtu") => Ok(OutputKind::Vtu),
            Some("png") => Ok(OutputKind::Png),
            Some("exr") => Ok(OutputKind::Exr),
            Some("wrad") => Ok(OutputKind::Wrad),
            other => {
                let found = match other {
                    Some(extension) => format!("no format is known for the extension .{extension}"),
                    None => "the name has no extension to tell the format by".to_owned(),
                };
                Err(Error::UnknownFormat { path: path.to_owned(), found })
            }
        }
    }

    /// Whether writing it casts rays.
    pub fn is_image(self) -> bool {
        matches!(self, OutputKind::Png | OutputKind::Exr)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_tell_the_format_and_unknown_ones_list_the_known() {
        assert_eq!(OutputKind::from_path(Path::new("a/b.PNG")).unwrap(), OutputKind::Png);
        assert!(OutputKind::from_path(Path::new("b.exr")).unwrap().is_image());
        for name in ["b.jpg", "b", ".glb"] {
            let error = OutputKind::from_path(Path::new(name)).unwrap_err().to_string();
            assert!(error.starts_with(name) && error.contains(".wrad"), "{error}");
        }
    }
}
