//! Binary glTF 2.0: a JSON chunk and a binary chunk, per the Khronos specification, section 4.4.
//!
//! Viewers show the vertex colours as they are (`KHR_materials_unlit`): radiosity times an exposure,
//! linear, clamped to 1. The exposure stands in `asset.extras`, and the radiosity itself in the attribute
//! `_RADIOSITY` for scenes of any bands, mapped to red, green and blue. Axes are the scene's own.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::Mesh;
use super::colour::{ToRgb, luminance, quantile};

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes `mesh` as one primitive.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::InvalidInput`] if the file would pass glTF's limit of 4 GiB.
pub fn write_glb(mesh: &Mesh, name: &str, out: &mut dyn Write) -> io::Result<()> {
    let mut binary = Binary::default();
    let exposure = vertex_exposure(mesh);
    let to_rgb = ToRgb::new(&mesh.bands);
    let bands = mesh.bands.len().max(1);
    let rgb: Vec<[f64; 3]> = mesh.radiosity_w_m2.chunks(bands).map(|b| to_rgb.rgb(b)).collect();
    let colour = |c: &[f64; 3]| c.map(|v| (v * exposure).clamp(0.0, 1.0) as f32);

    let mut attributes = serde_json::Map::new();
    let positions = mesh.positions.iter().map(|p| p.as_vec3().to_array());
    attributes.insert("POSITION".to_owned(), binary.vectors(positions, true));
    let normals = mesh.normals.iter().map(|n| n.as_vec3().to_array());
    attributes.insert("NORMAL".to_owned(), binary.vectors(normals, false));
    attributes.insert("COLOR_0".to_owned(), binary.vectors(rgb.iter().map(colour), false));
    attributes
        .insert("_RADIOSITY".to_owned(), binary.vectors(rgb.iter().map(|c| c.map(|v| v as f32)), false));
    let indices = binary.indices(mesh.triangles.as_flattened());

    let extras = json!({
        "exposure": exposure,
        "colours": "COLOR_0 = exposure x radiosity, linear, clamped to 1",
        "radiosity": "_RADIOSITY in W/m2",
        "bands": mesh.bands,
    });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": 0, "mode": 4 });
    write_chunks(&document(name, extras, primitive, &binary), &binary.bytes, out)
}

/// The JSON chunk.
fn document(name: &str, extras: Value, primitive: Value, binary: &Binary) -> Value {
    let generator = concat!("wrad ", env!("CARGO_PKG_VERSION"));
    let mut document = json!({
        "asset": { "version": "2.0", "generator": generator, "extras": extras },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": name }],
        "meshes": [{ "primitives": [primitive] }],
        "materials": [{
            "name": "radiosity",
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "extensions": { "KHR_materials_unlit": {} },
        }],
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{ "byteLength": binary.bytes.len() }],
    });
    if binary.bytes.is_empty() {
        // glTF has no empty accessors: an empty solution is a scene without a mesh.
        for key in ["meshes", "accessors", "bufferViews", "buffers"] {
            document.as_object_mut().map(|d| d.remove(key));
        }
        document["nodes"] = json!([{ "name": name }]);
    }
    document
}

/// The exposure that shows the 95th percentile of the vertices' luminance at 0.9.
pub(super) fn vertex_exposure(mesh: &Mesh) -> f64 {
    let to_rgb = ToRgb::new(&mesh.bands);
    let bands = mesh.bands.len().max(1);
    let mut values: Vec<f64> = mesh.radiosity_w_m2.chunks(bands).map(|b| luminance(to_rgb.rgb(b))).collect();
    let bright = quantile(&mut values, 0.95);
    if bright > 0.0 { 0.9 / bright } else { 1.0 }
}

#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Binary {
    fn view(&mut self, start: usize, target: u32, accessor: Value) -> Value {
        self.views.push(json!({
            "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start, "target": target,
        }));
        self.accessors.push(accessor);
        json!(self.accessors.len() - 1)
    }

    /// Appends vectors of three; `bounded` states their bounds, which glTF wants for positions.
    fn vectors(&mut self, values: impl Iterator<Item = [f32; 3]>, bounded: bool) -> Value {
        let start = self.bytes.len();
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut count = 0usize;
        for value in values {
            for i in 0..3 {
                low[i] = low[i].min(value[i]);
                high[i] = high[i].max(value[i]);
                self.bytes.extend(value[i].to_le_bytes());
            }
            count += 1;
        }
        let mut accessor = json!({
            "bufferView": self.views.len(), "componentType": FLOAT, "count": count, "type": "VEC3",
        });
        if bounded {
            accessor["min"] = json!(low);
            accessor["max"] = json!(high);
        }
        self.view(start, ARRAY_BUFFER, accessor)
    }

    fn indices(&mut self, values: &[u32]) -> Value {
        let start = self.bytes.len();
        self.bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        let accessor = json!({
            "bufferView": self.views.len(), "componentType": UNSIGNED_INT,
            "count": values.len(), "type": "SCALAR",
        });
        self.view(start, ELEMENT_ARRAY_BUFFER, accessor)
    }
}

fn write_chunks(document: &Value, binary: &[u8], out: &mut dyn Write) -> io::Result<()> {
    let mut text = serde_json::to_vec(document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary_chunk = if binary.is_empty() { 0 } else { 8 + binary.len() };
    let total = u32::try_from(12 + 8 + text.len() + binary_chunk).map_err(|_| {
        let text = "the mesh is larger than 4 GiB, the most a .glb file can hold (.vtu and .ply can hold it)";
        io::Error::new(io::ErrorKind::InvalidInput, text)
    })?;
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&total.to_le_bytes())?;
    out.write_all(&(text.len() as u32).to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    if !binary.is_empty() {
        // Every value is 4 bytes: the chunk needs no padding.
        out.write_all(&(binary.len() as u32).to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        out.write_all(binary)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Basis;
    use crate::output::rooms;

    #[test]
    fn an_unrelated_reader_finds_the_mesh_its_colours_and_the_exposure() {
        let mesh = Mesh::new(&rooms::gallery(Basis::M2, 4, 2)).unwrap();
        let mut bytes = Vec::new();
        write_glb(&mesh, "gallery", &mut bytes).unwrap();
        let glb = gltf::Gltf::from_slice(&bytes).unwrap();
        assert!(glb.materials().next().unwrap().unlit());
        let asset = &glb.document.as_json().asset;
        let extras: Value = serde_json::from_str(asset.extras.as_ref().unwrap().get()).unwrap();
        let exposure = extras["exposure"].as_f64().unwrap();
        let primitive = glb.meshes().next().unwrap().primitives().next().unwrap();
        let blob = glb.blob.as_deref();
        let reader = primitive.reader(|_| blob);
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let colours: Vec<[f32; 3]> = reader.read_colors(0).unwrap().into_rgb_f32().collect();
        assert_eq!(indices, mesh.triangles.as_flattened());
        for (v, (position, colour)) in positions.iter().zip(&colours).enumerate() {
            assert!((mesh.positions[v].as_vec3() - glam::Vec3::from_array(*position)).length() < 1e-6);
            let expected = (mesh.radiosity_w_m2[3 * v] * exposure).clamp(0.0, 1.0);
            assert!((f64::from(colour[0]) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn an_empty_mesh_is_a_valid_file() {
        let mut bytes = Vec::new();
        write_glb(&Mesh::default(), "empty", &mut bytes).unwrap();
        assert_eq!(gltf::Gltf::from_slice(&bytes).unwrap().meshes().count(), 0);
    }
}
