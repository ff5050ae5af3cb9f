//! Playing a cache back.

use std::path::PathBuf;
use std::sync::Arc;

use forelock_core::frame::FrameReport;
use forelock_io::Cache;
use glam::Vec3;

use super::Status;
use super::worker::{Source, Task};
use crate::assets::Assets;
use crate::pictures;
use crate::player::{Asked, Moment, Untold};
use crate::scene::Scene;

/// A cache, open at one of its frames, with body and solids where the scene has them.
pub(super) struct Recording {
    path: PathBuf,
    cache: Cache,
    scene: Scene,
    assets: Arc<Assets>,
    frame: u32,
}

impl Recording {
    /// Opens the cache at `path` that a run of `scene` wrote.
    pub fn open(path: PathBuf, scene: Scene) -> Result<Self, String> {
        let mut cache = Cache::open(&path).map_err(|error| error.to_string())?;
        let assets = Assets::of_cache(&scene, &mut cache).map_err(|error| error.to_string())?;
        Ok(Self { path, cache, scene, assets: Arc::new(assets), frame: 0 })
    }

    fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

impl Source for Recording {
    fn frame(&self) -> u32 {
        self.frame
    }

    fn time_secs(&self) -> f64 {
        pictures::frame_time_secs(&self.scene, &self.cache, self.frame as usize)
    }

    fn reached(&self) -> u32 {
        self.cache.frames().saturating_sub(1) as u32
    }

    fn is_at_end(&self) -> bool {
        self.frame >= self.reached()
    }

    fn step(&mut self) -> Result<FrameReport, String> {
        self.frame += 1;
        Ok(FrameReport::default())
    }

    fn seek(&mut self, frame: u32) -> Result<(), String> {
        self.frame = frame;
        Ok(())
    }

    fn change(&mut self, _: Task) -> Result<(), String> {
        Err(format!("{} is played back: open its scene to change it", self.name()))
    }

    fn moment(&mut self, _: Asked) -> Result<Moment, String> {
        let mut positions: Vec<Vec3> = Vec::new();
        self.cache.read_frame(self.frame as usize, &mut positions).map_err(|error| error.to_string())?;
        Ok(Moment::recorded(self.assets.clone(), self.frame, self.time_secs(), positions))
    }

    fn tell(&self, status: &mut Status) {
        status.device = format!("{}, a cache", self.name());
        status.notes.clone_from(&self.assets.notes);
        status.untold = Untold::OF_CACHE;
    }
}
