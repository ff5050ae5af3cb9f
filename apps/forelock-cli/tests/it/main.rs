//! The tests of the command, as one program.

mod bad_input;
mod bench;
mod common;
mod gpu;
mod grooming;
mod help;
#[cfg(unix)]
mod kills;
mod runs;
mod shots;
