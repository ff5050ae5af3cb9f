use super::*;
use forelock_core::body::{Head, SEGMENT_TOLERANCE_M, Sdf, Shape};
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// Points within 5 mm of the head's surface, in strands of eight of which two are clamped.
fn points(closed: &ClosedMesh) -> Vec<Vec3> {
    let mesh = &Head::builtin().mesh;
    let near = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        (a + b + c) / 3.0 + normal * (((t * 7919) % 1000) as f32 * 1e-5 - 0.005)
    };
    let points: Vec<Vec3> = (0..mesh.triangles.len()).step_by(5).map(near).collect();
    assert!(points.iter().any(|p| closed.contains(*p)));
    points[..points.len() / 8 * 8].to_vec()
}

#[test]
fn depths_are_those_under_the_mesh_whatever_the_field() {
    let closed = ClosedMesh::new(&Head::builtin().mesh);
    let local = points(&closed);
    let world_from_local = Pose::new(DQuat::from_rotation_y(0.7), DVec3::new(0.3, -1.0, 2.0));
    let world: Vec<Vec3> =
        local.iter().map(|p| world_from_local.transform_point(p.as_dvec3()).as_vec3()).collect();
    let strand_offsets: Vec<u32> = (0..=local.len() as u32).step_by(8).collect();
    let layout = Layout { strand_offsets: &strand_offsets, clamped: 2 };
    let depths = local.iter().enumerate().filter(|(i, _)| i % 8 >= 2);
    let depths: Vec<f64> = depths.map(|(_, p)| f64::from(-closed.signed_distance(*p)).max(0.0)).collect();
    let share = depths.iter().filter(|d| **d > INSIDE_M).count() as f64 / depths.len() as f64;
    let deepest = depths.iter().copied().fold(0.0, f64::max);
    assert!(share > 0.2 && deepest > 4e-3, "{share} {deepest}");
    for (nodes, near, is_exact) in [(16, f32::INFINITY, false), (16, 2e-3, true)] {
        let field = Sdf::near(&closed, nodes, 0.02, near).unwrap();
        assert_eq!(field.is_refined(), is_exact);
        let shape = Shape::Sdf(Arc::new(field));
        let frame = ColliderFrame {
            shape: &shape,
            local: Pose::IDENTITY,
            from: Pose::IDENTITY,
            to: world_from_local,
            friction: 0.0,
        };
        let measure = |surface| Penetration::measure(&world, layout, &[MeasuredSolid { frame, surface }]);
        let exact = measure(Some(&closed));
        // The world's positions are rounded to 0.2 µm.
        assert!((exact.share_inside - share).abs() < 2e-3, "{nodes}: {exact:?}, not {share}");
        assert!((exact.deepest_m - deepest).abs() < 1e-6, "{nodes}: {exact:?}, not {deepest}");
        // By a coarse field alone it is another measurement.
        let by_field = measure(None);
        assert!(is_exact || (by_field.share_inside - share).abs() > 0.02, "{by_field:?}");
    }
}

#[test]
fn primitives_are_measured_in_closed_form() {
    let shape = Shape::Sphere { radius: 0.1 };
    let still = Pose::IDENTITY;
    let frame = ColliderFrame { shape: &shape, local: still, from: still, to: still, friction: 0.0 };
    let positions = [0.0, 0.2, 0.097, 0.0995].map(|x| Vec3::new(x, 0.0, 0.0));
    let layout = Layout { strand_offsets: &[0, 4], clamped: 1 };
    let found = Penetration::measure(&positions, layout, &[MeasuredSolid { frame, surface: None }]);
    assert_eq!(found.share_inside, 1.0 / 3.0);
    assert!((found.deepest_m - 3e-3).abs() < 1e-8, "{found:?}");
}

/// A number from 0 to 1 for each `i`.
fn noise(i: usize) -> f32 {
    (i as f32 * 0.618_034 + (i as f32 * 0.37).sin() * 43.758_5).rem_euclid(1.0)
}

fn scatter(i: usize, reach: f32) -> Vec3 {
    (Vec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)) - 0.5) * (2.0 * reach)
}

/// Solids of all shapes that have a closed form, many of them small.
fn many_solids() -> Vec<Shape> {
    let mut solids = vec![Shape::HollowSphere { radius: 0.97 }];
    for i in 0..120 {
        let radius = 0.01 + f64::from(noise(i + 7000)) * 0.03;
        solids.push(match i % 3 {
            0 => Shape::Sphere { radius },
            1 => Shape::Capsule { half_length: 0.1, radius },
            _ => Shape::Box { half_extents: DVec3::new(0.1, radius, 0.02) },
        });
    }
    solids
}

/// Depth of the deepest of `samples` points from `a` to `b` in any of `frames`, metres.
fn sampled(frames: &[ColliderFrame<'_>], a: Vec3, b: Vec3, samples: usize) -> f64 {
    let points = (0..=samples).map(|i| a.as_dvec3().lerp(b.as_dvec3(), i as f64 / samples.max(1) as f64));
    let points: Vec<DVec3> = points.collect();
    let depth = |frame: &ColliderFrame<'_>| {
        let inverse = frame.pose(1.0).inverse();
        let depth = |p: &DVec3| -frame.shape.sample(inverse.transform_point(*p).to_array()).0;
        points.iter().map(depth).fold(0.0, f64::max)
    };
    frames.iter().map(depth).fold(0.0, f64::max)
}

/// Solids that are looked up by their boxes are measured as all of them, one by one, are.
#[test]
fn many_solids_are_measured_as_one_by_one() {
    let shapes = many_solids();
    let mut frames = Vec::new();
    for (i, shape) in shapes.iter().enumerate() {
        let turned = DQuat::from_euler(glam::EulerRot::XYZ, f64::from(noise(i)) * 6.0, 1.0, 2.0);
        let at = if i == 0 { DVec3::ZERO } else { scatter(i + 900, 0.35).as_dvec3() };
        let (local, to) = (Pose::new(turned, at * 0.25), Pose::new(DQuat::IDENTITY, at * 0.75));
        frames.push(ColliderFrame { shape, local, from: Pose::IDENTITY, to, friction: 0.0 });
    }
    let mut positions = Vec::new();
    let mut offsets = vec![0];
    for strand in 0..100 {
        let (root, along) = (scatter(strand, 0.4), scatter(strand + 400, 0.02));
        let bend = scatter(strand + 700, 5e-4);
        let particles = 2 + strand % 23;
        positions.extend((0..particles).map(|i| root + along * i as f32 + bend * (i * i) as f32));
        offsets.push(positions.len() as u32);
    }
    let solids: Vec<_> = frames.iter().map(|frame| MeasuredSolid { frame: *frame, surface: None }).collect();
    for clamped in [0, 1, 2] {
        let layout = Layout { strand_offsets: &offsets, clamped };
        let found = Penetration::measure(&positions, layout, &solids);
        let (mut particles, mut edges) = (Vec::new(), Vec::new());
        for ends in offsets.windows(2).map(|ends| ends[0] as usize..ends[1] as usize) {
            let free = ends.start + clamped as usize..ends.end;
            particles.extend(free.clone().map(|i| sampled(&frames, positions[i], positions[i], 0)));
            for i in free.filter(|i| *i > ends.start) {
                let is_rooted = i == ends.start + clamped as usize;
                // Of an edge from a clamped particle only solids without that particle count.
                let own = |frame: &&ColliderFrame<'_>| {
                    !is_rooted || sampled(&[**frame], positions[i - 1], positions[i - 1], 0) == 0.0
                };
                let frames: Vec<_> = frames.iter().filter(own).copied().collect();
                edges.push(sampled(&frames, positions[i - 1], positions[i], 64));
            }
        }
        let share = |depths: &[f64], from: f64| {
            depths.iter().filter(|depth| **depth > from).count() as f64 / depths.len() as f64
        };
        let deepest = particles.iter().copied().fold(0.0, f64::max);
        assert_eq!((found.share_inside, found.deepest_m), (share(&particles, INSIDE_M), deepest));
        assert!(found.share_inside > 0.05);
        // Edges are up to 60 mm long, most shorter: samples lie near the deepest point.
        let tolerance = f64::from(SEGMENT_TOLERANCE_M);
        let deepest = edges.iter().copied().fold(0.0, f64::max);
        assert!((found.deepest_edge_m - deepest).abs() < 2.0 * tolerance, "{found:?}, not {deepest}");
        let [most, least] = [-tolerance, 2.0 * tolerance].map(|by| share(&edges, INSIDE_M + by));
        assert!((least..=most).contains(&found.edge_share_inside), "{found:?}: {least} to {most}");
        assert!(found.edge_share_inside > found.share_inside);
    }
}

#[test]
fn an_edge_between_particles_outside_is_measured() {
    let shape = Shape::Sphere { radius: 0.1 };
    let still = Pose::IDENTITY;
    let frame = ColliderFrame { shape: &shape, local: still, from: still, to: still, friction: 0.0 };
    let measure = |clamped, positions: &[Vec3]| {
        let layout = Layout { strand_offsets: &[0, positions.len() as u32], clamped };
        Penetration::measure(positions, layout, &[MeasuredSolid { frame, surface: None }])
    };
    let chord = [Vec3::new(-0.06, 0.09, 0.0), Vec3::new(0.06, 0.09, 0.0), Vec3::new(0.2, 0.2, 0.0)];
    let found = measure(1, &chord);
    assert_eq!((found.share_inside, found.deepest_m, found.edge_share_inside), (0.0, 0.0, 0.5));
    assert!((found.deepest_edge_m - 0.01).abs() < 1e-4, "{found:?}");
    // Hair grows out of the skin: an edge from a root under it does not count.
    let rooted = [Vec3::Y * 0.09, Vec3::Y * 0.11, Vec3::Y * 0.2];
    assert_eq!(measure(1, &rooted), Penetration::default());
    assert!(measure(0, &rooted).deepest_edge_m > 0.009);
    // Nor does one between clamped particles.
    assert_eq!(measure(2, &chord), Penetration::default());
}
