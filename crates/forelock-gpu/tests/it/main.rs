//! The tests of this crate that use its public interface alone, as one program.

mod common;
#[path = "../../../forelock-core/tests/it/golden/mod.rs"]
mod golden;
#[path = "../../../forelock-core/tests/it/golden_rods.rs"]
mod golden_rods;
mod gpu;
mod kernels;
