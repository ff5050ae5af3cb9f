//! A player's body that bends: the motion of the roots, and the skin as a solid.

use std::sync::Arc;

use forelock_core::body::character::{Performance, PosingBuffers};
use forelock_core::body::{ClosedMesh, ColliderFrame, Shape};
use forelock_core::groom::{FrameBuffers, Groom, RootFrames, SurfaceRoots};
use forelock_core::pose::Pose;

use crate::assets::{Assets, BendingSolid};
use crate::penetration::MeasuredSolid;

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
    /// The skin as a solid between two times, if hair collides with it.
    skin: Option<Skin>,
}

/// The skin of a body as a solid.
#[derive(Debug)]
struct Skin {
    shape: Shape,
    secs: [f64; 2],
}

/// What a step needs of a body that bends.
#[derive(Clone, Copy)]
pub(super) struct BentBody<'a> {
    /// The motions of the roots at both ends.
    pub roots: [&'a RootFrames; 2],
    skin: Option<(&'a BendingSolid, &'a Shape)>,
}

impl<'a> BentBody<'a> {
    /// The skin as a solid that moves with the joint that carries the hair.
    pub fn solid(&self, joint: [Pose; 2]) -> Option<ColliderFrame<'a>> {
        self.skin.map(|(solid, shape)| solid.frame(shape, joint))
    }
}

/// The skin at one time, with its surface.
#[derive(Debug)]
pub(super) struct ShownSkin {
    shape: Shape,
    surface: ClosedMesh,
}

impl ShownSkin {
    /// The skin of the body of `assets` at `secs`, if hair collides with it.
    pub fn new(assets: &Assets, secs: f64) -> Option<Self> {
        let (performance, solid) = (assets.performance()?, assets.bending_solid()?);
        let mut buffers = PosingBuffers::default();
        let positions = performance.posed(secs, &mut buffers).positions;
        let mut field = solid.field.clone();
        field.hold(positions);
        let surface = field.faces().closed(positions);
        Some(Self { shape: Shape::Bending(Arc::new(field)), surface })
    }

    /// It at two poses of the joint that carries the hair.
    pub fn measured(&self, solid: &BendingSolid, joint: [Pose; 2]) -> MeasuredSolid<'_> {
        MeasuredSolid { frame: solid.frame(&self.shape, joint), surface: Some(&self.surface) }
    }
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
            skin: assets.bending_solid().map(|solid| Skin {
                shape: Shape::Bending(Arc::new(solid.field.clone())),
                secs: [f64::NAN; 2],
            }),
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

    /// The body between two times, seconds.
    pub fn at<'a>(&'a mut self, assets: &'a Assets, secs: [f64; 2]) -> BentBody<'a> {
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
        if let Some(skin) = &mut self.skin {
            skin.bend(&self.performance, secs, &mut self.posing);
        }
        let [from, to] = &self.frames;
        let skin = assets.bending_solid().zip(self.skin.as_ref().map(|skin| &skin.shape));
        BentBody { roots: [from, to], skin }
    }
}

impl Skin {
    /// Moves it to the step between two times.
    fn bend(&mut self, performance: &Performance, secs: [f64; 2], posing: &mut PosingBuffers) {
        let Shape::Bending(field) = &mut self.shape else { return };
        if self.secs == secs {
            return;
        }
        let field = Arc::make_mut(field);
        if self.secs[1] == secs[0] {
            field.advance(performance.posed(secs[1], posing).positions);
        } else {
            let from = performance.posed(secs[0], posing).positions.to_vec();
            field.set([&from, performance.posed(secs[1], posing).positions]);
        }
        self.secs = secs;
    }
}
