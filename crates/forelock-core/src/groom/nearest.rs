//! Nearest neighbours of points: a k-d tree over roots.
//!
//! # Theory
//! Bentley, *Multidimensional binary search trees used for associative searching*, 1975: the points
//! are split recursively at their median along the longest side of their bounding box. The tree is
//! stored as a permutation of the points, with the median of each part in its middle.
//!
//! # Practice
//! Ties are resolved by the index of the point, so that the result is the same on every machine.
//!
//! # Limitations
//! Many points at the same position make the search slow, but not wrong.

use glam::Vec3;

/// A k-d tree over points.
#[derive(Clone, Debug)]
pub(super) struct Nearest {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    point: Vec3,
    number: u32,
    /// The axis along which the part with this node in its middle is split.
    axis: u8,
}

impl Nearest {
    /// Builds a tree over `points`; points that are not finite are never found.
    pub(super) fn new(points: impl IntoIterator<Item = Vec3>) -> Self {
        let nodes = points.into_iter().zip(0u32..).map(|(point, number)| Node { point, number, axis: 0 });
        let mut nodes: Vec<Node> = nodes.filter(|node| node.point.is_finite()).collect();
        arrange(&mut nodes);
        Self { nodes }
    }

    /// Finds the `count` points nearest to `p` within `reach` metres, nearest first, and writes
    /// them into `found` as (distance², index).
    pub(super) fn find(&self, p: Vec3, count: usize, reach: f32, found: &mut Vec<(f32, u32)>) {
        found.clear();
        if count > 0 {
            search(&self.nodes, p, count, reach * reach, found);
        }
    }

    /// The index of the point nearest to `p`; `None` if the tree is empty.
    pub(super) fn nearest(&self, p: Vec3) -> Option<u32> {
        let mut found = Vec::with_capacity(2);
        self.find(p, 1, f32::INFINITY, &mut found);
        found.first().map(|&(_, number)| number)
    }
}

fn arrange(nodes: &mut [Node]) {
    if nodes.len() < 2 {
        return;
    }
    let (lo, hi) = nodes
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), n| (lo.min(n.point), hi.max(n.point)));
    let size = hi - lo;
    let axis = (0..3u8).fold(
        0,
        |best, axis| {
            if size[usize::from(axis)] > size[usize::from(best)] { axis } else { best }
        },
    );
    let along = |node: &Node| node.point[usize::from(axis)];
    let middle = nodes.len() / 2;
    nodes.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.number.cmp(&b.number)));
    nodes[middle].axis = axis;
    let (left, right) = nodes.split_at_mut(middle);
    arrange(left);
    arrange(&mut right[1..]);
}

fn search(nodes: &[Node], p: Vec3, count: usize, reach_squared: f32, found: &mut Vec<(f32, u32)>) {
    if nodes.is_empty() {
        return;
    }
    let middle = nodes.len() / 2;
    let node = &nodes[middle];
    let across = p[usize::from(node.axis)] - node.point[usize::from(node.axis)];
    let (near, far) = if across < 0.0 {
        (&nodes[..middle], &nodes[middle + 1..])
    } else {
        (&nodes[middle + 1..], &nodes[..middle])
    };
    search(near, p, count, reach_squared, found);
    let distance = p.distance_squared(node.point);
    if distance <= reach_squared {
        let place = found.partition_point(|&(d, n)| d.total_cmp(&distance).then(n.cmp(&node.number)).is_lt());
        if place < count {
            found.insert(place, (distance, node.number));
            found.truncate(count);
        }
    }
    let bound = found.get(count - 1).map_or(reach_squared, |&(worst, _)| worst);
    if across * across <= bound {
        search(far, p, count, reach_squared, found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::groom::grow::random::Random;

    #[test]
    fn results_agree_with_an_exhaustive_search() {
        let mut random = Random::new(3, 1);
        for size in [1, 2, 3, 17, 400] {
            // Points on a coarse lattice cause ties and repeated points.
            let points: Vec<Vec3> = (0..size).map(|_| (random.cube() * 4.0).round()).collect();
            let tree = Nearest::new(points.iter().copied());
            for _ in 0..50 {
                let p = random.cube() * 5.0;
                let mut all: Vec<(f32, u32)> =
                    points.iter().zip(0..).map(|(q, n)| (p.distance_squared(*q), n)).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                for (count, reach) in [(1, f32::INFINITY), (5, f32::INFINITY), (1000, 2.0)] {
                    let mut found = Vec::new();
                    tree.find(p, count, reach, &mut found);
                    let near = all.iter().filter(|(d, _)| *d <= reach * reach).take(count);
                    assert!(found.iter().eq(near), "{size} points, {count} within {reach}");
                }
            }
        }
    }
}
