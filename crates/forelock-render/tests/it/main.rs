//! The tests of this crate that use its public interface alone, as one program.

#[cfg(feature = "gpu")]
mod gpu;
mod pictures;
