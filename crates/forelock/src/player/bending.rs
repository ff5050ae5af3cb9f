//! A player's body that bends: the motion of the roots, and the skin as a solid.

use std::sync::Arc;

use forelock_core::body::character::{Performance, PosingBuffers, SkinPose};
use forelock_core::body::{ClosedMesh, ColliderFrame, Shape};
use forelock_core::frame::Roots;
use forelock_core::groom::{FrameBuffers, Groom, RootFrames, SkinnedRoots};
use forelock_core::pose::Pose;

use crate::assets::{Assets, BendingSolid};
use crate::penetration::MeasuredSolid;

/// The motion of each root relative to the joint that carries the hair, as a function of time.
#[derive(Debug)]
pub(super) struct Bending {
    performance: Arc<Performance>,
    roots: Arc<SkinnedRoots>,
    /// The edited groom that the roots are those of; none for the groom of the assets.
    groom: Option<Arc<Groom>>,
    posing: PosingBuffers,
    buffers: FrameBuffers,
    frames: Ends<RootFrames>,
    /// The poses of the skin, for simulators that compute the motions themselves.
    poses: Ends<SkinPose>,
    /// The skin as a solid between two times, if hair collides with it.
    skin: Option<Skin>,
}

/// What a step needs at its start and its end, each a function of the time alone.
#[derive(Debug, Default)]
struct Ends<T> {
    own: [T; 2],
    secs: [Option<f64>; 2],
}

impl<T> Ends<T> {
    /// The values at the times `secs`. `make` computes those that the step before has not left.
    fn at(&mut self, secs: [f64; 2], mut make: impl FnMut(f64, &mut T)) -> [&T; 2] {
        if self.secs[1] == Some(secs[0]) {
            self.own.swap(0, 1);
            self.secs.swap(0, 1);
        }
        for ((secs, known), own) in secs.into_iter().zip(&mut self.secs).zip(&mut self.own) {
            if *known != Some(secs) {
                make(secs, own);
                *known = Some(secs);
            }
        }
        self.own.each_ref()
    }
}

/// The skin of a body as a solid.
#[derive(Debug)]
struct Skin {
    shape: Shape,
    secs: [f64; 2],
}

/// The roots in a step, at both ends.
#[derive(Clone, Copy)]
pub(super) enum BentRoots<'a> {
    /// Their motions.
    Motions([&'a RootFrames; 2]),
    /// The poses of the skin, from which a simulator computes them.
    Posed { roots: &'a Arc<SkinnedRoots>, poses: [&'a SkinPose; 2] },
}

impl<'a> BentRoots<'a> {
    /// The input of a frame in which the head moves between the poses `head`.
    pub fn on(self, head: [Pose; 2]) -> Roots<'a> {
        match self {
            Self::Motions(frames) => Roots::PerStrand { head, frames },
            Self::Posed { roots, poses } => Roots::OnSkin { head, roots, poses },
        }
    }

    /// Their motions at the start, if they are known.
    pub fn at_start(self) -> Option<&'a RootFrames> {
        if let Self::Motions([from, _]) = self { Some(from) } else { None }
    }
}

/// What a step needs of a body that bends.
#[derive(Clone, Copy)]
pub(super) struct BentBody<'a> {
    /// The roots.
    pub roots: BentRoots<'a>,
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
            roots: Arc::new(assets.bind(groom)?),
            performance,
            groom: None,
            posing: PosingBuffers::default(),
            buffers: FrameBuffers::default(),
            frames: Ends::default(),
            poses: Ends::default(),
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
            (self.roots, self.groom) = (Arc::new(roots), edited.cloned());
            self.frames = Ends::default();
        }
    }

    /// The body between two times, seconds: with the motions of its roots, or `posed` for a
    /// simulator that computes them.
    pub fn at<'a>(&'a mut self, assets: &'a Assets, secs: [f64; 2], posed: bool) -> BentBody<'a> {
        let Self { performance, roots, posing, buffers, frames, poses, skin, .. } = self;
        if let Some(skin) = skin {
            skin.bend(performance, secs, posing);
        }
        let roots = if posed {
            let poses = poses.at(secs, |secs, pose| {
                performance.pose(secs, posing, pose);
            });
            BentRoots::Posed { roots, poses }
        } else {
            BentRoots::Motions(frames.at(secs, |secs, frames| {
                let posed = performance.posed(secs, posing);
                roots.surface().frames(posed.positions, buffers, frames);
            }))
        };
        let skin = assets.bending_solid().zip(skin.as_ref().map(|skin| &skin.shape));
        BentBody { roots, skin }
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
