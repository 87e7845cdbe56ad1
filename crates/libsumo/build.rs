//! Finds libsumo, and compiles the shim, which loads it late.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, exit};

const SHIM: &str = "src/shim/shim.cpp";
const LATE: &str = "src/shim/late.S";
const HEADER: &str = "src/shim/shim.h";

const LIBRARY: &str = "libsumocpp.so";
/// Beginnings of the names of SUMO's functions, as C++ compilers write them: the namespace `libsumo`, and a class.
const OF_SUMO: [&str; 2] = ["_ZN7libsumo", "_ZN6MSLane"];

const DEBIAN: &str = "on Debian, apt install";
const FOLDERS: &str = "LIBSUMO_INCLUDE=<above libsumo/libsumo.h> LIBSUMO_LIB=<with libsumocpp.so>";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={SHIM}");
    println!("cargo:rerun-if-changed={LATE}");
    println!("cargo:rerun-if-changed={HEADER}");

    if env::var_os("DOCS_RS").is_some() {
        // docs.rs has no SUMO, and documentation calls nothing.
        println!("cargo:rustc-env=LIBSUMO_LIBRARY={LIBRARY}");
        return;
    }

    let home = |sub: &str| variable("SUMO_HOME").map(|home| home.join(sub));
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let mut tried = Vec::new();

    let include = find(
        "libsumo/libsumo.h",
        ["LIBSUMO_INCLUDE", "DIALS_SUMO_INCLUDE"],
        home("include"),
        &["/usr/include", "/usr/local/include"],
        &mut tried,
    );
    let multiarch = format!("/usr/lib/{arch}-linux-gnu");
    let libraries = [multiarch.as_str(), "/usr/lib64", "/usr/lib", "/usr/local/lib"];
    let library = find(LIBRARY, ["LIBSUMO_LIB", "DIALS_SUMO_LIB"], home("lib"), &libraries, &mut tried);
    let (Some(include), Some(library)) = (include, library) else {
        give_up(
            "libsumo was not found",
            &tried,
            &format!("{DEBIAN} sumo (headers and library), or name their folders: {FOLDERS}"),
        );
    };

    compile(&include, &library, &arch, &tried);
    // A library where the system does not look is opened by its path.
    let place = if library.starts_with("/usr") { LIBRARY.into() } else { library.join(LIBRARY) };
    println!("cargo:rustc-env=LIBSUMO_LIBRARY={}", place.display());
}

/// Compiles the shim, and for each function of SUMO that it calls one that finds it late. Only on x86-64: elsewhere SUMO
/// is linked.
fn compile(include: &Path, library: &Path, arch: &str, tried: &[String]) {
    let failed = |file: &str, error: cc::Error| -> ! {
        let reason = format!("C++ compiler on {file}: {error}");
        give_up("the shim over libsumo did not compile", &[tried, &[reason]].concat(), "on Debian, apt install g++")
    };
    let mut shim = cc::Build::new();
    shim.cpp(true).std("c++17").opt_level(2).file(SHIM).include(include).flag("-fvisibility=hidden");
    let objects = shim.try_compile_intermediates().unwrap_or_else(|error| failed(SHIM, error));
    let late = if arch == "x86_64" { late_functions(&objects, library, tried) } else { Vec::new() };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    let lines: String = late.iter().map(|name| format!("late {name}\n")).collect();
    std::fs::write(out.join("sumo_calls.inc"), lines).expect("the folder for outputs can be written to");
    let mut both = cc::Build::new();
    both.cpp(true).file(LATE).include(out).objects(objects);
    both.try_compile("sumo_shim").unwrap_or_else(|error| failed(LATE, error));
    if late.is_empty() {
        // After the shim, because a linker reads from left to right.
        println!("cargo:rustc-link-search=native={}", library.display());
        println!("cargo:rustc-link-lib=dylib=sumocpp");
        if !library.starts_with("/usr") {
            // The loader does not look here by itself.
            println!("cargo:rustc-link-arg=-Wl,-rpath,{}", library.display());
        }
    }
}

/// Returns the names of SUMO's functions that the objects call. The library must have them.
fn late_functions(objects: &[PathBuf], library: &Path, tried: &[String]) -> Vec<String> {
    let symbols = |file: &Path, options: &[&str]| {
        symbols(file, options).unwrap_or_else(|reason| {
            let way_out = "on Debian, apt install binutils (for `nm`)";
            give_up("the functions of libsumo cannot be listed", &[tried, &[reason]].concat(), way_out)
        })
    };
    let called = objects.iter().flat_map(|object| symbols(object, &["--undefined-only"])).map(|(name, _)| name);
    let called: Vec<String> = called.filter(|name| OF_SUMO.iter().any(|begin| name.starts_with(begin))).collect();
    let library = library.join(LIBRARY);
    let there = symbols(&library, &["--dynamic", "--defined-only"]);
    let is_function = |name: &str| there.iter().any(|(other, kind)| other == name && "TW".contains(kind));
    if let Some(name) = called.iter().find(|name| !is_function(name)) {
        let reason = format!("{}: has no function {name}", library.display());
        let way_out = "install SUMO 1.15, the version that was tried";
        give_up("this libsumo lacks what the shim calls", &[tried, &[reason]].concat(), way_out);
    }
    called
}

/// Returns the names in a file's table of symbols, each with its kind: one letter, `T` and `W` for functions.
fn symbols(file: &Path, options: &[&str]) -> Result<Vec<(String, String)>, String> {
    let output = Command::new("nm").arg("--format=posix").args(options).arg(file).output();
    let output = output.map_err(|error| format!("nm: {error}"))?;
    if !output.status.success() {
        return Err(format!("nm on {}: {}", file.display(), String::from_utf8_lossy(&output.stderr).trim()));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let words = text.lines().map(|line| line.split(' '));
    Ok(words.filter_map(|mut words| Some((words.next()?.to_owned(), words.next()?.to_owned()))).collect())
}

/// Returns the first folder that holds `file`. A folder that one of `variables` names is the only candidate. The second of
/// them is the older name.
fn find(
    file: &str,
    variables: [&'static str; 2],
    home: Option<PathBuf>,
    system: &[&str],
    tried: &mut Vec<String>,
) -> Option<PathBuf> {
    let named = variables.map(|name| variable(name).map(|folder| (folder, name)));
    let candidates: Vec<(PathBuf, &str)> = match named.into_iter().flatten().next() {
        Some(named) => vec![named],
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

fn give_up(what: &str, tried: &[String], way_out: &str) -> ! {
    eprintln!("\n{what}. What was tried:");
    for (number, line) in tried.iter().enumerate() {
        eprintln!("  {}. {line}", number + 1);
    }
    eprintln!("What to do: {way_out}\n");
    exit(1)
}
