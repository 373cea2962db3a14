//! Shapes made of vertices → polygons as lists of corners: `FaceSet`, `IndexedFaceSet`, strips and
//! `QuadMesh`.

use super::document::Node;
use super::schema::Kind;
use crate::scene::read::ReadError;

/// What is called for every polygon; an error ends the shape.
type Visit<'a> = dyn FnMut(Polygon) -> Result<(), ReadError> + 'a;
/// What is called for every run of corners, with its number.
type VisitRun<'a> = dyn FnMut(&[Corner], usize) -> Result<(), ReadError> + 'a;

/// A corner of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// Which point of the coordinates; `usize::MAX` stands for an index no list can hold.
    pub point: usize,
    /// Its number among the shape's vertices: where `PER_VERTEX` takes its colour.
    pub vertex: usize,
    /// Its place in `coordIndex`: where `PER_VERTEX_INDEXED` looks up its colour.
    pub slot: usize,
}

/// A polygon of a shape.
#[derive(Clone, Copy, Debug)]
pub struct Polygon<'a> {
    /// In the order of the file.
    pub corners: &'a [Corner],
    /// Number of the part: strip, row or face.
    pub part: usize,
    /// Number of the face in the shape.
    pub face: usize,
}

/// Calls `visit` for every polygon of a vertex-based shape with `points` coordinates; stops at the first
/// error.
pub fn for_each(node: &Node, points: usize, visit: &mut Visit) -> Result<(), ReadError> {
    match node.kind {
        Kind::IndexedFaceSet => {
            indexed(node, &mut |corners, part| visit(Polygon { corners, part, face: part }))
        }
        Kind::FaceSet => {
            runs(node, points, &mut |corners, part| visit(Polygon { corners, part, face: part }))
        }
        Kind::IndexedTriangleStripSet | Kind::TriangleStripSet => {
            let mut face = 0;
            let mut strip = |corners: &[Corner], part: usize| triangles(corners, part, &mut face, visit);
            match node.kind {
                Kind::TriangleStripSet => runs(node, points, &mut strip),
                _ => indexed(node, &mut strip),
            }
        }
        Kind::QuadMesh => quads(node, points, visit),
        _ => Ok(()),
    }
}

/// Runs of `coordIndex` between negative entries; the last one may end with the list.
fn indexed(node: &Node, visit: &mut VisitRun) -> Result<(), ReadError> {
    let Some(indices) = node.numbers("coordIndex") else { return Ok(()) };
    let (mut corners, mut part, mut vertex) = (Vec::new(), 0, 0);
    for (slot, index) in indices.iter().enumerate() {
        if *index >= 0.0 {
            corners.push(Corner { point: *index as usize, vertex, slot });
            vertex += 1;
        }
        if (*index < 0.0 || slot + 1 == indices.len()) && !corners.is_empty() {
            visit(&corners, part)?;
            corners.clear();
            part += 1;
        }
    }
    Ok(())
}

/// Runs of `numVertices` consecutive points from `startIndex`; a negative number takes the rest.
fn runs(node: &Node, points: usize, visit: &mut VisitRun) -> Result<(), ReadError> {
    let mut next = first_point(node);
    let mut vertex = 0;
    let all = [-1.0];
    let lengths = node.numbers("numVertices").map_or(&all[..], |numbers| numbers);
    let mut corners = Vec::new();
    for (part, length) in lengths.iter().enumerate() {
        let rest = points.saturating_sub(next);
        let length = if *length < 0.0 { rest } else { *length as usize };
        corners.clear();
        corners.extend((0..length.min(rest)).map(|i| Corner {
            point: next + i,
            vertex: vertex + i,
            slot: vertex + i,
        }));
        if length > rest {
            // More points than there are: the caller refuses the face for this corner.
            corners.push(Corner { point: usize::MAX, vertex, slot: vertex });
        }
        next = next.saturating_add(length);
        vertex = vertex.saturating_add(length);
        visit(&corners, part)?;
    }
    Ok(())
}

fn first_point(node: &Node) -> usize {
    node.integer("startIndex", 0).max(0) as usize
}

/// The triangles of a strip, every second one turned so that all face the same way.
fn triangles(strip: &[Corner], part: usize, face: &mut usize, visit: &mut Visit) -> Result<(), ReadError> {
    if strip.len() < 3 {
        return visit(Polygon { corners: strip, part, face: *face });
    }
    for (i, corners) in strip.windows(3).enumerate() {
        let mut corners = [corners[0], corners[1], corners[2]];
        if i % 2 == 1 {
            corners.swap(0, 1);
        }
        visit(Polygon { corners: &corners, part, face: *face })?;
        *face += 1;
    }
    Ok(())
}

/// A grid of `verticesPerColumn` rows by `verticesPerRow` columns of points.
fn quads(node: &Node, points: usize, visit: &mut Visit) -> Result<(), ReadError> {
    let start = first_point(node);
    let rows = node.integer("verticesPerColumn", 1).max(0) as usize;
    let columns = node.integer("verticesPerRow", 1).max(0) as usize;
    if rows < 2 || columns < 2 {
        return Ok(());
    }
    let needed = rows.checked_mul(columns).and_then(|n| n.checked_add(start));
    if needed.is_none_or(|needed| needed > points) {
        let missing = Corner { point: usize::MAX, vertex: 0, slot: 0 };
        return visit(Polygon { corners: &[missing], part: 0, face: 0 });
    }
    let corner = |row: usize, column: usize| {
        let vertex = row * columns + column;
        Corner { point: start + vertex, vertex, slot: vertex }
    };
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let corners = [
                corner(row, column),
                corner(row + 1, column),
                corner(row + 1, column + 1),
                corner(row, column + 1),
            ];
            visit(Polygon { corners: &corners, part: row, face: row * (columns - 1) + column })?;
        }
    }
    Ok(())
}
