//! Compiles the shim over libsumo, and stand-ins for five libraries. It needs a C++ compiler, and no SUMO: that is looked for at run
//! time.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::exit;

const FOLDER: &str = "src/shim";
/// The libraries with a stand-in, and their functions: src/stand_ins.rs.
const STAND_INS: &str = "src/stand_ins.txt";

/// The two builds of the shim: whether std::string is that of C++11, and the name of the function that finds SUMO's.
const STRINGS: [(&str, &str); 2] = [("0", "ds_bind_old"), ("1", "ds_bind_new")];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={FOLDER}");
    println!("cargo:rerun-if-changed={STAND_INS}");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    // Documentation calls nothing.
    let is_documentation = env::var_os("DOCS_RS").is_some();
    make_stand_ins(&out, is_documentation);
    if is_documentation {
        return;
    }
    compile("open.cpp", &[]);
    compile("detours.cpp", &[]);
    compile("guard.cpp", &[]);
    for (of_cpp11, bind) in STRINGS {
        compile("shim.cpp", &[("_GLIBCXX_USE_CXX11_ABI", of_cpp11), ("DS_BIND", bind)]);
    }
}

fn compile(file: &str, defines: &[(&str, &str)]) {
    let mut build = cc::Build::new();
    build.cpp(true).std("c++17").opt_level(2).flag("-fvisibility=hidden").file(format!("{FOLDER}/{file}"));
    defines.iter().for_each(|&(name, value)| _ = build.define(name, value));
    let library = defines.last().map_or(file, |&(_, bind)| bind);
    build.try_compile(library).unwrap_or_else(|error| give_up(file, &error.to_string()));
}

/// Makes a shared library of empty functions for each one in the list, and `stand_ins.in`: a Rust array of their names and bytes.
fn make_stand_ins(out: &Path, only_names: bool) {
    let list = fs::read_to_string(STAND_INS).expect("it lies beside build.rs");
    // The first block is a comment.
    let libraries = list.split("\n\n").skip(1).filter_map(|block| block.split_once(':'));
    let mut array = String::from("[\n");
    for (library, names) in libraries {
        // Not under its name: cargo lets the loader look in this folder.
        let [source, made] = ["c", "stand_in"].map(|ending| out.join(format!("{library}.{ending}")));
        let functions: String = names.split_whitespace().map(|name| format!("void {name}(void) {{}}\n")).collect();
        fs::write(&source, functions).expect("the folder for outputs can be written to");
        if only_names {
            fs::write(&made, "").expect("as above");
        } else {
            link(library, &source, &made);
        }
        array += &format!("    ({library:?}, include_bytes!({made:?})),\n");
    }
    fs::write(out.join("stand_ins.in"), array + "]\n").expect("as above");
}

fn link(library: &str, source: &Path, made: &Path) {
    let mut linker = cc::Build::new().opt_level(2).warnings(false).get_compiler().to_command();
    linker.args(["-w", "-shared", "-fPIC", "-fno-builtin", "-nostdlib", "-s"]).arg(format!("-Wl,-soname={library}"));
    match linker.arg("-o").arg(made).arg(source).status() {
        Ok(status) if status.success() => {}
        Ok(status) => give_up(library, &status.to_string()),
        Err(error) => give_up(library, &error.to_string()),
    }
}

fn give_up(file: &str, reason: &str) -> ! {
    eprintln!("\nthe shim over libsumo did not compile: {file}: {reason}");
    eprintln!("What to do: install a compiler of C++17 (on Debian: apt install g++)\n");
    exit(1)
}
