//! What a [`Moment`](super::Moment) tells of strands besides their positions, on request.
//!
//! # Practice
//! Nothing is noted while the solver steps; what is asked for is read afterwards
//! ([`Player::moment_with`]). [`Player::untold`] says beforehand what cannot be told, and why.
//! Particles that are not simulated tell of the simulated one that they follow most: strands that
//! guides carry of their nearest guide, particles beyond a cut of the tip.

use forelock_core::frame::GridCells;
use forelock_core::simulation::Touch;

use super::{Player, PlayerError};

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asked {
    /// [`Told::damage`].
    pub damage: bool,
    /// [`Told::contacts`].
    pub contacts: bool,
    /// [`Told::grid`].
    pub grid: bool,
}

impl Asked {
    /// Whether all that this asks for is in what `other` asks for.
    pub fn is_in(self, other: Self) -> bool {
        let pairs = [(self.damage, other.damage), (self.contacts, other.contacts), (self.grid, other.grid)];
        pairs.into_iter().all(|(own, other)| other || !own)
    }
}

/// What was asked for and is known. Lists have an entry a particle, in the order of
/// [`Moment::groom`](super::Moment::groom).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// By how much the tie to the rest shape has weakened, from 0, intact, to 1, broken.
    pub damage: Option<Vec<f32>>,
    /// In which contacts it took part in the solver's last step. None also directly after going to
    /// a kept frame and after changes: the next step tells them.
    pub contacts: Option<Vec<Touch>>,
    /// The cells of the grid that held hair in the solver's last step, where the head is now. None
    /// also where `contacts` are none, and while all strands sleep.
    pub grid: Option<GridCells>,
}

/// What cannot be told, and why; none for what can be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Untold {
    /// Why [`Told::damage`] is not known.
    pub damage: Option<WhyUntold>,
    /// Why [`Told::contacts`] are not known.
    pub contacts: Option<WhyUntold>,
    /// Why [`Told::grid`] is not known.
    pub grid: Option<WhyUntold>,
}

/// Why something is not known of strands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WhyUntold {
    /// A cache is played back.
    #[error("a cache holds positions only: open its scene")]
    Cache,
    /// Ties do not weaken.
    #[error("no tie to the rest shape weakens: the solver has none, or its `non_hookean` is off")]
    NoTies,
    /// What simulates does not tell it.
    #[error("it is known of simulations on the CPU only, and not of trained models")]
    Simulator,
    /// Nothing can touch.
    #[error("contacts between strands are off, and there is no solid")]
    NothingTouches,
    /// There is no grid.
    #[error("strands do not interact on a grid")]
    NoGrid,
}

impl Untold {
    /// What a cache does not tell.
    pub const OF_CACHE: Self = Self {
        damage: Some(WhyUntold::Cache),
        contacts: Some(WhyUntold::Cache),
        grid: Some(WhyUntold::Cache),
    };
}

impl Player {
    /// What moments cannot tell of the strands, with the parameters as they are now.
    pub fn untold(&self) -> Untold {
        let weaken = self.live.setting.params.rules().ties_weaken;
        let contacts = if !self.engine.tells_interactions() {
            Some(WhyUntold::Simulator)
        } else if !self.live.setting.interaction.contacts && !self.has_solids() {
            Some(WhyUntold::NothingTouches)
        } else {
            None
        };
        let grid = if !self.engine.tells_interactions() {
            Some(WhyUntold::Simulator)
        } else {
            let has_grid = self.live.setting.interaction.interactions().grid.is_some();
            (!has_grid).then_some(WhyUntold::NoGrid)
        };
        Untold { damage: (!weaken).then_some(WhyUntold::NoTies), contacts, grid }
    }

    /// What is `asked` for, as far as it is known of the present frame.
    pub(super) fn told(&mut self, asked: Asked) -> Result<Told, PlayerError> {
        let untold = self.untold();
        let mut told = Told::default();
        if asked.damage && untold.damage.is_none() {
            let mut damage = Vec::new();
            self.engine.simulator().read_damage(&mut damage)?;
            told.damage = Some(self.of_shown(damage));
        }
        if asked.contacts && untold.contacts.is_none() {
            let mut touches = Vec::new();
            if self.engine.simulator().touches(&mut touches) {
                told.contacts = Some(self.of_shown(touches));
            }
        }
        if asked.grid && untold.grid.is_none() {
            // The grid is where the step ended, the head between two steps.
            let shown = self.live.head_shown.after(&self.live.head_at.inverse());
            let cells = self.engine.simulator().grid_cells();
            told.grid = cells.map(|cells| GridCells { pose: shown.after(&cells.pose), ..cells });
        }
        Ok(told)
    }

    /// The values of the particles that are shown, from those of the simulated ones.
    fn of_shown<T: Copy>(&self, values: Vec<T>) -> Vec<T> {
        match &self.skinning {
            Some(skinning) => skinning.nearest().map(|particle| values[particle]).collect(),
            None => match self.live.grooming.nearest() {
                Some(nearest) => nearest.map(|particle| values[particle]).collect(),
                None => values,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Override, SolverKind, SolverSection};
    use crate::{Backend, Scene};
    use forelock_core::groom::edit::{Operation, Trim};
    use glam::{IVec3, Vec3};
    use std::collections::HashSet;

    const ALL: Asked = Asked { damage: true, contacts: true, grid: true };

    fn player(sets: &[&str]) -> Player {
        player_on(Backend::Cpu, sets)
    }

    fn player_on(backend: Backend, sets: &[&str]) -> Player {
        let small = ["groom.strands=60", "body.sdf_cells=32", "solver.sleep_speed=0"];
        let sets: Vec<_> = small.iter().chain(sets).map(|set| Override::set(set).unwrap()).collect();
        Player::builder(Scene::builtin(&sets).unwrap()).backend(backend).build().unwrap()
    }

    #[test]
    fn what_is_not_asked_for_is_not_told() {
        let mut player = player(&["solver.ams.non_hookean=true"]);
        player.step().unwrap();
        assert_eq!(player.moment().unwrap().told, Told::default());
        let hash = player.state_hash().unwrap();
        let told = player.moment_with(ALL).unwrap().told;
        let count = player.groom().particle_count();
        assert_eq!(told.damage.map(|own| own.len()), Some(count));
        assert_eq!(told.contacts.map(|own| own.len()), Some(count));
        assert_eq!(player.state_hash().unwrap(), hash);
    }

    #[test]
    fn hair_that_lies_on_the_head_touches_it() {
        let mut player = player(&["interaction.contacts=false"]);
        assert_eq!(player.moment_with(ALL).unwrap().told, Told::default());
        let mut touching = 0;
        for _ in 0..20 {
            touching = player.step().unwrap().solver.touching;
        }
        let contacts = player.moment_with(ALL).unwrap().told.contacts.unwrap();
        let found = contacts.iter().filter(|own| own.solids).count();
        assert!(touching > 0 && found > 0, "{found} of {touching}");
        assert!(found < contacts.len() / 2, "{found}");
        assert!(contacts.iter().all(|own| !own.strands));
        // A state that was kept does not hold them; the step after it tells them again.
        player.seek(0).unwrap();
        assert_eq!(player.moment_with(ALL).unwrap().told.contacts, None);
        player.seek(20).unwrap();
        assert_eq!(player.moment_with(ALL).unwrap().told.contacts, Some(contacts));
    }

    #[test]
    fn ties_that_give_way_are_told() {
        let weak = ["solver.ams.non_hookean=true", "solver.ams.elastic_limit=0.01"];
        let shaken = [&weak[..], &["body.motion=builtin:shake"]].concat();
        let mut player = player(&shaken);
        assert_eq!(player.untold().damage, None);
        (0..40).for_each(|_| drop(player.step().unwrap()));
        let damage = player.moment_with(ALL).unwrap().told.damage.unwrap();
        assert!(damage.iter().all(|own| (0.0..=1.0).contains(own)));
        assert!(damage.iter().any(|own| *own > 0.01));
        let intact = player.state().unwrap().integrity;
        assert!(damage.iter().zip(&intact).all(|(own, intact)| *own == 1.0 - intact));
    }

    #[test]
    fn the_grid_is_where_the_hair_is() {
        let grid = ["interaction.kind=grid", "interaction.grid.resolution=16", "body.motion=builtin:turn"];
        // Frames that end between two steps of the solver.
        let mut player = player(&[&grid[..], &["time.fps=100"]].concat());
        assert_eq!(player.untold().grid, None);
        (0..33).for_each(|_| drop(player.step().unwrap()));
        let moment = player.moment_with(ALL).unwrap();
        let cells = moment.told.grid.unwrap();
        let back = cells.pose.inverse();
        let cell = |x: &Vec3| (back.transform_point(x.as_dvec3()) / cells.side).floor().as_ivec3();
        let held: HashSet<_> = cells.cells.iter().map(|own| IVec3::from_array(own.at)).collect();
        assert_eq!(held.len(), cells.cells.len());
        let inside = moment.positions.iter().filter(|x| held.contains(&cell(x))).count();
        assert!(inside * 100 > moment.positions.len() * 95, "{inside} of {}", moment.positions.len());
        // It is not elsewhere.
        let beside = |x: &&Vec3| held.contains(&(cell(x) + IVec3::X * 40));
        assert_eq!(moment.positions.iter().filter(beside).count(), 0);
        player.seek(0).unwrap();
        assert_eq!(player.moment_with(ALL).unwrap().told.grid, None);
    }

    #[test]
    #[cfg_attr(not(gpu), ignore = "there is no GPU")]
    fn a_gpu_tells_damage_only() {
        let weak = ["solver.ams.non_hookean=true", "solver.ams.elastic_limit=0.01"];
        let shaken = [&weak[..], &["body.motion=builtin:shake"]].concat();
        let mut player = player_on(Backend::Gpu, &shaken);
        let why = Some(WhyUntold::Simulator);
        assert_eq!(player.untold(), Untold { damage: None, contacts: why, grid: why });
        (0..20).for_each(|_| drop(player.step().unwrap()));
        let told = player.moment_with(ALL).unwrap().told;
        assert_eq!((told.contacts, told.grid), (None, None));
        let damage = told.damage.unwrap();
        assert!(damage.iter().any(|own| *own > 0.01));
        let intact = player.state().unwrap().integrity;
        assert!(damage.iter().zip(&intact).all(|(own, intact)| *own == 1.0 - intact));
    }

    #[test]
    fn what_cannot_be_told_says_why() {
        let mut elastic = player(&["interaction.kind=none"]);
        let none = Untold { damage: Some(WhyUntold::NoTies), contacts: None, grid: Some(WhyUntold::NoGrid) };
        assert_eq!(elastic.untold(), none);
        let leader = SolverSection { kind: SolverKind::Dftl, ..elastic.solver().clone() };
        elastic.set_params(&leader).unwrap();
        elastic.step().unwrap();
        assert_eq!(elastic.untold().damage, Some(WhyUntold::NoTies));
        assert_eq!(elastic.moment_with(ALL).unwrap().told.damage, None);
        assert!(elastic.moment_with(ALL).unwrap().told.contacts.is_some());
        let bare = player(&["body.collide=false", "interaction.contacts=false"]);
        assert_eq!(bare.untold().contacts, Some(WhyUntold::NothingTouches));
        let contacts = player(&["body.collide=false"]);
        assert_eq!(contacts.untold().contacts, None);
    }

    #[test]
    fn strands_that_are_not_simulated_tell_of_those_that_they_follow() {
        let mut guided = player(&["groom.guides=10"]);
        (0..10).for_each(|_| drop(guided.step().unwrap()));
        let contacts = guided.moment_with(ALL).unwrap().told.contacts.unwrap();
        assert_eq!(contacts.len(), guided.groom().particle_count());
        let mut own = Vec::new();
        assert!(guided.engine.simulator().touches(&mut own));
        let skinning = guided.skinning.as_ref().unwrap();
        for (guide, &strand) in skinning.chosen().iter().enumerate() {
            let [whole, part] = [guided.groom().range(strand), skinning.guides().range(guide)];
            assert_eq!(contacts[whole], own[part], "{guide}");
        }
        // Where a cut shortens strands, what is shown keeps its layout.
        let mut cut = player(&[]);
        cut.edit(Operation::Trim(Trim { to: 0.05, ..Trim::default() })).unwrap();
        (0..5).for_each(|_| drop(cut.step().unwrap()));
        let moment = cut.moment_with(ALL).unwrap();
        assert_eq!(moment.told.contacts.unwrap().len(), moment.positions.len());
    }
}
