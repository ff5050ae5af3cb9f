//! Pressure: removes from the velocities of the grid the part that would compress dense hair
//! further.
//!
//! # Theory
//! Let ρ be the density of a cell, relative to that of the same hair at rest, u the velocities of
//! the faces between cells and m their masses: the momentum of a face divided by its mass, each the
//! mean of the two cells. Over the frame ρ becomes ρ (1 − dt ∇·u), which must not exceed 1,
//! and must not grow where it already does: ∇·u ≥ t, with
//!
//! ```text
//! t = −(1 − ρ)/(ρ dt)   ρ ≤ 1 ,      t = 0   ρ > 1
//! ```
//!
//! The pressure P ≥ 0 acts only where this would be violated (hair may separate freely, as in
//! Narain 2010's granular flow), and ∇·u = t where P > 0: Δu = −(P₊ − P₋)/m on each face. The
//! change of a cell is the mean of those of its faces, so Σ m Δu = 0 over the cells as over the
//! faces, and momentum is conserved.
//!
//! Hair that is already too dense is displaced, without gaining velocity: displacements s from the
//! same system with ∇·s = (1 − exp(−volume_rate dt)) (ρ − 1)/ρ where ρ > 1 and ∇·s ≥ −(1 − ρ)/ρ
//! elsewhere change positions and not velocities, so the hair stops at its rest density and does
//! not expand beyond it.
//!
//! # Practice
//! The equations have coefficients 1/m on the faces and the compact stencil of seven cells. What
//! alternates from cell to cell is not seen by the faces and remains.
//! Projected over-relaxation in two colours solves them ([`relaxation`]). Hair is a shell a few
//! cells thick with free cells outside, so few sweeps suffice. Both pressures have the same matrix,
//! which contains only cells with hair.
//!
//! Strips of sixteen cells are computed together; strips without hair are skipped. What neighbours
//! of hair hold is set in every frame, so nothing of earlier frames is cleared.
//!
//! Solids: nothing flows through a cell whose centre is inside a solid; its faces move with the
//! solid. Collision detection keeps the hair out of solids in a later stage.
//!
//! # Limitations
//! The boundary of a solid follows the cells, not the surface within them. Nothing flows through
//! faces with almost no hair.

mod fields;
mod relax;
mod system;
mod walls;

pub(crate) use fields::Fields;
pub use fields::{LOOSE, SPARSE};
pub use relax::{SLACK, SWEEPS, relaxation};

use crate::interaction::grid::{Grid, GridMoment, GridPlacement, GridReport};
use system::Terms;

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Solves for the pressures. Replaces momenta and volumes of the nodes by the velocities to
/// interpolate and the displacements of over-dense hair.
pub fn solve(grid: &mut Grid, moment: &GridMoment<'_>) -> GridReport {
    let Grid { params, bounds, cell, sample_mass, nodes, marks, pressure: fields, .. } = grid;
    let placement = GridPlacement {
        frame: &moment.frame,
        cell: *cell,
        origin: moment.origin,
        last_substep: moment.last_substep,
        h: moment.dt_secs * (1.0 - moment.last_substep),
    };
    fields.fit(bounds, nodes, marks, moment.solids, &placement);
    let side = *cell as f32;
    let expansion = params.expansion(moment.dt_secs) as f32;
    let least = SPARSE * *sample_mass;
    let terms = Terms { least, cell: side, slack: side / moment.dt_secs as f32, expansion };
    let densest = fields.build_system(bounds, terms);
    let displaces = densest > 1.0 && expansion > 0.0;
    let [velocities, displacements] = fields.system.solve(bounds, &fields.strips, params, displaces);
    let cells = fields.collect_pressures(bounds);
    let pic = params.pic_share(moment.dt_secs) as f32;
    GridReport {
        densest,
        cells,
        iterations: velocities.sweeps + displacements.sweeps,
        residual: velocities.residual.max(displacements.residual).into(),
        farthest_m: fields.apply_pressure(bounds, nodes, least, pic),
        ..GridReport::default()
    }
}

#[cfg(test)]
mod tests;
