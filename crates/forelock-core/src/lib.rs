//! Strands, bodies, parameters and the solvers of Forelock on the CPU.
//!
//! Four kinds of data, never mixed:
//!
//! - [`Groom`](groom::Groom): the asset, strands at rest in the scalp's space, what a file holds;
//! - `Model`: what is derived once from groom, body and parameters, constant afterwards;
//! - `State`: what each step changes, and what a snapshot saves;
//! - `Workspace`: scratch that nothing may rely on between steps.
//!
//! Units are SI (metres, seconds, radians) and y is up, unless a name says otherwise.

pub mod air;
pub mod body;
pub mod collide;
mod curve;
pub mod frame;
pub mod groom;
pub mod interaction;
pub mod lane;
pub mod memory;
pub mod meter;
pub mod params;
pub mod pose;
mod scratch;
pub mod simulation;
pub mod simulator;
pub mod solver;
pub mod strands;
