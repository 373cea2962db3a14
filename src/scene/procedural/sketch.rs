//! A scene on the drawing board: parts in their places, and areas that will be paved with as many stones as are left.

use glam::DVec3;

use super::dice::Dice;
use super::placement::Placement;

/// Corners counter-clockwise seen from the front.
pub(super) type Polygon = Vec<DVec3>;

/// A material: reflectance and exitance in W/m², red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Paint {
    pub reflectance: [f64; 3],
    pub exitance_w_m2: [f64; 3],
}

/// A diffuse material.
pub(super) const fn matt(r: f64, g: f64, b: f64) -> Paint {
    Paint { reflectance: [r, g, b], exitance_w_m2: [0.0; 3] }
}

/// A lamp, black itself.
pub(super) const fn lamp(r: f64, g: f64, b: f64) -> Paint {
    Paint { reflectance: [0.0; 3], exitance_w_m2: [r, g, b] }
}

/// Faces of one material under one name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    pub name: String,
    pub paint: Paint,
    pub faces: Vec<Polygon>,
}

/// A part by its name.
pub(super) fn part(name: &str, paint: Paint, faces: Vec<Polygon>) -> Part {
    Part { name: name.to_owned(), paint, faces }
}

/// A view worth looking at: eye, what it looks at, vertical opening in degrees.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct View {
    pub name: &'static str,
    pub eye: DVec3,
    pub target: DVec3,
    pub degrees: f64,
}

/// A parallelogram to be paved: `corner`, `corner + u`, `corner + u + v` is counter-clockwise from the front.
struct Paved {
    name: String,
    corner: DVec3,
    u: DVec3,
    v: DVec3,
    tones: [Paint; 3],
}

/// A scene that is being drawn.
#[derive(Default)]
pub(super) struct Sketch {
    pub parts: Vec<Part>,
    pub views: Vec<View>,
    paved: Vec<Paved>,
}

impl Sketch {
    /// Adds parts, their names after `name`.
    pub fn place(&mut self, name: &str, at: &Placement, parts: Vec<Part>) {
        let named =
            |part: Part| Part { name: format!("{name}_{}", part.name), faces: at.faces(part.faces), ..part };
        self.parts.extend(parts.into_iter().filter(|part| !part.faces.is_empty()).map(named));
    }

    /// Adds faces as they are.
    pub fn add(&mut self, name: &str, paint: Paint, faces: Vec<Polygon>) {
        self.parts.push(part(name, paint, faces));
    }

    /// Sets an area aside for paving.
    pub fn pave(&mut self, name: &str, [corner, u, v]: [DVec3; 3], tones: [Paint; 3]) {
        self.paved.push(Paved { name: name.to_owned(), corner, u, v, tones });
    }

    /// Adds a view.
    pub fn view(&mut self, name: &'static str, eye: DVec3, target: DVec3, degrees: f64) {
        self.views.push(View { name, eye, target, degrees });
    }

    /// Faces when every paved area is a single stone: no scene of this sketch has fewer.
    pub fn least(&self) -> usize {
        self.parts.iter().map(|part| part.faces.len()).sum::<usize>() + self.paved.len()
    }

    /// Paves so that there are `total` faces, which is at least [`Sketch::least`]; stones are shared out by area.
    pub fn finish(mut self, total: usize, dice: &mut Dice) -> (Vec<Part>, Vec<View>) {
        let spare = total - self.least();
        let area: f64 = self.paved.iter().map(Paved::area_m2).sum();
        let (mut covered, mut given) = (0.0, 0);
        for paved in &self.paved {
            covered += paved.area_m2();
            // Rounding the running sum makes the shares add up.
            let due = (spare as f64 * covered / area).round().min(spare as f64) as usize;
            paved.lay(1 + due - given, dice, &mut self.parts);
            given = due;
        }
        (self.parts, self.views)
    }
}

impl Paved {
    fn area_m2(&self) -> f64 {
        self.u.cross(self.v).length()
    }

    /// Courses of stones, alike in length within a course.
    fn lay(&self, stones: usize, dice: &mut Dice, parts: &mut Vec<Part>) {
        let shape = self.v.length() / self.u.length();
        let courses = ((stones as f64 * shape).sqrt().round() as usize).clamp(1, stones);
        let mut laid = 0;
        for course in 0..courses {
            let until = stones * (course + 1) / courses;
            let (low, high) = (course as f64 / courses as f64, (course + 1) as f64 / courses as f64);
            let count = until - laid;
            let at = |i: usize, t: f64| self.corner + self.u * (i as f64 / count as f64) + self.v * t;
            let stone = |i: usize| vec![at(i, low), at(i + 1, low), at(i + 1, high), at(i, high)];
            parts.extend((0..count).map(|i| Part {
                name: format!("{}_{course}_{i}", self.name),
                paint: dice.pick(&self.tones),
                faces: vec![stone(i)],
            }));
            laid = until;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn any_number_of_stones_covers_the_area() {
        let tones = [matt(0.5, 0.5, 0.5); 3];
        for total in [2, 3, 5, 11, 64, 1001] {
            let mut sketch = Sketch::default();
            sketch.pave("a", [DVec3::ZERO, 3.0 * DVec3::X, 2.0 * DVec3::Y], tones);
            sketch.pave("b", [dvec3(5.0, 0.0, 0.0), DVec3::X, 0.5 * DVec3::Y], tones);
            assert_eq!(sketch.least(), 2);
            let (parts, _) = sketch.finish(total, &mut Dice::new(1));
            let faces: Vec<&Polygon> = parts.iter().flat_map(|part| &part.faces).collect();
            assert_eq!(faces.len(), total);
            let area = |f: &Polygon| (f[1] - f[0]).cross(f[2] - f[0]).z;
            assert!(faces.iter().all(|f| area(f) > 0.0));
            assert!((faces.iter().map(|f| area(f)).sum::<f64>() - 6.5).abs() < 1e-9);
        }
    }
}
