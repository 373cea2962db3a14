//! A drawing as an Open Inventor file, in the conventions of `scenes/`: metres, one-sided faces, `diffuseColor` the reflectance,
//! `emissiveColor` the exitance in W/m².

use std::collections::HashMap;
use std::io::{self, Write};

use glam::{DMat3, DQuat, DVec3};

use super::Drawing;
use super::sketch::{Part, View};

/// Digits after the point: nanometres.
const GRID: f64 = 1e9;

impl Drawing {
    /// Writes it as Open Inventor V2.1 text.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let (name, surfaces) = (self.subject.name(), self.surfaces());
        let shuffle = if self.shuffled { " --shuffle" } else { "" };
        writeln!(out, "#Inventor V2.1 ascii")?;
        writeln!(
            out,
            "# {name}: exitance in emissiveColor (W/m^2), Lambertian reflectance in diffuseColor, lengths in metres"
        )?;
        writeln!(out, "# {surfaces} surfaces, {} of them lights", self.lights())?;
        writeln!(out, "# wrad generate {name} --surfaces {surfaces} --seed {}{shuffle}", self.seed)?;
        writeln!(out, "Separator {{")?;
        for view in &self.views {
            write_view(view, out)?;
        }
        writeln!(
            out,
            "  ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID faceType UNKNOWN_FACE_TYPE }}"
        )?;
        for part in &self.parts {
            write_part(part, out)?;
        }
        writeln!(out, "}}")
    }
}

/// A perspective camera; without turning it looks along −z with y up.
fn write_view(view: &View, out: &mut dyn Write) -> io::Result<()> {
    let forward = (view.target - view.eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let turn = DQuat::from_mat3(&DMat3::from_cols(right, right.cross(forward), -forward));
    let (axis, angle) = turn.to_axis_angle();
    writeln!(
        out,
        "  DEF {} PerspectiveCamera {{ position {} orientation {} {} heightAngle {} }}",
        view.name,
        Shown(view.eye),
        Shown(axis),
        rounded(angle),
        rounded(view.degrees.to_radians()),
    )
}

fn write_part(part: &Part, out: &mut dyn Write) -> io::Result<()> {
    let (mut points, mut numbers) = (Vec::new(), HashMap::new());
    let mut indices = String::new();
    for vertex in part.faces.iter().flat_map(|face| face.iter().map(Some).chain([None])) {
        let index = vertex.map(|v| {
            let shown = Shown(*v).to_string();
            *numbers.entry(shown.clone()).or_insert_with(|| {
                points.push(shown);
                points.len() - 1
            })
        });
        indices += &index.map_or("-1, ".to_owned(), |i| format!("{i}, "));
    }
    let Part { name, paint, .. } = part;
    let (rho, m) = (DVec3::from(paint.reflectance), DVec3::from(paint.exitance_w_m2));
    writeln!(out, "  DEF {name} Separator {{")?;
    writeln!(out, "    Material {{ diffuseColor {} emissiveColor {} }}", Shown(rho), Shown(m))?;
    writeln!(out, "    Coordinate3 {{ point [ {} ] }}", points.join(", "))?;
    writeln!(out, "    IndexedFaceSet {{ coordIndex [ {} ] }}", indices.trim_end_matches(", "))?;
    writeln!(out, "  }}")
}

/// Three numbers as the file holds them.
struct Shown(DVec3);

impl std::fmt::Display for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let [x, y, z] = self.0.to_array().map(rounded);
        write!(f, "{x} {y} {z}")
    }
}

/// Rounded to the grid; `+ 0.0` makes −0 and 0 alike.
fn rounded(x: f64) -> f64 {
    (x * GRID).round() / GRID + 0.0
}
