//! Compares the solvers with results that are known in advance: closed forms, conservation laws,
//! invariances, and the accuracy that this project requires (`thresholds`). Nothing here is
//! compared with stored output; `goldens` does that.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

mod air;
mod bending;
mod channels;
mod closed_forms;
mod contacts;
mod counting;
pub mod dense;
mod faults;
mod follow;
mod grid;
mod hash;
mod invariance;
mod keeper;
mod limit;
mod masses;
mod non_hookean;
mod particles;
pub mod rig;
mod rods;
mod roots;
mod settles;
mod sleep;
mod solids;
mod steps;
mod swept;
mod system;
mod thresholds;
