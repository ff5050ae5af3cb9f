//! What all tests on a GPU need.

pub mod little;
pub mod rms;
pub mod shaken;

use forelock_gpu::{Choice, Gpu};
use std::sync::LazyLock;

/// The one device of all tests of this program. The build script compiles tests as ignored where
/// there is none.
pub fn gpu() -> Gpu {
    static GPU: LazyLock<Gpu> = LazyLock::new(|| {
        Gpu::open(&Choice::Fastest).unwrap_or_else(|error| {
            panic!("{error}; build with FORELOCK_REQUIRE_GPU=0 to leave these tests out")
        })
    });
    GPU.clone()
}
