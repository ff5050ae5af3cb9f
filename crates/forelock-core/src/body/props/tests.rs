use std::collections::HashMap;

use super::*;

const PROPS: [Prop; 3] = [Prop::Hand, Prop::Comb, Prop::HoledSphere { radius: 0.12 }];

/// The genus of a closed surface: 0 for a ball; for a shell, the number of holes minus one.
fn genus(mesh: &TriMesh) -> i64 {
    let mut edges = HashMap::new();
    for t in &mesh.triangles {
        for i in 0..3 {
            *edges.entry((t[i], t[(i + 1) % 3])).or_insert(0) += 1;
        }
    }
    let closed = edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1));
    assert!(closed, "each directed edge must occur once, and its opposite once");
    let euler = mesh.positions.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64;
    (2 - euler) / 2
}

#[test]
fn meshes_are_closed_and_have_the_right_genus() {
    for (prop, handles) in PROPS.into_iter().zip([0, 0, 13]) {
        assert_eq!(genus(&prop.mesh()), handles, "{prop:?}");
    }
}

#[test]
fn props_have_the_sizes_of_real_objects() {
    let size = |prop: Prop| {
        let (low, high) = prop.mesh().bounds();
        (low, high)
    };
    let (low, high) = size(Prop::Hand);
    assert!((high.y - 0.19).abs() < 0.003, "wrist to fingertip {}", high.y);
    assert!((low.y + 0.07).abs() < 0.003, "forearm {}", low.y);
    let breadth = high.x - low.x;
    assert!((0.12..0.16).contains(&breadth), "spread {breadth}");
    let (low, high) = size(Prop::Comb);
    assert!((high.x - low.x - 0.175).abs() < 0.004, "{}", high.x - low.x);
    let (low, high) = size(Prop::HoledSphere { radius: 0.12 });
    assert!(high.max_element() < 0.1201 && low.min_element() > -0.1201);
}

#[test]
fn a_field_resolves_the_thinnest_part() {
    for prop in PROPS {
        let mesh = prop.mesh();
        let sdf = crate::body::Sdf::from_mesh(&mesh, prop.field_nodes(), 0.004).unwrap();
        // Vertices moved inwards by half a millimetre are inside the field, and outside when moved
        // outwards.
        let normals = mesh.vertex_normals();
        let wrong = mesh.positions.iter().zip(&normals).filter(|(p, n)| {
            let at = |by: f32| sdf.sample(**p + **n * by).0;
            at(-5e-4) >= 0.0 || at(5e-4) <= 0.0
        });
        let share = wrong.count() as f32 / mesh.positions.len() as f32;
        assert!(share < 0.01, "{prop:?}: {share}");
    }
    // There is space between two teeth, and a tooth is thicker than two cells.
    assert!(Prop::Comb.distance(Vec3::new(0.00275, -0.02, 0.0)) > 5e-4);
    assert!(Prop::Comb.distance(Vec3::new(0.0, -0.039, 0.0)) < -1e-3);
}
