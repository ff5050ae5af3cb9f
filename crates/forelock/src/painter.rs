//! Pictures by a GPU.

use std::sync::{Mutex, PoisonError};

use forelock_gpu::{Choice, Gpu};
use forelock_render::gpu::GpuRenderer;
use forelock_render::{Image, Scene, Settings};

use crate::pictures::PictureError;
use crate::scene::Renderer;

/// A GPU that draws pictures for [`Studio::drawn_by`](crate::Studio::drawn_by).
#[derive(Debug)]
pub struct GpuPainter {
    gpu: Gpu,
    renderer: Mutex<GpuRenderer>,
}

impl GpuPainter {
    /// Opens the fastest GPU.
    ///
    /// # Errors
    /// [`PictureError::NoGpu`] if there is none.
    pub fn open() -> Result<Self, PictureError> {
        let gpu = Gpu::open(&Choice::Fastest)?;
        let renderer = Mutex::new(GpuRenderer::new(gpu.device(), gpu.queue()));
        gpu.check()?;
        Ok(Self { gpu, renderer })
    }

    /// The painter that `scene` asks for; none: the CPU draws.
    ///
    /// # Errors
    /// [`PictureError::NoGpu`] if there is no GPU.
    pub fn of(scene: &crate::Scene) -> Result<Option<Self>, PictureError> {
        (scene.output.renderer == Renderer::Gpu).then(Self::open).transpose()
    }

    /// Draws `scene`.
    ///
    /// # Errors
    /// [`PictureError`] if the scene cannot be drawn or the GPU failed.
    pub(crate) fn render(&self, scene: &Scene<'_>, settings: &Settings) -> Result<Image, PictureError> {
        let mut renderer = self.renderer.lock().unwrap_or_else(PoisonError::into_inner);
        let drawn = renderer.render(scene, settings);
        self.gpu.check()?;
        let dropped = renderer.report().dropped;
        if drawn.is_ok() && dropped > 0 {
            tracing::warn!("the GPU has no room for {dropped} pieces of strands: the picture lacks them");
        }
        Ok(drawn?)
    }
}
