//! The tests of this crate that use its public interface alone, as one program.

mod golden;
mod losses;
mod network;
mod reference;
