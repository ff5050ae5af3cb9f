//! The tests of this crate that use its public interface alone, as one program.

mod codes;
mod features;
mod golden;
mod losses;
mod measures;
mod model;
mod network;
mod packed;
mod reference;
mod rigged;
