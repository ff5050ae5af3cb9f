//! The tests of this crate that use its public interface alone, as one program.

mod common;
#[path = "../../../forelock-core/tests/it/golden/mod.rs"]
mod golden;
mod gpu;
mod kernels;
