//! Values of options that are chosen by name, refused with the list of what is available.

use super::Error;

/// The value that `name` stands for in `available`. `planned` holds names that the command line's contract
/// knows but this version does not offer.
///
/// # Errors
/// [`Error::Input`] that tells planned names from unknown ones and lists the available.
pub(super) fn choose<T: Copy>(
    option: &str,
    name: &str,
    available: &[(&str, T)],
    planned: &[&str],
) -> Result<T, Error> {
    if let Some((_, value)) = available.iter().find(|(known, _)| *known == name) {
        return Ok(*value);
    }
    let names: Vec<&str> = available.iter().map(|(known, _)| *known).collect();
    let names = names.join(", ");
    let why = match planned.contains(&name) {
        true => "not available in this version of wrad",
        false => "there is no such value",
    };
    Err(Error::Input(format!("{option} {name}: {why}; available: {names}")))
}

/// A number above 0 and at most `greatest`.
///
/// # Errors
/// [`Error::Input`] that says what was found.
pub(super) fn positive(option: &str, text: &str, greatest: f64) -> Result<f64, Error> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value <= greatest => Ok(value),
        _ if greatest == f64::MAX => {
            Err(Error::Input(format!("{option} {text}: expected a finite number above 0")))
        }
        _ => Err(Error::Input(format!("{option} {text}: expected a number above 0, at most {greatest}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_say_what_is_available() {
        let of = |name| choose("--method", name, &[("shoot", 1), ("push", 2)], &["gather"]);
        assert_eq!(of("push").unwrap(), 2);
        let planned = of("gather").unwrap_err().to_string();
        assert_eq!(planned, "--method gather: not available in this version of wrad; available: shoot, push");
        assert!(of("Shoot").unwrap_err().to_string().contains("there is no such value"));
    }

    #[test]
    fn only_positive_finite_numbers_pass() {
        assert_eq!(positive("--error", "1e-3", 1.0).unwrap(), 1e-3);
        for text in ["0", "-1", "nan", "inf", "1.5", "abc", ""] {
            let error = positive("--error", text, 1.0).unwrap_err().to_string();
            assert!(error.starts_with(&format!("--error {text}: expected a number above 0")), "{error}");
        }
        assert!(positive("--exposure", "inf", f64::MAX).is_err());
    }
}
