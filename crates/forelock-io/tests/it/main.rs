//! The tests of this crate that use its public interface alone, as one program.

mod alembic;
mod cache;
mod characters;
mod common;
mod files;
mod gltf_hair;
mod interrupted;
mod khronos;
mod malformed;
mod real_data;
mod round_trips;
mod usd;
