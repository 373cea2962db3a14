//! The scenes of the paper, drawn by rule: Stanislas, Quito, Soda (a room and a floor), after *Parallel Wavelet Radiosity*
//! (1998), table 1, whose models are not public. Same kind of place, same number of surfaces and lights.
//!
//! A scene is drawn as solids in their places ([`sketch`]) at the finest detail that leaves some surfaces over; these become
//! paving stones, tiles and carpet squares, so that the number of surfaces is exact. Every face is one-sided and one surface. Parts
//! that are neighbours in space are neighbours in the file, unless shuffled.

mod cornell;
mod dice;
mod fittings;
mod furniture;
mod gallery;
mod office;
mod openings;
mod opera;
mod order;
mod placement;
mod quito;
mod sketch;
mod soda;
mod solids;
mod square;
mod stanislas;
mod workplace;
mod write;

use dice::Dice;
use sketch::{Part, Sketch, View};

/// A scene that can be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A square before an opera: long façades lit by pairs of lamps close to them.
    Stanislas,
    /// A cloister: two storeys of arcades around a court, lit by bowls that shine at bright vaults.
    Quito,
    /// A furnished office.
    SodaRoom,
    /// A floor of offices around a ring of corridors.
    SodaFloor,
    /// The Cornell box.
    Cornell,
}

impl Subject {
    /// All of them.
    pub const ALL: [Subject; 5] =
        [Subject::Stanislas, Subject::Quito, Subject::SodaRoom, Subject::SodaFloor, Subject::Cornell];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Subject::Stanislas => "stanislas",
            Subject::Quito => "quito",
            Subject::SodaRoom => "soda-room",
            Subject::SodaFloor => "soda-floor",
            Subject::Cornell => "cornell",
        }
    }

    /// Surfaces of the paper's model of the same name.
    pub fn surfaces(self) -> usize {
        match self {
            Subject::Stanislas => 17_307,
            Subject::Quito => 54_789,
            Subject::SodaRoom => 9_189,
            Subject::SodaFloor => 144_255,
            Subject::Cornell => 17,
        }
    }

    /// Draws it `scale` times as rich as the paper's, in the given detail.
    fn draw(self, scale: f64, detail: Detail, dice: &mut Dice) -> Sketch {
        match self {
            Subject::Stanislas => stanislas::draw(scale, detail, dice),
            Subject::Quito => quito::draw(scale, detail, dice),
            Subject::SodaRoom => soda::room(detail, dice),
            Subject::SodaFloor => soda::floor(scale, detail, dice),
            Subject::Cornell => cornell::draw(),
        }
    }
}

/// How finely things are drawn: 0 is coarse.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
struct Detail(f64);

impl Detail {
    /// A number of sides, segments or pieces that grows with the detail.
    fn count(self, least: usize, per_step: f64, most: usize) -> usize {
        (least + (self.0 * per_step) as usize).min(most)
    }
}

/// The finest detail; beyond it surfaces go to the paving.
const FINEST: usize = 400;
/// Details are this far apart.
const STEP: f64 = 0.1;
/// Sizes that are tried, each this share of the one before.
const SIZES: i32 = 24;
const SHRINK: f64 = 0.9;
/// The share of the surfaces that is kept for paving.
const PAVING: f64 = 0.06;

/// What to draw.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of surfaces; that of the paper's model without it.
    pub surfaces: Option<usize>,
    /// Seed of all that is left to chance.
    pub seed: u64,
    /// Whether the faces are put in random order, so that neighbours in the file are none in space.
    pub shuffle: bool,
}

/// The scene cannot be drawn with so few surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{} needs at least {least} surfaces, {asked} were asked for", .subject.name())]
pub struct TooFewSurfaces {
    /// What was to be drawn.
    pub subject: Subject,
    /// The fewest it can have.
    pub least: usize,
    /// How many were asked for.
    pub asked: usize,
}

/// A drawn scene, ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    subject: Subject,
    seed: u64,
    shuffled: bool,
    parts: Vec<Part>,
    views: Vec<View>,
}

/// Draws a scene.
///
/// # Errors
/// [`TooFewSurfaces`]: less than the coarsest drawing takes.
pub fn draw(subject: Subject, options: &Options) -> Result<Drawing, TooFewSurfaces> {
    let asked = options.surfaces.unwrap_or(subject.surfaces());
    let sketch =
        |scale: f64, step: usize, dice: &mut Dice| subject.draw(scale, Detail(STEP * step as f64), dice);
    let least = |scale: f64, step: usize| sketch(scale, step, &mut Dice::new(options.seed)).least();
    let smallest = least(0.0, 0);
    if smallest > asked {
        return Err(TooFewSurfaces { subject, least: smallest, asked });
    }
    let enough = asked - (PAVING * asked as f64) as usize;
    // The size that goes with the number; small scenes have to be smaller, because things cannot be drawn arbitrarily coarsely.
    let whole = asked as f64 / subject.surfaces() as f64;
    let scale =
        (0..SIZES).map(|i| whole * SHRINK.powi(i)).find(|scale| least(*scale, 0) <= enough).unwrap_or(0.0);
    // The finest detail that leaves enough for the paving; the coarsest does where that leaves less.
    let steps: Vec<usize> = (0..=FINEST).collect();
    let step = steps.partition_point(|step| least(scale, *step) <= enough).saturating_sub(1);
    let mut dice = Dice::new(options.seed);
    let (mut parts, views) = sketch(scale, step, &mut dice).finish(asked, &mut dice);
    match options.shuffle {
        true => order::shuffle(&mut parts, &mut dice),
        false => order::along_a_curve(&mut parts),
    }
    Ok(Drawing { subject, seed: options.seed, shuffled: options.shuffle, parts, views })
}

impl Drawing {
    /// Number of surfaces.
    pub fn surfaces(&self) -> usize {
        self.parts.iter().map(|part| part.faces.len()).sum()
    }

    /// Number of surfaces that emit.
    pub fn lights(&self) -> usize {
        let emits = |part: &&Part| part.paint.exitance_w_m2.iter().any(|m| *m > 0.0);
        self.parts.iter().filter(emits).map(|part| part.faces.len()).sum()
    }
}
