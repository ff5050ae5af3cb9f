//! A single strand after a ride (Fig. 10), compared with a reference in float64.

use std::f64::consts::TAU;

use forelock_core::frame::{Air, FrameInput};
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use glam::{DQuat, DVec3};

use crate::BenchError;
use forelock::AssetError;

use super::coaster::BROKEN;
use super::study::Table;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.81;

/// Loads of the single strand's rides, g, and what the reference says: smallest s, ties broken,
/// largest offset from the elastic strand over L.
const LOADS: [(f64, &str, &str, &str); 4] = [
    (1.0, "1", "0", "0"),
    (2.0, "0.78–0.91", "0", ""),
    (3.0, "", "up to 8", "0.05–0.09"),
    (5.0, "", "3–9", "0.05–0.09"),
];
/// Substeps per frame of the single strand's rides.
const SUBSTEPS: [u32; 2] = [4, 8];

/// A single strand after a ride.
#[derive(Clone, Copy, Debug)]
struct Ridden {
    least: f64,
    broken: usize,
    /// Farthest that a particle is from where the elastic strand has it, over L.
    from_elastic: f64,
    /// Farthest that a particle of the elastic strand is from its place at rest, over L.
    elastic: f64,
}

/// Where the head is at `time` of a ride of 3 s at 1 Hz that pulls up to `load` g sideways, from
/// rest to rest.
fn ride(load: f64, time: f64) -> Pose {
    let reach = load * GRAVITY / (TAU * TAU) * (1.0 - (TAU * time.min(3.0)).cos());
    Pose::new(DQuat::IDENTITY, DVec3::new(0.96, 0.0, 0.28) * reach)
}

/// A hanging helix of 30 particles and 30 cm along its edges: radius 1 cm, three turns.
fn strand() -> Result<Groom, BenchError> {
    let (edges, radius, length) = (29.0, 0.01, 0.3);
    let (turn, edge) = (3.0 * TAU / edges, length / edges);
    let across = 2.0 * radius * (0.5 * turn).sin();
    let down = (edge * edge - across * across).sqrt();
    let point = |i: u32| {
        let (sin, cos) = (turn * f64::from(i)).sin_cos();
        DVec3::new(radius * cos, -down * f64::from(i), radius * sin).as_vec3()
    };
    Ok(Groom::from_strands([(0..30).map(point).collect::<Vec<_>>()]).map_err(AssetError::from)?)
}

/// That strand after a ride at up to `load` g and 4.5 s of rest.
fn ridden(load: f64, substeps: u32) -> Result<Ridden, BenchError> {
    let groom = strand()?;
    let dt_secs = 1.0 / 60.0;
    let gravity = DVec3::new(0.0, -GRAVITY, 0.0);
    let run = |non_hookean| -> Result<_, BenchError> {
        let options = Options { rest_gravity: gravity, ..Options::default() };
        let substep_secs = dt_secs / f64::from(substeps);
        let params = AmsParams { non_hookean, substep_secs, ..AmsParams::default() };
        let mut simulation = Simulation::<f32>::new(&groom, &params, &options)?;
        for frame in 0..450 {
            let head = [frame, frame + 1].map(|frame| ride(load, f64::from(frame) * dt_secs));
            let air_velocity = DVec3::ZERO;
            simulation.step_frame(&FrameInput {
                roots: head.into(),
                gravity,
                air: Air::uniform(air_velocity),
                dt_secs,
                ..FrameInput::default()
            })?;
        }
        let mut positions = Vec::new();
        simulation.positions(&mut positions);
        Ok((positions, simulation.snapshot().integrity))
    };
    let ((damaged, intact), (elastic, _)) = (run(true)?, run(false)?);
    let farthest =
        |distances: &mut dyn Iterator<Item = f64>| distances.fold(0.0, f64::max) / f64::from(groom.length(0));
    let end = ride(load, 7.5);
    let rest = groom.positions().iter().map(|p| end.transform_point(p.as_dvec3()));
    Ok(Ridden {
        // Without healing the smallest integrity is that of the end.
        least: intact.iter().fold(1.0, |least, &s| least.min(f64::from(s))),
        broken: intact.iter().filter(|&&s| f64::from(s) < BROKEN).count(),
        from_elastic: farthest(&mut damaged.iter().zip(&elastic).map(|(a, b)| f64::from(a.distance(*b)))),
        elastic: farthest(&mut elastic.iter().zip(rest).map(|(a, b)| a.as_dvec3().distance(b))),
    })
}

/// The strand after its rides, with the reference in brackets.
pub(super) fn table() -> Result<Table, BenchError> {
    let columns = [
        "ride of 3 s",
        "smallest s",
        "ties broken of 30",
        "farthest from the elastic strand / L",
        "elastic strand, farthest from rest / L",
    ];
    let mut table = Table::new("A single strand of 30 cm, 4.5 s after a ride", &columns);
    for (load, least, broken, apart) in LOADS {
        for substeps in SUBSTEPS {
            let ridden = ridden(load, substeps)?;
            let cell = |ours: String, reference: &str| match reference {
                "" => ours,
                reference => format!("{ours} ({reference})"),
            };
            table.rows.push(vec![
                format!("{load} g, {substeps} substeps"),
                cell(format!("{:.2}", ridden.least), least),
                cell(ridden.broken.to_string(), broken),
                cell(format!("{:.3}", ridden.from_elastic), apart),
                format!("{:.3}", ridden.elastic),
            ]);
        }
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the reference found: no damage at 1 g, some at 2 g, ties that break at 3 g and 5 g, and
    /// a strand that does not come back where the elastic one does.
    #[test]
    fn a_strand_is_damaged_by_its_load() {
        for substeps in SUBSTEPS {
            let of = |load| ridden(load, substeps).unwrap();
            let [one, two, three, five] = [1.0, 2.0, 3.0, 5.0].map(of);
            assert!(one.least > 0.999 && one.from_elastic < 1e-4, "{one:?}");
            assert!((0.78..=0.91).contains(&two.least) && two.broken == 0, "{two:?}");
            assert!((1..=8).contains(&three.broken) && three.from_elastic > 0.03, "{three:?}");
            assert!((3..=9).contains(&five.broken) && five.from_elastic > 0.045, "{five:?}");
            for ridden in [one, two, three, five] {
                assert!(ridden.elastic < 2e-3, "the elastic strand is back: {ridden:?}");
            }
        }
    }
}
