//! Stanford polygon files, binary little-endian: positions, sRGB colours, radiosity per band, triangles.

use std::io::{self, Write};

use super::Mesh;
use super::colour::{ToRgb, srgb8};
use super::glb::vertex_exposure;

/// Writes `mesh`; a comment in the header states the exposure of the colours.
///
/// # Errors
/// Those of `out`.
pub fn write_ply(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let exposure = vertex_exposure(mesh);
    let to_rgb = ToRgb::new(&mesh.bands);
    let bands = mesh.bands.len();
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment wrad {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "comment radiosity in W/m2, colours are sRGB of {exposure:e} times radiosity")?;
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    for property in ["float x", "float y", "float z", "float nx", "float ny", "float nz"] {
        writeln!(out, "property {property}")?;
    }
    for property in ["red", "green", "blue"] {
        writeln!(out, "property uchar {property}")?;
    }
    for band in &mesh.bands {
        writeln!(out, "property float radiosity_{}", identifier(band))?;
    }
    writeln!(out, "element face {}", mesh.triangles.len())?;
    writeln!(out, "property list uchar uint vertex_indices\nend_header")?;
    for (v, (position, normal)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        let radiosity = &mesh.radiosity_w_m2[v * bands..(v + 1) * bands];
        for value in position.to_array().into_iter().chain(normal.to_array()) {
            out.write_all(&(value as f32).to_le_bytes())?;
        }
        out.write_all(&to_rgb.rgb(radiosity).map(|c| srgb8(c * exposure)))?;
        for value in radiosity {
            out.write_all(&(*value as f32).to_le_bytes())?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for corner in triangle {
            out.write_all(&corner.to_le_bytes())?;
        }
    }
    Ok(())
}

/// A band's name fit for a header of words.
fn identifier(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};

    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    #[test]
    fn an_unrelated_reader_finds_vertices_radiosity_and_triangles() {
        let mesh = Mesh::new(&rooms::gallery(Basis::M3, 3, 3)).unwrap();
        let mut bytes = Vec::new();
        write_ply(&mesh, &mut bytes).unwrap();
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        let (vertices, faces) = (&ply.payload["vertex"], &ply.payload["face"]);
        assert_eq!((vertices.len(), faces.len()), (mesh.positions.len(), mesh.triangles.len()));
        for (v, vertex) in vertices.iter().enumerate() {
            let float = |name: &str| match vertex[name] {
                Property::Float(value) => f64::from(value),
                ref other => panic!("{name} is {other:?}"),
            };
            assert!((float("y") - mesh.positions[v].y).abs() < 1e-6);
            assert!((float("radiosity_g") - mesh.radiosity_w_m2[3 * v + 1]).abs() < 1e-5);
            assert!(matches!(vertex["blue"], Property::UChar(_)));
        }
        for (face, triangle) in faces.iter().zip(&mesh.triangles) {
            assert_eq!(face["vertex_indices"].to_u32_list().unwrap(), triangle);
        }
    }
}
