//! Classical façades bay by bay: arches and piers on the ground, on a façade of honour giant columns before two rows of windows,
//! cornices, balustrades and vases.

use glam::{DVec3, dvec3};

use super::Detail;
use super::fittings::{balustrade, bars, column, raised, vase};
use super::openings::{Opening, wall};
use super::placement::Placement;
use super::sketch::{Paint, Part, Polygon, Sketch, lamp, matt, part};
use super::solids::{BETWEEN, STANDING, Side, block, cuboid, moulding, swell};

/// Width of a bay from pier to pier.
pub(super) const BAY: f64 = 4.2;
/// What a façade goes on beyond its outer piers.
pub(super) const MARGIN: f64 = 0.8;
/// Height of the ground floor with its ledge.
pub(super) const LEDGE: f64 = 6.2;
/// Height of a façade of honour.
pub(super) const CORNICE: f64 = 14.6;

const STONE: Paint = matt(0.66, 0.61, 0.5);
const PALE: Paint = matt(0.74, 0.7, 0.6);
const GLASS: Paint = matt(0.12, 0.13, 0.15);
const FRAME: Paint = matt(0.5, 0.47, 0.42);
const METAL: Paint = matt(0.15, 0.15, 0.15);
const LIGHT: Paint = lamp(2600.0, 2200.0, 1500.0);

/// Underside of the ledge and of the entablature.
const GROUND: f64 = 5.6;
const ARCHITRAVE: f64 = 13.0;
/// How far piers, ledge and columns stand out.
const PROUD: f64 = 0.98;
/// Half the width of the pedestals of columns.
const PEDESTAL: f64 = 0.47;

/// A façade: its wall's plane, and the ground before it with y into the wall.
pub(super) struct Facade<'a> {
    pub name: &'a str,
    wall: Placement,
    stand: Placement,
    bays: usize,
    detail: Detail,
}

impl<'a> Facade<'a> {
    /// Centred on `origin`; turned by 0 degrees it faces −y.
    pub fn new(name: &'a str, origin: DVec3, degrees: f64, bays: usize, detail: Detail) -> Facade<'a> {
        let stand = Placement::standing(origin, degrees);
        let right = stand.point(DVec3::X) - origin;
        Facade { name, wall: Placement::wall(origin, right), stand, bays, detail }
    }

    /// Half the width.
    pub fn half(&self) -> f64 {
        0.5 * BAY * self.bays as f64 + MARGIN
    }

    /// Draws one with a single storey.
    pub fn draw_low(&self, sketch: &mut Sketch) {
        self.ground_floor(sketch);
        self.crown(LEDGE, 0.6, sketch);
    }

    /// Draws one with columns, and a pair of lamps at each pier.
    pub fn draw_grand(&self, sketch: &mut Sketch) {
        self.ground_floor(sketch);
        self.upper_floors(sketch);
        let profile = self.entablature();
        self.on_wall("entablature", PALE, moulding(&profile, -self.half(), self.half()), sketch);
        self.crown(CORNICE, 0.85, sketch);
        for pier in 0..=self.bays {
            self.lamps(pier, sketch);
        }
    }

    fn on_wall(&self, name: &str, paint: Paint, faces: Vec<Polygon>, sketch: &mut Sketch) {
        sketch.place(self.name, &self.wall, vec![part(name, paint, faces)]);
    }

    /// Where pier `i` stands.
    fn pier(&self, i: usize) -> f64 {
        BAY * (i as f64 - 0.5 * self.bays as f64)
    }

    /// The wall from `y0` to `y1` around the openings of each bay, in sections of four bays.
    fn walls(&self, name: &str, y0: f64, y1: f64, openings: &[Vec<Opening>], sketch: &mut Sketch) {
        for start in (0..self.bays).step_by(4) {
            let end = self.bays.min(start + 4);
            let x0 = if start == 0 { -self.half() } else { self.pier(start) };
            let x1 = if end == self.bays { self.half() } else { self.pier(end) };
            let mut face = wall(x0, x1, y1 - y0, &openings[start..end].concat());
            face.iter_mut().for_each(|p| p.y += y0);
            self.on_wall(&format!("{name}{start}"), STONE, vec![face], sketch);
        }
    }

    fn ground_floor(&self, sketch: &mut Sketch) {
        let d = self.detail;
        let arch = |bay: usize| {
            let x = self.pier(bay) + 0.5 * BAY;
            Opening::arched(x - 1.1, x + 1.1, 0.0, 3.0, d.count(4, 0.7, 40))
        };
        let openings: Vec<Vec<Opening>> = (0..self.bays).map(|bay| vec![arch(bay)]).collect();
        self.walls("arcade", 0.0, GROUND, &openings, sketch);
        for bay in 0..self.bays {
            let (x, opening) = (self.pier(bay) + 0.5 * BAY, &openings[bay][0]);
            let frame = [(0.0, 0.0), (0.0, 0.1), (0.16, 0.1), (0.16, 0.06), (0.32, 0.06), (0.32, 0.0)];
            let keystone = block(dvec3(x - 0.18, 4.14, 0.0), dvec3(x + 0.18, 4.9, 0.2), &[]);
            let door = bars([x - 1.1, x + 1.1, 0.0, 3.0], -0.5, 2 + d.count(0, 0.1, 2), d.count(2, 0.2, 8));
            sketch.place(
                &format!("{}_bay{bay}", self.name),
                &self.wall,
                vec![
                    part("arch", STONE, opening.reveals(0.5)),
                    part("archivolt", PALE, opening.frame(&frame)),
                    part("keystone", PALE, keystone),
                    part("pane", GLASS, vec![opening.pane(0.5)]),
                    part("bars", FRAME, door),
                ],
            );
        }
        for pier in 0..=self.bays {
            let x = self.pier(pier);
            let faces = self.rusticated(x);
            self.on_wall(&format!("pier{pier}"), PALE, faces, sketch);
        }
        let mut profile = vec![(0.0, GROUND)];
        profile.extend(swell((0.85, GROUND), (1.15, GROUND + 0.4), d.count(1, 0.3, 12)));
        profile.extend([(1.15, LEDGE), (0.0, LEDGE)]);
        self.on_wall("ledge", PALE, moulding(&profile, -self.half(), self.half()), sketch);
    }

    /// A pier of courses with grooves between them.
    fn rusticated(&self, x: f64) -> Vec<Polygon> {
        let courses = self.detail.count(1, 0.4, 12);
        let y = |i: usize| GROUND * i as f64 / courses as f64;
        let mut faces = Vec::new();
        for i in 0..courses {
            let groove = if i + 1 == courses { 0.0 } else { 0.04 };
            let ends = [(i == 0, Side::Front), (i + 1 == courses, Side::Back)];
            let hidden: Vec<Side> =
                ends.into_iter().filter(|(is_end, _)| *is_end).map(|(_, side)| side).collect();
            let top = y(i + 1) - groove;
            faces.extend(block(dvec3(x - 0.5, y(i), 0.0), dvec3(x + 0.5, top, 0.8), &hidden));
            if groove > 0.0 {
                let (low, high) = (dvec3(x - 0.46, top, 0.0), dvec3(x + 0.46, y(i + 1), 0.76));
                faces.extend(block(low, high, &[Side::Front, Side::Back]));
            }
        }
        faces
    }

    fn upper_floors(&self, sketch: &mut Sketch) {
        let d = self.detail;
        let windows = |bay: usize| {
            let x = self.pier(bay) + 0.5 * BAY;
            let tall = Opening::arched(x - 0.75, x + 0.75, 1.3, 3.4, d.count(4, 0.6, 40));
            vec![tall, Opening::rectangle(x - 0.65, x + 0.65, 5.0, 6.5).hung()]
        };
        let openings: Vec<Vec<Opening>> = (0..self.bays).map(windows).collect();
        self.walls("wall", GROUND, ARCHITRAVE, &openings, sketch);
        let above = self.wall.then(&Placement::standing(dvec3(0.0, GROUND, 0.0), 0.0));
        for (bay, pair) in openings.iter().enumerate() {
            sketch.place(&format!("{}_bay{bay}", self.name), &above, self.windows(bay, pair));
            let (x0, x1) = (self.pier(bay) + PEDESTAL, self.pier(bay + 1) - PEDESTAL);
            let rail = balustrade(x0, x1, 0.95, d.count(3, 0.7, 14), d.count(4, 0.1, 12));
            let at = self.stand.then(&Placement::standing(dvec3(0.0, -0.5, LEDGE), 0.0));
            sketch.place(&format!("{}_bay{bay}", self.name), &at, vec![part("balcony", PALE, rail)]);
        }
        for pier in 0..=self.bays {
            let half = PEDESTAL;
            let mut faces = cuboid(dvec3(-half, -half, 0.0), dvec3(half, half, 1.0), STANDING);
            let fineness = [d.count(6, 0.6, 32), d.count(1, 0.3, 10)];
            faces.extend(raised(column(ARCHITRAVE - LEDGE - 1.0, 0.32, fineness, &[Side::Top]), 1.0));
            let at = self.stand.then(&Placement::standing(dvec3(self.pier(pier), -0.5, LEDGE), 0.0));
            sketch.place(&format!("{}_pier{pier}", self.name), &at, vec![part("column", PALE, faces)]);
        }
    }

    /// The two windows of a bay, their frames, sills and bars; y from [`GROUND`].
    fn windows(&self, bay: usize, openings: &[Opening]) -> Vec<Part> {
        let (d, x) = (self.detail, self.pier(bay) + 0.5 * BAY);
        let frame = [(0.0, 0.0), (0.0, 0.08), (0.12, 0.08), (0.12, 0.05), (0.22, 0.05), (0.22, 0.0)];
        let mut trim: Vec<Polygon> = openings.iter().flat_map(|o| o.frame(&frame)).collect();
        for (opening, out) in openings.iter().zip([0.2, 0.16]) {
            let (low, high) = opening.bounds();
            trim.extend(block(
                dvec3(low.x - 0.3, low.y - 0.22, 0.0),
                dvec3(high.x + 0.3, low.y - 0.02, out),
                &[],
            ));
        }
        let top = openings[1].bounds().1.y;
        let mut profile = vec![(0.0, top + 0.3)];
        profile.extend(swell((0.06, top + 0.3), (0.3, top + 0.5), d.count(1, 0.3, 10)));
        profile.extend([(0.3, top + 0.58), (0.0, top + 0.58)]);
        trim.extend(moulding(&profile, x - 1.0, x + 1.0));
        let (columns, rows) = (2 + d.count(0, 0.1, 2), d.count(2, 0.15, 6));
        let mut glazing = bars([x - 0.75, x + 0.75, 1.3, 3.4], -0.3, columns, rows + 1);
        glazing.extend(bars([x - 0.65, x + 0.65, 5.0, 6.5], -0.3, columns, rows));
        vec![
            part("reveals", STONE, openings.iter().flat_map(|o| o.reveals(0.3)).collect()),
            part("panes", GLASS, openings.iter().map(|o| o.pane(0.3)).collect()),
            part("trim", PALE, trim),
            part("glazing", FRAME, glazing),
        ]
    }

    fn entablature(&self) -> Vec<(f64, f64)> {
        let mut profile = vec![(0.0, ARCHITRAVE), (PROUD, ARCHITRAVE), (PROUD, ARCHITRAVE + 0.95)];
        profile.extend(swell(
            (PROUD + 0.14, ARCHITRAVE + 0.95),
            (1.5, CORNICE - 0.2),
            self.detail.count(2, 0.4, 16),
        ));
        profile.extend([(1.5, CORNICE), (0.0, CORNICE)]);
        profile
    }

    /// Dentils below, balustrade, pedestals and vases on a cornice at height `z`.
    fn crown(&self, z: f64, out: f64, sketch: &mut Sketch) {
        let d = self.detail;
        for bay in 0..self.bays {
            let (x0, x1) = (self.pier(bay), self.pier(bay + 1));
            if z == CORNICE {
                let n = d.count(3, 0.5, 20);
                let step = (x1 - x0) / n as f64;
                let dentil = |i: usize| {
                    let x = x0 + step * (i as f64 + 0.3);
                    block(dvec3(x, 13.7, PROUD), dvec3(x + 0.4 * step, 13.88, PROUD + 0.12), &[])
                };
                let faces = (0..n).flat_map(dentil).collect();
                self.on_wall(&format!("bay{bay}_dentils"), PALE, faces, sketch);
            }
            let rail = balustrade(x0 + 0.35, x1 - 0.35, 1.0, d.count(3, 0.7, 14), d.count(4, 0.1, 12));
            let at = self.stand.then(&Placement::standing(dvec3(0.0, -out, z), 0.0));
            sketch.place(&format!("{}_bay{bay}", self.name), &at, vec![part("balustrade", PALE, rail)]);
        }
        for pier in 0..=self.bays {
            let (low, high) = (dvec3(-0.35, -0.35, 0.0), dvec3(0.35, 0.35, 1.1));
            let at = self.stand.then(&Placement::standing(dvec3(self.pier(pier), -out, z), 0.0));
            let mut faces = cuboid(low, high, STANDING);
            faces.extend(raised(vase(1.5, d.count(5, 0.5, 32)), 1.1));
            sketch.place(&format!("{}_pier{pier}", self.name), &at, vec![part("vase", PALE, faces)]);
        }
    }

    /// A pair of lamps at a pier that shine up at the façade: one on the ground, one on the ledge, which shades what is above it.
    fn lamps(&self, pier: usize, sketch: &mut Sketch) {
        for (place, out, z) in [("foot", 1.5, 0.0), ("ledge", 1.06, LEDGE)] {
            let (low, high) = (dvec3(-0.2, -0.07, 0.0), dvec3(0.2, 0.07, 0.2));
            let at = self.stand.then(&Placement::standing(dvec3(self.pier(pier), -out, z), 0.0));
            let lens = cuboid(low, high, &[Side::Left, Side::Right, Side::Front, Side::Back, Side::Bottom]);
            let housing = cuboid(low, high, BETWEEN);
            let parts = vec![part("housing", METAL, housing), part("lens", LIGHT, lens)];
            sketch.place(&format!("{}_lamp{pier}_{place}", self.name), &at, parts);
        }
    }
}
