//! What the last frame did to single particles, for whoever shows it.
//!
//! # Practice
//! Nothing is stored for this: both the contacts between strands and the clearances are still there
//! after a frame, and are read when they are asked for. A frame costs nothing more.

use super::{Simulation, SimulationReal};
use crate::frame::GridCells;
use crate::lane::LANES;
use crate::strands::Model;

/// Largest clearance of a particle that touches a solid, metres: above the rounding of positions,
/// far below the thickness of the skin.
const TOUCHING_M: f64 = 1e-6;

/// In which contacts a particle took part in the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Touch {
    /// In a contact between strands that was resolved; of several exchanges in the frame, in the
    /// last.
    pub strands: bool,
    /// In one with a solid: the particle is at its skin or inside.
    pub solids: bool,
}

impl Touch {
    /// What either of both took part in.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self { strands: self.strands || other.strands, solids: self.solids || other.solids }
    }
}

/// What contacts are known of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum LastFrame {
    /// None: something other than a whole frame has changed the state, or what acts on it.
    #[default]
    Unknown,
    /// A frame in which all strands slept.
    Asleep,
    /// A frame in which strands moved.
    Awake,
}

impl<T: SimulationReal> Simulation<T> {
    /// The contacts of each particle of the groom in the last frame, `[P]`, in its order. Strands
    /// that sleep have none. Returns false, and an empty list, where no whole frame has been run
    /// since the start, a jump, a restored state, an edit, or a change of the interactions or of
    /// the set of colliders.
    pub fn touches(&self, out: &mut Vec<Touch>) -> bool {
        out.clear();
        if self.last_frame == LastFrame::Unknown {
            return false;
        }
        out.resize(self.model.groom_particles(), Touch::default());
        each_near(&self.model, |near, place, lane| {
            // An infinite clearance has not been queried.
            let clearance = self.state.clearance[place].0[lane].to_f64().unwrap_or(f64::INFINITY);
            if clearance.is_finite() && clearance <= TOUCHING_M {
                near.into_iter().for_each(|p| out[p].solids = true);
            }
        });
        if self.last_frame == LastFrame::Awake {
            let mut marks = vec![false; LANES * self.model.places()];
            for interaction in &self.interactions {
                interaction.each_in_contact(&mut |particle| marks[particle as usize] = true);
            }
            each_near(&self.model, |near, place, lane| {
                if marks[LANES * place + lane] {
                    near.into_iter().for_each(|p| out[p].strands = true);
                }
            });
        }
        true
    }

    /// The cells of the grid on which strands interact, in the last frame. None without a grid, and
    /// where [`touches`](Self::touches) are not known or all strands slept.
    pub fn grid_cells(&self) -> Option<GridCells> {
        let is_awake = self.last_frame == LastFrame::Awake;
        self.interactions.iter().filter(|_| is_awake).find_map(|own| own.cells())
    }

    /// By how much the tie of each particle of the groom to the rest shape has weakened, `[P]`, in
    /// its order: 0 for an intact one, 1 for a broken one. All are 0 under solvers whose ties do
    /// not weaken ([`FrameRules::ties_weaken`](crate::frame::FrameRules::ties_weaken)).
    pub fn damage(&self, out: &mut Vec<f32>) {
        out.clear();
        out.resize(self.model.groom_particles(), 0.0);
        each_near(&self.model, |near, place, lane| {
            let intact = self.state.integrity[place].0[lane].to_f32().unwrap_or(1.0);
            if near[0] == near[1] {
                out[near[0]] = 1.0 - intact;
            }
        });
    }
}

/// Calls `visit(near, place, lane)` for every particle, with the particles of the groom before and
/// after it on the strand: twice the same for one that is of the groom.
fn each_near<T>(model: &Model<T>, mut visit: impl FnMut([usize; 2], usize, usize)) {
    let every = model.every as usize;
    for block in &model.blocks {
        for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
            let from = model.groom_offset(strand as usize);
            for (i, place) in block.range().enumerate() {
                visit([from + i / every, from + i.div_ceil(every)], place, lane);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{ColliderFrame, Shape};
    use crate::frame::FrameInput;
    use crate::groom::Groom;
    use crate::interaction::contact::ContactParams;
    use crate::interaction::grid::GridParams;
    use crate::pose::Pose;
    use crate::simulation::Options;
    use crate::simulator::{HostPositions, Simulator};
    use crate::solver::{AmsParams, MassSpringParams, Solver};
    use crate::strands::State;
    use glam::{DVec3, Vec3};

    const PARTICLES: usize = 12;

    type Change<'a> = &'a dyn Fn(&mut Simulation<f32>);

    /// Two strands that cross as seen along x, 2 cm apart, and one beside a ball, 1 m away.
    fn strands() -> Groom {
        let along = |from: Vec3, to: Vec3| (0..PARTICLES as u8).map(move |i| from + to * f32::from(i));
        let groom = Groom::from_strands([
            along(Vec3::new(-0.01, 0.0, 0.0), Vec3::new(0.0, -0.01, 0.0)).collect::<Vec<_>>(),
            along(Vec3::new(0.01, -0.083, -0.083), Vec3::new(0.0, 0.0, 0.01)).collect(),
            along(Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, -0.01, 0.0)).collect(),
        ]);
        groom.unwrap()
    }

    /// Two strands thrown at each other, and the third at rest, where the ball is.
    fn thrown(solver: impl Into<Solver<f32>>) -> Simulation<f32> {
        let mut simulation = Simulation::new(&strands(), solver, &Options::default()).unwrap();
        simulation.set_contacts(Some(&ContactParams::default())).unwrap();
        let mut snapshot = simulation.snapshot();
        let of_strand = snapshot.velocities.len() / 3;
        for (strand, velocities) in snapshot.velocities.chunks_mut(of_strand).enumerate() {
            velocities.fill([[1.5, -1.5, 0.0][strand], 0.0, 0.0]);
        }
        simulation.restore(&snapshot).unwrap();
        simulation
    }

    /// A frame, perhaps with the ball; returns the contacts between strands.
    fn step(simulation: &mut Simulation<f32>, has_ball: bool) -> usize {
        let shape = Shape::Sphere { radius: 0.02 };
        let at = Pose::new(glam::DQuat::IDENTITY, DVec3::new(1.01, -0.08, 0.0));
        let ball = [ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: at, to: at, friction: 0.3 }];
        let colliders = if has_ball { &ball[..] } else { &[] };
        let frame = FrameInput { colliders, dt_secs: 1.0 / 60.0, ..FrameInput::default() };
        simulation.step_frame(&frame).unwrap().strand_contacts.contacts
    }

    #[test]
    fn particles_that_meet_are_told() {
        let mut simulation = thrown(&AmsParams::default());
        let mut touches = Vec::new();
        assert!(!simulation.touches(&mut touches) && touches.is_empty());
        let met = step(&mut simulation, true);
        assert!(met > 0);
        assert!(simulation.touches(&mut touches));
        assert_eq!(touches.len(), 3 * PARTICLES);
        // One contact is of two particles of each strand.
        let marked = |strand: usize, of: fn(&Touch) -> bool| {
            touches[strand * PARTICLES..][..PARTICLES].iter().filter(|own| of(own)).count()
        };
        for strand in 0..2 {
            let count = marked(strand, |own| own.strands);
            assert!((2..=2 * met).contains(&count), "{count}");
            assert_eq!(marked(strand, |own| own.solids), 0);
        }
        assert_eq!(marked(2, |own| own.strands), 0);
        // The crossing is at y = −0.083, z = 0.
        assert!(touches[8].strands && touches[9].strands && !touches[3].strands);
        // Clearances of the third strand: outside, at the skin, inside, not queried.
        let clearances = [1e-3, 0.0, -1e-3, f32::NEG_INFINITY];
        let mut state = simulation.state.clone();
        State::each_particle(&simulation.model, |particle, place, lane| {
            if particle >= 2 * PARTICLES {
                state.clearance[place].0[lane] = clearances[particle % 4];
            }
        });
        simulation.state = state;
        assert!(simulation.touches(&mut touches));
        for (particle, own) in touches.iter().enumerate().skip(2 * PARTICLES) {
            assert_eq!(own.solids, matches!(particle % 4, 1 | 2), "{particle}");
        }
    }

    #[test]
    fn contacts_are_not_known_of_a_state_that_no_frame_has_led_to() {
        let mut simulation = thrown(&AmsParams::default());
        let snapshot = simulation.snapshot();
        let mut touches = Vec::new();
        let changes: [Change<'_>; 5] = [
            &|simulation| simulation.restore(&snapshot).unwrap(),
            &|simulation| simulation.set_contacts(None).unwrap(),
            &|simulation| simulation.forget_solids(),
            &|simulation| simulation.teleport(&Pose::IDENTITY, &Pose::IDENTITY, Default::default()),
            &|simulation| simulation.state_mut().velocities.reverse(),
        ];
        for (number, change) in changes.iter().enumerate() {
            step(&mut simulation, true);
            assert!(simulation.touches(&mut touches), "{number}");
            change(&mut simulation);
            assert!(!simulation.touches(&mut touches), "{number}");
        }
        // Without solids and contacts, a frame has none.
        step(&mut simulation, false);
        simulation.forget_solids();
        step(&mut simulation, false);
        assert!(simulation.touches(&mut touches));
        assert!(touches.iter().all(|own| *own == Touch::default()));
    }

    #[test]
    fn particles_of_the_groom_take_part_for_those_between_them() {
        let solver = MassSpringParams::default();
        let mut simulation = thrown(&solver);
        assert!(simulation.model().every > 1);
        let met = step(&mut simulation, true);
        let mut touches = Vec::new();
        assert!(met > 0 && simulation.touches(&mut touches));
        assert_eq!(touches.len(), 3 * PARTICLES);
        assert!(touches[8].strands && touches[9].strands && !touches[3].strands);
    }

    #[test]
    fn cells_hold_the_hair() {
        let strand = |s: u8| {
            let root = Vec3::new(f32::from(s % 8), 0.0, f32::from(s / 8)) * 2e-3;
            (0..PARTICLES as u8).map(move |i| root + Vec3::new(0.0, -0.01, 0.0) * f32::from(i)).collect()
        };
        let groom = Groom::from_strands((0..64).map(strand).collect::<Vec<Vec<Vec3>>>()).unwrap();
        let mut simulation = Simulation::new(&groom, &AmsParams::default(), &Options::default()).unwrap();
        let grid = GridParams { resolution: 16, ..GridParams::default() };
        simulation.set_grid(Some(&grid)).unwrap();
        assert_eq!(simulation.grid_cells(), None);
        // The head is turned: so is the grid.
        let head = Pose::new(glam::DQuat::from_rotation_z(0.4), DVec3::new(0.3, 0.0, -0.1));
        simulation.teleport(&Pose::IDENTITY, &head, Default::default());
        let still = FrameInput { roots: [head; 2].into(), dt_secs: 1.0 / 60.0, ..FrameInput::default() };
        simulation.step_frame(&still).unwrap();
        let cells = simulation.grid_cells().unwrap();
        assert!((cells.side - 0.11 / 16.0).abs() < 1e-6, "{}", cells.side);
        let mut positions = Vec::new();
        simulation.positions(&mut positions);
        let cell_of = |x: DVec3| (cells.pose.inverse().transform_point(x) / cells.side).floor().as_ivec3();
        let places: Vec<glam::IVec3> = cells.cells.iter().map(|own| own.at.into()).collect();
        // Roots and tips lie on the rim of the densest cells.
        for x in positions.chunks(PARTICLES).flat_map(|strand| &strand[1..PARTICLES - 1]) {
            assert!(places.contains(&cell_of(x.as_dvec3())), "{x}");
        }
        // No cell is farther from hair than the stencil of a sample.
        let held: Vec<_> = positions.iter().map(|x| cell_of(x.as_dvec3())).collect();
        let near = |place: &glam::IVec3| held.iter().any(|own| (*own - place).abs().max_element() <= 2);
        assert!(places.iter().all(near));
        // Hair at rest has its density at rest.
        let dense: Vec<f32> = cells.cells.iter().map(|own| own.density).filter(|own| *own > 0.5).collect();
        let mean = dense.iter().sum::<f32>() / dense.len() as f32;
        assert!((0.8..1.1).contains(&mean), "{mean}");
        simulation.set_grid(None).unwrap();
        simulation.step_frame(&still).unwrap();
        assert_eq!(simulation.grid_cells(), None);
    }

    #[test]
    fn damage_is_what_is_left_to_intact() {
        let params = AmsParams { non_hookean: true, elastic_limit: 0.02, ..AmsParams::default() };
        let mut simulation = thrown(&params);
        assert!(simulation.solver().rules().ties_weaken);
        let mut damage = Vec::new();
        simulation.damage(&mut damage);
        assert_eq!(damage, vec![0.0; 3 * PARTICLES]);
        for _ in 0..20 {
            step(&mut simulation, true);
        }
        simulation.damage(&mut damage);
        let expected: Vec<f32> = simulation.snapshot().integrity.iter().map(|own| 1.0 - own).collect();
        assert_eq!(damage, expected);
        assert!(damage.iter().any(|own| *own > 0.01), "{damage:?}");
        let mut host = HostPositions::new(simulation);
        host.read_damage(&mut damage).unwrap();
        assert_eq!(damage, expected);
        // Elastic ties do not weaken.
        let elastic: Solver<f32> = (&AmsParams::default()).into();
        assert!(!elastic.rules().ties_weaken);
    }
}
