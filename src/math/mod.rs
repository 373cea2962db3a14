//! The mathematics that knows no light: function bases, quadrature, planar polygons.

pub mod basis;
pub mod cell;
pub mod polygon;
pub mod quadrature;

pub use basis::Basis;
pub use cell::{Cell, Split};
