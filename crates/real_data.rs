//! Tells the tests whether the real input is there: without it they are compiled as ignored, never passed over.

#![expect(clippy::print_stdout, reason = "this is how a build script speaks to cargo")]

use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-changed=../real_data.rs");
    println!("cargo::rerun-if-env-changed=FORELOCK_DATA");
    println!("cargo::rustc-check-cfg=cfg(real_data)");
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var_os("FORELOCK_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    if let Ok(data) = data.canonicalize() {
        println!("cargo::rustc-cfg=real_data");
        println!("cargo::rustc-env=REAL_DATA={}", data.display());
    }
}
