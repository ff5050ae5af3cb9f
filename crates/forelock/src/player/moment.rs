//! The present frame, detached from the player: what a picture of it needs.

use std::borrow::Cow;
use std::sync::Arc;

use forelock_core::air::WindParams;
use forelock_core::body::TriMesh;
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_render::{Body, Camera};
use glam::Vec3;

use super::regrooming::Covering;
use super::timeline::Change;
use super::told::{Asked, Told};
use super::{Player, PlayerError};
use crate::assets::{Assets, Solid};
use crate::pictures::{self, Studio};
use crate::scene::{CameraSection, EditSection, HairSection, InteractionSection, Scene, SolverSection};

/// Strands, body and solids at one frame. It stays as it is while the player goes on.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Frames done.
    pub frame: u32,
    /// Its time, seconds.
    pub time_secs: f64,
    /// World from head.
    pub head: Pose,
    /// All strands, those that guides carry included, metres, in the order of [`Moment::groom`].
    pub positions: Vec<Vec3>,
    /// What was asked for besides: see [`Player::moment_with`].
    pub told: Told,
    assets: Arc<Assets>,
    /// The edited groom that `positions` are of; none for that of the assets.
    edited: Option<Arc<Groom>>,
    /// How the groom with all edits covers the body; none for that of the assets.
    covering: Option<Covering>,
    /// The body, if it bends.
    bent: Option<TriMesh>,
    solids: Vec<(Arc<Solid>, Pose)>,
}

/// What can be changed while a player runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// The solver and its parameters.
    pub solver: SolverSection,
    /// How strands interact.
    pub interaction: InteractionSection,
    /// The wind.
    pub wind: WindParams,
    /// Gravity, m/s².
    pub gravity: [f64; 3],
}

impl Moment {
    /// Frame `frame` of a run of `assets`, at `time_secs`, with the strands at `positions`.
    pub(crate) fn recorded(assets: Arc<Assets>, frame: u32, time_secs: f64, positions: Vec<Vec3>) -> Self {
        let head = assets.head_pose(time_secs);
        let bent = bent(&assets, time_secs);
        let solids = assets.solids().iter().map(|solid| (solid.clone(), solid.pose(time_secs, &head)));
        let (solids, told) = (solids.collect(), Told::default());
        Self { frame, time_secs, head, positions, told, edited: None, covering: None, bent, solids, assets }
    }

    /// The groom that the positions are of, at rest; for a cache its first frame.
    pub fn groom(&self) -> &Groom {
        self.edited.as_deref().unwrap_or(&self.assets.groom)
    }

    /// The body, in the space of the head.
    pub fn body(&self) -> Option<&TriMesh> {
        self.bent.as_ref().or(self.assets.body_mesh())
    }

    /// The visible solids and their poses, world from local.
    pub fn solids(&self) -> impl Iterator<Item = (&TriMesh, Pose)> {
        self.solids.iter().filter_map(|(solid, pose)| Some((solid.mesh_at(self.time_secs)?, *pose)))
    }

    /// The box around hair and body, smallest and largest corner, metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let body = self.body().into_iter().flat_map(|mesh| &mesh.positions);
        let body = body.map(|x| self.head.transform_point(x.as_dvec3()).as_vec3());
        let all = self.positions.iter().copied().chain(body).filter(|x| x.is_finite());
        all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)))
    }

    /// The camera of `scene`, of which this is a frame.
    pub fn camera(&self, scene: &Scene) -> Camera {
        Studio::new(scene, &self.assets).camera()
    }

    /// The keys of `scene` that put its camera where `camera` is.
    pub fn camera_keys(&self, scene: &Scene, camera: &Camera) -> CameraSection {
        Studio::new(scene, &self.assets).keys_of(camera)
    }

    /// The scene for a picture from `camera`, in the colours of `hair`.
    pub fn picture(&self, hair: &HairSection, camera: Camera) -> forelock_render::Scene<'_> {
        let edited = self.covering.as_ref();
        let cover = edited.map_or_else(|| self.assets.cover(), |own| own.cover(&self.assets));
        let dress = |mesh| pictures::dressed(hair, &self.assets, cover, Body::new(mesh, self.head));
        let body = self.body().map(dress);
        let solids = self.solids().map(|(mesh, pose)| Body::new(mesh, pose));
        let strands = pictures::strands(hair, self.groom(), &self.positions);
        forelock_render::Scene::new(body.into_iter().chain(solids).collect(), vec![strands], camera)
    }
}

/// The body at `time_secs`, if it bends.
fn bent(assets: &Assets, time_secs: f64) -> Option<TriMesh> {
    match assets.body_mesh_at(time_secs) {
        Some(Cow::Owned(mesh)) => Some(mesh),
        _ => None,
    }
}

impl Player {
    /// The present frame.
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn moment(&mut self) -> Result<Moment, PlayerError> {
        self.moment_with(Asked::default())
    }

    /// The present frame, with what is `asked` for besides, as far as it is known
    /// ([`Player::untold`]).
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn moment_with(&mut self, asked: Asked) -> Result<Moment, PlayerError> {
        let mut positions = Vec::new();
        self.positions(&mut positions)?;
        let told = self.told(asked)?;
        let time_secs = self.time_secs();
        let solids = self.live.solids.iter();
        Ok(Moment {
            frame: self.frame(),
            time_secs,
            head: self.head_pose(),
            positions,
            told,
            assets: self.assets.clone(),
            edited: self.live.grooming.shown_groom().cloned(),
            covering: self.live.grooming.covering.clone(),
            bent: bent(&self.assets, time_secs),
            solids: solids.map(|own| (own.solid.clone(), own.shown[1].after(own.solid.base()))).collect(),
        })
    }

    /// What can be changed, as it is now.
    pub fn parameters(&self) -> Parameters {
        let setting = &self.live.setting;
        let wind = setting.wind.params();
        // The seed of the running wind is the sum of the scene's seed and the wind's own.
        let seed = wind.seed.wrapping_sub(self.scene.seed);
        Parameters {
            solver: (*setting.solver).clone(),
            interaction: (*setting.interaction).clone(),
            wind: WindParams { seed, ..wind.clone() },
            gravity: setting.gravity.to_array(),
        }
    }

    /// The scene with all changes that were made while it ran: solver, interaction, wind and
    /// gravity as they were set last, and the edits from outside as edits before the first frame.
    /// It does not depend on the frame that is shown. Motions and poses from outside, and added
    /// colliders, are no part of it: see [`Player::performed_scene`].
    pub fn changed_scene(&self) -> Scene {
        let Parameters { solver, interaction, wind, gravity } = self.parameters();
        let mut scene = Scene { solver, interaction, wind, gravity, ..(*self.scene).clone() };
        for change in self.timeline.all() {
            match change {
                Change::Solver(solver) => scene.solver = (**solver).clone(),
                Change::Interaction(interaction) => scene.interaction = (**interaction).clone(),
                Change::Wind(wind) => scene.wind = wind.clone(),
                Change::Gravity(gravity) => scene.gravity = gravity.to_array(),
                Change::Edit(edit) => {
                    scene.edits.0.push(EditSection { edit: (**edit).clone(), at_secs: None });
                }
                Change::Motion(_)
                | Change::HeadPose(_)
                | Change::Teleport(_)
                | Change::ColliderPose(..)
                | Change::AddCollider(..)
                | Change::RemoveCollider(_) => {}
            }
        }
        scene.time.substep_secs = scene.solver.substep_secs();
        scene
    }
}
