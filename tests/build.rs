//! Does nothing: a build script can have build dependencies, whose features Cargo.toml explains.
fn main() {}
