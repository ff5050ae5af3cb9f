//! The panels around the picture.

pub mod change;
pub mod files;
pub mod keys;
pub mod play;
pub mod recent;
pub mod see;
