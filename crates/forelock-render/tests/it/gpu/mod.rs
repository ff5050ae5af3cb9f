//! Pictures by the GPU, compared with those by the CPU. All tests share one device.

mod agreement;

use forelock_gpu::{Choice, Gpu};
use forelock_render::gpu::GpuRenderer;
use std::sync::LazyLock;

/// A renderer on the one device of all tests. The build script compiles tests as ignored where
/// there is none.
fn renderer() -> GpuRenderer {
    static GPU: LazyLock<Gpu> = LazyLock::new(|| {
        Gpu::open(&Choice::Fastest).unwrap_or_else(|error| {
            panic!("{error}; build with FORELOCK_REQUIRE_GPU=0 to leave these tests out")
        })
    });
    GpuRenderer::new(GPU.device(), GPU.queue())
}
