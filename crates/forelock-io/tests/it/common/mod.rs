//! Grooms for round trips.

#![expect(clippy::expect_used, reason = "a helper of tests fails by panicking")]

use forelock_core::groom::{Groom, Labels, RootBinding};
use glam::Vec3;
use proptest::{prelude::*, sample::select};

fn scalars(n: usize) -> impl Strategy<Value = Option<Vec<f32>>> {
    prop::option::of(prop::collection::vec(-1e3f32..1e3, n))
}

fn tuples<const N: usize>(n: usize) -> impl Strategy<Value = Option<Vec<[f32; N]>>> {
    prop::option::of(prop::collection::vec(0.0f32..1.0, n * N).prop_map(|v| v.as_chunks::<N>().0.to_vec()))
}

/// A value for each of `strands` strands, or none.
fn each<T: Strategy>(one: T, strands: usize) -> impl Strategy<Value = Option<Vec<T::Value>>>
where
    T::Value: Clone,
{
    prop::option::of(prop::collection::vec(one, strands))
}

fn labels(strands: usize) -> impl Strategy<Value = Labels> {
    let all = (
        each(any::<i32>(), strands),
        each(any::<i32>(), strands),
        each(any::<bool>(), strands),
        each(prop::array::uniform3(any::<i32>()), strands),
        each(prop::array::uniform3(0.0f32..1.0), strands),
    );
    all.prop_map(|(ids, group_ids, guides, closest_guides, guide_weights)| Labels {
        ids,
        group_ids,
        guides,
        closest_guides,
        guide_weights,
    })
}

/// Strands of 1 to 8 particles, all the same number or not, with any attributes.
pub fn grooms() -> impl Strategy<Value = Groom> {
    let mixed = prop::collection::vec(1usize..9, 1..8);
    let equal = (1usize..9, 1usize..8).prop_map(|(each, strands)| vec![each; strands]);
    prop_oneof![mixed, equal].prop_flat_map(|counts| {
        let (strands, particles) = (counts.len(), counts.iter().sum::<usize>());
        let coordinate = prop_oneof![-1e3f32..1e3, select(vec![0.0, -0.0, 1e-38, 3e38])];
        let positions = prop::collection::vec(prop::array::uniform3(coordinate), particles);
        let pinned = prop::option::of(counts.iter().map(|&n| 0..=n as u16).collect::<Vec<_>>());
        let bindings = prop::option::of(prop::collection::vec((any::<u32>(), -1.0f32..1.0), strands));
        let attributes = (scalars(particles), scalars(particles), tuples(particles), tuples(strands));
        let own = (scalars(strands), labels(strands));
        (positions, pinned, bindings, attributes, own).prop_map(
            move |(positions, pinned, bindings, attributes, own)| {
                let mut offsets = vec![0];
                offsets.extend(counts.iter().scan(0, |sum, &n| {
                    *sum += n as u32;
                    Some(*sum)
                }));
                let positions = positions.into_iter().map(Vec3::from_array).collect();
                let mut groom = Groom::new(positions, offsets).expect("the offsets end at the particles");
                (groom.widths, groom.transparencies, groom.colours, groom.root_uvs) = attributes;
                (groom.stiffness, groom.labels) = own;
                groom.pinned = pinned;
                let bind =
                    |(triangle, distance)| RootBinding { triangle, barycentric: [0.5, 0.25, 0.25], distance };
                groom.bindings = bindings.map(|b| b.into_iter().map(bind).collect());
                groom
            },
        )
    })
}
