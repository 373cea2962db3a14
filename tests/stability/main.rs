//! A stress of the numerics: scenes at the edge of what can be computed, each with what is demanded of its solution.
//!
//! Here in a short form; `scripts/stability` runs the same cases at more sizes, bases, errors and seeds, and writes the table.

mod furnaces;
mod invariance;
mod judge;
mod scenes;
mod transfers;

/// How much of the list is run.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// In under a minute.
    Short,
    /// All of it: `WRAD_STABILITY=long`.
    Long,
}

fn form() -> Form {
    if std::env::var_os("WRAD_STABILITY").is_some_and(|form| form == "long") {
        Form::Long
    } else {
        Form::Short
    }
}

/// A test for each item of the list.
macro_rules! items {
    ($($name:ident: $($cases:path),+;)+) => {
        $(#[test]
        fn $name() {
            $(judge::judge($cases(form()));)+
        })+
    };
}

items! {
    scale: invariance::scale;
    translation: invariance::translation;
    rotation: invariance::rotation;
    order_of_faces: invariance::order;
    slivers: furnaces::slivers;
    areas_over_12_decades: furnaces::areas;
    near_coplanar_faces: furnaces::near_coplanar;
    contacts_and_duplicates: furnaces::contacts;
    corners: furnaces::corners;
    dihedrals: furnaces::dihedrals;
    partly_shared_edges: furnaces::shared_edges;
    polygons: furnaces::polygons, transfers::disc;
    reflectances: furnaces::reflectances;
    areas_apart: transfers::areas_apart;
    radiosities_over_15_decades: invariance::power, transfers::decades;
    zero_light_and_one_surface: transfers::degenerate;
    duplicates_of_a_face: furnaces::duplicates;
    deep_refinement: transfers::deep;
    every_basis_and_error: transfers::sweep;
    lights_without_area: transfers::lamps;
}
