//! Sets the soname of the shared library, and creates a link of that name in the build's folder, so that programs
//! linked with the library there find it.
#![allow(clippy::print_stdout, reason = "build scripts pass settings to cargo by stdout")]

use std::os::unix::fs::symlink;
use std::path::Path;

/// Its number rises when programs compiled with an older header would fail.
const SONAME: &str = "libisotherm_client.so.0";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
    // -Bsymbolic: if another library contains iceoryx2 too, each library uses its own. -z nodelete: the library is
    // never unloaded, because threads may have messages of it in thread-local storage.
    println!("cargo::rustc-cdylib-link-arg=-Wl,-Bsymbolic,-z,nodelete");
    // The folder is target/release; OUT_DIR is target/release/build/isotherm-client-c-../out.
    let folder = std::env::var_os("OUT_DIR");
    if let Some(folder) = folder.as_deref().and_then(|out| Path::new(out).ancestors().nth(3)) {
        // Fails if the link exists already. If it cannot be created, only programs linked in this folder are affected.
        let _ = symlink("libisotherm_client.so", folder.join(SONAME));
    }
}
