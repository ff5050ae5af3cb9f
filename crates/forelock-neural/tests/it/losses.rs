//! The energies against reference results and finite differences.

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

use crate::golden::{error, load, numbers, vectors};
use forelock_core::lane::{Lane, Mat3, Pack, V3};
use forelock_neural::PARTICLES;
use forelock_neural::losses::adhesion::{Adhesion, AdhesionTerms};
use forelock_neural::losses::body::{Body, BodyTerms, Capsule, Ellipsoid, FIRST, Near, Sphere, body};
use forelock_neural::losses::elastic::{ElasticTerms, RestStrand, Transport, elastic};
use forelock_neural::losses::motion::{Inertial, MotionTerms, Place};
use forelock_neural::losses::repulsion::{Repulsion, RepulsionTerms, densities, kernel};
use forelock_neural::losses::style::{StyleTerms, style};
use forelock_neural::losses::{Strand, zero};
use glam::{DMat3, DVec3};
use serde_json::Value;

/// The float32 lanes of the tests.
type F32 = Pack<4, false>;

/// The tolerances of values and of gradients.
trait Tolerance: Lane {
    const OF: [f64; 2];
}
impl Tolerance for f64 {
    const OF: [f64; 2] = [1e-9, 1e-9];
}
impl Tolerance for F32 {
    const OF: [f64; 2] = [2e-5, 1e-3];
}

fn strands<L: Lane>(value: &Value) -> Vec<Strand<L>> {
    let strand = |x: &[[f64; 3]]| std::array::from_fn(|i| V3::splat(DVec3::from(x[i])));
    vectors(value).chunks_exact(PARTICLES).map(strand).collect()
}

fn f64_of<L: Lane>(x: L) -> f64 {
    num(x.get(L::WIDTH - 1))
}

fn num<T: forelock_core::lane::Real>(x: T) -> f64 {
    x.to_f64().unwrap()
}

fn flat<L: Lane>(strands: &[Strand<L>]) -> Vec<f64> {
    strands.iter().flatten().flat_map(|v| v.get(L::WIDTH - 1).map(num)).collect()
}

/// Compares with `expected.value` and `expected.grad`.
fn compare<L: Tolerance>(name: &str, value: f64, gradient: &[Strand<L>], expected: &Value) {
    let errors = [
        error(&[value], &[expected["value"].as_f64().unwrap()]),
        error(&flat(gradient), &numbers(&expected["grad"])),
    ];
    assert!(errors[0] <= L::OF[0] && errors[1] <= L::OF[1], "{name}: {errors:?}");
}

fn matrix(value: &Value) -> DMat3 {
    DMat3::from_cols_array(&numbers(value).try_into().unwrap()).transpose()
}

fn vector(value: &Value) -> DVec3 {
    vectors(value)[0].into()
}

/// Energies of each strand of a file, and gradients.
fn each<L: Lane>(
    x: &[Strand<L>],
    mut energy: impl FnMut(usize, &Strand<L>, &mut Strand<L>) -> L,
) -> (f64, Vec<Strand<L>>) {
    let mut sum = 0.0;
    let gradients = x.iter().enumerate().map(|(s, x)| {
        let mut gradient = zero();
        sum += f64_of(energy(s, x, &mut gradient));
        gradient
    });
    let gradients = gradients.collect();
    (sum, gradients)
}

fn elastic_and_motion<L: Tolerance>() {
    let file = load("loss_1_elastic_inertia");
    let [x, rest, before, earlier] = ["x", "x_rest", "x_tm1", "x_tm2"].map(|key| strands::<L>(&file[key]));
    let none = ElasticTerms { stretch: 0.0, bend_twist: 0.0, least_arc: 0.0, ..ElasticTerms::default() };
    let bend = ElasticTerms { bend_twist: 100.0, ..none };
    let cases = [
        ("stretch", ElasticTerms { stretch: 200.0, ..none }),
        ("bend_sequential", bend),
        ("bend_sequential_noclamp", ElasticTerms { clamps_root: false, ..bend }),
        ("bend_direct_root", ElasticTerms { transport: Transport::Direct, ..bend }),
        ("bend_direct_chord", ElasticTerms { transport: Transport::Chord, ..bend }),
    ];
    for (name, terms) in cases {
        let (value, gradients) =
            each(&x, |s, x, g| elastic(&terms, &RestStrand::new(&rest[s], &terms), x, g));
        compare(name, value, &gradients, &file["out"][name]);
    }
    let place = |when: &str| Place::<L> {
        rotation: Mat3::splat(matrix(&file[format!("R_{when}")])),
        origin: V3::splat(vector(&file[format!("p_{when}")])),
    };
    let still = MotionTerms { is_dynamic: false, ..MotionTerms::default() };
    let weightless = MotionTerms { gravity: DVec3::ZERO, drag: 0.0, ..MotionTerms::default() };
    for (name, terms) in [("gravity", still), ("inertia", weightless)] {
        let (value, gradients) = each(&x, |s, x, g| {
            let before = [place("tm1").world(&before[s]), place("tm2").world(&earlier[s])];
            Inertial { place: place("t"), before: [&before[0], &before[1]] }.energy(&terms, x, g)
        });
        // Differences of world positions 165 cm from the origin in float32.
        if name == "gravity" || L::OF[0] < 1e-6 {
            compare(name, value, &gradients, &file["out"][name]);
        } else {
            let expected = &file["out"][name];
            let errors = [
                error(&[value], &numbers(&expected["value"])),
                error(&flat(&gradients), &numbers(&expected["grad"])),
            ];
            assert!(errors[0] < 1e-3 && errors[1] < 1e-3, "{name}: {errors:?}");
        }
    }
}

#[test]
fn elastic_energies_gravity_and_inertia_agree_with_reference_results() {
    elastic_and_motion::<f64>();
    elastic_and_motion::<F32>();
}

/// The spheres and capsules of a file.
fn shapes<L: Lane>(value: &Value) -> Vec<Capsule<L>> {
    let shape = |shape: &Value| {
        let ends = if shape["type"] == "sphere" { ["c", "c"] } else { ["a", "b"] };
        let ends = ends.map(|key| V3::splat(vector(&shape[key])));
        Capsule { ends, radius: L::from_f64(shape["r"].as_f64().unwrap()) }
    };
    value.as_array().unwrap().iter().map(shape).collect()
}

/// A mesh by the plane of its nearest triangle.
struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[usize; 3]>,
}

impl Body<f64> for Mesh {
    fn near(&self, x: V3<f64>) -> Near<f64> {
        let x = DVec3::from(x.0);
        let to = |triangle: &&[usize; 3]| closest(triangle.map(|i| self.vertices[i]), x).distance_squared(x);
        let nearest = self.triangles.iter().min_by(|a, b| to(a).total_cmp(&to(b))).unwrap();
        let [a, b, c] = nearest.map(|i| self.vertices[i]);
        let normal = (b - a).cross(c - a).normalize();
        Near { distance: normal.dot(x - a), gradient: V3::splat(normal) }
    }
}

/// The point of a triangle that is nearest to `x`: the projection, or the nearest on an edge.
fn closest([a, b, c]: [DVec3; 3], x: DVec3) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let inside = [[a, b], [b, c], [c, a]].iter().all(|[p, q]| normal.cross(*q - *p).dot(x - *p) >= 0.0);
    if inside {
        return x - normal * (normal.dot(x - a) / normal.length_squared());
    }
    let edges = [[a, b], [b, c], [c, a]]
        .map(|[p, q]| p + (q - p) * ((x - p).dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0));
    edges.into_iter().min_by(|p, q| p.distance_squared(x).total_cmp(&q.distance_squared(x))).unwrap()
}

fn collisions<L: Tolerance>() {
    let file = load("loss_3_body_collision");
    let x = strands::<L>(&file["x"]);
    let shapes = shapes::<L>(&file["prims"]);
    let found: Vec<f64> =
        x.iter().flat_map(|x| &x[FIRST..]).map(|x| f64_of(shapes.near(*x).distance)).collect();
    assert!(error(&found, &numbers(&file["out"]["prim_d"])) <= L::OF[0]);
    for (name, tail) in [("prim", f64::INFINITY), ("prim_tail", file["q_lin"].as_f64().unwrap())] {
        let terms = BodyTerms { tail, ..BodyTerms::default() };
        let (value, gradients) =
            each(&x, |_, x, g| body(&terms, shapes.as_slice(), x, g, &mut [L::zero(); PARTICLES]));
        compare(name, value, &gradients, &file["out"][name]);
    }
}

#[test]
fn body_collision_agrees_with_reference_results() {
    collisions::<f64>();
    collisions::<F32>();
    let file = load("loss_3_body_collision");
    let vertices = vectors(&file["mesh_verts"]).into_iter().map(DVec3::from).collect();
    let triangles = numbers(&file["mesh_tris"]);
    let triangles = triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|i| i as usize)).collect();
    let mesh = Mesh { vertices, triangles };
    let x = strands::<f64>(&file["x_mesh"]);
    let terms = BodyTerms { tail: f64::INFINITY, ..BodyTerms::default() };
    let (value, gradients) = each(&x, |_, x, g| body(&terms, &mesh, x, g, &mut [0.0; PARTICLES]));
    compare("mesh", value, &gradients, &file["out"]["mesh"]);
}

#[test]
fn repulsion_agrees_with_reference_results() {
    let file = load("loss_4_sph");
    for pair in file["kernel"].as_array().unwrap() {
        let [r, w] = numbers(pair)[..] else { panic!() };
        assert!((kernel(r, 0.6)[0] - w).abs() < 1e-9);
    }
    let [x, rest] = ["x", "x_rest"].map(|key| vectors(&file[key]));
    assert!(error(&densities(&x, 0.6), &numbers(&file["out"]["rho"])) < 1e-9);
    assert!(error(&densities(&rest, 0.6), &numbers(&file["rho_rest"])) < 1e-9);
    let repulsion = Repulsion::new(RepulsionTerms::default(), &rest);
    let mut gradient = vec![[0.0; 3]; x.len()];
    let value = repulsion.energy(&x, &mut gradient, &mut vec![Default::default(); x.len()]);
    let expected = &file["out"]["loss"];
    assert!(error(&[value], &numbers(&expected["value"])) < 1e-9);
    assert!(error(gradient.as_flattened(), &numbers(&expected["grad"])) < 1e-9);
    let to_f32 = |x: &[[f64; 3]]| -> Vec<[f32; 3]> { x.iter().map(|x| x.map(|c| c as f32)).collect() };
    let [x, rest] = [to_f32(&x), to_f32(&rest)];
    let mut gradient = vec![[0.0; 3]; x.len()];
    let value = Repulsion::new(RepulsionTerms::default(), &rest).energy(
        &x,
        &mut gradient,
        &mut vec![Default::default(); x.len()],
    );
    let gradient: Vec<f64> = gradient.as_flattened().iter().map(|g| f64::from(*g)).collect();
    assert!(error(&[value.into()], &numbers(&expected["value"])) < 2e-5);
    assert!(error(&gradient, &numbers(&expected["grad"])) < 1e-3);
}

#[test]
fn adhesion_and_style_agree_with_reference_results() {
    let file = load("loss_5_adhesion_style");
    let [x, rest] = ["x", "x_rest"].map(|key| vectors(&file[key]));
    let terms = AdhesionTerms { range: file["r_neighbor"].as_f64().unwrap(), ..AdhesionTerms::default() };
    let adhesion = Adhesion::new(terms, &rest, PARTICLES);
    let (mut found, mut apart) = (Vec::new(), Vec::new());
    for i in 0..x.len() {
        let near: Vec<(usize, f64)> = adhesion.neighbours(i).collect();
        found.extend((0..5).map(|n| near.get(n).map_or(-1.0, |near| near.0 as f64)));
        apart.extend((0..5).map(|n| near.get(n).map_or(0.0, |near| near.1)));
    }
    assert_eq!(found, numbers(&file["neighbours"]));
    assert!(error(&apart, &numbers(&file["d0"])) < 1e-9);
    for (name, adhesion) in [("adhesion_paper", adhesion.clone().printed()), ("adhesion_excess", adhesion)] {
        let mut gradient = vec![[0.0; 3]; x.len()];
        let value = adhesion.energy(&x, &mut gradient, &mut vec![Default::default(); x.len()]);
        let expected = &file["out"][name];
        assert!(error(&[value], &numbers(&expected["value"])) < 1e-9, "{name}");
        assert!(error(gradient.as_flattened(), &numbers(&expected["grad"])) < 1e-9, "{name}");
    }
    styles::<f64>(&file);
    styles::<F32>(&file);
}

fn styles<L: Tolerance>(file: &Value) {
    let sphere = &file["sphere"];
    let sphere = Sphere {
        centre: V3::splat(vector(&sphere["c"])),
        radius: L::from_f64(sphere["r"].as_f64().unwrap()),
    };
    let terms = StyleTerms { stiffness: 3.0, range: file["s_max"].as_f64().unwrap() };
    let [x, rest] = ["x", "x_rest"].map(|key| strands::<L>(&file[key]));
    let (value, gradients) =
        each(&x, |s, x, g| style(&terms, &sphere, [&rest[s], x], g, &mut [L::zero(); PARTICLES]));
    compare("style", value, &gradients, &file["out"]["style_detached"]);
}

/// Compares `gradient` of `energy` with central differences along every coordinate.
fn finite_differences(name: &str, x: &Strand<f64>, energy: impl Fn(&Strand<f64>, &mut Strand<f64>) -> f64) {
    let mut gradient = zero();
    energy(x, &mut gradient);
    let h = 1e-5;
    let mut found = Vec::new();
    for i in 0..PARTICLES {
        for c in 0..3 {
            let ends = [h, -h].map(|h| {
                let mut moved = *x;
                moved[i].0[c] += h;
                energy(&moved, &mut zero())
            });
            found.push((ends[0] - ends[1]) / (2.0 * h));
        }
    }
    let error = error(&found, &flat(&[gradient]));
    assert!(error < 1e-5, "{name}: {error:e}");
}

#[test]
fn gradients_agree_with_finite_differences() {
    let file = load("loss_1_elastic_inertia");
    let [x, rest] = ["x", "x_rest"].map(|key| strands::<f64>(&file[key]));
    // Folded back by more than the least arc allows.
    let mut folded = x[0];
    folded[12] = folded[10] + (folded[11] - folded[10]).scale(1e-3) + V3::splat(DVec3::new(2e-3, 0.0, 1e-3));
    for transport in [Transport::Sequential, Transport::Direct, Transport::Chord] {
        let terms = ElasticTerms { transport, ..ElasticTerms::default() };
        let at_rest = RestStrand::new(&rest[0], &terms);
        for x in [&x[0], &x[1], &x[2], &folded] {
            finite_differences(&format!("{transport:?}"), x, |x, g| elastic(&terms, &at_rest, x, g));
        }
    }
    let place = Place {
        rotation: Mat3::splat(DMat3::from_rotation_y(0.7)),
        origin: V3::splat(DVec3::new(3.0, 160.0, -2.0)),
    };
    let before = [place.world(&x[1]), place.world(&x[2])];
    let inertial = Inertial { place, before: [&before[0], &before[1]] };
    finite_differences("motion", &x[0], |x, g| inertial.energy(&MotionTerms::default(), x, g));
    let ellipsoid = Ellipsoid { radii: V3::splat(DVec3::new(7.5, 10.5, 9.0)) };
    let deep = x[0].map(|x| x.scale(0.8));
    finite_differences("ellipsoid", &deep, |x, g| {
        body(&BodyTerms::default(), &ellipsoid, x, g, &mut [0.0; PARTICLES])
    });
    let capsule = Capsule { ends: [V3::splat(DVec3::ZERO), V3::splat(DVec3::Y)], radius: 11.5 };
    finite_differences("capsule", &x[0], |x, g| {
        body(&BodyTerms::default(), &capsule, x, g, &mut [0.0; PARTICLES])
    });
}

#[test]
fn gradients_between_strands_agree_with_finite_differences() {
    let file = load("loss_5_adhesion_style");
    let [x, rest] = ["x", "x_rest"].map(|key| vectors(&file[key]));
    let near: Vec<[f64; 3]> =
        rest.iter().zip(&x).map(|(a, b)| [0, 1, 2].map(|c| 0.9 * a[c] + 0.1 * b[c])).collect();
    let repulsion = Repulsion::new(RepulsionTerms::default(), &near);
    let adhesion = Adhesion::new(AdhesionTerms { range: 1.2, ..AdhesionTerms::default() }, &rest, PARTICLES);
    for is_repulsion in [true, false] {
        let energy = |x: &[[f64; 3]], by: &mut [[f64; 3]]| {
            let mut held = vec![0.0; x.len()];
            if is_repulsion { repulsion.energy(x, by, &mut held) } else { adhesion.energy(x, by, &mut held) }
        };
        let mut gradient = vec![[0.0; 3]; x.len()];
        let mut unused = gradient.clone();
        assert!(energy(&x, &mut gradient) > 0.0);
        let h = 1e-6;
        let mut found = gradient.clone();
        for i in 0..x.len() {
            for c in 0..3 {
                let ends = [h, -h].map(|h| {
                    let mut moved = x.clone();
                    moved[i][c] += h;
                    energy(&moved, &mut unused)
                });
                found[i][c] = (ends[0] - ends[1]) / (2.0 * h);
            }
        }
        let error = error(found.as_flattened(), gradient.as_flattened());
        assert!(error < 1e-5, "{error:e}");
    }
}
