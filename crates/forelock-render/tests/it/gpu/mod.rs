//! Pictures by the GPU, compared with those by the CPU. All tests share one device.

mod agreement;
mod coverage;
mod kept;
mod lists;
mod over;
mod shared;
mod target;

use forelock_gpu::{Choice, Gpu};
use forelock_render::gpu::GpuRenderer;
use std::sync::LazyLock;

/// A renderer on the one device of all tests. The build script compiles tests as ignored where
/// there is none.
fn renderer() -> GpuRenderer {
    let gpu = gpu();
    GpuRenderer::new(gpu.device(), gpu.queue())
}

/// The one device of all tests.
fn gpu() -> Gpu {
    static GPU: LazyLock<Gpu> = LazyLock::new(|| {
        Gpu::open(&Choice::Fastest).unwrap_or_else(|error| {
            panic!("{error}; build with FORELOCK_REQUIRE_GPU=0 to leave these tests out")
        })
    });
    GPU.clone()
}
