//! Which CPU this is, as event tables name CPUs.

use serde::Serialize;

/// Vendor, family and model; on Arm the implementer, the architecture and the part.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct CpuId {
    /// `GenuineIntel`, `AuthenticAMD`, or the implementer's number.
    pub vendor: String,
    /// Family; on Arm the architecture version.
    pub family: u32,
    /// Model; on Arm the part number.
    pub model: u32,
}

impl CpuId {
    /// The first CPU of this machine; empty where the system does not tell.
    pub fn this() -> Self {
        Self::parse(&std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default())
    }

    /// Reads the text of `/proc/cpuinfo`.
    pub fn parse(text: &str) -> Self {
        let field = |names: [&str; 2]| {
            let mut lines = text.lines().filter_map(|line| line.split_once(':'));
            lines.find(|(name, _)| names.contains(&name.trim())).map_or("", |(_, value)| value.trim())
        };
        let number = |names| {
            let text: &str = field(names);
            match text.strip_prefix("0x") {
                Some(digits) => u32::from_str_radix(digits, 16).unwrap_or(0),
                None => text.parse().unwrap_or(0),
            }
        };
        Self {
            vendor: field(["vendor_id", "CPU implementer"]).to_owned(),
            family: number(["cpu family", "CPU architecture"]),
            model: number(["model", "CPU part"]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_kinds_of_cpuinfo() {
        let x86 =
            CpuId::parse("processor\t: 0\nvendor_id\t: AuthenticAMD\ncpu family\t: 25\nmodel\t\t: 17\n");
        assert_eq!(x86, CpuId { vendor: "AuthenticAMD".to_owned(), family: 25, model: 17 });
        let arm = CpuId::parse("CPU implementer\t: 0x41\nCPU architecture: 8\nCPU part\t: 0xd0c\n");
        assert_eq!(arm, CpuId { vendor: "0x41".to_owned(), family: 8, model: 0xd0c });
        assert_eq!(CpuId::parse("nothing"), CpuId::default());
    }
}
