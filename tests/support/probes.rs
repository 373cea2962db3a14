//! Files of probes where the irradiance is known.

use std::path::Path;

/// Its rows: the face's name; position in m, normal, irradiance in W/m² by band, and the standard error of that.
pub fn read(file: &Path) -> Vec<(String, [[f64; 3]; 4])> {
    let mut rows = csv::Reader::from_path(file).unwrap();
    let three = |row: &csv::StringRecord, at: usize| [at, at + 1, at + 2].map(|i| row[i].parse().unwrap());
    rows.records()
        .map(|row| {
            let row = row.unwrap();
            (row[0].to_owned(), [1, 4, 7, 10].map(|at| three(&row, at)))
        })
        .collect()
}
