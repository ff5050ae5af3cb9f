//! How a player is built.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use forelock_core::groom::guides::Skinning;
use forelock_core::simulation::{BuildError, check_memory};
use forelock_core::solver::Solver;
use forelock_gpu::Gpu;

use super::bending::Bending;
use super::engine::{Engine, Solvers, Start};
use super::history::{History, HistoryOptions};
use super::live::Live;
use super::timeline::Timeline;
use super::{Player, PlayerError};
use crate::assets::Assets;
use crate::backend::Backend;
use crate::progress::Observer;
use crate::scene::Scene;

/// Options of a [`Player`].
#[derive(Debug)]
pub struct PlayerBuilder {
    scene: Arc<Scene>,
    assets: Option<Arc<Assets>>,
    backend: Backend,
    gpu: Option<Gpu>,
    history: Option<HistoryOptions>,
    solvers: Solvers,
}

impl PlayerBuilder {
    pub(super) fn new(scene: Arc<Scene>) -> Self {
        Self {
            scene,
            assets: None,
            backend: Backend::default(),
            gpu: None,
            history: Some(HistoryOptions::default()),
            solvers: Solvers::default(),
        }
    }

    /// Uses `assets` instead of loading what the scene names.
    #[must_use]
    pub fn assets(self, assets: Arc<Assets>) -> Self {
        Self { assets: Some(assets), ..self }
    }

    /// Computes on `backend`. Default [`Backend::Cpu`].
    #[must_use]
    pub fn backend(self, backend: Backend) -> Self {
        Self { backend, ..self }
    }

    /// Simulates on `gpu`, an engine's device ([`Gpu::from_device`]), in place of one of its own,
    /// and sets the backend to [`Backend::Gpu`]. [`Player::step`] waits for the device, for its
    /// report.
    #[must_use]
    pub fn gpu(self, gpu: Gpu) -> Self {
        Self { gpu: Some(gpu), backend: Backend::Gpu, ..self }
    }

    /// How many states of the past are kept. Default [`HistoryOptions::default`].
    #[must_use]
    pub fn history(self, options: HistoryOptions) -> Self {
        Self { history: Some(options), ..self }
    }

    /// Keeps no states of the past and records no changes: the player neither seeks nor undoes.
    #[must_use]
    pub fn without_history(self) -> Self {
        Self { history: None, ..self }
    }

    /// Registers the solver `name`: a scene that names it in `solver.kind` runs with what `make`
    /// returns for its table of parameters, `[solver.NAME]`. Such a scene is read by
    /// [`Scene::load_with`].
    ///
    /// ```
    /// use forelock::core::solver::DftlParams;
    /// use forelock::player::Player;
    /// use forelock::Scene;
    /// use std::path::Path;
    ///
    /// let text = "[groom]\nstrands = 5\n[body]\ncollide = false\n\
    ///             [solver]\nkind = \"chain\"\n[solver.chain]\ndamping = 0.8\n";
    /// let scene = Scene::parse_with(text, Path::new("scene.toml"), &[], &["chain"])?;
    /// let player = Player::builder(scene).solver("chain", |table| {
    ///     let damping = table.get("damping").and_then(|value| value.as_float());
    ///     let damping = damping.ok_or("damping is missing")?;
    ///     Ok((&DftlParams { damping, ..DftlParams::default() }).into())
    /// });
    /// player.build()?.step()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn solver(
        mut self,
        name: impl Into<String>,
        make: impl Fn(&toml::Table) -> Result<Solver<f32>, String> + Send + Sync + 'static,
    ) -> Self {
        self.solvers.register(name.into(), Arc::new(make));
        self
    }

    /// Builds the player, at rest before the first frame.
    ///
    /// # Errors
    /// [`PlayerError`] if something that the scene names cannot be used.
    pub fn build(self) -> Result<Player, PlayerError> {
        self.build_observed(&mut |_| {})
    }

    /// Like [`PlayerBuilder::build`]; `observer` receives what is worth knowing about the assets.
    ///
    /// # Errors
    /// The same errors as [`PlayerBuilder::build`].
    pub fn build_observed(self, observer: &mut Observer<'_>) -> Result<Player, PlayerError> {
        static PLAYERS: AtomicU64 = AtomicU64::new(0);
        let Self { scene, assets, backend, gpu, history, solvers } = self;
        let assets = match assets {
            Some(assets) => assets,
            None => {
                // Before minutes of growth, not after them.
                let groom = &scene.groom;
                let share = if groom.guides > 0 { groom.strands.div_ceil(groom.guides) } else { 1 };
                let simulated = groom.grown_particles() / u64::from(share);
                check_memory(simulated, &scene.interaction.interactions()).map_err(BuildError::from)?;
                Arc::new(Assets::load(&scene, observer)?)
            }
        };
        let guides = scene.groom.guides as usize;
        let skinning = (guides > 0).then(|| Skinning::new(&assets.groom, guides, scene.seed)).transpose()?;
        let groom = skinning.as_ref().map_or(&assets.groom, Skinning::guides);
        let live = Live::new(&scene, &assets, &solvers)?;
        let mut bending = Bending::new(&assets, groom);
        let solids: Vec<_> =
            live.measured_solids(&assets, true).into_iter().map(|solid| solid.frame).collect();
        let start = Start { head: live.head_at, solids: &solids };
        let bends_on_cpu = bending.is_some() && backend == Backend::Auto;
        let backend = if bends_on_cpu { Backend::Cpu } else { backend };
        let (mut engine, note) = Engine::new(&scene, groom, &live.setting.parts(), backend, gpu, start)?;
        drop(solids);
        if let Some(bending) = &mut bending
            && let Some(frames) = bending.at(&assets, [0.0; 2], false).roots.at_start()
        {
            engine.simulator().rest_on(&live.head_at, frames)?;
        }
        let middle = assets.middle_of_roots();
        let of_model = live.setting.learned.iter().flat_map(|learned| learned.notes.clone());
        let notes = note.into_iter().chain(of_model).collect();
        let mut player = Player {
            engine,
            start: live.clone(),
            live,
            timeline: Timeline::default(),
            history: history.map(History::new),
            reached: 0,
            id: PLAYERS.fetch_add(1, Ordering::Relaxed),
            bending,
            skinning,
            middle,
            simulated: Vec::new(),
            notes,
            scene,
            assets,
            solvers,
        };
        player.keep_state()?;
        Ok(player)
    }
}
