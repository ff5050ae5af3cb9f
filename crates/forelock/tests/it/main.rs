//! The tests of this crate that use its public interface alone, as one program.

mod ams_scenes;
mod chain;
mod characters;
mod documented_parameters;
mod frame_rates;
mod measure;
mod measured_runs;
mod mesh_sequence;
mod neural;
mod player;
mod rates_agree;
mod readme;
mod real_grooms;
mod renderer;
mod sleep;
mod teleports;
mod training;
