//! Probe files: CSV with a header that holds `x,y,z,nx,ny,nz`; the same rows come out with the readings appended.

use std::path::Path;

use csv::{ByteRecord, ReaderBuilder, Writer};
use glam::DVec3;

use crate::output::{self, write_atomically};
use crate::radiosity::probe::{Probe, Reading};

use super::Error;

const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// The content of a probe file.
#[derive(Debug)]
pub(super) struct Probes {
    header: ByteRecord,
    rows: Vec<ByteRecord>,
    /// One probe per row, its normal of length 1.
    pub points: Vec<Probe>,
}

impl Probes {
    /// Reads a probe file for a scene whose bands are not known yet.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file and, for a bad row, row, line, column and what was found.
    pub fn read(path: &Path) -> Result<Probes, Error> {
        let refuse = |why: String| Error::Input(format!("{}: {why}", path.display()));
        let file = std::fs::File::open(path).map_err(|error| refuse(format!("cannot be read: {error}")))?;
        let mut reader = ReaderBuilder::new().flexible(true).from_reader(std::io::BufReader::new(file));
        let header = reader.byte_headers().map_err(|error| refuse(error.to_string()))?.clone();
        let columns = columns(&header).map_err(&refuse)?;
        let (mut rows, mut points) = (Vec::new(), Vec::new());
        for (index, row) in reader.into_byte_records().enumerate() {
            let row = row.map_err(|error| refuse(error.to_string()))?;
            let probe = probe(&row, &columns, header.len()).map_err(|why| {
                let line = row.position().map_or(0, |position| position.line());
                refuse(format!("row {} (line {line}): {why}", index + 1))
            })?;
            points.push(probe);
            rows.push(row);
        }
        Ok(Probes { header, rows, points })
    }

    /// The numbers of another column, one per row; `None` if there is no such column.
    ///
    /// # Errors
    /// [`Error::Input`] naming row and column of what is no number.
    pub fn numbers(&self, path: &Path, name: &str) -> Result<Option<Vec<f64>>, Error> {
        let Some(column) = self.header.iter().position(|field| field.trim_ascii() == name.as_bytes()) else {
            return Ok(None);
        };
        let numbers = self.rows.iter().enumerate().map(|(index, row)| {
            finite(&row[column], name)
                .map_err(|why| Error::Input(format!("{}: row {}: {why}", path.display(), index + 1)))
        });
        numbers.collect::<Result<Vec<f64>, _>>().map(Some)
    }

    /// Refuses files that already hold a column of the readings.
    ///
    /// # Errors
    /// [`Error::Input`] naming the column.
    pub fn check(&self, path: &Path, bands: &[String]) -> Result<(), Error> {
        let added = added_columns(bands);
        match added.iter().find(|name| self.header.iter().any(|column| column == name.as_bytes())) {
            None => Ok(()),
            Some(name) => Err(Error::Input(format!(
                "{}: the column {name} is there already; remove the results of an earlier run first",
                path.display()
            ))),
        }
    }

    /// Writes the rows with their readings, whole or not at all.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, readings: &[Reading], bands: &[String], path: &Path) -> Result<(), output::Error> {
        write_atomically(path, |out| {
            let mut writer = Writer::from_writer(out);
            let mut header = self.header.clone();
            added_columns(bands).iter().for_each(|name| header.push_field(name.as_bytes()));
            writer.write_byte_record(&header)?;
            for (row, reading) in self.rows.iter().zip(readings) {
                let mut row = row.clone();
                let radiosity = reading.radiosity_w_m2.as_ref();
                reading.irradiance_w_m2.iter().for_each(|e| row.push_field(e.to_string().as_bytes()));
                for band in 0..bands.len() {
                    let value = radiosity.map_or_else(String::new, |b| b[band].to_string());
                    row.push_field(value.as_bytes());
                }
                writer.write_byte_record(&row)?;
            }
            writer.flush()
        })
    }
}

fn added_columns(bands: &[String]) -> Vec<String> {
    let of = |what: &'static str| bands.iter().map(move |band| format!("{what}_{band}"));
    of("irradiance").chain(of("radiosity")).collect()
}

/// Where the six columns stand.
fn columns(header: &ByteRecord) -> Result<[usize; 6], String> {
    let mut found = [0; 6];
    for (place, name) in found.iter_mut().zip(COLUMNS) {
        let mut places = (0..header.len()).filter(|i| header[*i].trim_ascii() == name.as_bytes());
        *place = places.next().ok_or_else(|| {
            let found: Vec<_> = header.iter().map(String::from_utf8_lossy).collect();
            let found = found.join(",");
            format!("the header must hold the columns x,y,z,nx,ny,nz; {name} is missing in \"{found}\"")
        })?;
        if places.next().is_some() {
            return Err(format!("the header holds the column {name} twice"));
        }
    }
    Ok(found)
}

/// The probe of a row.
fn probe(row: &ByteRecord, columns: &[usize; 6], width: usize) -> Result<Probe, String> {
    if row.len() != width {
        return Err(format!("expected {width} columns as in the header, found {}", row.len()));
    }
    let mut numbers = [0.0; 6];
    for ((number, column), name) in numbers.iter_mut().zip(columns).zip(COLUMNS) {
        *number = finite(&row[*column], name)?;
    }
    let [position, normal] = [0, 3].map(|i| DVec3::from_slice(&numbers[i..i + 3]));
    // Scaled first, so that squares neither overflow nor vanish.
    let normal = (normal / normal.abs().max_element()).normalize_or_zero();
    if normal == DVec3::ZERO {
        return Err("columns nx, ny, nz: expected a direction, found a normal of zero length".to_owned());
    }
    Ok(Probe { position, normal })
}

/// The number in a field of the column `name`.
fn finite(field: &[u8], name: &str) -> Result<f64, String> {
    let text = String::from_utf8_lossy(field.trim_ascii());
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("column {name}: expected a finite number, found \"{text}\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Probes, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Probes::read(file.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn rows_keep_their_order_and_their_other_columns() {
        let text = "name,nx,ny,nz,x,y,z,note\n\"a, b\",0,0,2,1,2,3,first\nc,0,1e-300,0,4,5,6,\n";
        let probes = read(text).unwrap();
        assert_eq!(probes.points[0], Probe { position: DVec3::new(1.0, 2.0, 3.0), normal: DVec3::Z });
        assert_eq!(probes.points[1].normal, DVec3::Y);
        let on = Reading { irradiance_w_m2: vec![0.1, 2.0], radiosity_w_m2: Some(vec![3.0, 1e-9]) };
        let free = Reading { irradiance_w_m2: vec![1.0, 0.0], radiosity_w_m2: None };
        let out = tempfile::NamedTempFile::new().unwrap();
        let bands = ["r".to_owned(), "n".to_owned()];
        probes.write(&[on, free], &bands, out.path()).unwrap();
        assert_eq!(
            std::fs::read_to_string(out.path()).unwrap(),
            "name,nx,ny,nz,x,y,z,note,irradiance_r,irradiance_n,radiosity_r,radiosity_n\n\
             \"a, b\",0,0,2,1,2,3,first,0.1,2,3,0.000000001\nc,0,1e-300,0,4,5,6,,1,0,,\n"
        );
        let again = Probes::read(out.path()).unwrap();
        assert!(again.check(out.path(), &bands).unwrap_err().to_string().contains("irradiance_r"));
        assert!(probes.check(out.path(), &bands).is_ok());
    }

    #[test]
    fn spaces_byte_order_marks_and_line_ends_of_other_systems_do_no_harm() {
        let probes = read("\u{feff}x, y, z, nx, ny, nz\r\n 1, 2, 3, 0, 0, 1\r\n\r\n").unwrap();
        assert_eq!(probes.points, [Probe { position: DVec3::new(1.0, 2.0, 3.0), normal: DVec3::Z }]);
        assert_eq!(read("x,y,z,nx,ny,nz\n").unwrap().points, []);
    }

    #[test]
    fn errors_name_the_row_the_column_and_what_was_found() {
        let header = "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n";
        let cases = [
            ("1,2,three,0,0,1", "row 2 (line 3): column z: expected a finite number, found \"three\""),
            ("1,2,3,0,NaN,1", "row 2 (line 3): column ny: expected a finite number, found \"NaN\""),
            ("1,2,3,0,0,0", "row 2 (line 3): columns nx, ny, nz: expected a direction"),
            ("1,2,3,0,0", "row 2 (line 3): expected 6 columns as in the header, found 5"),
            ("1,2,,0,0,1", "row 2 (line 3): column z: expected a finite number, found \"\""),
        ];
        for (row, message) in cases {
            let error = read(&format!("{header}{row}\n")).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
        assert!(read("x,y,z\n").unwrap_err().contains("nx is missing in \"x,y,z\""));
        assert!(read("").unwrap_err().contains("x is missing"));
        assert!(read("x,x,y,z,nx,ny,nz\n").unwrap_err().contains("column x twice"));
        let missing = Probes::read(Path::new("/nowhere/p.csv")).unwrap_err().to_string();
        assert!(missing.starts_with("/nowhere/p.csv: cannot be read"), "{missing}");
    }
}
