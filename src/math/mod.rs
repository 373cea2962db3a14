//! The mathematics that knows no light: function bases, quadrature, planar polygons, vectors side by side, chance.

pub mod basis;
pub mod cell;
pub mod chance;
pub mod lanes;
pub mod polygon;
pub mod quadrature;

pub use basis::Basis;
pub use cell::{Cell, Split};
