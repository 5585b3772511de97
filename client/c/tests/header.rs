//! `client/include/isotherm.h` has every function and flag of the library. `cargo run --manifest-path
//! client/c/header/Cargo.toml -- --check` checks that it is exactly what cbindgen generates from the code. That is not
//! a test here, because cbindgen's dependencies would cause a second build of the transport.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::Flags;
use std::collections::BTreeSet;
use std::fs;

const HEADER: &str = include_str!("../../include/isotherm.h");

/// The names before an opening parenthesis that begin with `isotherm_`.
fn functions(code: &str) -> BTreeSet<String> {
    let words = code.split('(').filter_map(|part| part.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next());
    words.filter(|word| word.starts_with("isotherm_")).map(str::to_owned).collect()
}

#[test]
fn the_header_has_every_function() {
    let mut exported = BTreeSet::new();
    for source in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src")).unwrap().flatten() {
        let text = fs::read_to_string(source.path()).unwrap();
        text.lines()
            .filter(|line| line.contains("extern \"C\" fn isotherm_"))
            .for_each(|line| exported.append(&mut functions(line)));
    }
    let code: Vec<_> = HEADER.lines().filter(|line| !line.starts_with([' ', '/', '#'])).collect();
    assert!(exported.len() > 20);
    assert_eq!(exported, functions(&code.join("\n")));
}

#[test]
fn the_header_has_every_flag_and_this_version() {
    for (bit, name) in Flags::NAMES {
        let line = format!("#define ISOTHERM_FLAG_{} (UINT64_C(1) << {bit})\n", name.replace('-', "_").to_uppercase());
        assert!(HEADER.contains(&line), "{line}");
    }
    assert_eq!(HEADER.matches("#define ISOTHERM_FLAG_").count(), Flags::NAMES.len());
    assert!(HEADER.contains(&format!("#define ISOTHERM_VERSION \"{}\"\n", env!("CARGO_PKG_VERSION"))));
}

/// The header without comments: each macro and declaration in one line, blanks made alike.
fn interface() -> Vec<String> {
    let mut code = String::new();
    let mut rest = HEADER;
    while let Some((before, comment)) = rest.split_once("/*") {
        code += before;
        rest = comment.split_once("*/").unwrap().1;
    }
    code += rest;
    let lines: Vec<_> =
        code.replace("\\\n", "").lines().map(|line| line.split("//").next().unwrap().to_owned()).collect();
    let (directives, text): (Vec<_>, Vec<_>) = lines.into_iter().partition(|line| line.starts_with('#'));
    let mut found: Vec<_> = directives.into_iter().filter(|line| line.starts_with("#define ISOTHERM_")).collect();
    // The version changes with each release, and what the header undefines again is not the user's.
    found.retain(|line| {
        !line.contains("ISOTHERM_VERSION") && !line.contains("_ASSERT") && !line.ends_with("ISOTHERM_H")
    });
    let (mut depth, mut declaration) = (0, String::new());
    for character in text.join("\n").replace("extern \"C\" {", "").chars() {
        match character {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth < 0 {
            // The end of `extern "C"`.
            depth = 0;
        } else if character == ';' && depth == 0 {
            found.push(core::mem::take(&mut declaration));
        } else {
            declaration.push(character);
        }
    }
    found.iter().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

/// Programs that were compiled with an earlier header of the same soname go on to work: what it declared is there and
/// unchanged. `abi/libisotherm_client.so.N` has that, line by line.
#[test]
fn no_declaration_has_vanished_or_changed_under_this_soname() {
    let build = include_str!("../build.rs");
    let soname = build.split("const SONAME: &str = \"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    let path = format!("{}/abi/{soname}", env!("CARGO_MANIFEST_DIR"));
    let recorded = fs::read_to_string(&path).unwrap_or_default();
    let recorded: BTreeSet<_> = recorded.lines().map(str::to_owned).collect();
    let interface = interface();
    let all: BTreeSet<_> = interface.iter().cloned().collect();
    let vanished: Vec<_> = recorded.difference(&all).collect();
    assert!(
        vanished.is_empty(),
        "{vanished:#?}\nvanished or changed: programs that use them break. Raise SONAME in client/c/build.rs, and record \
         the interface under that name (only isotherm_options may gain fields at its end, without a new soname)"
    );
    if std::env::var_os("ISOTHERM_RECORD_ABI").is_some() {
        return fs::write(&path, interface.join("\n") + "\n").unwrap();
    }
    let new: Vec<_> = all.difference(&recorded).collect();
    assert!(
        new.is_empty(),
        "{new:#?}\nnew: record them with ISOTHERM_RECORD_ABI=1 cargo test -p isotherm-client-c --test header, \
         and their symbols with this version in client/c/abi/symbols"
    );
}

/// The Debian package states which version each symbol came with.
#[test]
fn every_function_has_the_version_that_it_came_with() {
    let code: Vec<_> = HEADER.lines().filter(|line| !line.starts_with([' ', '/', '#'])).collect();
    let symbols = include_str!("../abi/symbols");
    let listed: BTreeSet<_> = symbols
        .lines()
        .filter_map(|line| line.strip_prefix(' ')?.split_once("@Base "))
        .map(|(name, _)| name.to_owned())
        .collect();
    assert_eq!(listed, functions(&code.join("\n")));
}
