//! Effect of the pressure on the grid.

use crate::body::{ColliderFrame, Head, Sdf, Shape};
use crate::interaction::grid::{Grid, GridFrame, GridMoment, GridParams, splat_segments};
use crate::lane::Row;
use crate::pose::Pose;
use crate::strands::{Model, Strands};
use glam::{DQuat, DVec3};
use std::sync::Arc;

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

/// Root mean square of the compression of the cells under pressure, m/s: before the solve and
/// after it.
fn compression(grid: &Grid) -> [f64; 2] {
    let strides = grid.bounds.strides();
    let fields = &grid.pressure;
    // The change of velocity at the face between two cells.
    let change = |below: usize, above: usize| {
        let [pressure, mass] = [&fields.pressures[0], &fields.masses].map(|own| [own[below], own[above]]);
        2.0 * (pressure[0] - pressure[1]) / (mass[0] + mass[1])
    };
    let (mut sums, mut count) = ([0.0; 2], 0);
    fields.system.right_hand_sides(&grid.bounds, |cell, rhs| {
        if rhs > 0.0 {
            let changes = strides.map(|stride| change(cell, cell + stride) - change(cell - stride, cell));
            let left = (rhs - changes.iter().sum::<f32>()).max(0.0);
            sums = [sums[0] + f64::from(rhs).powi(2), sums[1] + f64::from(left).powi(2)];
            count += 1;
        }
    });
    assert!(count > 1000, "{count} cells are compressed");
    sums.map(|sum| (sum / f64::from(count)).sqrt())
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
    splat_segments::splat(&mut grid, &model, [&positions, &velocities], &moment().frame);
    let report = super::solve(&mut grid, &moment());
    let [before, after] = compression(&grid);
    println!("compression {before:.3e} m/s a cell before the solve, after it {after:.3e}; {report:?}");
    assert!(after < 1e-3 * before, "{before} {after}");
}

/// Two slabs reach into the hair, one at rest, one that moves along x at 6 m/s: the solid cells of
/// each have its velocity.
#[test]
fn solid_cells_move_with_their_solid() {
    let model = block();
    // Particles adopt the velocity of the grid as it is.
    let params = GridParams { resolution: 32, pic_rate: 1e9, ..GridParams::default() };
    let mut grid = Grid::new(&model, &params);
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
    grid.exchange(&model, &mut positions, &mut velocities, &mut [], &moment);
    let mut seen = [0; 2];
    for (index, node) in grid.filled_nodes() {
        let middle = |c: usize, i: usize| (f64::from(grid.bounds.low[c]) + i as f64 + 0.5) * grid.cell;
        let place = grid.bounds.place(index);
        let [x, y, z] = [0, 1, 2].map(|c| middle(c, place[c]));
        let inside = |centre: f64| (x - centre).abs() < 0.02 && y.abs() < 0.08 && z.abs() < 0.08;
        for (k, (centre, speed)) in [(-0.06, 0.0), (0.06, 6.0)].into_iter().enumerate() {
            if inside(centre) && node.mass() > 0.0 {
                assert!((f64::from(node.0[0]) - speed).abs() < 1e-4, "{x} {y} {z}: {node:?}");
                seen[k] += 1;
            }
        }
    }
    assert!(seen[0] > 1000 && seen[1] > 1000, "{seen:?}");
}

/// Hair in a pocket that is closed by walls on all sides, while one of them moves in at 6 m/s: the
/// constraint cannot be satisfied, so a compression remains, but velocities stay of the order of
/// the wall's speed, and displacements within a cell.
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
    splat_segments::splat(&mut grid, &model, [&positions, &still], &moment.frame);
    let report = super::solve(&mut grid, &moment);
    assert!(report.cells > 100, "{report:?}");
    let fastest = grid.filled_nodes().flat_map(|(_, node)| &node.0[..3]).map(|v| v.abs()).fold(0.0, f32::max);
    println!("fastest {fastest} m/s; {report:?}");
    assert!(fastest < 1.5 * 6.0 && report.farthest_m < grid.cell, "{fastest} m/s, {report:?}");
}

/// The cells inside a distance field that the head carries are remembered from frame to frame. A
/// grid that has seen other frames gives the same bits as a new one.
#[test]
fn remembered_cells_do_not_depend_on_the_frames_before() {
    let model = block();
    let params = GridParams { resolution: 32, ..GridParams::default() };
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 32, 0.02).unwrap()));
    let step = |grid: &mut Grid, angle: f64, with_head: bool| {
        let head = Pose::new(DQuat::from_rotation_y(angle), DVec3::new(0.3, 0.2, 0.1) * angle);
        let solid =
            ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: head, to: head, friction: 0.0 };
        let solids = if with_head { &[solid][..] } else { &[] };
        let moment = GridMoment {
            frame: GridFrame::new(&head, &head, 1e-3),
            solids,
            origin: head.translation,
            ..moment()
        };
        let mut positions = model.rest.clone();
        for rows in positions.chunks_exact_mut(3) {
            for lane in 0..16 {
                let x = DVec3::from_array([0, 1, 2].map(|c| f64::from(rows[c].0[lane])));
                let x = (head.rotation * x).as_vec3();
                (0..3).for_each(|c| rows[c].0[lane] = x[c]);
            }
        }
        let mut velocities: Vec<_> = positions.iter().map(|row| Row(row.0.map(|x| -5.0 * x))).collect();
        grid.exchange(&model, &mut positions, &mut velocities, &mut [], &moment);
        velocities
    };
    let mut seasoned = Grid::new(&model, &params);
    for angle in [0.0, 0.3, 0.1] {
        step(&mut seasoned, angle, true);
    }
    let mut new = Grid::new(&model, &params);
    let expected = step(&mut new, 0.7, true);
    assert!(step(&mut seasoned, 0.7, true) == expected, "the frames before count");
    assert!(step(&mut new, 0.7, false) != expected, "the head does not reach the hair");
}
