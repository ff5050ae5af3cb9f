//! Reuse of units that no longer react to their inputs ("dormant neurons", Sokar et al. 2023).
//!
//! # Theory
//! A ReLU unit whose sum is negative for all inputs has no gradient and stays so. High learning
//! rates make many of them. Such a unit gets new random incoming weights, as at the start, and
//! outgoing weights of 0: what the network computes hardly changes, and the unit learns again.
//!
//! # Practice
//! A unit counts as dormant when the mean square of its bias's gradient is a small share of its
//! layer's mean; the publication looks at activations. Late in a training, at a low rate, units are
//! left as they are.

use super::axes::CHANGE_EVERY;
use crate::network::Shape;
use crate::random::Random;
use std::ops::Range;

/// Steps between two searches for dormant units.
const EVERY: u32 = 500;
// No step of the weights is pending then.
const _: () = assert!(EVERY.is_multiple_of(CHANGE_EVERY));
/// The share of its layer's mean square below which a unit is dormant.
const SHARE: f32 = 1e-3;
/// The share of a training after which units are left as they are.
const LAST: f64 = 0.7;

/// Whether units are reused after `done` steps, the `share` of a training.
pub(super) fn is_due(done: u32, share: f64) -> bool {
    done.is_multiple_of(EVERY) && share < LAST
}

/// Gives each dormant unit new weights, in the network and in its running average; `second` are the
/// mean squares of all parameters' gradients, of which those of the biases tell the dormant units:
/// theirs become the layer's mean.
pub(super) fn reuse(shape: &Shape, networks: [&mut [f32]; 2], second: &mut [f32], random: &mut Random) {
    let [statics, shared, first_bias, hidden, second_bias, output, _] = shape.ranges();
    let width = shape.width;
    let [first, second_layer] = shape.deviations();
    let layers = [
        Layer {
            incoming: statics.start..shared.end,
            bias: first_bias,
            outgoing: hidden.start,
            targets: width,
            deviation: first,
            may_hide_inputs: true,
        },
        Layer {
            incoming: hidden,
            bias: second_bias,
            outgoing: output.start,
            targets: shape.outputs,
            deviation: second_layer,
            may_hide_inputs: false,
        },
    ];
    let [network, average] = networks;
    for layer in layers {
        let second = &mut second[layer.bias.clone()];
        let mean = second.iter().sum::<f32>() / width as f32;
        for unit in 0..width {
            if second[unit] >= SHARE * mean {
                continue;
            }
            // Not dormant again before it has learned.
            second[unit] = mean;
            for row in layer.incoming.clone().step_by(width) {
                let is_seen = !layer.may_hide_inputs || network[row..row + width].iter().any(|x| *x != 0.0);
                let weight = if is_seen { (layer.deviation * random.normal()) as f32 } else { 0.0 };
                (network[row + unit], average[row + unit]) = (weight, weight);
            }
            for own in [&mut *network, &mut *average] {
                own[layer.bias.start + unit] = 0.0;
                own[layer.outgoing + unit * layer.targets..][..layer.targets].fill(0.0);
            }
        }
    }
}

/// Where the weights of a layer's units are.
struct Layer {
    /// A column a unit.
    incoming: Range<usize>,
    bias: Range<usize>,
    /// The first of the rows, one a unit, of `targets` weights.
    outgoing: usize,
    targets: usize,
    /// Of new incoming weights.
    deviation: f64,
    /// Whether an input with weights of 0 is one that the network does not see.
    may_hide_inputs: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape { statics: 3, shared: 4, width: 8, outputs: 5 };

    fn layer(inputs: &[f32], weights: &[f32], bias: &[f32]) -> Vec<f32> {
        let of = |unit: usize| {
            inputs.iter().zip(weights.chunks_exact(bias.len())).map(move |(x, row)| x * row[unit])
        };
        bias.iter().enumerate().map(|(unit, bias)| bias + of(unit).sum::<f32>()).collect()
    }

    fn outputs(network: &[f32], inputs: &[f32]) -> Vec<f32> {
        let [statics, shared, first_bias, hidden, second_bias, output, last_bias] = SHAPE.ranges();
        let relu = |sums: Vec<f32>| -> Vec<f32> { sums.iter().map(|x| x.max(0.0)).collect() };
        let first = relu(layer(inputs, &network[statics.start..shared.end], &network[first_bias]));
        let second = relu(layer(&first, &network[hidden], &network[second_bias]));
        layer(&second, &network[output], &network[last_bias])
    }

    #[test]
    fn dormant_units_get_new_weights_and_the_network_stays_the_same_function() {
        let mut random = Random::new(4);
        let [statics, _, first_bias, hidden, second_bias, output, _] = SHAPE.ranges();
        let mut network: Vec<f32> = (0..SHAPE.parameters()).map(|_| random.normal() as f32).collect();
        let dormant = [first_bias.start + 2, second_bias.start + 5];
        let mut second = vec![1.0; network.len()];
        for bias in dormant {
            (network[bias], second[bias]) = (-1e3, 1e-5);
        }
        // An input that the network does not see.
        network[statics.start + 8..][..8].fill(0.0);
        let (before, mut average) = (network.clone(), network.clone());
        reuse(&SHAPE, [&mut network, &mut average], &mut second, &mut random);
        assert_eq!(network, average);
        assert!(second.iter().all(|x| *x > 0.5));
        for _ in 0..20 {
            let inputs: Vec<f32> = (0..7).map(|_| random.normal() as f32).collect();
            for (a, b) in outputs(&network, &inputs).iter().zip(outputs(&before, &inputs)) {
                assert!((a - b).abs() < 1e-5, "{a} {b}");
            }
        }
        assert!(network[statics.start + 8..][..8].iter().all(|x| *x == 0.0));
        let changed = |k: usize| network[k] != before[k];
        for row in 0..7 {
            for unit in 0..8 {
                assert_eq!(changed(row * 8 + unit), unit == 2 && row != 1, "{row} {unit}");
            }
        }
        for row in 0..8 {
            for unit in 0..8 {
                assert_eq!(changed(hidden.start + row * 8 + unit), row == 2 || unit == 5, "{row} {unit}");
            }
            let of = |k: usize| output.start + row * 5 + k;
            assert!((0..5).all(|k| changed(of(k)) == (row == 5)), "{row}");
        }
        // Unit 2 of the first layer has no effect until it learns, nor has unit 5 of the second.
        assert!((0..8).filter(|k| *k != 5).all(|k| network[hidden.start + 16 + k] == 0.0));
        assert!((0..5).all(|k| network[output.start + 25 + k] == 0.0));
        for bias in dormant {
            assert_eq!(network[bias], 0.0);
        }
    }

    #[test]
    fn units_are_left_alone_late_in_a_training() {
        assert!(is_due(500, 0.1) && is_due(1000, 0.69));
        assert!(!is_due(501, 0.1) && !is_due(1000, 0.7));
    }
}
