//! The motion does not depend on the frame rate.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use forelock::scene::Override;

use crate::frame_rates::{HAIR, MOTIONS, apart, player, run};

/// Tips over the length of their strand: what is left is the rounding of float32 where frames lie
/// between two steps.
const BOUND: f32 = 1e-5;

fn set(text: &str) -> Vec<Override> {
    vec![Override::set(text).unwrap()]
}

#[test]
fn tips_are_where_they_are_at_any_frame_rate() {
    for solver in ["ams", "mass-spring", "dftl", "xpbd"] {
        let sets = set(&format!("solver.kind={solver}"));
        for hair in &HAIR {
            for motion in &MOTIONS {
                // The first two have frames within a step in common.
                let runs =
                    [240, 120, 24, 30, 50, 60, 144].map(|fps| run(hair, motion, fps, 1, &sets).unwrap());
                for other in &runs[1..] {
                    let found = apart(&runs[0], other);
                    assert!(found.frames > 1, "{found:?}");
                    assert!(found.worst <= BOUND, "{solver}, {}, {}: {found:?}", hair.name, motion.name);
                }
            }
        }
    }
}

/// Interactions run once a step too.
#[test]
fn interactions_do_not_depend_on_the_frame_rate_either() {
    let mut sets = set("interaction.kind=grid");
    sets.extend(set("interaction.contacts=true"));
    let [slow, fast] = [30, 120].map(|fps| run(&HAIR[1], &MOTIONS[1], fps, 1, &sets).unwrap());
    let found = apart(&slow, &fast);
    assert!(found.frames == 30 && found.worst <= BOUND, "{found:?}");
}

/// The comparison sees what depends on time: another substep moves tips.
#[test]
fn the_substep_shows() {
    let finer = set("time.substep_secs=0.002");
    for motion in &MOTIONS {
        let own = [&[][..], &finer].map(|sets| run(&HAIR[0], motion, 60, 1, sets).unwrap());
        let found = apart(&own[0], &own[1]);
        assert!(found.worst > 10.0 * BOUND, "{}: {found:?}", motion.name);
    }
}

/// Frames between two steps are shown again by a player that goes back or resumes, bit for bit, and
/// strands keep their roots on the head and their lengths.
#[test]
fn frames_within_a_step_come_back() {
    let (hair, motion) = (&HAIR[3], &MOTIONS[1]);
    let mut first = player(hair, motion, 240, &[]).unwrap();
    let mut frames = Vec::new();
    let mut state = None;
    for frame in 1..=42 {
        first.step().unwrap();
        let mut positions = Vec::new();
        first.positions(&mut positions).unwrap();
        let (head, groom) = (first.head_pose(), first.groom());
        for s in 0..groom.strand_count() {
            let (now, rest) = (&positions[groom.range(s)], groom.strand(s));
            let root = head.transform_point(rest[0].as_dvec3()).as_vec3();
            assert!(now[0].distance(root) < 1e-6, "frame {frame}");
            for (edge, rest) in now.windows(2).zip(rest.windows(2)) {
                let [now, rest] = [edge[0].distance(edge[1]), rest[0].distance(rest[1])];
                assert!((now / rest - 1.0).abs() < 0.05, "frame {frame}: {now} {rest}");
            }
        }
        frames.push(positions);
        if frame == 38 {
            state = Some(first.state().unwrap());
        }
    }
    // Each frame differs from the one before, also within a step.
    assert!(frames[20..].windows(2).all(|pair| pair[0] != pair[1]));
    let mut shown = Vec::new();
    first.seek(37).unwrap();
    first.positions(&mut shown).unwrap();
    assert_eq!(shown, frames[36]);
    let mut second = player(hair, motion, 240, &[]).unwrap();
    second.resume(38, &state.unwrap()).unwrap();
    for frame in 38..=42 {
        second.positions(&mut shown).unwrap();
        assert_eq!(shown, frames[frame - 1], "frame {frame}");
        second.step().unwrap();
    }
}
