//! Transfer of the simulated state to an edited groom.
//!
//! # Theory
//! The edited strands are the new rest shape: they define ghosts, rest lengths and weights. The
//! motion continues: each particle takes position, velocity, damage and the channels of the solver
//! from its strand before the edit, at the particle's arc length from the root. So cut hair is the
//! same hair, shorter; combed and curled hair keeps its position, and its ties pull it to the new
//! shape. Hair that is longer than before is extended from the old tip, with the rotation of the
//! tip's edge from its rest direction. A new strand starts with the displacement from the rest
//! shape that its source has, and with its edges at their rest lengths.
//!
//! # Practice
//! [`Edit::apply`](crate::groom::edit::Edit::apply) reports the [`Source`]s that
//! [`Simulation::regroom`] needs.
//!
//! # Limitations
//! With `sag_free` the weight of every particle is compensated at the particle, so a strand that
//! hangs at rest does not rise when hair below is cut; without it, it does. Simulations with
//! virtual particles are not supported.

use glam::{DQuat, DVec3};

use super::Simulation;
use crate::groom::Groom;
use crate::groom::edit::Source;
use crate::pose::Pose;
use crate::strands::{Channel, Masses, Model, PackError, Snapshot, State, Strands, vector};

/// Why the state cannot be transferred to an edited groom.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegroomError {
    /// The groom cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The number of sources is not that of the strands, or a source does not exist.
    #[error(
        "the edited groom has {strands} strands, but the {sources} sources do not fit the simulation's {simulated}"
    )]
    Sources {
        /// Strands of the edited groom.
        strands: usize,
        /// Sources given.
        sources: usize,
        /// Strands simulated so far.
        simulated: usize,
    },
    /// The masses were given particle by particle, and those of the edited groom are not known.
    #[error("strands with masses of their own cannot be edited during a simulation: take masses from widths")]
    Masses,
    /// The strands have virtual particles, which edits do not support.
    #[error("strands with virtual particles cannot be edited during a simulation: build a new simulation")]
    Virtual,
}

/// Fraction of an edge below which a position on it coincides with a particle.
const SAME: f64 = 1e-4;

/// The model and the state of an edited groom.
#[derive(Debug)]
pub struct Regroomed {
    /// The model.
    pub model: Model<f32>,
    /// The state.
    pub state: State<f32>,
}

/// `groom` with the motion of the strands of `model` and `state` that `sources` name, with the head
/// at `head`.
///
/// # Errors
/// [`RegroomError`] if the groom cannot be simulated or the sources do not fit.
pub fn regroom(
    model: &Model<f32>,
    state: &State<f32>,
    groom: &Groom,
    masses: Masses,
    sources: &[Source],
    head: &Pose,
) -> Result<Regroomed, RegroomError> {
    if model.every != 1 {
        return Err(RegroomError::Virtual);
    }
    let (strands, simulated) = (groom.strand_count(), model.strand_count);
    if sources.len() != strands || sources.iter().any(|s| s.strand as usize >= simulated) {
        return Err(RegroomError::Sources { strands, sources: sources.len(), simulated });
    }
    if masses == Masses::Uniform && !model.masses.is_empty() {
        return Err(RegroomError::Masses);
    }
    let masses = masses.of(groom)?;
    let edited = Model::new(&Strands { masses: masses.as_deref(), ..groom.into() })?;
    let mut begun = State::at_rest(&edited, head);
    if !state.previous.is_empty() {
        begun.remember();
    }
    let channels: Vec<Channel> = state.extra.channels().copied().collect();
    begun.extra.prepare(&channels, edited.places());
    let mut now = begun.snapshot(&edited);
    let before = Before {
        channels: &channels,
        rest: rest(model),
        head,
        moving: state.snapshot(model),
        offsets: &model.offsets,
        shift: state.origin - begun.origin,
    };
    for channel in &channels {
        let started = before.moving.extra.get(channel.name).is_some_and(|values| !values.is_empty());
        let entries = if started { channel.rows() * edited.particle_count } else { 0 };
        now.extra.insert(channel.name.to_owned(), vec![0.0; entries]);
    }
    for (strand, source) in sources.iter().enumerate() {
        before.transfer(groom, strand, source, &mut now);
    }
    // Cannot fail: the snapshot has as many particles as the model.
    if begun.restore(&edited, &now).is_err() {
        return Err(RegroomError::Sources { strands, sources: sources.len(), simulated });
    }
    Ok(Regroomed { model: edited, state: begun })
}

impl Simulation<f32> {
    /// Replaces the groom by `groom` and transfers the motion of the strands that `sources` name,
    /// with the head at `head`.
    ///
    /// # Errors
    /// [`RegroomError`] if the groom cannot be simulated or the sources do not fit; nothing has
    /// changed then.
    pub fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), RegroomError> {
        let Regroomed { model, state } =
            regroom(&self.model, &self.state, groom, self.options.masses, sources, head)?;
        (self.model, self.state) = (model, state);
        self.solver.channels().prepare(&mut self.model, &mut self.state);
        self.fit_workspace();
        Ok(())
    }
}

/// Rest positions in the head's frame and the groom's order.
fn rest(model: &Model<f32>) -> Vec<DVec3> {
    let mut rest = vec![DVec3::ZERO; model.particle_count];
    State::each_particle(model, |particle, place, lane| {
        let relative = vector(&model.rest, place, lane);
        rest[particle] = DVec3::from_array(relative.map(f64::from)) + DVec3::from_array(model.centre);
    });
    rest
}

/// The simulation before the edit.
struct Before<'a> {
    channels: &'a [Channel],
    rest: Vec<DVec3>,
    head: &'a Pose,
    moving: Snapshot<f32>,
    offsets: &'a [u32],
    /// Added to positions relative to the old origin to obtain those relative to the new origin.
    shift: DVec3,
}

impl Before<'_> {
    /// Transfers the motion of `source` to strand `strand` of `groom`; `now` contains the rest
    /// shape on the head before.
    fn transfer(&self, groom: &Groom, strand: usize, source: &Source, now: &mut Snapshot<f32>) {
        let old = source.strand as usize;
        let old = self.offsets[old] as usize..self.offsets[old + 1] as usize;
        let arcs = arcs(self.rest[old.clone()].iter().copied());
        let length = arcs[arcs.len() - 1];
        let edges = arcs.len() - 1;
        let (places, velocities) =
            (&self.moving.positions[old.clone()], &self.moving.velocities[old.clone()]);
        let place = |i: usize| DVec3::from_array(places[i].map(f64::from)) + self.shift;
        let velocity = |i: usize| DVec3::from_array(velocities[i].map(f64::from));
        // Displacement in the step before.
        let previous = self.moving.previous.get(old.clone()).unwrap_or_default();
        let displacement = |i: usize| {
            let before = previous.get(i).unwrap_or(&places[i]);
            DVec3::from_array(places[i].map(f64::from)) - DVec3::from_array(before.map(f64::from))
        };
        let ghost = |i: usize| self.head.transform_point(self.rest[old.start + i]);
        let tip_turn = self.turn_of_tip(&old, place(edges) - place(edges - 1));
        let range = groom.range(strand);
        let new_arcs = self::arcs(groom.strand(strand).iter().map(|p| p.as_dvec3()));
        // The particle of the new rest shape at the old tip: the pivot of the extension.
        let end = new_arcs.partition_point(|&a| a <= length * (1.0 + 1e-6)).saturating_sub(1);
        let mut before: Option<(DVec3, f64)> = None;
        for (particle, &arc) in range.clone().zip(&new_arcs) {
            let edge = arcs.partition_point(|&a| a <= arc).saturating_sub(1).min(edges - 1);
            let t = (arc - arcs[edge]) / (arcs[edge + 1] - arcs[edge]).max(f64::MIN_POSITIVE);
            // Snaps to particles, so that strands that were not edited keep their exact positions.
            let t = if (t - t.round()).abs() < SAME { t.round() } else { t }.clamp(0.0, 1.0);
            let mut at = place(edge).lerp(place(edge + 1), t);
            if source.fresh {
                let own = DVec3::from_array(now.positions[particle].map(f64::from));
                let source_ghost = ghost(edge).lerp(ghost(edge + 1), t);
                at = own + (at - self.shift + DVec3::from_array(self.moving.origin) - source_ghost);
                // Displacements of a mirrored strand are not mirrored: restore the edge lengths.
                if let Some((from, from_arc)) = before {
                    at = from + (at - from).normalize_or(DVec3::NEG_Y) * (arc - from_arc);
                }
                before = Some((at, arc));
            } else if arc > length * (1.0 + 1e-6) {
                let rest = |i: usize| groom.strand(strand)[i].as_dvec3();
                at = place(edges) + tip_turn * (rest(particle - range.start) - rest(end));
            }
            let integrity = &self.moving.integrity[old.clone()];
            #[expect(clippy::cast_possible_truncation, reason = "the state is float32")]
            {
                now.positions[particle] = at.as_vec3().to_array();
                now.velocities[particle] = velocity(edge).lerp(velocity(edge + 1), t).as_vec3().to_array();
                if let Some(before) = now.previous.get_mut(particle) {
                    *before = (at - displacement(edge).lerp(displacement(edge + 1), t)).as_vec3().to_array();
                }
                now.integrity[particle] =
                    integrity[edge] + (integrity[edge + 1] - integrity[edge]) * t as f32;
            }
            self.transfer_channels(old.start + edge, t, particle, now);
        }
    }

    /// Writes the channels of a particle that lies at fraction `t` of the edge after particle
    /// `from` of the strands before.
    fn transfer_channels(&self, from: usize, t: f64, particle: usize, now: &mut Snapshot<f32>) {
        for channel in self.channels {
            let (Some(old), Some(new)) =
                (self.moving.extra.get(channel.name), now.extra.get_mut(channel.name))
            else {
                continue;
            };
            let rows = channel.rows();
            // A channel that has not started has no values.
            if let Some(out) = new.get_mut(rows * particle..rows * (particle + 1)) {
                let (before, after) = old[rows * from..rows * (from + 2)].split_at(rows);
                channel.interpolate([before, after], t, out);
            }
        }
    }

    /// The rotation from the rest shape to the direction `now` of the last edge of the strand at
    /// `old`.
    fn turn_of_tip(&self, old: &std::ops::Range<usize>, now: DVec3) -> DQuat {
        let rest = self.rest[old.end - 1] - self.rest[old.end - 2];
        let rest = (self.head.rotation * rest).normalize_or(DVec3::Y);
        DQuat::from_rotation_arc(rest, now.normalize_or(rest)) * self.head.rotation
    }
}

/// Arc length from the first of `points` to each, metres.
fn arcs(points: impl Iterator<Item = DVec3>) -> Vec<f64> {
    let mut arc = 0.0;
    let mut last = None;
    points
        .map(|point| {
            arc += last.replace(point).map_or(0.0, |last: DVec3| last.distance(point));
            arc
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::frame::{Air, FrameInput};
    use crate::groom::edit::{Curl, Density, Edit, Lengthen, Mirror, Operation, Trim};
    use crate::simulation::Options;
    use crate::solver::AmsParams;

    const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

    fn curls() -> Groom {
        let strand = |s: usize| {
            let at = move |i: usize| {
                let angle = 0.5 * i as f32;
                Vec3::new(0.008 * angle.cos() + 0.02 * s as f32, -0.005 * i as f32, 0.008 * angle.sin())
            };
            (0..40).map(at).collect::<Vec<_>>()
        };
        Groom::from_strands((0..20).map(strand)).unwrap()
    }

    fn step(simulation: &mut Simulation, frames: u32) {
        let head = [Pose::IDENTITY; 2];
        let air_velocity = DVec3::ZERO;
        let frame = FrameInput {
            roots: head.into(),
            gravity: GRAVITY,
            air: Air::uniform(air_velocity),
            dt_secs: 1.0 / 60.0,
            ..FrameInput::default()
        };
        for _ in 0..frames {
            assert_eq!(simulation.step_frame(&frame).unwrap().quarantined_strands, 0);
        }
    }

    /// Hair without compensated weight, which has sagged.
    fn hanging() -> Simulation {
        let params = AmsParams { sag_free: false, drag: 4.0, ..AmsParams::default() };
        let mut simulation = Simulation::new(&curls(), &params, &Options::default()).unwrap();
        step(&mut simulation, 240);
        simulation
    }

    fn positions(simulation: &Simulation) -> Vec<Vec3> {
        let mut out = Vec::new();
        simulation.positions(&mut out);
        out
    }

    /// The groom after `operation`, and its sources.
    fn edited(operation: Operation) -> (Groom, Vec<Source>) {
        let mut groom = curls();
        let report = Edit::all(operation).apply(&mut groom, None).unwrap();
        (groom, report.sources)
    }

    #[test]
    fn cut_hair_keeps_its_position_and_rises() {
        let mut simulation = hanging();
        let before = positions(&simulation);
        let (groom, sources) = edited(Operation::Trim(Trim { to: 0.12, ..Trim::default() }));
        simulation.regroom(&groom, &sources, &Pose::IDENTITY).unwrap();
        let cut = positions(&simulation);
        assert_eq!(cut.len(), groom.particle_count());
        let kept = groom.strand(0).len() - 1;
        for s in 0..20 {
            for i in 0..kept {
                let (a, b) = (cut[groom.range(s).start + i], before[40 * s + i]);
                assert!(a.distance(b) < 1e-7, "particle {i} of strand {s} has moved by {}", a.distance(b));
            }
        }
        step(&mut simulation, 240);
        let after = positions(&simulation);
        let rise = after[kept - 1].y - cut[kept - 1].y;
        println!("cut from 26 to 12 cm, the tip rises by {:.2} mm", rise * 1e3);
        assert!(rise > 1e-3, "{rise}");
        // Hair with compensated weight hangs as it was groomed, cut or not.
        let options = Options { rest_gravity: GRAVITY, ..Options::default() };
        let mut at_rest = Simulation::new(&curls(), &AmsParams::default(), &options).unwrap();
        at_rest.regroom(&groom, &sources, &Pose::IDENTITY).unwrap();
        step(&mut at_rest, 60);
        let drift = positions(&at_rest).into_iter().zip(groom.positions()).map(|(a, b)| a.distance(*b));
        assert!(drift.fold(0.0, f32::max) < 1e-5);
    }

    #[test]
    fn curled_hair_moves_to_its_curl() {
        let options = Options { rest_gravity: GRAVITY, ..Options::default() };
        let mut simulation = Simulation::new(&curls(), &AmsParams::default(), &options).unwrap();
        let curl = Curl { wavelength: 0.06, radius: 0.01, ..Curl::default() };
        let (groom, sources) = edited(Operation::Curl(curl));
        simulation.regroom(&groom, &sources, &Pose::IDENTITY).unwrap();
        let far = |simulation: &Simulation| -> f32 {
            let apart =
                positions(simulation).iter().zip(groom.positions()).map(|(a, b)| a.distance(*b)).sum::<f32>();
            apart / groom.particle_count() as f32
        };
        let start = far(&simulation);
        step(&mut simulation, 180);
        assert!(start > 5e-3 && far(&simulation) < 0.2 * start, "{start} {}", far(&simulation));
    }

    #[test]
    fn longer_and_new_hair_starts_with_intact_edges() {
        for operation in [
            Operation::Lengthen(Lengthen { by: 0.05, ..Lengthen::default() }),
            Operation::Density(Density { factor: 2.5, ..Density::default() }),
            Operation::Density(Density { factor: 0.4, ..Density::default() }),
            Operation::Mirror(Mirror::default()),
        ] {
            let mut simulation = hanging();
            let (groom, sources) = edited(operation.clone());
            simulation.regroom(&groom, &sources, &Pose::IDENTITY).unwrap();
            let now = positions(&simulation);
            for s in 0..groom.strand_count() {
                let points = &now[groom.range(s)];
                assert!(points[0].distance(groom.strand(s)[0]) < 1e-6, "{operation:?}: root {s}");
                for (edge, rest) in points.windows(2).zip(groom.strand(s).windows(2)) {
                    let (now, rest) = (edge[0].distance(edge[1]), rest[0].distance(rest[1]));
                    assert!((now / rest - 1.0).abs() < 0.05, "{operation:?}: {now} {rest}");
                }
            }
            step(&mut simulation, 60);
            assert!(positions(&simulation).iter().all(|p| p.is_finite()));
        }
    }

    #[test]
    fn an_empty_edit_does_not_change_the_motion() {
        let following = || {
            let params = crate::solver::DftlParams::default();
            let mut simulation = Simulation::new(&curls(), &params, &Options::default()).unwrap();
            step(&mut simulation, 30);
            simulation
        };
        let (mut simulation, mut same) = (following(), following());
        let sources: Vec<Source> = (0..20).map(|strand| Source { strand, fresh: false }).collect();
        same.regroom(&curls(), &sources, &Pose::IDENTITY).unwrap();
        for _ in 0..2 {
            let (a, b) = (same.snapshot(), simulation.snapshot());
            let far = |a: &[[f32; 3]], b: &[[f32; 3]]| {
                let apart = |(a, b): (&[f32; 3], &[f32; 3])| Vec3::from(*a).distance((*b).into());
                a.iter().zip(b).map(apart).fold(0.0, f32::max)
            };
            assert!(far(&a.positions, &b.positions) < 1e-6 && far(&a.previous, &b.previous) < 1e-6);
            assert!(far(&b.positions, &b.previous) > 1e-4, "in motion");
            [&mut simulation, &mut same].into_iter().for_each(|own| step(own, 1));
        }
        let mut simulation = hanging();
        step(&mut simulation, 3);
        let mut same = hanging();
        step(&mut same, 3);
        same.regroom(&curls(), &sources, &Pose::IDENTITY).unwrap();
        assert_eq!(same.snapshot().positions, simulation.snapshot().positions);
        assert_eq!(same.snapshot().velocities, simulation.snapshot().velocities);
        let wrong = same.regroom(&curls(), &sources[1..], &Pose::IDENTITY);
        assert!(matches!(wrong, Err(RegroomError::Sources { .. })));
    }
}
