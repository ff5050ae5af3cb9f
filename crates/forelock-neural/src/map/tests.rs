use super::strands::strands_of_texels;
use super::*;
use crate::network::rotation::{basis, rotate};
use crate::random::Random;
use crate::train::TrainingStrand;
use crate::{EDGES, PARTICLES};
use forelock_core::lane::V3;

/// A network with random weights for random strands.
fn random_network(head: OutputHead) -> (MapNetwork, MapStrands) {
    let mut random = Random::stream(5, 0);
    let mut own = vec![0.0f32; parameters()];
    for (number, layer) in LAYERS.iter().enumerate() {
        let deviation = (2.0 / layer.inputs as f64).sqrt();
        for range in ranges(number) {
            own[range].iter_mut().for_each(|x| *x = (deviation * random.normal()) as f32);
        }
    }
    let strands: Vec<TrainingStrand> = (0..50)
        .map(|_| {
            let mut at = [0.0f32, 9.0, 0.0];
            let rest = std::array::from_fn(|_| {
                let here = at;
                at.iter_mut().for_each(|x| *x += 0.5 * random.signed() as f32);
                here
            });
            let statics = (0..STATICS).map(|_| random.signed() as f32).collect();
            TrainingStrand { rest, statics }
        })
        .collect();
    let basis = basis(100.0, 1e-4, 1.0 / 30.0);
    (MapNetwork::new(own, head, &basis).unwrap(), MapStrands::new(&strands).unwrap())
}

fn inputs(frames: u64) -> Vec<f32> {
    let mut random = Random::stream(6, frames);
    (0..frames as usize * SHARED).map(|_| random.signed() as f32).collect()
}

#[test]
fn the_children_of_a_pixel_are_next_to_each_other() {
    assert_eq!([texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1), texel(2, 0)], [0, 1, 2, 3, 4]);
    assert_eq!([texel(63, 0), texel(0, 63), texel(63, 63)], [1365, 2730, 4095]);
    let mut seen = vec![false; TEXELS];
    for (u, v) in (0..SIDE).flat_map(|v| (0..SIDE).map(move |u| (u, v))) {
        seen[texel(u, v)] = true;
        for level in 1..7 {
            let corner = texel(u >> level << level, v >> level << level);
            assert_eq!(texel(u, v) >> (2 * level), corner >> (2 * level));
        }
    }
    assert!(seen.iter().all(|own| *own));
}

#[test]
fn there_are_as_many_parameters_as_the_layers_have() {
    let layers = [683 * 256, 257 * 2048, 129 * 512, 129 * 256, 65 * 256, 65 * 128, 99 * 128, 129 * 72];
    assert_eq!(parameters(), layers.iter().sum::<usize>());
    assert_eq!(parameters(), 847_176);
    let error = MapNetwork::new(vec![0.0; 9], OutputHead::Rotation, &[[0.0; EDGES]; EDGES]).unwrap_err();
    assert_eq!(error, LengthError { expected: 847_176, found: 9 });
}

#[test]
fn a_texel_has_the_strand_with_the_nearest_root() {
    // The map covers these bounds: half of [−1, 1] across, a tenth down.
    let uv = [[-0.5f32, -0.1], [0.5, -0.1], [0.5, 0.1]];
    let own = strands_of_texels(&uv).unwrap();
    assert_eq!([own[texel(0, 0)], own[texel(63, 0)], own[texel(63, 63)]], [0, 1, 2]);
    // Texels 31 and 32 are left and right of the middle between the first two.
    assert_eq!([own[texel(31, 10)], own[texel(32, 10)]], [0, 1]);
    assert_eq!(strands_of_texels(&[]), None);
}

/// The outputs at column `u` and row `v`, by transposed convolutions of images, a number after the
/// other, in float64.
fn plain(network: &MapNetwork, shared: &[f32], statics: &[f32], [u, v]: [usize; 2]) -> Vec<f64> {
    let mut values: Vec<f64> = shared.iter().map(|x| f64::from(*x)).collect();
    // Width of the image of each layer, and that of what it makes of a pixel.
    let sides = [(1, 1), (4, 4), (8, 2), (16, 2), (32, 2), (64, 2), (64, 1), (64, 1)];
    for (number, (layer, (side, kernel))) in LAYERS.iter().zip(sides).enumerate() {
        if number == JOINED {
            values.extend(statics.iter().map(|x| f64::from(*x)));
        }
        // The place in the image, and that in the kernel: its pixels in the order of a quadtree.
        let [x, y] = [u * side / SIDE, v * side / SIDE].map(|at| at % kernel);
        let child = if kernel == 4 { [0, 1, 4, 5][x] + 2 * [0, 1, 4, 5][y] } else { x + 2 * y };
        let channels = layer.outputs / layer.children;
        let [matrix, bias] = ranges(number).map(|range| &network.parameters[range]);
        let output = |c: usize| {
            let column = child * channels + c;
            let products =
                values.iter().enumerate().map(|(k, x)| x * f64::from(matrix[k * layer.outputs + column]));
            let sum = f64::from(bias[column]) + products.sum::<f64>();
            if number + 1 < DEPTH { sum.max(0.0) } else { sum }
        };
        values = (0..channels).map(output).collect();
    }
    values
}

#[test]
fn predictions_are_those_of_plain_convolutions() {
    for head in [OutputHead::Rotation, OutputHead::Displacement] {
        let (network, strands) = random_network(head);
        let shared = inputs(1);
        let predictor = MapPredictor::new(&network, &strands, Simd::Auto);
        let found = predictor.predict(&shared).unwrap();
        for (u, v) in [(0, 0), (63, 63), (17, 42), (42, 17), (5, 0), (32, 31)] {
            let at = texel(u, v);
            let statics = &strands.statics()[at * STATICS..][..STATICS];
            let o = plain(&network, &shared, statics, [u, v]);
            let o: [V3<f64>; EDGES] = std::array::from_fn(|i| V3(std::array::from_fn(|c| o[3 * i + c])));
            let rest = strands.rest()[at].map(|x| V3(x.map(f64::from)));
            let edges: [V3<f64>; EDGES] = std::array::from_fn(|i| rest[i + 1] - rest[i]);
            let mut arc = 0.0;
            let mut expected = rest;
            if head == OutputHead::Rotation {
                let turns = network.basis.map(|row| {
                    row.iter().zip(&o).fold(V3::zero(), |sum: V3<f64>, (b, o)| sum.add_scaled(0.5 * b, *o))
                });
                expected = rotate(rest[0], &edges, &turns);
            } else {
                for i in 0..EDGES {
                    arc += edges[i].dot(edges[i]).sqrt();
                    expected[i + 1] = rest[i + 1].add_scaled(arc, o[i]);
                }
            }
            for i in 0..PARTICLES {
                let off = expected[i] - V3(found[at][i].map(f64::from));
                assert!(off.dot(off).sqrt() < 1e-3, "{head:?}, {u}, {v}, particle {i}: {off:?}");
            }
        }
        let other = MapPredictor::new(&network, &strands, Simd::Auto).predict(&inputs(2)[..SHARED]).unwrap();
        let moved = other.iter().zip(&found).map(|(a, b)| (a[24][0] - b[24][0]).abs()).fold(0.0, f32::max);
        assert!(moved > 0.1, "the inputs count: {moved}");
        assert_eq!(predictor.predict(&[0.0; 4]).unwrap_err(), LengthError { expected: 682, found: 4 });
    }
}

/// What a training computes of some texels in several frames is what the whole map has there.
#[test]
fn texels_alone_have_the_outputs_of_the_whole_map() {
    let (network, strands) = random_network(OutputHead::Rotation);
    let weights = Weights::new(&network);
    let (shared, statics) = (inputs(3), strands.statics());
    let some = [3, 4, 5, 700, 2048, 4095];
    let simd = Simd::Auto.resolve();
    let alone = Pass { texels: &some, shared: &shared, statics }.forward(simd, &weights);
    let all: Vec<usize> = (0..TEXELS).collect();
    for frame in 0..3 {
        let shared = &shared[frame * SHARED..][..SHARED];
        let whole = Pass { texels: &all, shared, statics }.forward(simd, &weights);
        for (s, own) in some.iter().enumerate() {
            let alone = &alone[DEPTH - 1].outputs[(s * 3 + frame) * OUTPUTS..][..OUTPUTS];
            assert_eq!(alone, &whole[DEPTH - 1].outputs[own * OUTPUTS..][..OUTPUTS], "{own}, {frame}");
        }
    }
}
