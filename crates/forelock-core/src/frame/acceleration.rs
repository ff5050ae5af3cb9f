//! Acceleration of particles in addition to gravity, for engines and tests.

use crate::lane::{LANES, Real, Row};
use crate::params::ParamsError;
use crate::strands::{Block, Model, PlaceInGroom, State, number, vector};
use glam::{DVec3, Vec3};
use std::fmt;

/// Acceleration of particles in addition to gravity, m/s², world axes.
///
/// It is sampled at the start of a frame, and adds h a to the velocity of a particle in each
/// substep of h seconds, whatever its mass. Clamped particles follow the head all the same.
#[derive(Clone, Copy, Default)]
#[non_exhaustive]
pub enum Acceleration<'a> {
    /// None.
    #[default]
    None,
    /// Of each particle, `[P]`, in the groom's order.
    PerParticle(&'a [Vec3]),
    /// A function of the place in the world, metres. A CPU calls it for every particle, on the
    /// threads of the rayon pool. A GPU calls it at the nodes of a lattice that contains the hair
    /// in any pose ([`LATTICE`] cells a side), interpolates linearly, and takes 0 where it is not
    /// finite.
    Field(&'a (dyn Fn(DVec3) -> DVec3 + Sync)),
}

/// WGSL of the acceleration.
pub const ACCELERATION_WGSL: &str = include_str!("wgsl/acceleration.wgsl");

/// Cells a side of the lattice on which a GPU samples [`Acceleration::Field`].
pub const LATTICE: u32 = 16;

impl fmt::Debug for Acceleration<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "None",
            Self::PerParticle(_) => "PerParticle(..)",
            Self::Field(_) => "Field(..)",
        })
    }
}

impl Acceleration<'_> {
    /// Checks that there is one acceleration a particle of the groom, if each has its own.
    ///
    /// # Errors
    /// [`ParamsError::Count`] if there is not.
    pub fn check<T>(&self, model: &Model<T>) -> Result<(), ParamsError> {
        let Self::PerParticle(all) = self else { return Ok(()) };
        let (found, expected) = (all.len(), model.groom_particles());
        if found == expected {
            return Ok(());
        }
        Err(ParamsError::Count { name: "acceleration", found, expected, of: "particles" })
    }

    /// Writes `all`, one acceleration a particle of the groom, to `out`, three rows a place.
    pub fn pack<T: Real>(all: &[Vec3], model: &Model<T>, out: &mut Vec<Row<T>>) {
        fill(model, out, |block, lane, i| {
            let PlaceInGroom { before, after, share } = model.in_groom(block.strands[lane] as usize, i);
            all[before].lerp(all[after], share).as_dvec3()
        });
    }

    /// Writes the acceleration of each particle in `state` to `out`, three rows a place; no rows if
    /// there is none.
    pub fn sample<T: Real>(&self, model: &Model<T>, state: &State<T>, out: &mut Vec<Row<T>>) {
        match *self {
            Self::None => out.clear(),
            Self::PerParticle(all) => Self::pack(all, model, out),
            Self::Field(field) => fill(model, out, |block, lane, i| {
                let relative = vector(&state.positions, block.first + i, lane);
                field(state.origin + DVec3::from_array(relative.map(|x| x.to_f64().unwrap_or(0.0))))
            }),
        }
    }
}

/// Fills three rows a place with `value` of each block, lane and particle.
fn fill<T: Real>(
    model: &Model<T>,
    out: &mut Vec<Row<T>>,
    value: impl Fn(&Block, usize, usize) -> DVec3 + Sync,
) {
    out.resize(3 * model.places(), Row([T::zero(); LANES]));
    fill_blocks(&model.blocks, out, &value);
}

/// Halves the list of blocks, without an allocation.
fn fill_blocks<T: Real>(
    blocks: &[Block],
    rows: &mut [Row<T>],
    value: &(impl Fn(&Block, usize, usize) -> DVec3 + Sync),
) {
    if blocks.len() > 1 {
        let (left, right) = blocks.split_at(blocks.len() / 2);
        let (left_rows, right_rows) = rows.split_at_mut(3 * (right[0].first - left[0].first));
        rayon::join(|| fill_blocks(left, left_rows, value), || fill_blocks(right, right_rows, value));
        return;
    }
    for block in blocks {
        for (i, rows) in rows.chunks_exact_mut(3).enumerate() {
            for lane in 0..block.live {
                for (row, x) in rows.iter_mut().zip(value(block, lane, i).to_array()) {
                    row.0[lane] = number(x);
                }
            }
        }
    }
}
