//! Reference probes beside a scene: `NAME.probes.csv` with `x,y,z,nx,ny,nz`, the irradiance `E_<band>` and, if known, its standard error
//! `se_<band>`, in W/m².

use std::path::Path;

use crate::cli::Error;
use crate::cli::probes::Probes;
use crate::study::truth::Reference;

/// The reference of a scene, if there is one.
///
/// # Errors
/// [`Error::Input`]: there is one, and it cannot be used.
pub(super) fn beside(scene: &Path, bands: &[String]) -> Result<Option<Reference>, Error> {
    let path = scene.with_extension("probes.csv");
    if !path.exists() {
        return Ok(None);
    }
    let probes = Probes::read(&path)?;
    let columns = |prefix: &str| -> Result<Option<Vec<Vec<f64>>>, Error> {
        bands.iter().map(|band| probes.numbers(&path, &format!("{prefix}_{band}"))).collect()
    };
    let Some(irradiance) = columns("E")? else {
        let wanted: Vec<String> = bands.iter().map(|band| format!("E_{band}")).collect();
        let (path, wanted) = (path.display(), wanted.join(", "));
        return Err(Error::Input(format!("{path}: a reference needs the columns {wanted}")));
    };
    let square = |columns: &[Vec<f64>]| columns.iter().flatten().map(|value| value * value).sum::<f64>();
    let noise = columns("se")?.map(|errors| (square(&errors) / square(&irradiance)).sqrt());
    let rows = 0..probes.points.len();
    let irradiance_w_m2 = rows.flat_map(|row| irradiance.iter().map(move |column| column[row])).collect();
    Ok(Some(Reference { probes: probes.points, irradiance_w_m2, noise }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_found_beside_their_scene() {
        let place = tempfile::tempdir().unwrap();
        let scene = place.path().join("room.iv");
        let bands = ["r".to_owned(), "g".to_owned()];
        assert!(beside(&scene, &bands).unwrap().is_none());
        let write = |text: &str| std::fs::write(place.path().join("room.probes.csv"), text).unwrap();
        write("E_g,se_r,se_g,E_r,x,y,z,nx,ny,nz\n4,0.1,0,3,0,0,0,0,0,1\n0,0,0,0,1,0,0,0,0,1\n");
        let reference = beside(&scene, &bands).unwrap().unwrap();
        assert_eq!(reference.irradiance_w_m2, [3.0, 4.0, 0.0, 0.0]);
        assert_eq!((reference.probes.len(), reference.noise), (2, Some(0.02)));
        write("E_r,E_g,x,y,z,nx,ny,nz\n1,dark,0,0,0,0,0,1\n");
        let error = beside(&scene, &bands).unwrap_err().to_string();
        assert!(error.contains("row 1: column E_g: expected a finite number, found \"dark\""), "{error}");
        write("E_r,x,y,z,nx,ny,nz\n");
        assert!(beside(&scene, &bands).unwrap_err().to_string().contains("needs the columns E_r, E_g"));
    }
}
