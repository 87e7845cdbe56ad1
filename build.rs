//! Finds libsumo, compiles the shim of `src/sumo` and translates its header for Rust.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, exit};

const SHIM: &str = "src/sumo/shim/dials_sumo.cpp";
const HEADER: &str = "src/sumo/shim/dials_sumo.h";

const DEBIAN: &str = "on Debian, apt install";
const FOLDERS: &str = "DIALS_SUMO_INCLUDE=<above libsumo/libsumo.h> DIALS_SUMO_LIB=<with libsumocpp.so>";

fn main() {
    tell_versions();
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={SHIM}");
    println!("cargo:rerun-if-changed={HEADER}");
    println!("cargo:rerun-if-env-changed=LIBCLANG_PATH");

    let home = |sub: &str| variable("SUMO_HOME").map(|home| home.join(sub));
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let mut tried = Vec::new();

    let include = find(
        "libsumo/libsumo.h",
        "DIALS_SUMO_INCLUDE",
        home("include"),
        &["/usr/include", "/usr/local/include"],
        &mut tried,
    );
    let multiarch = format!("/usr/lib/{arch}-linux-gnu");
    let libraries = [multiarch.as_str(), "/usr/lib64", "/usr/lib", "/usr/local/lib"];
    let library = find("libsumocpp.so", "DIALS_SUMO_LIB", home("lib"), &libraries, &mut tried);
    let (Some(include), Some(library)) = (include, library) else {
        give_up(
            "libsumo was not found",
            &tried,
            &format!("{DEBIAN} sumo (headers and library), or name their folders: {FOLDERS}"),
        );
    };

    let compiled = cc::Build::new()
        .cpp(true)
        .std("c++17")
        .opt_level(2)
        .file(SHIM)
        .include(&include)
        .flag("-fvisibility=hidden")
        .try_compile("dials_sumo");
    if let Err(error) = compiled {
        tried.push(format!("C++ compiler on {SHIM}: {error}"));
        give_up("the shim over libsumo did not compile", &tried, &format!("{DEBIAN} g++"));
    }
    // After the shim, because a linker reads from left to right.
    println!("cargo:rustc-link-search=native={}", library.display());
    println!("cargo:rustc-link-lib=dylib=sumocpp");
    if !library.starts_with("/usr") {
        // The loader does not look here by itself.
        println!("cargo:rustc-link-arg=-Wl,-rpath,{}", library.display());
    }

    if let Err(error) = translate() {
        tried.push(format!("bindgen on {HEADER}: {error}"));
        give_up("the shim's header could not be translated", &tried, &format!("{DEBIAN} libclang-dev"));
    }
}

/// Returns the first folder that holds `file`. A folder named by `variable_name` is the only candidate.
fn find(
    file: &str,
    variable_name: &str,
    home: Option<PathBuf>,
    system: &[&str],
    tried: &mut Vec<String>,
) -> Option<PathBuf> {
    let candidates: Vec<(PathBuf, &str)> = match variable(variable_name) {
        Some(folder) => vec![(folder, variable_name)],
        None => {
            let home = home.into_iter().map(|folder| (folder, "SUMO_HOME"));
            home.chain(system.iter().map(|folder| (PathBuf::from(folder), "system"))).collect()
        }
    };
    for (folder, source) in candidates {
        let found = folder.join(file).exists();
        tried.push(format!("{} ({source}): {}", folder.join(file).display(), if found { "found" } else { "missing" }));
        if found {
            return Some(folder);
        }
    }
    None
}

/// Returns the folder that a variable names. An empty variable counts as unset.
fn variable(name: &str) -> Option<PathBuf> {
    println!("cargo:rerun-if-env-changed={name}");
    env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
}

fn translate() -> Result<(), String> {
    let out = Path::new(&env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?).join("dials_sumo.rs");
    // bindgen panics if there is no libclang.
    std::panic::set_hook(Box::new(|_| {}));
    let bindings = std::panic::catch_unwind(|| {
        bindgen::Builder::default()
            .header(HEADER)
            .allowlist_item("(ds|DS)_.*")
            .prepend_enum_name(false)
            .rust_edition(bindgen::RustEdition::Edition2024)
            .formatter(bindgen::Formatter::None)
            .layout_tests(false)
            .generate()
    });
    let _ = std::panic::take_hook();
    let bindings = bindings
        .map_err(|panic| match panic.downcast_ref::<String>() {
            Some(message) => message.clone(),
            None => "panicked".into(),
        })?
        .map_err(|error| error.to_string())?;
    bindings.write_to_file(out).map_err(|error| error.to_string())
}

fn give_up(what: &str, tried: &[String], way_out: &str) -> ! {
    eprintln!("\n{what}. What was tried:");
    for (number, line) in tried.iter().enumerate() {
        eprintln!("  {}. {line}", number + 1);
    }
    eprintln!("What to do: {way_out}\n");
    exit(1)
}

/// Sets the versions that `dials-traffic info` and `run.json` report of this build.
fn tell_versions() {
    println!("cargo:rustc-env=DIALS_GIT_COMMIT={}", commit().unwrap_or("unknown".into()));
    println!("cargo:rustc-env=DIALS_LIBTORCH_VERSION={}", libtorch_version().unwrap_or("none".into()));
}

/// Returns the version of libtorch; `None` in a build without the feature `torch`.
fn libtorch_version() -> Option<String> {
    env::var_os("CARGO_FEATURE_TORCH")?;
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    let header = PathBuf::from(env::var("LIBTORCH").unwrap_or("/usr".into()))
        .join("include/torch/csrc/api/include/torch/version.h");
    let text = std::fs::read_to_string(header).unwrap_or_default();
    let number = |part: &str| {
        let define = format!("#define TORCH_VERSION_{part} ");
        text.lines().find_map(|line| line.strip_prefix(&define)).unwrap_or("?").to_owned()
    };
    Some(["MAJOR", "MINOR", "PATCH"].map(number).join("."))
}

/// Returns the commit of this checkout, with `-dirty` if a source has changed since.
fn commit() -> Option<String> {
    const SOURCES: [&str; 4] = ["src", "build.rs", "Cargo.toml", "Cargo.lock"];
    SOURCES.iter().for_each(|source| println!("cargo:rerun-if-changed={source}"));
    // The log grows with every commit and checkout. In a worktree it is not under `.git`.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat())?;
    Some(if changed.is_empty() { commit } else { format!("{commit}-dirty") })
}

/// Returns git's output; `None` if git fails.
fn git(words: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("--no-optional-locks")
        .args(words)
        .output()
        .ok()
        .filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
