use super::super::character::{Performance, Playback, PosingBuffers, Skinning};
use super::super::shapes_for_tests::{lattice, uv_sphere};
use super::super::{Shape, Walker};
use super::*;

fn around(mesh: &TriMesh, near: f32) -> BendingBox {
    let (low, high) = mesh.bounds();
    BendingBox { bounds: [low - 0.05, high + 0.05], balls: Vec::new(), near, thinness: 0.016 }
}

/// A ball, and a field around it in which it can move and grow.
fn ball_with_room() -> (TriMesh, BendingBox) {
    let bounds = [Vec3::splat(-0.2), Vec3::splat(0.2)];
    let mesh = uv_sphere(0.06, 48, 24);
    (mesh, BendingBox { bounds, balls: Vec::new(), near: 0.004, thinness: 0.016 })
}

/// Compares the field at the step's end with exact distances at points within `reach` of it.
fn check_end(field: &BendingField, positions: &[Vec3], points: impl Iterator<Item = Vec3>) -> [f32; 2] {
    let exact = field.faces().closed(positions);
    let (mut inner, mut outer) = (0.0f32, 0.0f32);
    let near = field.cell();
    let mut compared = 0;
    for p in points {
        let (truth, found) = (exact.signed_distance(p), field.sample_end(p));
        if truth.abs() < 0.7 * near {
            inner = inner.max((found - truth).abs());
            compared += 1;
        } else {
            // Never on the wrong side, and never farther than it is but by the error of the
            // interpolation.
            assert!(found * truth >= 0.0, "{p}: {found} instead of {truth}");
        }
        if truth > 0.0 {
            outer = outer.max(found / truth.max(near));
        }
    }
    assert!(compared > 20, "{compared}");
    [inner, outer]
}

#[test]
fn at_rest_it_is_the_distance_from_the_surface() {
    let mesh = uv_sphere(0.1, 64, 32);
    let mut field = BendingField::new(&mesh, &around(&mesh, 0.004)).unwrap();
    assert!(!field.changes());
    let [inner, outer] = check_end(&field, &mesh.positions, lattice(20_000, 0.14));
    assert!(inner < 0.3e-3 && outer < 1.05, "{inner} {outer}");
    // A pose at rest changes nothing, bit for bit.
    let before = field.end().values().to_vec();
    field.advance(&mesh.positions);
    assert!(!field.changes() && field.end().values() == before);
}

#[test]
fn a_ball_that_moves_and_grows_is_followed() {
    let (mesh, place) = ball_with_room();
    let mut field = BendingField::new(&mesh, &place).unwrap();
    for step in 1..8u8 {
        let by = f32::from(step);
        let moved: Vec<Vec3> = mesh
            .positions
            .iter()
            .map(|p| *p * (1.0 + 0.02 * by) + Vec3::new(0.01, 0.004, -0.006) * by)
            .collect();
        field.advance(&moved);
        let [inner, outer] = check_end(&field, &moved, lattice(20_000, 0.19));
        assert!(inner < 0.4e-3 && outer < 1.25, "{step}: {inner} {outer}");
        // The skin's displacement is that of the nearest point.
        for p in lattice(3000, 0.19) {
            let now = field.sample_end(p);
            if now.abs() < 0.002 {
                let centre = Vec3::new(0.01, 0.004, -0.006);
                let at = (p - centre * by) / (1.0 + 0.02 * by);
                let expected = at * 0.02 + centre;
                assert!(field.displacement(p).unwrap().distance(expected) < 0.2e-3);
            }
        }
    }
    // A field is a function of the pose alone.
    let last = field.end().values().len();
    let mut fresh = BendingField::new(&mesh, &place).unwrap();
    let moved: Vec<Vec3> =
        mesh.positions.iter().map(|p| *p * 1.14 + Vec3::new(0.01, 0.004, -0.006) * 7.0).collect();
    fresh.set([&moved, &moved]);
    assert_eq!(fresh.end().values().len(), last);
    assert!(!fresh.changes());
    for p in lattice(3000, 0.19) {
        assert_eq!(fresh.sample(p, 1.0), field.sample(p, 1.0));
    }
}

/// What the field is at a fraction is at least what it was before less the fall, and at least the
/// smaller of both ends later.
#[test]
fn clearances_hold_until_the_end_of_the_step() {
    let (mesh, place) = ball_with_room();
    let mut field = BendingField::new(&mesh, &place).unwrap();
    let moved: Vec<Vec3> = mesh.positions.iter().map(|p| *p + Vec3::X * 0.02).collect();
    field.advance(&moved);
    let mut falls = 0;
    for p in lattice(20_000, 0.25) {
        let start = field.sample(p, 0.0).0;
        let fall = field.fall(p);
        falls += u32::from(fall > 0.0 && fall < 0.03);
        for share in [0.25, 0.5, 0.9, 1.0] {
            let now = field.sample(p, share).0;
            assert!(now >= start - fall - 1e-6, "{p} at {share}: {now}, {start} less {fall}");
            assert!(now >= start.min(field.sample_end(p)) - 1e-6);
        }
    }
    assert!(falls > 100, "{falls}");
    assert!((field.motion() - 0.02).abs() < 1e-6);
}

#[test]
fn packets_and_single_points_are_bit_identical() {
    let mesh = uv_sphere(0.06, 48, 24);
    let mut field = BendingField::new(&mesh, &around(&mesh, 0.004)).unwrap();
    let moved: Vec<Vec3> = mesh.positions.iter().map(|p| *p + Vec3::X * p.x.max(0.0) * 0.2).collect();
    field.advance(&moved);
    let shape = Shape::Bending(Arc::new(field));
    let points: Vec<Vec3> = lattice(4000, 0.13).collect();
    for points in points.chunks_exact(PACKET) {
        let p = [0, 1, 2].map(|c| std::array::from_fn(|k| points[k][c]));
        for share in [0.0, 0.3, 1.0] {
            let (distances, gradients) = shape.sample_packet::<f32>(&p, share);
            for (k, p) in points.iter().enumerate() {
                let (distance, gradient) = shape.sample_at(p.to_array(), share);
                assert_eq!(distances[k], distance);
                let packed = gradients.map(|row| row[k]);
                assert!(Vec3::from_array(packed).distance(gradient.into()) < 1e-6);
            }
        }
    }
}

#[test]
fn a_walking_body_is_followed() {
    let walker = Walker::builtin();
    let head = walker.skeleton().find("head").unwrap();
    for clip in walker.clips() {
        let playback = Playback { blend_secs: 0.0, ..Playback::default() };
        let own = Performance::new(walker.clone(), clip.clone(), playback, Skinning::Linear, head).unwrap();
        let (low, high) = walker.rest().bounds();
        // Head and shoulders.
        let bounds = [Vec3::new(-0.4, high.y - 0.6, low.z - 0.1), high + 0.1];
        let place = BendingBox { bounds, balls: Vec::new(), near: 0.004, thinness: 0.016 };
        let mut field = BendingField::new(walker.rest(), &place).unwrap();
        let mut buffers = PosingBuffers::default();
        for step in 0..4u8 {
            let posed = own.posed(0.13 * f64::from(step), &mut buffers).positions;
            field.advance(posed);
            let centre = (bounds[0] + bounds[1]) * 0.5;
            let half = (bounds[1] - bounds[0]) * 0.5;
            let points = lattice(6000, 1.0).map(|p| centre + p * half);
            let exact = field.faces().closed(posed);
            let mut worst = 0.0f32;
            for p in points {
                let (truth, found) = (exact.signed_distance(p), field.sample_end(p));
                if truth.abs() < 0.003 {
                    worst = worst.max((truth - found).abs());
                }
                // Inside, surfaces that pass through others count as well.
                if truth > 0.004 {
                    assert!(found > 0.0 && found < 1.25 * truth, "{}: {p}: {found}, not {truth}", clip.name);
                }
            }
            assert!(worst < 1e-3, "{} {step}: {worst}", clip.name);
        }
    }
}
