//! Compiles the tests that read real bodies as ignored where there are none.

fn main() {
    println!("cargo::rerun-if-env-changed=FORELOCK_DATA");
    println!("cargo::rustc-check-cfg=cfg(real_data)");
    let data = std::env::var("FORELOCK_DATA").unwrap_or_else(|_| "../../../shared/data".to_owned());
    if let Ok(data) = std::fs::canonicalize(data) {
        println!("cargo::rustc-cfg=real_data");
        println!("cargo::rustc-env=REAL_DATA={}", data.display());
    }
}
