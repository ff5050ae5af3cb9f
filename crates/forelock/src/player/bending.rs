//! The roots of a player on a body that bends.

use std::sync::Arc;

use forelock_core::body::character::{Performance, PosingBuffers};
use forelock_core::groom::{FrameBuffers, Groom, RootFrames, SurfaceRoots};

use crate::assets::Assets;

/// The motion of each root relative to the joint that carries the hair, as a function of time.
#[derive(Debug)]
pub(super) struct Bending {
    performance: Arc<Performance>,
    roots: SurfaceRoots,
    /// The edited groom that the roots are those of; none for the groom of the assets.
    groom: Option<Arc<Groom>>,
    posing: PosingBuffers,
    buffers: FrameBuffers,
    /// At the times of `secs`.
    frames: [RootFrames; 2],
    secs: [Option<f64>; 2],
}

impl Bending {
    /// The roots of `groom` on the body of `assets`, if it bends.
    pub fn new(assets: &Assets, groom: &Groom) -> Option<Self> {
        let performance = assets.performance()?.clone();
        Some(Self {
            roots: assets.bind(groom)?,
            performance,
            groom: None,
            posing: PosingBuffers::default(),
            buffers: FrameBuffers::default(),
            frames: [RootFrames::default(), RootFrames::default()],
            secs: [None; 2],
        })
    }

    /// Binds the roots of `edited`, or else of the groom of `assets`, if they are not bound.
    pub fn follow(&mut self, assets: &Assets, edited: Option<&Arc<Groom>>) {
        let is_bound = match (edited, &self.groom) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        if is_bound {
            return;
        }
        if let Some(roots) = assets.bind(edited.map_or(&assets.groom, |groom| groom)) {
            (self.roots, self.groom, self.secs) = (roots, edited.cloned(), [None; 2]);
        }
    }

    /// The motions at two times, seconds.
    pub fn at(&mut self, secs: [f64; 2]) -> [&RootFrames; 2] {
        if self.secs[1] == Some(secs[0]) {
            self.frames.swap(0, 1);
            self.secs.swap(0, 1);
        }
        for ((secs, known), frames) in secs.into_iter().zip(&mut self.secs).zip(&mut self.frames) {
            if *known != Some(secs) {
                let posed = self.performance.posed(secs, &mut self.posing);
                self.roots.frames(posed.positions, &mut self.buffers, frames);
                *known = Some(secs);
            }
        }
        let [from, to] = &self.frames;
        [from, to]
    }
}
