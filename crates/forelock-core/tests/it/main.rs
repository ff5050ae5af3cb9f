//! The tests of this crate that use its public interface alone, as one program.

mod golden;
mod golden_rods;
mod goldens;
mod long_run;
mod real_bodies;
mod resample;
mod verification;

use verification::{dense, rig};
