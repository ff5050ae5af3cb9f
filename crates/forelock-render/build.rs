//! Sets `cfg(gpu)` where a GPU can be used; tests that need one are ignored otherwise.
//! `FORELOCK_REQUIRE_GPU` (0 or 1) decides. Where it is not set, on Linux, the script looks for a
//! graphics card or for Mesa's software driver.

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
