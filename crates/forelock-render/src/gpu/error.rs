//! Why the GPU cannot draw a picture.

use crate::image::ImageError;
use crate::scene::RenderError;

/// Why the GPU cannot draw a picture.
#[derive(Debug, thiserror::Error)]
pub enum GpuRenderError {
    /// The scene or a setting is invalid.
    #[error(transparent)]
    Scene(#[from] RenderError),
    /// The picture cannot be made.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A buffer exceeds the limits of the device.
    #[error("{what} take {bytes} bytes, but the GPU allows {limit}; draw fewer strands or a smaller picture")]
    TooLarge {
        /// What is in the buffer.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size that the device allows.
        limit: u64,
    },
    /// Positions that are on the device cannot be used.
    #[error("shared positions cannot be used: {0}")]
    Shared(String),
    /// A target cannot be drawn over.
    #[error("the target cannot be drawn over: {0}")]
    Target(String),
    /// The device did not finish its work.
    #[error("the GPU failed: {0}")]
    Failed(String),
}
