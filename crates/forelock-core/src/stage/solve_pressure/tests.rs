//! What the pressure does to the grid itself.

use crate::grid::{Grid, GridFrame, GridMoment, GridParams, Segments};
use crate::lane::Row;
use crate::model::{Model, Strands};
use glam::DVec3;

/// A block of hair, a side of 20 cm: strands along y, 5 mm apart, a particle every centimetre.
fn block() -> Model<f32> {
    let at = |k: u16| f32::from(k) * 5e-3;
    let mut positions = Vec::new();
    for strand in 0..1600u16 {
        positions.extend((0..20u8).map(|i| [at(strand % 40), -0.01 * f32::from(i), at(strand / 40)]));
    }
    let offsets: Vec<u32> = (0..=1600).map(|s| 20 * s).collect();
    Model::new(&Strands { positions: &positions, offsets: &offsets, stiffness: None }).unwrap()
}

fn moment() -> GridMoment<'static> {
    GridMoment {
        frame: GridFrame::at_rest(),
        solids: &[],
        last_substep: 0.75,
        origin: DVec3::ZERO,
        clamped: 0,
        dt_secs: 1.0 / 60.0,
    }
}

/// How much cells that hair may not press closer together still do, root mean square, m/s.
fn pressed(grid: &Grid, change: bool) -> f64 {
    let [nx, _, _] = grid.bounds.dims;
    let strides = [1, nx, grid.bounds.layer()];
    let fields = &grid.pressure;
    let (mut sum, mut count) = (0.0, 0);
    for (index, &lack) in fields.lack.iter().enumerate() {
        if lack == f32::NEG_INFINITY {
            continue;
        }
        let mut left = lack;
        if change {
            for (faces, stride) in grid.faces.iter().zip(strides) {
                left -= faces[index + stride][1] - faces[index][1];
            }
        }
        if lack > 0.0 {
            sum += f64::from(left.max(0.0)).powi(2);
            count += 1;
        }
    }
    assert!(count > 1000, "{count} cells are pressed");
    (sum / f64::from(count)).sqrt()
}

/// Hair that flows together from the sides, 1 m/s at the faces of the block.
#[test]
fn what_presses_dense_hair_together_falls_a_thousandfold() {
    let model = block();
    let params = GridParams { resolution: 32, tolerance: 1e-5, iterations: 500, ..GridParams::default() };
    let mut grid = Grid::new(&model, &params);
    let mut positions = model.rest.clone();
    let velocities: Vec<Row<f32>> = positions.iter().map(|row| Row(row.0.map(|x| -10.0 * x))).collect();
    // A tenth closer than at rest, so that all of it is dense.
    for row in &mut positions {
        row.0 = row.0.map(|x| 0.9 * x);
    }
    grid.fit(&model, &positions, &moment().frame);
    let hair = Segments { model: &model, positions: &positions, velocities: &velocities, rooms: &grid.rooms };
    let (bounds, cell) = (grid.bounds, grid.cell);
    grid.chunks.iter_mut().for_each(|chunk| chunk.fill(&hair, &moment().frame, &bounds, cell));
    crate::stage::splat_segments::splat(&mut grid);
    let report = super::solve_velocities(&mut grid, &moment());
    let (before, after) = (pressed(&grid, false), pressed(&grid, true));
    println!("pressed together at {before:.3e} m/s a cell, then {after:.3e}; {report:?}");
    assert!(after < 1e-3 * before, "{before} {after}");
}
