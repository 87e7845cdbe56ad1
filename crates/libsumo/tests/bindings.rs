//! What is written down here of C and C++ is what the headers say.
//!
//! The bindings of the shim over SUMO, `src/ffi.rs`, are those that bindgen makes of its header. They are kept, so that a build
//! needs neither bindgen nor libclang. After a change of the header, empty `src/lib.rs` for a moment, and make them again with
//! `UPDATE_BINDINGS=1 cargo test -p libsumo --test bindings`. This test needs libclang, which `./setup.sh all` installs.

use std::fs;
use std::path::Path;
use std::process::Command;

const ABOUT: &str = "//! Bindings of `shim/shim.h`, made by bindgen: `UPDATE_BINDINGS=1 cargo test -p libsumo`.\n\n\
                     #![allow(dead_code, non_camel_case_types, unreachable_pub, clippy::all, reason = \"bindgen writes it\")]";

#[test]
fn the_bindings_are_those_of_the_header() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let bindings = bindgen::Builder::default()
        .header(root.join("src/shim/shim.h").to_str().unwrap())
        .allowlist_item("(ds|DS)_.*")
        .prepend_enum_name(false)
        .merge_extern_blocks(true)
        .ctypes_prefix("std::ffi")
        .rust_target(bindgen::RustTarget::stable(89, 0).unwrap_or_else(|_| panic!("bindgen knows Rust 1.89")))
        .rust_edition(bindgen::RustEdition::Edition2024)
        .layout_tests(false)
        .disable_header_comment()
        .raw_line(ABOUT)
        .formatter(bindgen::Formatter::Rustfmt)
        .rustfmt_configuration_file(Some(root.join("../../rustfmt.toml")))
        .generate()
        .unwrap();
    let (made, file) = (bindings.to_string(), root.join("src/ffi.rs"));
    if std::env::var_os("UPDATE_BINDINGS").is_some() {
        fs::write(&file, &made).unwrap();
    }
    assert!(fs::read_to_string(&file).unwrap() == made, "src/ffi.rs is old; it must be:\n{made}");
}

#[test]
fn the_functions_and_constants_are_those_of_sumos_own_headers() {
    let includes = ["/usr/include", "/usr/local/include"].map(Path::new);
    let Some(include) = includes.into_iter().find(|folder| folder.join("libsumo/libsumo.h").exists()) else {
        return eprintln!("no headers of SUMO are installed: nothing to compare with");
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut compiler = Command::new("g++");
    compiler.args(["-std=c++17", "-fsyntax-only", "-Isrc/shim", "-idirafter"]).arg(include).arg("tests/headers.cpp");
    let output = compiler.current_dir(root).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_crossing_names_every_file_with_unsafe_code() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let header = read("call.rs").split("\nuse ").next().unwrap().to_owned();
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let Some(stem) = name.strip_suffix(".rs").filter(|stem| *stem != "call") else { continue };
        let has = ["unsafe {", "unsafe fn ", "unsafe extern "].iter().any(|word| read(&name).contains(word));
        assert_eq!(has, header.contains(&format!("`{stem}`")), "{name}");
    }
}
