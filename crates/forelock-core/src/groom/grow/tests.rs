use std::sync::OnceLock;

use super::*;
use crate::body::Region;

/// A preset with few strands, for speed.
fn small(name: &str) -> Groom {
    let params = GrowParams { strands: 300, ..GrowParams::preset(name).unwrap() };
    grow_on_head(&params).unwrap()
}

/// All presets, grown once.
fn presets() -> &'static [Groom] {
    static GROOMS: OnceLock<Vec<Groom>> = OnceLock::new();
    GROOMS.get_or_init(|| PRESETS.map(small).into())
}

fn square() -> TriMesh {
    let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)];
    let positions = corners.map(|(x, z)| Vec3::new(0.1 * x, 0.0, 0.1 * z)).to_vec();
    TriMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
}

/// FNV-1a over the bits of all coordinates.
fn hash(groom: &Groom) -> u64 {
    let bytes = groom.positions().iter().flat_map(|p| p.to_array()).flat_map(|x| x.to_bits().to_le_bytes());
    bytes.fold(0xCBF2_9CE4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01B3))
}

#[test]
fn no_particle_is_inside() {
    for (name, groom) in PRESETS.iter().zip(presets()) {
        for strand in groom.strands() {
            // Roots lie on the mesh, whose flat triangles are a hair's width below the curved
            // surface.
            assert!(Head::distance(strand[0]).abs() < 3e-4, "{name}: a root is off the skin");
            let deepest = strand[1..].iter().map(|&x| Head::distance(x)).fold(f32::INFINITY, f32::min);
            assert!(deepest > 0.0, "{name}: {deepest} m");
            let edges = strand[1..].windows(2).map(|w| Head::distance(0.5 * (w[0] + w[1])));
            let deepest = edges.fold(f32::INFINITY, f32::min);
            assert!(deepest > -1e-3, "{name}: an edge runs {deepest} m inside");
        }
    }
}

#[test]
fn no_hair_hangs_in_front_of_the_face() {
    for (name, groom) in PRESETS.iter().zip(presets()).filter(|(name, _)| **name != "beard") {
        let hides = |x: &Vec3| x.z > 0.07 && x.x.abs() < 0.035 && (-0.11..0.04).contains(&x.y);
        assert!(!groom.positions().iter().any(hides), "{name} hides the face");
    }
}

#[test]
fn edges_of_a_strand_are_equal() {
    let uniform = GrowParams { strands: 200, helix_radius: 25.0, gravity: 0.02, ..GrowParams::default() };
    let groom = grow_on_head(&uniform).unwrap();
    for strand in groom.strands() {
        for edge in strand.windows(2) {
            let length = edge[0].distance(edge[1]);
            assert!((length / uniform.step - 1.0).abs() < 1e-4, "{length}");
        }
    }
    for groom in presets() {
        for strand in groom.strands() {
            let first = strand[0].distance(strand[1]);
            for edge in strand.windows(2) {
                assert!((edge[0].distance(edge[1]) / first - 1.0).abs() < 5e-4);
            }
        }
    }
}

#[test]
fn roots_are_at_the_points_of_their_bindings() {
    let head = Head::builtin();
    for groom in presets() {
        groom.check_attributes().unwrap();
        for (strand, binding) in groom.strands().zip(groom.bindings.as_ref().unwrap()) {
            let corners = head.mesh.corners(binding.triangle as usize);
            let [a, b, c] = binding.barycentric;
            assert!((a + b + c - 1.0).abs() < 1e-6 && a.min(b).min(c) > -1e-6);
            assert!(strand[0].distance(corners[0] * a + corners[1] * b + corners[2] * c) < 1e-6);
        }
    }
}

#[test]
fn roots_are_uniform_by_area_and_weight() {
    let params = GrowParams { strands: 40_000, vertices_per_strand: 2, ..GrowParams::default() };
    // The weight falls from 1 at x = 0 to 0 at x = 10 cm, so a triangle's probability is
    // proportional to its mean weight.
    let groom = grow(&square(), &[1.0, 1.0, 0.0, 0.0], &params, None).unwrap();
    let first = groom.bindings.as_ref().unwrap().iter().filter(|b| b.triangle == 0).count();
    assert!((first as f32 / 40_000.0 - 2.0 / 3.0).abs() < 0.01, "{first}");
    let mean = |axis: fn(&[Vec3]) -> f32| groom.strands().map(axis).sum::<f32>() / 40_000.0;
    // ∫∫ x over the two triangles, weighted 2/3 and 1/3: centroids at (1/3, 2/3) and (2/3, 1/3) of
    // 10 cm.
    assert!((mean(|s| s[0].x) - 0.1 * 4.0 / 9.0).abs() < 5e-4);
    assert!((mean(|s| s[0].z) - 0.1 * 5.0 / 9.0).abs() < 5e-4);
}

#[test]
fn without_noise_and_gravity_strands_follow_the_normal() {
    let params = GrowParams { strands: 10, noise: 0.0, spiral: 0.0, ..GrowParams::default() };
    let groom = grow(&square(), &[1.0; 4], &params, None).unwrap();
    for strand in groom.strands() {
        for (i, x) in strand.iter().enumerate() {
            assert!(x.distance(strand[0] + Vec3::Y * (params.step * i as f32)) < 1e-6);
        }
    }
}

#[test]
fn growth_follows_the_formula_of_the_paper() {
    // On a level skin without noise p⁰ = ŷ; Eqs. 4–7 in float64, written out for this case.
    let params = GrowParams {
        strands: 1,
        vertices_per_strand: 30,
        noise: 0.0,
        gravity: 0.02,
        helix_radius: 20.0,
        ..GrowParams::default()
    };
    let groom = grow(&square(), &[1.0; 4], &params, None).unwrap();
    let mut p = glam::DVec3::Y;
    let mut x = groom.strand(0)[0].as_dvec3();
    for (i, grown) in groom.strand(0).iter().enumerate().skip(1) {
        let turn = i as f64;
        let pulled = p - glam::DVec3::Y * ((turn - 1.0) * 0.02 * (1.0 - p.y.abs()).max(0.2));
        let helix = glam::DVec3::new(20.0 * turn.cos(), 1.0, 20.0 * turn.sin());
        p = pulled + 0.017 * (pulled - helix);
        x += 0.01 * p.normalize();
        assert!(x.distance(grown.as_dvec3()) < 1e-6, "particle {i}: {x} against {grown}");
    }
}

#[test]
fn the_same_seed_grows_the_same_hair() {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let params = GrowParams { strands: 200, ..GrowParams::preset("wavy").unwrap() };
    let grown = pool(1).install(|| grow_on_head(&params)).unwrap();
    assert_eq!(grown, pool(2).install(|| grow_on_head(&params)).unwrap());
    let other = grow_on_head(&GrowParams { seed: 2, ..params }).unwrap();
    assert_ne!(grown, other);

    // The same bits on every machine: this constant changes only if growth is changed on purpose.
    let params = GrowParams {
        strands: 64,
        hang: 20.0,
        comb: [1.0, 0.0, -0.3],
        wave_radius: 0.01,
        clump: 0.5,
        ..GrowParams::default()
    };
    let groom = grow(&square(), &[1.0, 0.5, 1.0, 0.0], &params, None).unwrap();
    assert_eq!(format!("{:016x}", hash(&groom)), "0cfe13e2de1b1bd2");
}

#[test]
fn sheets_vary_two_parameters() {
    for sheet in sheets() {
        assert_eq!(sheet.cells.len(), sheet.rows.len() * sheet.columns.len());
        let distinct = sheet.cells.iter().enumerate().all(|(i, a)| !sheet.cells[..i].contains(a));
        assert!(distinct, "{}", sheet.name);
        sheet.cells.iter().for_each(|cell| cell.check().unwrap());
    }
}

#[test]
fn documented_defaults_equal_the_defaults() {
    // Parses a value as documented or as `Debug` prints it: a name or a list of numbers.
    let value = |text: &str| {
        let text = if text.starts_with('[') {
            text.trim_start_matches('[').split(']').next().unwrap()
        } else {
            text.split(", ").next().unwrap().split([';', ' ']).next().unwrap()
        };
        let text = text.trim_end_matches('.').trim_matches('"').to_lowercase();
        let numbers: Result<Vec<f32>, _> = text.split(", ").map(str::parse).collect();
        numbers.map_err(|_| text)
    };
    let shown = format!("{:?}", GrowParams::default());
    let (_, fields) = include_str!("params.rs").split_once("pub struct GrowParams {").unwrap();
    let (mut doc, mut compared) = (String::new(), 0);
    for line in fields.split("\n}").next().unwrap().lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("///") {
            doc.push_str(text);
        } else if let Some((name, _)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(": ")) {
            let documented = doc.split_once("efault ").unwrap().1;
            let actual = shown.split_once(&format!(" {name}: ")).unwrap().1;
            assert_eq!(value(documented), value(actual), "{name}");
            doc.clear();
            compared += 1;
        }
    }
    assert_eq!(compared, shown.matches(": ").count());
}

#[test]
fn invalid_input_is_refused() {
    let mesh = square();
    let fail = |weights: &[f32], change: fn(&mut GrowParams)| {
        let mut params = GrowParams { strands: 10, ..GrowParams::default() };
        change(&mut params);
        grow(&mesh, weights, &params, None).unwrap_err()
    };
    let one = [1.0f32; 4];
    assert_eq!(fail(&[0.0; 4], |_| ()), GrowError::EmptyRegion);
    assert_eq!(fail(&[1.0; 3], |_| ()), GrowError::WeightCount { expected: 4, found: 3 });
    assert!(matches!(fail(&[1.0, f32::NAN, 1.0, 1.0], |_| ()), GrowError::Weight { vertex: 1, .. }));
    assert!(matches!(fail(&[1.0, 1.0, -0.5, 1.0], |_| ()), GrowError::Weight { vertex: 2, .. }));
    let parameter = |change: fn(&mut GrowParams)| match fail(&one, change) {
        GrowError::Parameter { name, .. } => name,
        other => panic!("{other}"),
    };
    assert_eq!(parameter(|p| p.strands = 0), "strands");
    assert_eq!(parameter(|p| p.vertices_per_strand = 1), "vertices_per_strand");
    assert_eq!(parameter(|p| p.step = 0.0), "step");
    assert_eq!(parameter(|p| p.step = f32::NAN), "step");
    assert_eq!(parameter(|p| p.gravity = -1.0), "gravity");
    assert_eq!(parameter(|p| p.comb[2] = f32::INFINITY), "comb");
    assert!(GrowParams::preset("mohawk").unwrap_err().to_string().contains("short-fur"));
    let broken = TriMesh { positions: vec![Vec3::ZERO; 3], triangles: vec![[0, 1, 3]] };
    let params = GrowParams { region: Region::Beard, ..GrowParams::default() };
    assert_eq!(grow(&broken, &[1.0; 3], &params, None), Err(GrowError::Triangle(0)));
}
