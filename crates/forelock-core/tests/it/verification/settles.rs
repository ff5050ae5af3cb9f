//! Hair comes to rest after a shake, and falls asleep.

use crate::rig::{DT, GRAVITY, shake};
use forelock_core::body::{ClosedMesh, ColliderFrame, Head, Sdf, Shape};
use forelock_core::frame::{FrameInput, FrameReport};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::Interactions;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::strands::vector;
use glam::DVec3;
use std::sync::Arc;

/// Length of the shake, seconds.
const SHAKE_SECS: f64 = 2.0;
/// Motion in a frame above which a particle counts as moving, metres.
const MOVING: f64 = 1e-5;

/// What a second of a run showed.
#[derive(Debug, Default)]
struct Second {
    /// The largest distance that a particle moved in a frame, metres.
    farthest: f64,
    /// The largest number of particles that moved in a frame.
    moving: usize,
    /// Contacts of all frames.
    contacts: usize,
}

/// Hair on the built-in head, which is shaken at 4 g for two seconds and then held.
struct Shaken {
    simulation: Simulation,
    shape: Shape,
    frame: u32,
}

impl Shaken {
    fn new(strands: u32, interactions: &Interactions, sleep_speed: f64) -> Self {
        let preset = GrowParams::preset("straight").unwrap();
        let groom = grow_on_head(&GrowParams { strands, vertices_per_strand: 30, ..preset }).unwrap();
        let options = Options { rest_gravity: GRAVITY, sleep_speed, ..Options::default() };
        let mut simulation = Simulation::<f32>::new(&groom, &AmsParams::default(), &options).unwrap();
        simulation.set_interactions(interactions).unwrap();
        let field = Sdf::near(&ClosedMesh::new(&Head::builtin().mesh), 128, 0.02, 0.002).unwrap();
        Self { simulation, shape: Shape::Sdf(Arc::new(field)), frame: 0 }
    }

    fn step(&mut self) -> FrameReport {
        let secs = [self.frame, self.frame + 1].map(|f| (f64::from(f) * DT).min(SHAKE_SECS));
        let head = secs.map(|t| shake(4.0, 2.0, t));
        let collider = ColliderFrame {
            shape: &self.shape,
            local: Pose::IDENTITY,
            from: head[0],
            to: head[1],
            friction: 0.3,
        };
        self.frame += 1;
        self.simulation
            .step_frame(&FrameInput {
                roots: head.into(),
                colliders: &[collider],
                gravity: GRAVITY,
                dt_secs: DT,
                ..FrameInput::default()
            })
            .unwrap()
    }
}

/// The shake and what follows, without sleep: second after second.
fn settle(strands: u32, secs: u32, params: &ContactParams) -> Vec<Second> {
    let contacts = Interactions { contacts: Some(params.clone()), ..Interactions::default() };
    let mut shaken = Shaken::new(strands, &contacts, 0.0);
    let mut before: Vec<DVec3> = Vec::new();
    let mut course = Vec::new();
    for _ in 0..secs {
        let mut found = Second::default();
        for _ in 0..60 {
            found.contacts += shaken.step().strand_contacts.contacts;
            let now = places(&shaken.simulation);
            let moves = now.iter().zip(&before).map(|(x, y)| x.distance(*y));
            found.moving = found.moving.max(moves.clone().filter(|&d| d > MOVING).count());
            found.farthest = moves.fold(found.farthest, f64::max);
            before = now;
        }
        course.push(found);
    }
    course
}

/// The positions of all particles.
fn places(simulation: &Simulation) -> Vec<DVec3> {
    let state = simulation.state();
    let of_block = |block: &forelock_core::strands::Block| {
        let live = block.live;
        block.range().flat_map(move |place| (0..live).map(move |lane| (place, lane)))
    };
    let all = simulation.model().blocks.iter().flat_map(of_block);
    all.map(|(place, lane)| state.origin + DVec3::from(vector(&state.positions, place, lane).map(f64::from)))
        .collect()
}

/// Nothing moves any more where friction holds, in these grooms. Which ones come to rest within
/// 20 s is chance: without sleep some particles of 145, 150 and 170 strands still slip and stick,
/// by up to half a millimetre a frame. Without friction a tenth of the hair does, by millimetres.
#[test]
fn hair_with_contacts_comes_to_rest() {
    for strands in [120, 140, 160, 180, 200] {
        let course = settle(strands, 20, &ContactParams::default());
        let last = &course[19];
        println!("{strands} strands, in the last second: {last:?}");
        assert!(course[1].contacts > 1000 && last.farthest < MOVING, "{strands}: {last:?}");
    }
    let course = settle(150, 20, &ContactParams { hold: 0.0, slip: 0.01, ..ContactParams::default() });
    let last = &course[19];
    assert!(last.farthest > 20.0 * MOVING, "{last:?}");
}

/// All hair sleeps within 20 s of the shake, whichever interactions it has, so that nothing moves
/// and a frame costs next to nothing; and not during the shake. Half of its particles are then
/// within half a millimetre of their rest; friction between neighbours that did not fade would hold
/// them some millimetres away.
#[test]
fn all_hair_falls_asleep_after_a_shake() {
    let (grid, contacts) = (Some(GridParams::default()), Some(ContactParams::default()));
    for interactions in [
        Interactions::default(),
        Interactions { grid: grid.clone(), ..Interactions::default() },
        Interactions { grid, contacts, ..Interactions::default() },
    ] {
        let mut shaken = Shaken::new(600, &interactions, 2e-3);
        let rest = places(&shaken.simulation);
        let asleep = (0..22 * 60).find(|_| shaken.step().sleeping_strands == 600);
        println!("all asleep after frame {asleep:?}");
        assert!(asleep.is_some_and(|frame| frame > 180), "{asleep:?}");
        let before = places(&shaken.simulation);
        shaken.step();
        assert_eq!(places(&shaken.simulation), before);
        let head = shake(4.0, 2.0, SHAKE_SECS);
        let mut off: Vec<f64> =
            before.iter().zip(&rest).map(|(x, rest)| head.transform_point(*rest).distance(*x)).collect();
        let middle = off.len() / 2;
        let (_, median, _) = off.select_nth_unstable_by(middle, f64::total_cmp);
        println!("half of the particles within {:.2} mm of their rest", *median * 1e3);
        assert!(*median < 5e-4, "{median}");
    }
}
