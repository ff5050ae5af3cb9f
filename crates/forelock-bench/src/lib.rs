//! The experiments behind Forelock's figures: the tables and figures of the papers, and how the
//! time of a frame and of a picture scales with the number of strands.
//!
//! # Practice
//! [`paper`] reruns the papers' scenes, which are built in; [`scaling()`] times ever more strands,
//! [`rendering()`] their pictures;
//! [`growth_sheets`] draws the AMS paper's two explorations of growth. `forelock bench` and
//! `forelock grow --sheets` print and write what they return.

mod error;
pub mod paper;
pub mod plot;
pub mod rendering;
pub mod scaling;
mod sheets;

pub use error::BenchError;
pub use rendering::rendering;
pub use scaling::scaling;
pub use sheets::growth_sheets;
