//! Compiles the tests that need a GPU as ignored where there is none. `FORELOCK_REQUIRE_GPU`
//! decides (0 or 1); where it is not set, on Linux, whether there is a card, or the driver of Mesa
//! that needs none.

fn main() {
    println!("cargo::rerun-if-env-changed=FORELOCK_REQUIRE_GPU");
    println!("cargo::rustc-check-cfg=cfg(gpu)");
    let software = format!("/usr/share/vulkan/icd.d/lvp_icd.{}.json", std::env::consts::ARCH);
    let signs = ["/dev/dri/renderD128", "/dev/nvidia0", "/dev/dxg", &software];
    let found = !cfg!(target_os = "linux") || signs.iter().any(|sign| std::path::Path::new(sign).exists());
    if std::env::var("FORELOCK_REQUIRE_GPU").map_or(found, |asked| asked != "0") {
        println!("cargo::rustc-cfg=gpu");
    }
}
