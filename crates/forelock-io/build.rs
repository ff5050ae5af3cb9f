//! Finds the real grooms that some tests read, so that those tests are ignored, not passed, where the files
//! are missing.

use std::{env, path::Path};

fn main() {
    println!("cargo::rustc-check-cfg=cfg(forelock_data)");
    println!("cargo::rerun-if-env-changed=FORELOCK_DATA");
    println!("cargo::rerun-if-changed=build.rs");
    let beside = format!("{}/../../../shared/data", env::var("CARGO_MANIFEST_DIR").unwrap_or_default());
    let folder = env::var("FORELOCK_DATA").unwrap_or(beside);
    let readme = Path::new(&folder).join("README.md");
    if readme.is_file() {
        println!("cargo::rerun-if-changed={}", readme.display());
        println!("cargo::rustc-cfg=forelock_data");
        println!("cargo::rustc-env=FORELOCK_DATA_FOLDER={folder}");
    }
}
