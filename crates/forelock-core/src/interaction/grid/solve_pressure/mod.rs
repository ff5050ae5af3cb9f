//! Pressure: removes from the velocities of the grid the part that would compress dense hair
//! further.
//!
//! # Theory
//! Let φ be the fill fraction of a cell, u the velocities of the faces and m their masses. Over the
//! frame φ becomes φ (1 − dt ∇·u), which must not exceed 1, and must not grow where it already
//! does: ∇·u ≥ t, with
//!
//! ```text
//! t = −(1 − φ)/(φ dt)   φ ≤ 1 ,      t = 0   φ > 1
//! ```
//!
//! The pressure P ≥ 0 acts only where this would be violated (hair may separate freely, as in
//! Narain 2010's granular flow): Δu = −(P₊ − P₋)/m on each face, P = 0 in all cells outside the
//! active set, and Σ m Δu = 0, so momentum is conserved. A primal–dual active-set method finds the
//! active cells: solve ∇·u = t in the active cells, deactivate cells of negative pressure, activate
//! cells that are still compressed, and repeat.
//!
//! Hair that is already too dense is displaced, without gaining velocity: displacements s from the
//! same system with ∇·s = (1 − exp(−volume_rate dt)) (φ − 1)/φ where φ > 1 and ∇·s ≥ −(1 − φ)/φ
//! elsewhere change positions and not velocities, so the hair stops at its rest density and does
//! not expand beyond it.
//!
//! # Practice
//! The system is a Poisson equation with coefficients 1/m on the faces. It is symmetric and
//! positive definite, has the compact stencil of a staggered grid, and is solved by conjugate
//! gradients with a diagonal preconditioner. Hair is a shell a few cells thick with free cells
//! outside, so few iterations suffice. Rows without active cells are skipped. Sums are computed
//! layer by layer and added in order, so results do not depend on the number of threads.
//!
//! Solids: nothing flows through a cell whose centre is inside a solid; its faces move with the
//! solid. Collision detection keeps the hair out of solids in a later stage.
//!
//! # Limitations
//! The boundary of a solid follows the cells, not the surface within them. Nothing flows through
//! faces with almost no hair.

mod conjugate;
mod fields;

pub use conjugate::SLACK;
pub(crate) use fields::Fields;
pub use fields::{LOOSE, SPARSE};

use crate::interaction::grid::{Bounds, Grid, GridMoment, GridParams, GridPlacement, GridReport, GridSolid};

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Maximum number of rounds of the active set.
const ROUNDS: u32 = 12;

/// Replaces (mass, momentum) of the faces by (new velocity, change of velocity).
pub fn solve_velocities(grid: &mut Grid, moment: &GridMoment<'_>) -> GridReport {
    let Grid { params, bounds, cell, sample_mass, faces, filled, pressure: fields, .. } = grid;
    fields.fit(bounds);
    fields.normalize_velocity(bounds, faces, *sample_mass);
    let placement = GridPlacement {
        frame: &moment.frame,
        cell: *cell,
        origin: moment.origin,
        last_substep: moment.last_substep,
        h: moment.dt_secs * (1.0 - moment.last_substep),
    };
    for (number, solid) in (1..=u16::MAX).zip(moment.solids) {
        let solid = GridSolid::new(solid, &placement, bounds);
        fields.mark_solid_cells(bounds, faces, filled, *cell, number, &solid);
    }
    let slack = (*cell / moment.dt_secs) as f32;
    let rhs = |share: f32, divergence: f32| slack * ((share - 1.0) / share).min(0.0) - divergence;
    let fullest = fields.compute_divergence(bounds, faces, filled, &rhs);
    let report = find_pressure(fields, bounds, params);
    fields.apply_pressure(bounds, faces);
    GridReport { fullest, ..report }
}

/// Computes the displacements of over-dense hair and writes them to both entries of the faces; does
/// nothing if no hair is too dense. Call it after [`solve_velocities`], whose solid cells and
/// masses it uses. Returns an upper bound of the displacements in metres, 0 if there are none.
pub fn solve_displacements(grid: &mut Grid, moment: &GridMoment<'_>, report: &mut GridReport) -> f64 {
    let Grid { params, bounds, cell, faces, filled, pressure: fields, .. } = grid;
    let share = params.expansion(moment.dt_secs) as f32;
    if report.fullest <= 1.0 || share <= 0.0 {
        return 0.0;
    }
    let cell = *cell as f32;
    for face in faces.iter_mut() {
        face.fill([0.0; 2]);
    }
    let rhs = |filled: f32, _: f32| {
        let excess = (filled - 1.0) / filled;
        cell * if excess > 0.0 { share * excess } else { excess }
    };
    fields.pressure.fill(0.0);
    fields.compute_divergence(bounds, faces, filled, &rhs);
    let found = find_pressure(fields, bounds, params);
    report.iterations += found.iterations;
    report.residual = report.residual.max(found.residual);
    if found.cells == 0 {
        return 0.0;
    }
    fields.mark_touched(bounds);
    fields.apply_pressure(bounds, faces)
}

/// Solves for the pressure of the cells with a positive right-hand side.
fn find_pressure(fields: &mut Fields, bounds: &Bounds, params: &GridParams) -> GridReport {
    let mut report = GridReport::default();
    for _ in 0..ROUNDS {
        report.cells = fields.build_system(bounds);
        if report.cells == 0 {
            break;
        }
        let (iterations, residual) = conjugate::solve(fields, bounds, params);
        report.iterations += iterations;
        report.residual = residual;
        if !fields.update_active_set(bounds) {
            break;
        }
    }
    report
}

#[cfg(test)]
mod tests;
