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

    if let Err((what, reason, way_out)) = compile(&include, &library, &arch) {
        tried.push(reason);
        give_up(what, &tried, way_out);
    }
    // A library where the system does not look is opened by its path.
    let place = if library.starts_with("/usr") { LIBRARY.into() } else { library.join(LIBRARY) };
    println!("cargo:rustc-env=LIBSUMO_LIBRARY={}", place.display());
}

/// What went wrong, the reason, and what to do.
type Failure = (&'static str, String, &'static str);

/// Compiles the shim, and for each function of SUMO that it calls one that finds it late. Only on x86-64: elsewhere SUMO
/// is linked.
fn compile(include: &Path, library: &Path, arch: &str) -> Result<(), Failure> {
    let failed = |file: &str, error: cc::Error| {
        (
            "the shim over libsumo did not compile",
            format!("C++ compiler on {file}: {error}"),
            "on Debian, apt install g++",
        )
    };
    let mut shim = cc::Build::new();
    shim.cpp(true).std("c++17").opt_level(2).file(SHIM).include(include).flag("-fvisibility=hidden");
    let objects = shim.try_compile_intermediates().map_err(|error| failed(SHIM, error))?;
    let late = if arch == "x86_64" { late_functions(&objects, library)? } else { Vec::new() };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    let lines: String = late.iter().map(|name| format!("late {name}\n")).collect();
    std::fs::write(out.join("sumo_calls.inc"), lines).expect("the folder for outputs can be written to");
    let mut both = cc::Build::new();
    both.cpp(true).file(LATE).include(out).objects(objects);
    both.try_compile("sumo_shim").map_err(|error| failed(LATE, error))?;
    if late.is_empty() {
        // After the shim, because a linker reads from left to right.
        println!("cargo:rustc-link-search=native={}", library.display());
        println!("cargo:rustc-link-lib=dylib=sumocpp");
        if !library.starts_with("/usr") {
            // The loader does not look here by itself.
            println!("cargo:rustc-link-arg=-Wl,-rpath,{}", library.display());
        }
    }
    Ok(())
}

/// Returns the names of SUMO's functions that the objects call, and that the library has.
fn late_functions(objects: &[PathBuf], library: &Path) -> Result<Vec<String>, Failure> {
    let unlisted =
        |reason| ("the functions of libsumo cannot be listed", reason, "on Debian, apt install binutils (for `nm`)");
    let mut called = Vec::new();
    for object in objects {
        called.extend(symbols(object, &["--undefined-only"]).map_err(unlisted)?);
    }
    called.retain(|(name, _)| OF_SUMO.iter().any(|begin| name.starts_with(begin)));
    let library = library.join(LIBRARY);
    let there = symbols(&library, &["--dynamic", "--defined-only"]).map_err(unlisted)?;
    let is_function = |name: &str| there.iter().any(|(other, kind)| other == name && "TW".contains(kind));
    if let Some((name, _)) = called.iter().find(|(name, _)| !is_function(name)) {
        let reason = format!("{}: has no function {name}", library.display());
        return Err((
            "this libsumo lacks what the shim calls",
            reason,
            "install SUMO 1.15, the version that was tried",
        ));
    }
    Ok(called.into_iter().map(|(name, _)| name).collect())
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
