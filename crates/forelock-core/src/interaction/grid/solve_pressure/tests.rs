//! Effect of the pressure on the grid.

use crate::body::{ColliderFrame, Shape};
use crate::interaction::grid::{Grid, GridFrame, GridMoment, GridParams, Segments};
use crate::lane::Row;
use crate::pose::Pose;
use crate::strands::{Model, Strands};
use glam::DVec3;

/// A block of hair, a side of 20 cm: strands along y, 5 mm apart, a particle every centimetre.
fn block() -> Model<f32> {
    let at = |k: u16| f32::from(k) * 5e-3;
    let mut positions = Vec::new();
    for strand in 0..1600u16 {
        positions.extend((0..20u8).map(|i| [at(strand % 40), -0.01 * f32::from(i), at(strand / 40)]));
    }
    let offsets: Vec<u32> = (0..=1600).map(|s| 20 * s).collect();
    Model::new(&Strands::new(&positions, &offsets)).unwrap()
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

/// Root mean square of the remaining compression of the cells under pressure, m/s.
fn compression(grid: &Grid, change: bool) -> f64 {
    let [nx, _, _] = grid.bounds.dims;
    let strides = [1, nx, grid.bounds.layer()];
    let fields = &grid.pressure;
    let (mut sum, mut count) = (0.0, 0);
    for (index, &rhs) in fields.rhs.iter().enumerate() {
        if rhs == f32::NEG_INFINITY {
            continue;
        }
        let mut left = rhs;
        if change {
            for (faces, stride) in grid.faces.iter().zip(strides) {
                left -= faces[index + stride][1] - faces[index][1];
            }
        }
        if rhs > 0.0 {
            sum += f64::from(left.max(0.0)).powi(2);
            count += 1;
        }
    }
    assert!(count > 1000, "{count} cells are under pressure");
    (sum / f64::from(count)).sqrt()
}

/// Hair that flows inwards, with 1 m/s at the faces of the block.
#[test]
fn compression_falls_a_thousandfold() {
    let model = block();
    let params = GridParams { resolution: 32, tolerance: 1e-5, iterations: 500, ..GridParams::default() };
    let mut grid = Grid::new(&model, &params);
    let mut positions = model.rest.clone();
    let velocities: Vec<Row<f32>> = positions.iter().map(|row| Row(row.0.map(|x| -10.0 * x))).collect();
    // Compressed by a tenth, so that all hair is too dense.
    for row in &mut positions {
        row.0 = row.0.map(|x| 0.9 * x);
    }
    grid.fit(&model, &positions, &moment().frame);
    let hair = Segments { model: &model, positions: &positions, velocities: &velocities, rooms: &grid.rooms };
    let (bounds, cell) = (grid.bounds, grid.cell);
    grid.chunks.iter_mut().for_each(|chunk| chunk.fill(&hair, &moment().frame, &bounds, cell));
    crate::interaction::grid::splat_segments::splat(&mut grid);
    let report = super::solve_velocities(&mut grid, &moment());
    let (before, after) = (compression(&grid, false), compression(&grid, true));
    println!("compression {before:.3e} m/s a cell before the solve, after it {after:.3e}; {report:?}");
    assert!(after < 1e-3 * before, "{before} {after}");
}

/// Two slabs reach into the hair, one at rest, one that moves along x at 6 m/s: the solid cells of
/// each have its velocity.
#[test]
fn solid_cells_move_with_their_solid() {
    let model = block();
    let mut grid = Grid::new(&model, &GridParams { resolution: 32, ..GridParams::default() });
    let shape = Shape::Box { half_extents: DVec3::new(0.03, 0.2, 0.2) };
    let at = |x: f64| Pose { translation: DVec3::X * x, ..Pose::IDENTITY };
    let slab = |from: f64, to: f64| ColliderFrame {
        shape: &shape,
        local: Pose::IDENTITY,
        from: at(from),
        to: at(to),
        friction: 0.0,
    };
    let solids = [slab(-0.06, -0.06), slab(-0.04, 0.06)];
    let moment = GridMoment { solids: &solids, ..moment() };
    let still = vec![Row([0.0; 16]); model.rest.len()];
    let (mut positions, mut velocities) = (model.rest.clone(), still);
    grid.exchange(&model, &mut positions, &mut velocities, &moment);
    super::solve_velocities(&mut grid, &moment);
    let [nx, ny, _] = grid.bounds.dims;
    let mut seen = [0; 2];
    for (index, face) in grid.faces[0].iter().enumerate() {
        let middle = |c: usize, i: usize| (f64::from(grid.bounds.low[c]) + i as f64 + 0.5) * grid.cell;
        let (y, z) = (middle(1, index / nx % ny), middle(2, index / (nx * ny)));
        let x = middle(0, index % nx) - 0.5 * grid.cell;
        let inside = |centre: f64| (x - centre).abs() < 0.02 && y.abs() < 0.08 && z.abs() < 0.08;
        for (k, (centre, speed)) in [(-0.06, 0.0), (0.06, 6.0)].into_iter().enumerate() {
            if inside(centre) {
                assert!((f64::from(face[0]) - speed).abs() < 1e-4, "{x} {y} {z}: {face:?}");
                seen[k] += 1;
            }
        }
    }
    assert!(seen[0] > 1000 && seen[1] > 1000, "{seen:?}");
}

/// Hair in a pocket that is closed by walls on all sides, while one of them moves in at 6 m/s: the
/// constraint cannot be satisfied, so a compression remains, but velocities stay of the order of
/// the wall's speed.
#[test]
fn the_pressure_of_a_closed_pocket_stays_bounded() {
    let model = block();
    let params = GridParams { resolution: 32, iterations: 500, ..GridParams::default() };
    let mut grid = Grid::new(&model, &params);
    let shape = Shape::Box { half_extents: DVec3::splat(0.15) };
    // The pocket is three cells wide along x.
    let half = [1.5 * grid.cell, 0.04, 0.04];
    let wall = |axis: usize, side: f64, shift: f64| {
        let along = DVec3::AXES[axis] * side;
        let at = |x: f64| Pose { translation: along * (0.15 + half[axis] + x), ..Pose::IDENTITY };
        ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: at(shift), to: at(0.0), friction: 0.0 }
    };
    let solids: [ColliderFrame<'_>; 6] = std::array::from_fn(|k| {
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        wall(k / 2, side, if k == 0 { 0.1 } else { 0.0 })
    });
    let moment = GridMoment { solids: &solids, ..moment() };
    let still = vec![Row([0.0; 16]); model.rest.len()];
    // Compressed by a fifth, so that no cell has free volume.
    let positions: Vec<_> = model.rest.iter().map(|row| Row(row.0.map(|x| 0.8 * x))).collect();
    grid.fit(&model, &positions, &moment.frame);
    let hair = Segments { model: &model, positions: &positions, velocities: &still, rooms: &grid.rooms };
    let (bounds, cell) = (grid.bounds, grid.cell);
    grid.chunks.iter_mut().for_each(|chunk| chunk.fill(&hair, &moment.frame, &bounds, cell));
    crate::interaction::grid::splat_segments::splat(&mut grid);
    let report = super::solve_velocities(&mut grid, &moment);
    assert!(report.cells > 100, "{report:?}");
    let fastest = grid.faces.iter().flatten().map(|face| face[0].abs()).fold(0.0, f32::max);
    println!("fastest {fastest} m/s; {report:?}");
    assert!(fastest < 1.5 * 6.0 && report.residual < 1.0, "{fastest} m/s, {report:?}");
}
