//! How the presets look, measured, with two seeds.

use std::sync::OnceLock;

use super::looks::{cracks, folds, mean_length, nests, shelves, strings};
use super::*;
use crate::groom::length;

/// The presets of hair that is worn down and not curled.
const SMOOTH: [&str; 4] = ["straight", "wavy", "bob", "asymmetric"];

struct Grown {
    name: &'static str,
    params: GrowParams,
    groom: Groom,
}

/// All presets with two seeds, grown once.
fn grown() -> &'static [Grown] {
    static GROOMS: OnceLock<Vec<Grown>> = OnceLock::new();
    GROOMS.get_or_init(|| {
        let both = PRESETS.iter().flat_map(|&name| [(name, 1), (name, 2)]);
        both.map(|(name, seed)| {
            let params = GrowParams { strands: 1000, seed, ..GrowParams::preset(name).unwrap() };
            let groom = grow_on_head(&params).unwrap();
            Grown { name, params, groom }
        })
        .collect()
    })
}

fn smooth() -> impl Iterator<Item = &'static Grown> {
    grown().iter().filter(|grown| SMOOTH.contains(&grown.name))
}

#[test]
fn strands_do_not_fold() {
    for Grown { name, groom, .. } in grown() {
        let limit = if *name == "curly" { 0.02 } else { 0.001 };
        assert!(folds(groom) < limit, "{name}: {}", folds(groom));
    }
}

#[test]
fn hair_makes_no_nest_on_the_shoulders() {
    for Grown { name, groom, .. } in grown() {
        assert_eq!(nests(groom), 0.0, "{name}");
    }
}

#[test]
fn no_hair_crosses_the_throat() {
    for Grown { name, groom, .. } in grown().iter().filter(|grown| grown.name != "beard") {
        assert_eq!(strings(groom), 0.0, "{name}");
    }
}

#[test]
fn hair_covers_the_ears_without_a_shelf() {
    for Grown { name, groom, .. } in smooth() {
        assert!(shelves(groom) < 0.012, "{name}: {}", shelves(groom));
    }
}

#[test]
fn neighbours_stay_together() {
    // The parting is given in half widths of the scalp, 7.3 cm.
    let shares: Vec<f32> = smooth().map(|grown| cracks(&grown.groom, 0.073 * grown.params.parting)).collect();
    let mean = shares.iter().sum::<f32>() / shares.len() as f32;
    assert!(mean < 0.012, "{shares:?}");
}

#[test]
fn hair_is_finer_at_the_hairline() {
    for Grown { name, params, groom } in grown() {
        let head = Head::builtin();
        let weights = head.weights(params.region);
        let (bindings, widths) = (groom.bindings.as_ref().unwrap(), groom.widths.as_ref().unwrap());
        let mut thin = Vec::new();
        for (strand, binding) in bindings.iter().enumerate() {
            let corners = head.mesh.triangles[binding.triangle as usize].map(|v| weights[v as usize]);
            let weight: f32 = corners.iter().zip(binding.barycentric).map(|(w, b)| w * b).sum();
            if weight < 0.5 {
                thin.push(widths[groom.range(strand).start] / params.width);
            }
        }
        assert!(thin.len() > 5, "{name}: {} hairs at the edge of the region", thin.len());
        assert!(thin.iter().all(|&width| width < 0.66), "{name}: thick hair at the edge");
    }
}

#[test]
fn few_strands_are_as_long_as_many() {
    for name in PRESETS {
        let many = grown().iter().find(|grown| grown.name == name).unwrap();
        let usual = mean_length(&many.groom);
        for strands in [1, 2, 5, 10] {
            let groom = grow_on_head(&GrowParams { strands, ..many.params.clone() }).unwrap();
            let lengths = groom.strands().map(length);
            let (short, long) = lengths.fold((f32::MAX, 0.0), |(s, l), x: f32| (x.min(s), x.max(l)));
            assert!(short > 0.25 * usual && long > 0.65 * usual, "{name}, {strands}: {short} to {long} m");
        }
    }
}
