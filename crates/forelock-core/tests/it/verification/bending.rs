//! Hair and a body that bends: skin that slides carries hair by friction, hair that is squeezed
//! comes out at bounded speed, and nothing tears it.

use std::sync::Arc;

use forelock_core::body::{BendingBox, BendingField, ColliderFrame, Shape, TriMesh};
use forelock_core::collide::resolve_solids::PINCHED;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::{AmsParams, DftlParams, Solver, XpbdParams};
use glam::Vec3;

use super::rig::{DT, Rig, Strand};

/// The most that edges stretch: lengths have precedence over skin.
const MOST_STRETCH: f64 = PINCHED + 1e-3;

/// Boxes, centre and half size each, as one mesh.
fn boxes(of: &[[Vec3; 2]]) -> TriMesh {
    const FACES: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for [centre, half] in of {
        let first = positions.len() as u32;
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            positions.push(*centre + *half * Vec3::new(sign(0), sign(1), sign(2)));
        }
        for [a, b, c, d] in FACES {
            triangles.extend([[a, b, c], [a, c, d]].map(|face| face.map(|corner| first + corner)));
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// The length of hair, metres.
const LONG: f64 = 0.3;
/// That of a beard of several days: edges of 0.3 mm, shorter than the thickness of the skin.
const SHORT: f64 = 29.0 * 3e-4;

/// Sixteen hanging strands of 30 particles, 4 mm apart in z.
fn strands(length: f64) -> Vec<Strand> {
    let strand = |s: usize| (0..30).map(|i| [0.0, -length / 29.0 * i as f64, 0.004 * s as f64]).collect();
    (0..16).map(strand).collect()
}

/// The largest stretch of an edge of [`strands`].
fn stretch(rig: &Rig<f32>, length: f64) -> f64 {
    let positions = rig.positions();
    let edges = positions.chunks(30).flat_map(|strand| strand.windows(2));
    edges.map(|edge| (edge[0].distance(edge[1]) / (length / 29.0) - 1.0).abs()).fold(0.0, f64::max)
}

fn solvers() -> [Solver<f32>; 3] {
    [(&AmsParams::default()).into(), (&DftlParams::default()).into(), (&XpbdParams::default()).into()]
}

fn field(mesh: &TriMesh) -> Arc<BendingField> {
    let bounds = [Vec3::splat(-0.5), Vec3::splat(0.5)];
    let place = BendingBox { bounds, balls: Vec::new(), near: 0.004, thinness: 0.016 };
    Arc::new(BendingField::new(mesh, &place).unwrap())
}

/// A step to the mesh with its vertices at `positions`.
fn step(rig: &mut Rig<f32>, field: &mut Arc<BendingField>, positions: &[Vec3], friction: f64) {
    Arc::get_mut(field).unwrap().advance(positions);
    let shape = Shape::Bending(field.clone());
    let [local, from, to] = [Pose::IDENTITY; 3];
    rig.step_among(Pose::IDENTITY, &[ColliderFrame { shape: &shape, local, from, to, friction }]);
}

/// How far the tips of strands that lie on a slab, along z, are carried in x in 0.3 s, metres: by
/// skin that slides at 0.3 m/s.
fn carried(friction: f64) -> f64 {
    let slab = boxes(&[[Vec3::new(0.0, -0.1, 0.15), Vec3::new(0.4, 0.095, 0.3)]]);
    let mut own = field(&slab);
    let params = AmsParams { k_integrity: 0.0, k_angular: 0.0, ..AmsParams::default() };
    let lying = |s: usize| (0..30).map(|i| [0.004 * s as f64, 0.0, 0.3 / 29.0 * i as f64]).collect();
    let strands: Vec<Strand> = (0..16).map(lying).collect();
    let mut rig = Rig::<f32>::new(&strands, &params, Simd::Auto);
    let mut positions = slab.positions.clone();
    let mut before = 0.0;
    for frame in 0..48 {
        // They come to lie first.
        if frame >= 30 {
            positions.iter_mut().for_each(|p| p.x += 0.3 / 60.0);
        }
        step(&mut rig, &mut own, &positions, friction);
        let tips: f64 = rig.positions().chunks(30).map(|strand| strand[29].x).sum::<f64>() / 16.0;
        if frame < 30 {
            before = tips;
        }
        if frame == 47 {
            return tips - before;
        }
    }
    0.0
}

#[test]
fn skin_that_slides_along_itself_carries_hair() {
    let (rough, smooth) = (carried(0.8), carried(0.0));
    eprintln!("{rough:.4} m, without friction {smooth:.4} m");
    assert!(rough > 0.05 && rough < 0.095, "{rough}");
    assert!(smooth.abs() < 0.1 * rough, "{smooth} beside {rough}");
}

#[test]
fn hair_squeezed_between_parts_comes_out_at_bounded_speed() {
    for solver in solvers() {
        let half = Vec3::new(0.04, 0.12, 0.15);
        let wall = |side: f32| [Vec3::new(0.055 * side, -0.2, 0.03), half];
        let walls = boxes(&[wall(-1.0), wall(1.0)]);
        let mut own = field(&walls);
        let mut rig = Rig::<f32>::new(&strands(LONG), solver.clone(), Simd::Auto);
        let mut before = rig.positions();
        let (mut fastest, mut deepest) = (0.0f64, 0.0f64);
        for frame in 0..120u16 {
            // They meet after a quarter of a second, press 5 mm into each other, and part.
            let share = f32::from(frame) / 15.0;
            let closed = if frame < 60 { share.min(1.0) } else { (5.0 - share).clamp(0.0, 1.0) };
            let moved = walls.positions.iter().map(|p| *p - Vec3::X * p.x.signum() * 0.02 * closed);
            let moved: Vec<Vec3> = moved.collect();
            step(&mut rig, &mut own, &moved, 0.3);
            let after = rig.positions();
            assert!(after.iter().all(|x| x.is_finite()), "frame {frame}");
            assert!(
                stretch(&rig, LONG) < MOST_STRETCH,
                "{}, frame {frame}: {}",
                solver.name(),
                stretch(&rig, LONG)
            );
            let fast = before.iter().zip(&after).map(|(a, b)| a.distance(*b) / DT);
            fastest = fast.fold(fastest, f64::max);
            before = after;
            if frame >= 90 {
                let depth = |x: &glam::DVec3| f64::from(-own.sample_end(x.as_vec3()));
                deepest = rig.positions().iter().map(depth).fold(deepest, f64::max);
            }
        }
        eprintln!("{}: {fastest:.2} m/s, {:.2} mm", solver.name(), 1e3 * deepest);
        // The walls move at 8 cm/s.
        assert!(fastest < 2.0, "{fastest} m/s");
        assert!(deepest < 1e-3, "{deepest}");
    }
}

/// A bar of 2 cm goes back and forth through the hair by 8 cm a step, four times its thickness.
#[test]
fn a_part_that_moves_by_more_than_its_thickness_tears_no_hair() {
    for (solver, length) in solvers().into_iter().flat_map(|s| [(s.clone(), LONG), (s, SHORT)]) {
        let case = format!("{}, {length} m", solver.name());
        // Its upper face is at half their length.
        let centre = Vec3::new(0.0, -0.5 * length as f32 - 0.01, 0.03);
        let bar = boxes(&[[centre, Vec3::new(0.01, 0.01, 0.15)]]);
        let mut own = field(&bar);
        let mut rig = Rig::<f32>::new(&strands(length), solver, Simd::Auto);
        let (mut moved, mut most) = (0.0f64, 0.0f64);
        for frame in 0..120u16 {
            let at = 0.15 * (f32::from(frame) * 0.55).sin();
            let positions: Vec<Vec3> = bar.positions.iter().map(|p| *p + Vec3::X * at).collect();
            step(&mut rig, &mut own, &positions, 0.3);
            let found = rig.positions();
            assert!(found.iter().all(|x| x.is_finite()), "{case}, frame {frame}");
            most = most.max(stretch(&rig, length));
            moved = found.iter().map(|x| x.x.abs()).fold(moved, f64::max);
        }
        eprintln!("{case}: stretch {most:.4}, moved by {moved:.4} m");
        assert!(most < MOST_STRETCH, "{case}: {most}");
        // It meets them.
        assert!(moved > 0.05 * length, "{case}: {moved} m");
    }
}
