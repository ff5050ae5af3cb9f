//! What all tests on a GPU need.

use forelock_gpu::{Choice, Gpu};
use std::sync::OnceLock;

/// The GPU of all tests of this program; none where there is none, which is said, and fails where `FORELOCK_REQUIRE_GPU` asks for one.
pub fn gpu() -> Option<Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    let opened = GPU.get_or_init(|| match Gpu::open(&Choice::Fastest) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("FORELOCK_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("not tested: {error}");
            None
        }
    });
    opened.clone()
}
