//! The grid on which strands interact, drawn into the picture of the hair.

use std::collections::HashMap;

use forelock_core::frame::GridCells;
use glam::{DVec3, IVec3};

use crate::lines::Lines;
use crate::measure::colour;

/// Density over that at rest at the end of the scale of colours.
pub const END: f32 = 2.0;

/// The edges of the cells that hold hair, each drawn once, in the colour of the densest cell beside
/// it.
pub fn edges_of(cells: &GridCells) -> Lines {
    let mut edges: HashMap<(IVec3, usize), f32> = HashMap::new();
    for cell in &cells.cells {
        for axis in 0..3 {
            let [u, v] = [IVec3::AXES[(axis + 1) % 3], IVec3::AXES[(axis + 2) % 3]];
            for corner in [IVec3::ZERO, u, v, u + v] {
                let densest = edges.entry((IVec3::from_array(cell.at) + corner, axis)).or_default();
                *densest = densest.max(cell.density);
            }
        }
    }
    // In an order that does not change from picture to picture.
    let mut edges: Vec<_> = edges.into_iter().map(|((at, axis), own)| (at.to_array(), axis, own)).collect();
    edges.sort_unstable_by_key(|(at, axis, _)| (*at, *axis));
    let corner = |at: IVec3| {
        let local: DVec3 = at.as_dvec3() * cells.side;
        cells.pose.transform_point(local).as_vec3()
    };
    let mut lines = Lines::default();
    for (at, axis, density) in edges {
        let at = IVec3::from_array(at);
        lines.add([at, at + IVec3::AXES[axis]].map(corner), colour(density / END));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use forelock_core::frame::GridCell;
    use forelock_core::pose::Pose;
    use glam::DQuat;

    #[test]
    fn neighbours_share_their_edges() {
        let cell = |at, density| GridCell { at, density, is_pressed: false };
        let pose = Pose::new(DQuat::from_rotation_z(0.5), DVec3::new(1.0, 2.0, 3.0));
        let cells = GridCells { pose, side: 0.01, cells: vec![cell([4, 0, 0], 0.0), cell([5, 0, 0], 2.0)] };
        let lattice = edges_of(&cells);
        // Twelve of each, four of which are of both.
        assert_eq!(lattice.offsets.len() - 1, 20);
        assert_eq!((lattice.positions.len(), lattice.colours.len()), (40, 40));
        for ends in lattice.positions.chunks(2) {
            assert!((ends[0].distance(ends[1]) - 0.01).abs() < 1e-6);
        }
        let dense = lattice.colours.iter().filter(|own| **own == colour(1.0)).count();
        assert_eq!((dense, lattice.colours.iter().filter(|own| **own == colour(0.0)).count()), (24, 16));
        let local: Vec<DVec3> =
            lattice.positions.iter().map(|x| pose.inverse().transform_point(x.as_dvec3())).collect();
        let (low, high) =
            local.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), x| (lo.min(*x), hi.max(*x)));
        assert!(low.distance(DVec3::new(0.04, 0.0, 0.0)) < 1e-6, "{low}");
        assert!(high.distance(DVec3::new(0.06, 0.01, 0.01)) < 1e-6, "{high}");
    }
}
