//! The volume of the hair, measured in the rest shape: see Practice in the documentation of the
//! grid.

use super::splat_segments::splat;
use super::{Bounds, Grid, GridFrame, Patch, Segments, Stencils, View, density};
use crate::lane::{LANES, Real, Row};
use crate::strands::Model;

/// Rounds of each iteration that distributes the rest volume.
const ROUNDS: usize = 8;
/// Least fill fraction at rest φ₀: sparser hair may gather until it fills as much of a cell.
const EMPTIEST: f32 = 0.3;
/// Largest fill fraction at rest φ₀ from the rounds that may lower it too: without a bound they
/// amplify differences between neighbouring edges, up to 1e11 in a groom of few strands.
const FULLEST: f32 = 4.0;
/// Density of hair at rest that keeps its volume, over the mean density of the groom, by default.
const SPARSEST: f32 = 0.1;

impl Grid {
    /// Measures `volumes`: see Practice in the module documentation.
    pub(super) fn measure_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) {
        // The first pass takes the length of an edge as its volume: the density in metres per cell.
        let lengths: Vec<Row<f32>> = model
            .rest_lengths
            .iter()
            .step_by(3)
            .map(|row| Row(row.0.map(|l| l.to_f32().unwrap_or(0.0))))
            .collect();
        for (volumes, lengths) in self.volumes.iter_mut().zip(&lengths) {
            volumes[0] = *lengths;
        }
        let at_edges = self.at_rest(model, frame, |[filled, _]| filled, false);
        self.sample_mass = mean_sample(&self.patches, model, &lengths);
        let sparsest = self.params.rest_density * self.cell.powi(3);
        let sparsest =
            if sparsest > 0.0 { sparsest as f32 } else { SPARSEST * mean(model, &lengths, &at_edges) };
        let sparsest = sparsest.max(f32::MIN_POSITIVE);
        self.densest = at_edges.iter().flat_map(|row| row.0).fold(0.0, f32::max);
        // A volume of at most `length / sparsest`: hair may gather until it is as dense as that.
        self.set_volumes(&at_edges, |_, _, [length, _], filled| [length / filled.max(sparsest), 0.0]);
        for _ in 0..ROUNDS {
            let filled = self.at_rest(model, frame, |[filled, _]| filled, false);
            self.set_volumes(&filled, |place, lane, [volume, _], filled| {
                [(volume / filled.max(0.5)).min(lengths[place].0[lane] / sparsest), 0.0]
            });
        }
        let filled = self.at_rest(model, frame, |[filled, _]| filled, false);
        self.set_volumes(&filled, |_, _, [volume, _], filled| [volume, volume * filled.max(EMPTIEST)]);
        // First up and down, until the density is near 1; then up only, until it is nowhere above.
        for round in 0..2 * ROUNDS {
            let largest = round >= ROUNDS;
            let (least, most) = if largest { (1.0, f32::MAX) } else { (0.0, FULLEST) };
            let densities = self.at_rest(model, frame, density, largest);
            self.set_volumes(&densities, |_, _, [volume, at_rest], density| {
                [volume, (at_rest * density.max(least)).clamp(volume * EMPTIEST, volume * most)]
            });
        }
        self.at_rest(model, frame, density, true);
        let largest = |f: fn([f32; 2]) -> f32| {
            self.filled_nodes().map(|(_, node)| f(node.volumes())).fold(0.0, f32::max)
        };
        // What is left of the last iteration, and rounding.
        let densest = largest(density).max(1.0) * (1.0 + 1e-5);
        self.fullest_at_rest = [largest(|[filled, _]| filled), densest * largest(|[_, at_rest]| at_rest)];
        for [_, at_rest] in &mut self.volumes {
            at_rest.0 = at_rest.0.map(|volume| volume * densest);
        }
    }

    /// Sets the volumes of each edge to `f` of its place, its lane, its volumes, and the value of
    /// `at_edges`.
    fn set_volumes(&mut self, at_edges: &[Row<f32>], f: impl Fn(usize, usize, [f32; 2], f32) -> [f32; 2]) {
        for (place, (volumes, at_edges)) in self.volumes.iter_mut().zip(at_edges).enumerate() {
            for lane in 0..LANES {
                let new = f(place, lane, [0, 1].map(|k| volumes[k].0[lane]), at_edges.0[lane]);
                [volumes[0].0[lane], volumes[1].0[lane]] = new;
            }
        }
    }

    /// A function of the sums of volumes in the cells around each edge of the rest shape,
    /// `[places]` rows.
    fn at_rest<T: Real>(
        &mut self,
        model: &Model<T>,
        frame: &GridFrame,
        f: impl Fn([f32; 2]) -> f32,
        largest: bool,
    ) -> Vec<Row<f32>> {
        let bounds = splat(self, model, [&model.rest; 2], frame);
        let mut cells = vec![0.0; bounds.cells()];
        for (index, node) in self.filled_nodes() {
            cells[index] = f(node.volumes());
        }
        at_edges(model, &cells, &bounds, self.cell, frame, largest)
    }
}

/// The mean of `at_edges` over all hair, weighted by the lengths of the edges.
fn mean<T: Real>(model: &Model<T>, lengths: &[Row<f32>], at_edges: &[Row<f32>]) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for block in &model.blocks {
        for place in block.range() {
            for lane in 0..block.live {
                let length = f64::from(lengths[place].0[lane]);
                sum += length * f64::from(at_edges[place].0[lane]);
                total += length;
            }
        }
    }
    (sum / total) as f32
}

/// A function of the nodes of the grid at the middle of each edge of the rest shape, or the largest
/// of the nodes around it.
fn at_edges<T: Real>(
    model: &Model<T>,
    nodes: &[f32],
    bounds: &Bounds,
    cell: f64,
    frame: &GridFrame,
    largest: bool,
) -> Vec<Row<f32>> {
    let nothing = Row([0.0; LANES]);
    let mut out = vec![nothing; model.rest_lengths.len() / 3];
    let (view, lattice) = (View::new(frame, bounds, cell), bounds.lattice());
    let volumes = vec![[nothing; 2]; out.len()];
    let hair = Segments { model, positions: &model.rest, velocities: &model.rest, volumes: &volumes };
    let (mut inside, mut stencils) = ([0; LANES], Stencils::default());
    for block in &model.blocks {
        view.visit(&hair, block, 1, false, |edge, samples| {
            bounds.hold(&samples.at, &mut inside);
            stencils.set(&lattice, &samples.at);
            let row = &mut out[block.first + edge].0;
            for lane in (0..block.live).filter(|&lane| inside[lane] != 0) {
                let around = stencils.nodes(lattice.rows(), lane).into_iter();
                row[lane] = if largest {
                    around.map(|(node, _)| nodes[node]).fold(0.0, f32::max)
                } else {
                    around.map(|(node, weight)| weight * nodes[node]).sum()
                };
            }
        });
    }
    out
}

/// Mean mass of a sample, metres of hair. `lengths` are those of the edges, a row a place.
fn mean_sample<T: Real>(patches: &[Patch], model: &Model<T>, lengths: &[Row<f32>]) -> f32 {
    let (mut count, mut mass) = (0.0, 0.0);
    for patch in patches {
        for (block, &points) in model.blocks[patch.blocks.clone()].iter().zip(&patch.points) {
            let edges = block.range().flat_map(|place| &lengths[place].0[..block.live]);
            for length in edges.filter(|length| **length > 0.0) {
                count += points as f64;
                mass += f64::from(*length);
            }
        }
    }
    (mass / f64::max(count, 1.0)) as f32
}
