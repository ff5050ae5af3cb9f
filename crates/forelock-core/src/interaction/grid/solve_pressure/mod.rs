//! Pressure: takes from the grid's velocities what would press dense hair together.
//!
//! # Theory
//! Let φ be the share of a cell that hair fills, u the faces' velocities and m their masses. Over the frame φ becomes
//! φ (1 − dt ∇·u), which must not pass 1, and must not grow where it has: ∇·u ≥ t, with
//!
//! ```text
//! t = −(1 − φ)/(φ dt)   φ ≤ 1 ,      t = 0   φ > 1
//! ```
//!
//! Pressure P ≥ 0 acts only where that would be broken (hair may separate freely, as in Narain 2010's granular flow):
//! Δu = −(P₊ − P₋)/m on each face, P = 0 wherever hair is not held, and Σ m Δu = 0, so that momentum is kept. The
//! held cells are found by a primal–dual active set: solve ∇·u = t on the cells held, let go of those that
//! would pull, take in those that are still pressed, again.
//!
//! Hair that is too dense already is moved apart, not thrown apart: displacements s, from the same system with
//! ∇·s = (1 − exp(−volume_rate dt)) (φ − 1)/φ where φ > 1 and ∇·s ≥ −(1 − φ)/φ elsewhere, change positions and leave
//! velocities alone, so that it comes to rest at its density and does not fly beyond it.
//!
//! # Practice
//! The system is a Poisson equation with 1/m on the faces, symmetric positive definite, with the compact stencil of a
//! staggered grid; conjugate gradients with its diagonal solve it. Hair is a shell a few cells thick with free cells
//! outside, so the iterations are few. Rows without held cells are skipped. Sums are taken a layer at a time and added
//! in order: results do not depend on threads.
//!
//! Solids: a cell whose middle is inside a solid lets nothing through; its faces move as the solid does. What keeps hair
//! itself out of solids comes later.
//!
//! # Limitations
//! Walls follow cells, not the surface within them. Faces with next to no hair let nothing through.

mod conjugate;
mod mark;

pub use conjugate::SLACK;
pub(crate) use mark::Fields;
pub use mark::{LOOSE, SPARSE};

use crate::interaction::grid::{Bounds, Grid, GridMoment, GridParams, GridReport, GridSolid};

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Rounds of the active set at most.
const ROUNDS: u32 = 12;

/// Turns (mass, momentum) of the faces into (new velocity, change).
pub fn solve_velocities(grid: &mut Grid, moment: &GridMoment<'_>) -> GridReport {
    let Grid { params, bounds, cell, sample_mass, faces, filled, pressure: fields, .. } = grid;
    fields.fit(bounds);
    fields.divide(bounds, faces, *sample_mass);
    let h = moment.dt_secs * (1.0 - moment.last_substep);
    for (number, solid) in (1..=u16::MAX).zip(moment.solids) {
        let at = (moment.last_substep, h);
        let solid = GridSolid::new(solid, at, moment.origin, &moment.frame, (bounds, *cell));
        fields.wall_off(bounds, faces, (filled, *cell), (number, &solid));
    }
    let slack = (*cell / moment.dt_secs) as f32;
    let lack = |share: f32, divergence: f32| slack * ((share - 1.0) / share).min(0.0) - divergence;
    let fullest = fields.aim(bounds, (faces, filled), &lack);
    let report = find_pressure(fields, bounds, params);
    fields.push(bounds, faces);
    GridReport { fullest, ..report }
}

/// Turns the faces into displacements, twice, where some hair is too dense; nothing, where none is. After
/// [`solve_velocities`], whose walls and masses hold. Returns a bound on them, metres; 0 where there are none.
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
    let lack = |filled: f32, _: f32| {
        let excess = (filled - 1.0) / filled;
        cell * if excess > 0.0 { share * excess } else { excess }
    };
    fields.pressure.fill(0.0);
    fields.aim(bounds, (faces, filled), &lack);
    let found = find_pressure(fields, bounds, params);
    report.iterations += found.iterations;
    report.residual = report.residual.max(found.residual);
    if found.cells == 0 {
        return 0.0;
    }
    fields.mark_touched(bounds);
    fields.push(bounds, faces)
}

/// The pressure of the cells that lack divergence.
fn find_pressure(fields: &mut Fields, bounds: &Bounds, params: &GridParams) -> GridReport {
    let mut report = GridReport::default();
    for _ in 0..ROUNDS {
        report.cells = fields.gather_held(bounds);
        if report.cells == 0 {
            break;
        }
        let (iterations, residual) = conjugate::solve(fields, bounds, (params.iterations, params.tolerance));
        report.iterations += iterations;
        report.residual = residual;
        if !fields.revise(bounds) {
            break;
        }
    }
    report
}

#[cfg(test)]
mod tests;
