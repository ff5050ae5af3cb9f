//! The tests of this crate that use its public interface alone, as one program.

mod ams_scenes;
mod documented_parameters;
mod measure;
mod mesh_sequence;
mod readme;
mod real_grooms;
