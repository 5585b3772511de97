//! Gives the shared library its soname, and the build's folder a file of that name, which programs linked there look for.
#![allow(clippy::print_stdout, reason = "that is how cargo is told")]

use std::os::unix::fs::symlink;
use std::path::Path;

/// Rises when a program compiled against an older header would go wrong.
const SONAME: &str = "libisotherm_client.so.0";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
    // Beside another library with iceoryx2 in it each uses its own. And it stays loaded: threads may have messages of it.
    println!("cargo::rustc-cdylib-link-arg=-Wl,-Bsymbolic,-z,nodelete");
    // target/release, from target/release/build/isotherm-client-c-../out.
    let folder = std::env::var_os("OUT_DIR");
    if let Some(folder) = folder.as_deref().and_then(|out| Path::new(out).ancestors().nth(3)) {
        // Fails if it is there already. Where there can be none, only programs linked in this folder miss it.
        let _ = symlink("libisotherm_client.so", folder.join(SONAME));
    }
}
