//! Options that are lists, separated by commas: every value in range, each once.

use std::fmt::Display;

use crate::cli::Error;
use crate::cli::choice::positive;

/// The most repetitions and workers: more are a slip of the keyboard.
const MOST: usize = 10_000;

/// Whole numbers from 1, each once.
pub(super) fn numbers(option: &str, text: &str) -> Result<Vec<usize>, Error> {
    let number = |part: &str| match part.trim().parse() {
        Ok(number) if (1..=MOST).contains(&number) => Ok(number),
        _ => Err(Error::Input(format!(
            "{option} {text}: expected whole numbers from 1 to {MOST}, separated by commas; found {part:?}"
        ))),
    };
    distinct(option, text.split(',').map(number).collect::<Result<Vec<usize>, _>>()?, |number| *number)
}

/// One whole number from 1.
pub(super) fn number(option: &str, text: &str) -> Result<usize, Error> {
    match numbers(option, text)?[..] {
        [number] => Ok(number),
        _ => Err(Error::Input(format!("{option} {text}: expected one number"))),
    }
}

/// Errors above 0, at most 1, each once; from the greatest down.
pub(super) fn errors(option: &str, text: &str) -> Result<Vec<f64>, Error> {
    let errors = text.split(',').map(|part| positive(option, part.trim(), 1.0));
    let mut errors = distinct(option, errors.collect::<Result<Vec<_>, _>>()?, |error| *error)?;
    errors.sort_by(|a, b| b.total_cmp(a));
    Ok(errors)
}

/// Refuses a list that names something twice.
pub(super) fn distinct<T, K: PartialEq + Display>(
    option: &str,
    items: Vec<T>,
    key: impl Fn(&T) -> K,
) -> Result<Vec<T>, Error> {
    for (i, item) in items.iter().enumerate() {
        if items[..i].iter().any(|before| key(before) == key(item)) {
            return Err(Error::Input(format!("{option}: {} is named twice", key(item))));
        }
    }
    Ok(items)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_numbers_are_checked() {
        assert_eq!(numbers("--threads", "1, 2,64").unwrap(), [1, 2, 64]);
        for (text, found) in
            [("", "\"\""), ("0", "\"0\""), ("1,x", "\"x\""), ("1,,2", "\"\""), ("1,1", "1 is named")]
        {
            let error = numbers("--threads", text).unwrap_err().to_string();
            assert!(error.starts_with("--threads") && error.contains(found), "{error}");
        }
    }

    #[test]
    fn errors_go_from_the_greatest_down() {
        assert_eq!(errors("--errors", "0.01, 0.3,1e-3").unwrap(), [0.3, 0.01, 0.001]);
        for (text, found) in
            [("0.1,", "--errors : expected"), ("0.1,0.10", "0.1 is named twice"), ("2", "at most 1")]
        {
            let error = errors("--errors", text).unwrap_err().to_string();
            assert!(error.contains(found), "{error}");
        }
    }
}
