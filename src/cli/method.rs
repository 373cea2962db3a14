//! The solver by its name: shooting or gathering, and what it may store of links.

use crate::schedule::Batches;

use super::Error;
use super::arguments::SolveArguments;
use super::choice::choose;
use super::workers::Workers;

/// What links may take where nothing is said: a constant, since what is stored shows in the last digits of the solution, and that must not
/// depend on the machine.
const LINK_BYTES: u64 = 512 << 20;

/// What happens to links.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Links {
    Recompute,
    Store,
    Auto,
}

impl Workers {
    /// The same by the solver that the arguments name, which also say whether links are stored. Gathering stores what it may: every iteration
    /// after the first then costs next to nothing. Shooting stores none: the links of its last pass carry light once.
    ///
    /// # Errors
    /// [`Error::Input`]: an unknown name, or a combination that cannot be.
    pub fn with_method(self, arguments: &SolveArguments) -> Result<Self, Error> {
        let refuse = |text: String| Err(Error::Input(text));
        let gathers = choose("--method", &arguments.method, &[("shoot", false), ("gather", true)], &[])?;
        let all = [("recompute", Links::Recompute), ("store", Links::Store), ("auto", Links::Auto)];
        let links = choose("--links", &arguments.links, &all, &[])?;
        let given = arguments.link_memory.as_deref();
        if let Some(size) = given.filter(|_| !gathers || links == Links::Recompute) {
            let why = if gathers { "--links recompute" } else { "--method shoot" };
            return refuse(format!("--link-memory {size}: {why} stores no links; leave one of them out"));
        }
        if !gathers {
            return match links {
                Links::Store => refuse(
                    "--links store: --method shoot carries all light once in its last pass, where stored links could save 2 % \
                     and storing costs a quarter; leave it out, or use --method gather"
                        .to_owned(),
                ),
                Links::Recompute | Links::Auto => Ok(self),
            };
        }
        if self.batches != Batches::Fitted {
            return refuse(format!(
                "--method gather: --schedule {} is about surfaces that shoot one after the other; use stealing or sequential",
                self.schedule
            ));
        }
        let link_bytes = match (links, given) {
            (Links::Recompute, _) => 0,
            (_, None) => LINK_BYTES,
            (_, Some(size)) => bytes(size)?,
        };
        Ok(Self { batches: Batches::All { link_bytes }, ..self })
    }
}

/// A size as in `512M`, in bytes; units are powers of 1024.
fn bytes(text: &str) -> Result<u64, Error> {
    let units = [("K", 1u64 << 10), ("M", 1 << 20), ("G", 1 << 30), ("", 1)];
    let unit = units.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)));
    let size = unit.and_then(|(number, unit)| number.parse::<u64>().ok()?.checked_mul(unit));
    size.filter(|bytes| *bytes > 0).ok_or_else(|| {
        Error::Input(format!(
            "--link-memory {text}: expected a whole number of bytes above 0, with K, M or G for powers of 1024, such as 512M"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units_or_none() {
        for (text, size) in [("4096", 4096), ("64K", 64 << 10), ("512M", 512 << 20), ("3G", 3 << 30)] {
            assert_eq!(bytes(text).unwrap(), size);
        }
        for text in ["", "0", "M", "-1M", "1.5G", "1T", "99999999999999G"] {
            assert!(bytes(text).unwrap_err().to_string().contains("such as 512M"), "{text}");
        }
    }
}
