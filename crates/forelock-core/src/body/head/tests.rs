use std::collections::HashMap;

use super::*;

fn area(head: &Head, weights: &[f32]) -> f32 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| head.mesh.positions[v as usize]);
        let weight = t.iter().map(|&v| weights[v as usize]).sum::<f32>() / 3.0;
        0.5 * (b - a).cross(c - a).length() * weight
    };
    head.mesh.triangles.iter().map(of).sum()
}

#[test]
fn mesh_is_closed_manifold_and_of_genus_zero() {
    let mesh = &Head::builtin().mesh;
    let mut edges = HashMap::new();
    for t in &mesh.triangles {
        for i in 0..3 {
            *edges.entry((t[i], t[(i + 1) % 3])).or_insert(0) += 1;
        }
    }
    // Each directed edge occurs once, and its opposite once: every edge has two triangles of the
    // same orientation.
    assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
    let euler = mesh.positions.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64;
    assert_eq!(euler, 2);
    let volume: f32 = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| mesh.positions[v as usize]))
        .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
        .sum();
    assert!((0.009..0.014).contains(&volume), "{volume} m³; a negative volume means an inside-out mesh");
}

#[test]
fn vertices_lie_on_the_surface() {
    let mut off: Vec<f32> = Head::builtin().mesh.positions.iter().map(|&p| Head::distance(p).abs()).collect();
    off.sort_by(f32::total_cmp);
    // All vertices except those in the creases of eyes and lips, where a vertex may move by less
    // than half a cell.
    assert!(off[off.len() * 99 / 100] < 5e-5, "{} m", off[off.len() * 99 / 100]);
    assert!(off[off.len() - 1] < 1e-3, "{} m", off[off.len() - 1]);
}

#[test]
fn the_head_has_the_size_of_a_human_head() {
    // The first point inside the head on a ray from outside.
    let reach = |from: Vec3, to: Vec3| {
        (0..4000).map(|i| from.lerp(to, i as f32 / 4000.0)).find(|&p| Head::distance(p) < 0.0).unwrap()
    };
    let crown = reach(vec3(0.0, 0.2, -0.02), vec3(0.0, 0.0, -0.02)).y;
    let chin = reach(vec3(0.0, -0.16, 0.075), vec3(0.0, -0.05, 0.075)).y;
    assert!((crown - chin - 0.23).abs() < 0.006, "height {}", crown - chin);
    let width = 2.0 * reach(vec3(0.2, 0.035, -0.02), vec3(0.0, 0.035, -0.02)).x;
    assert!((width - 0.155).abs() < 0.006, "width {width}");
    let brow = reach(vec3(0.0, 0.015, 0.2), vec3(0.0, 0.015, 0.0)).z;
    let back = reach(vec3(0.0, 0.02, -0.2), vec3(0.0, 0.02, 0.0)).z;
    assert!((brow - back - 0.20).abs() < 0.008, "depth {}", brow - back);
    let (low, high) = Head::builtin().mesh.bounds();
    assert!((low.y + 0.30).abs() < 0.002, "flat base at {}", low.y);
    assert!((0.38..0.46).contains(&(high.x - low.x)), "shoulders {}", high.x - low.x);
}

#[test]
fn regions_have_plausible_areas_and_do_not_overlap() {
    let head = Head::builtin();
    let (scalp, beard) = (1e4 * area(head, &head.scalp), 1e4 * area(head, &head.beard));
    assert!((500.0..800.0).contains(&scalp), "scalp {scalp} cm²");
    assert!((100.0..300.0).contains(&beard), "beard {beard} cm²");
    let both = head.scalp.iter().zip(&head.beard).filter(|&(&s, &b)| s > 0.5 && b > 0.5).count();
    assert_eq!(both, 0);
    let at = |region: Region, x: f32, y: f32, z: f32| region.weight(vec3(x, y, z));
    assert_eq!(at(Region::Scalp, 0.0, 0.115, -0.01), 1.0, "crown");
    assert_eq!(at(Region::Scalp, 0.0, 0.03, 0.09), 0.0, "forehead");
    assert_eq!(at(Region::Scalp, 0.08, -0.015, -0.013), 0.0, "ear");
    assert_eq!(at(Region::Beard, 0.0, -0.11, 0.08), 1.0, "chin");
    assert_eq!(at(Region::Beard, 0.0, -0.071, 0.09), 0.0, "lips");
}

#[test]
fn keep_out_points_outwards_with_the_distance() {
    let head = Head::builtin();
    let keep_out = head.keep_out(Region::Beard);
    let normals = head.mesh.vertex_normals();
    for (&p, &n) in head.mesh.positions.iter().zip(&normals).step_by(997) {
        let (distance, gradient) = keep_out(p + n * 0.002, 0.01).unwrap();
        assert!((gradient.length() - 1.0).abs() < 1e-3 && gradient.dot(n) > 0.8, "{p}: {gradient} {n}");
        assert!((distance - 0.002).abs() < 0.001, "{p}: {distance}");
    }
    // The bound that the module's documentation states.
    let slopes = head.mesh.positions.iter().zip(&normals).step_by(97).flat_map(|(&p, &n)| {
        [0.005, 0.01, 0.02].map(|out| crate::body::implicit::gradient(Head::distance, p + n * out).length())
    });
    let (all, within) = slopes.fold((0, 0), |(a, w), s| (a + 1, w + i32::from((0.5..1.5).contains(&s))));
    assert!(f64::from(within) > 0.97 * f64::from(all), "{within} of {all}");
    let before_the_face = vec3(0.0, -0.03, 0.2);
    assert!(keep_out(before_the_face, 0.0).is_none());
    assert!(head.keep_out(Region::Scalp)(before_the_face, 0.0).is_some());
}

#[test]
fn distances_have_no_steps() {
    // Along rays through the space around the head, outside of it. The distance to the groove over
    // the chin changes five times as fast as the place.
    const STEP: f32 = 2e-4;
    let (low, high) = (vec3(-0.26, -0.36, -0.22), vec3(0.26, 0.18, 0.22));
    for distance in [implicit::distance, implicit::distance_with_face_space] {
        for (axis, i, j) in (0..3).flat_map(|axis| (0..256).map(move |ray| (axis, ray % 16, ray / 16))) {
            let mut share = Vec3::ZERO;
            (share[(axis + 1) % 3], share[(axis + 2) % 3]) = (i as f32 / 15.0, j as f32 / 15.0);
            let mut at = low + share * (high - low);
            let mut before = distance(at);
            while at[axis] < high[axis] {
                at[axis] += STEP;
                let after = distance(at);
                let change = after.max(0.0) - before.max(0.0);
                assert!(change.abs() < 6.0 * STEP, "{before} to {after} m at {at}");
                before = after;
            }
        }
    }
}
