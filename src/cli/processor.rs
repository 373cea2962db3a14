//! Can this processor run this build? Asked first, so that an older one gets a sentence and not an illegal
//! instruction. A best effort: the check itself is built for the same processor.

/// Features builds are made for (`.cargo/config.toml`), whether this one was, and their names in `/proc/cpuinfo`.
const FEATURES: [(bool, &str); 4] = [
    (cfg!(target_feature = "avx2"), "avx2"),
    (cfg!(target_feature = "fma"), "fma"),
    (cfg!(target_feature = "bmi2"), "bmi2"),
    (cfg!(target_feature = "avx512f"), "avx512f"),
];

/// Compares what the build needs with what the system says of the processor.
///
/// # Errors
/// A message that names the missing features and the remedy. Silence of the system is no error.
pub fn check() -> Result<(), String> {
    // Not `is_x86_feature_detected!`: it answers at compile time for features the build was made for.
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let needed: Vec<&str> = FEATURES.iter().filter(|(needed, _)| *needed).map(|(_, name)| *name).collect();
    match missing(&text, &needed) {
        None => Ok(()),
        Some(missing) => Err(format!(
            "this program was built for processors with {}, and this one lacks {missing}; \
             build it for this machine: `WRAD_CPU=native scripts/setup`",
            needed.join(", ")
        )),
    }
}

fn missing(cpuinfo: &str, needed: &[&str]) -> Option<String> {
    let flags = cpuinfo.lines().find(|line| line.starts_with("flags"))?.split_once(':')?.1;
    let flags: Vec<&str> = flags.split_whitespace().collect();
    let missing: Vec<&str> = needed.iter().filter(|name| !flags.contains(name)).copied().collect();
    (!missing.is_empty()).then(|| missing.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_features_are_named_and_silence_passes() {
        let text = "processor : 0\nflags\t\t: fpu sse2 avx fma\nbugs : none\n";
        assert_eq!(missing(text, &["avx2", "fma", "bmi2"]).as_deref(), Some("avx2, bmi2"));
        assert_eq!(missing(text, &["fma"]), None);
        assert_eq!(missing("", &["avx2"]), None);
        assert_eq!(check(), Ok(()));
    }
}
