//! The command `wrad`.

fn main() {}
