//! VTK's unstructured grids (`.vtu`) for ParaView: XML whose arrays stand raw, little-endian, in one
//! appended block.
//!
//! Point data: `radiosity` and `irradiance` in W/m², one component per band. Cell data, constant over the
//! triangles of one leaf: `irradiance_mean`, `surface`, `face`, `level`, `element`, `element_area`.

use std::io::{self, Write};

use super::Mesh;

/// VTK's number for a triangle.
const VTK_TRIANGLE: u8 = 5;

/// Writes `mesh`.
///
/// # Errors
/// Those of `out`.
pub fn write_vtu(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let points = point_arrays(mesh);
    let cells = cell_arrays(mesh);
    let mut offset = 0u64;
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    write!(out, "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\"")?;
    writeln!(out, " byte_order=\"LittleEndian\" header_type=\"UInt64\">")?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    writeln!(out, "<UnstructuredGrid>")?;
    writeln!(out, "<Piece NumberOfPoints=\"{vertices}\" NumberOfCells=\"{triangles}\">")?;
    for (section, arrays) in [
        ("PointData", &points[1..]),
        ("CellData", &cells[3..]),
        ("Points", &points[..1]),
        ("Cells", &cells[..3]),
    ] {
        writeln!(out, "<{section}>")?;
        for array in arrays {
            array.declare(&mut offset, out)?;
        }
        writeln!(out, "</{section}>")?;
    }
    writeln!(out, "</Piece>\n</UnstructuredGrid>")?;
    write!(out, "<AppendedData encoding=\"raw\">\n_")?;
    for array in points[1..].iter().chain(&cells[3..]).chain(&points[..1]).chain(&cells[..3]) {
        array.append(out)?;
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")
}

type Writer<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

/// An array to be appended; values are made when written, for a mesh may be most of the memory.
struct Array<'a> {
    name: &'static str,
    components: &'a [String],
    width: usize,
    kind: &'static str,
    bytes: u64,
    write: Writer<'a>,
}

impl Array<'_> {
    fn declare(&self, offset: &mut u64, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "<DataArray type=\"{}\" Name=\"{}\"", self.kind, self.name)?;
        write!(out, " NumberOfComponents=\"{}\"", self.width)?;
        for (i, name) in self.components.iter().enumerate() {
            write!(out, " ComponentName{i}=\"{}\"", escape(name))?;
        }
        writeln!(out, " format=\"appended\" offset=\"{offset}\"/>")?;
        *offset += 8 + self.bytes;
        Ok(())
    }

    fn append(&self, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&self.bytes.to_le_bytes())?;
        (self.write)(out)
    }
}

fn array<'a, const N: usize, I: Iterator<Item = [u8; N]> + 'a>(
    name: &'static str,
    kind: &'static str,
    (components, width): (&'a [String], usize),
    count: usize,
    values: impl Fn() -> I + 'a,
) -> Array<'a> {
    let write = move |out: &mut dyn Write| values().try_for_each(|bytes| out.write_all(&bytes));
    Array { name, components, width, kind, bytes: (count * N) as u64, write: Box::new(write) }
}

fn floats<'a>(name: &'static str, mesh: &'a Mesh, values: &'a [f64]) -> Array<'a> {
    let bytes = move || values.iter().map(|v| (*v as f32).to_le_bytes());
    array(name, "Float32", (&mesh.bands, mesh.bands.len()), values.len(), bytes)
}

fn point_arrays(mesh: &Mesh) -> Vec<Array<'_>> {
    let positions = || mesh.positions.iter().flat_map(|p| p.to_array()).map(f64::to_le_bytes);
    vec![
        array("Points", "Float64", (&[], 3), 3 * mesh.positions.len(), positions),
        floats("radiosity", mesh, &mesh.radiosity_w_m2),
        floats("irradiance", mesh, &mesh.irradiance_w_m2),
    ]
}

fn cell_arrays(mesh: &Mesh) -> Vec<Array<'_>> {
    let (n, bands) = (mesh.triangles.len(), mesh.bands.len());
    let corners = || mesh.triangles.as_flattened().iter().map(|v| i64::from(*v).to_le_bytes());
    let ends = move || (1..=n as i64).map(|i| (3 * i).to_le_bytes());
    let of_element = |name, value: fn(&super::mesh::Element) -> u32| {
        let values = move || {
            let elements = mesh.triangle_element.iter().map(|e| &mesh.elements[*e as usize]);
            elements.map(move |e| value(e).to_le_bytes())
        };
        array(name, "UInt32", (&[], 1), n, values)
    };
    let mean = move || {
        let elements = mesh.triangle_element.iter().map(|e| *e as usize);
        let values = elements.flat_map(move |e| &mesh.element_irradiance_w_m2[e * bands..(e + 1) * bands]);
        values.map(|v| (*v as f32).to_le_bytes())
    };
    let areas = || {
        let elements = mesh.triangle_element.iter().map(|e| &mesh.elements[*e as usize]);
        elements.map(|e| (e.area_m2 as f32).to_le_bytes())
    };
    vec![
        array("connectivity", "Int64", (&[], 1), 3 * n, corners),
        array("offsets", "Int64", (&[], 1), n, ends),
        array("types", "UInt8", (&[], 1), n, move || (0..n).map(|_| [VTK_TRIANGLE])),
        array("irradiance_mean", "Float32", (&mesh.bands, bands), n * bands, mean),
        of_element("surface", |e| e.surface),
        of_element("face", |e| e.face),
        of_element("level", |e| e.level),
        array("element", "UInt32", (&[], 1), n, || mesh.triangle_element.iter().map(|e| e.to_le_bytes())),
        array("element_area", "Float32", (&[], 1), n, areas),
    ]
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use base64::Engine;
    use vtkio::model::{Attribute, DataSet, Piece, VertexNumbers, Vtk};

    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    /// The same file with its raw block in base 64, which is all the reader below takes.
    fn in_base_64(bytes: &[u8]) -> Vec<u8> {
        let marker = b"<AppendedData encoding=\"raw\">\n_";
        let at = bytes.windows(marker.len()).position(|w| w == marker).unwrap();
        let (head, block) = (std::str::from_utf8(&bytes[..at]).unwrap(), &bytes[at + marker.len()..]);
        let (mut text, mut encoded, mut end) = (String::new(), String::new(), 0);
        for (i, part) in head.split("offset=\"").enumerate() {
            if i == 0 {
                text.push_str(part);
                continue;
            }
            let (offset, rest) = part.split_once('"').unwrap();
            let offset: usize = offset.parse().unwrap();
            assert_eq!(offset, end, "arrays follow each other without gaps");
            let length = u64::from_le_bytes(block[offset..offset + 8].try_into().unwrap()) as usize;
            end = offset + 8 + length;
            text.push_str(&format!("offset=\"{}\"{rest}", encoded.len()));
            encoded.push_str(&base64::engine::general_purpose::STANDARD.encode(&block[offset..end]));
        }
        assert_eq!(&block[end..], b"\n</AppendedData>\n</VTKFile>\n");
        format!("{text}<AppendedData encoding=\"base64\">_{encoded}</AppendedData></VTKFile>").into_bytes()
    }

    #[test]
    fn an_unrelated_reader_finds_points_cells_and_data() {
        let mesh = Mesh::new(&rooms::gallery(Basis::M2, 4, 4)).unwrap();
        let mut bytes = Vec::new();
        write_vtu(&mesh, &mut bytes).unwrap();
        let vtk = Vtk::parse_xml(in_base_64(&bytes).as_slice()).unwrap();
        let DataSet::UnstructuredGrid { pieces, .. } = vtk.data else { panic!("not a grid") };
        let Piece::Inline(piece) = &pieces[0] else { panic!("not inline") };
        let points: Vec<f64> = piece.points.clone().into_vec().unwrap();
        let expected: Vec<f64> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
        assert_eq!(points, expected);
        assert!(piece.cells.types.iter().all(|t| *t as u8 == VTK_TRIANGLE));
        let VertexNumbers::XML { connectivity, offsets } = &piece.cells.cell_verts else { panic!("legacy") };
        assert!(connectivity.iter().zip(mesh.triangles.as_flattened()).all(|(a, b)| *a == u64::from(*b)));
        assert_eq!(offsets.last(), Some(&(3 * mesh.triangles.len() as u64)));
        let find = |list: &[Attribute], name: &str| -> Vec<f32> {
            let found = list.iter().find_map(|a| match a {
                Attribute::DataArray(array) if array.name == name => array.data.clone().cast_into(),
                _ => None,
            });
            found.unwrap_or_else(|| panic!("no array {name}"))
        };
        let radiosity = find(&piece.data.point, "radiosity");
        assert!(radiosity.iter().zip(&mesh.radiosity_w_m2).all(|(a, b)| *a == *b as f32));
        assert_eq!(find(&piece.data.point, "irradiance").len(), mesh.irradiance_w_m2.len());
        for name in ["surface", "face", "level", "element", "element_area"] {
            assert_eq!(find(&piece.data.cell, name).len(), mesh.triangles.len(), "{name}");
        }
        assert_eq!(find(&piece.data.cell, "irradiance_mean").len(), 3 * mesh.triangles.len());
    }
}
