//! Numbers for people: three or four significant digits and a unit.

/// `1.23 s`, `45.6 ms`, `2 min 03 s`, `1 h 02 min`.
pub fn seconds(value_s: f64) -> String {
    if !value_s.is_finite() || value_s < 0.0 {
        return format!("{value_s} s");
    }
    // Rounded first, so that 59.999 becomes a minute and not "60.0 s".
    let whole = value_s.round() as u64;
    match value_s {
        v if v >= 3599.5 => {
            let minutes = (v / 60.0).round() as u64;
            format!("{} h {:02} min", minutes / 60, minutes % 60)
        }
        v if v >= 59.95 => format!("{} min {:02} s", whole / 60, whole % 60),
        v if v >= 0.9995 => format!("{} s", digits(v)),
        v if v >= 0.999_5e-3 => format!("{} ms", digits(v * 1e3)),
        v => format!("{} µs", digits(v * 1e6)),
    }
}

/// `812 B`, `1.50 KiB`, `24.0 GiB`.
pub fn bytes(value: u64) -> String {
    scaled(value as f64, 1024.0, ["B", "KiB", "MiB", "GiB", "TiB", "PiB"])
}

/// `812`, `48.2 k`, `12.3 M`, `1.07 G`.
pub fn count(value: u64) -> String {
    scaled(value as f64, 1000.0, ["", "k", "M", "G", "T", "P"]).trim_end().to_owned()
}

/// `0.812 %`, `12.3 %`; tiny shares as `1.2e-6 %`.
pub fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value != 0.0 && value.abs() < 1e-3 { format!("{value:.1e} %") } else { format!("{} %", digits(value)) }
}

/// Three significant digits, never an exponent.
fn digits(value: f64) -> String {
    match value.abs() {
        v if v >= 99.95 => format!("{value:.0}"),
        v if v >= 9.995 => format!("{value:.1}"),
        v if v >= 0.9995 => format!("{value:.2}"),
        0.0 => "0".to_owned(),
        _ => format!("{value:.3}"),
    }
}

fn scaled(value: f64, base: f64, units: [&str; 6]) -> String {
    if value < base {
        return format!("{value} {}", units[0]);
    }
    let (mut value, mut unit) = (value, 0);
    // What would be shown as 1000 (or 1024) of a unit is 1 of the next.
    while value >= base - 0.5 && unit + 1 < units.len() {
        value /= base;
        unit += 1;
    }
    format!("{} {}", digits(value), units[unit])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well_at_every_size() {
        let cases = [
            (0.0, "0 µs"),
            (12.34e-6, "12.3 µs"),
            (0.0456, "45.6 ms"),
            (0.9999, "1.00 s"),
            (1.234, "1.23 s"),
        ];
        for (value, text) in cases {
            assert_eq!(seconds(value), text);
        }
        assert_eq!((seconds(59.97), seconds(123.4)), ("1 min 00 s".to_owned(), "2 min 03 s".to_owned()));
        assert_eq!((seconds(3599.9), seconds(3725.0)), ("1 h 00 min".to_owned(), "1 h 02 min".to_owned()));
        assert_eq!(
            (bytes(812), bytes(1536), bytes(25 << 30)),
            ("812 B".into(), "1.50 KiB".into(), "25.0 GiB".into())
        );
        assert_eq!((bytes((1 << 20) - 1), bytes(u64::MAX)), ("1.00 MiB".into(), "16384 PiB".into()));
        assert_eq!(
            (count(0), count(999), count(48_213), count(999_999)),
            ("0".into(), "999".into(), "48.2 k".into(), "1.00 M".into())
        );
        assert_eq!(
            (percent(0.00812), percent(0.5), percent(1e-8)),
            ("0.812 %".into(), "50.0 %".into(), "1.0e-6 %".into())
        );
    }
}
