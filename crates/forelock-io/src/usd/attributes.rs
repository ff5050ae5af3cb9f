//! What is written of a groom, for text and binary files alike.

use forelock_core::groom::Groom;
use glam::Vec3;

use super::names::{BINDING, COLOUR, OPACITY, PINNED, ROOT_UVS, STIFFNESS};
use crate::labels::PRIMVARS;

/// The names of the prims.
pub(super) const PARENT: &str = "groom";
pub(super) const PRIM: &str = "hair";

/// A list of numbers, or a word.
pub(super) enum Numbers {
    /// Joined vectors of so many numbers, of 32 bits.
    Integers(usize, Vec<i64>),
    /// Joined vectors of so many numbers.
    Floats(usize, Vec<f32>),
    Word(&'static str),
}

/// An attribute to be written.
pub(super) struct Written {
    pub name: &'static str,
    /// The type of an element.
    pub kind: &'static str,
    pub interpolation: Option<&'static str>,
    pub numbers: Numbers,
}

/// The attributes of `groom`, without its points.
pub(super) fn of(groom: &Groom) -> Vec<Written> {
    let counts = groom.strand_offsets().windows(2).map(|pair| i64::from(pair[1] - pair[0])).collect();
    let mut all = vec![
        Written {
            name: "curveVertexCounts",
            kind: "int",
            interpolation: None,
            numbers: Numbers::Integers(1, counts),
        },
        Written { name: "type", kind: "token", interpolation: None, numbers: Numbers::Word("linear") },
    ];
    let mut add = |name, kind, interpolation, numbers: Option<Numbers>| {
        if let Some(numbers) = numbers {
            all.push(Written { name, kind, interpolation: Some(interpolation), numbers });
        }
    };
    add("widths", "float", "vertex", groom.widths.clone().map(|w| Numbers::Floats(1, w)));
    let colours = groom.colours.as_ref().map(|c| Numbers::Floats(3, c.as_flattened().to_vec()));
    add(COLOUR, "color3f", "vertex", colours);
    let opacities = groom.transparencies.as_ref();
    let opacities = opacities.map(|t| Numbers::Floats(1, t.iter().map(|t| 1.0 - t).collect()));
    add(OPACITY, "float", "vertex", opacities);
    let uvs = groom.root_uvs.as_ref().map(|uvs| Numbers::Floats(2, uvs.as_flattened().to_vec()));
    add(ROOT_UVS[0], "texCoord2f", "uniform", uvs);
    let pinned = groom.pinned.as_ref().map(|p| integers(1, p));
    add(PINNED, "int", "uniform", pinned);
    add(STIFFNESS, "float", "uniform", groom.stiffness.clone().map(|k| Numbers::Floats(1, k)));
    if let Some(bindings) = &groom.bindings {
        let triangles: Vec<u32> = bindings.iter().map(|b| b.triangle).collect();
        let points = bindings.iter().flat_map(|b| b.barycentric).collect();
        let distances = bindings.iter().map(|b| b.distance).collect();
        add(BINDING[0], "uint", "uniform", Some(integers(1, &triangles)));
        add(BINDING[1], "float3", "uniform", Some(Numbers::Floats(3, points)));
        add(BINDING[2], "float", "uniform", Some(Numbers::Floats(1, distances)));
    }
    let labels = &groom.labels;
    let [id, group, guide, nearest, shares] = PRIMVARS;
    add(id, "int", "uniform", labels.ids.as_ref().map(|ids| integers(1, ids)));
    add(group, "int", "uniform", labels.group_ids.as_ref().map(|ids| integers(1, ids)));
    add(guide, "int", "uniform", labels.guides.as_ref().map(|guides| integers(1, guides)));
    let closest = labels.closest_guides.as_ref().map(|ids| integers(3, ids.as_flattened()));
    add(nearest, "int3", "uniform", closest);
    let weights = labels.guide_weights.as_ref().map(|w| Numbers::Floats(3, w.as_flattened().to_vec()));
    add(shares, "float3", "uniform", weights);
    all
}

fn integers<T: Copy + Into<i64>>(each: usize, values: &[T]) -> Numbers {
    Numbers::Integers(each, values.iter().map(|&value| value.into()).collect())
}

/// The corners of the box around `points`, made larger by `radius`.
pub(super) fn extent(points: &[Vec3], radius: f32) -> [Vec3; 2] {
    let finite = points.iter().filter(|p| p.is_finite());
    let (low, high) =
        finite.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
    if low.x > high.x { [Vec3::ZERO; 2] } else { [low - radius, high + radius] }
}

/// The largest radius of `groom`'s hair.
pub(super) fn radius(groom: &Groom) -> f32 {
    groom.widths.iter().flatten().fold(0.0f32, |most, &width| most.max(width)) / 2.0
}
