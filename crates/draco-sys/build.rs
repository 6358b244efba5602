//! Finds Debian's libdraco, compiles the shim against it and links both statically.

use std::path::{Path, PathBuf};

/// The last Draco whose decoder the shim was checked against is 1.5.5; the
/// interfaces it uses appeared in 1.4.
const OLDEST_VERSION: &str = "1.4";

fn main() {
    println!("cargo::rerun-if-changed=shim");
    let draco = find_draco();
    let mut build = cc::Build::new();
    build
        .cpp(true)
        .std("c++17")
        .opt_level(2)
        .flag("-fexceptions")
        .flag_if_supported("-Wno-unused-parameter")
        .include("shim")
        .files(["shim/budget.cc", "shim/decode.cc", "shim/encode.cc"]);
    for include in &draco.include_paths {
        // A system folder must not be named again: that would reorder the
        // standard library's own `#include_next`.
        if include != Path::new("/usr/include") {
            build.include(include);
        }
    }
    build.cpp_link_stdlib(None).compile("steadymesh_draco_shim");
    println!(
        "cargo::rustc-link-search=native={}",
        draco.archive_folder.display()
    );
    println!("cargo::rustc-link-lib=static=draco");
    // After the two archives: the shim's `operator new` must be found first.
    println!("cargo::rustc-link-lib=dylib=stdc++");
}

struct Draco {
    include_paths: Vec<PathBuf>,
    archive_folder: PathBuf,
}

fn find_draco() -> Draco {
    let library = pkg_config::Config::new()
        .cargo_metadata(false)
        .atleast_version(OLDEST_VERSION)
        .probe("draco")
        .unwrap_or_else(|_| {
            panic!(
                "libdraco {OLDEST_VERSION} or later was not found; install Debian's packages \
                 `libdraco-dev` and `pkg-config`"
            )
        });
    let archive_folder = library
        .link_paths
        .iter()
        .find(|folder| folder.join("libdraco.a").is_file())
        .cloned()
        .unwrap_or_else(|| {
            panic!(
                "the static library libdraco.a is not in {:?}; install Debian's package \
                 `libdraco-dev`, which holds it",
                library.link_paths
            )
        });
    Draco {
        include_paths: library.include_paths,
        archive_folder,
    }
}
