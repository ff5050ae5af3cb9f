//! Edits while the hair moves: `[[edit]]` tables with `at_secs`.
//!
//! # Practice
//! An edit is done before the step of the first frame that its time does not lie after; the simulation takes the edited groom over and goes on. A cache has one
//! layout, so strands are written as they were at the start: particles beyond a cut lie at the tip. A resumed run does the edits again that were done
//! before its snapshot.

use forelock_core::groom::{Groom, arc_lengths};
use forelock_core::pose::Pose;
use forelock_core::simulation::Simulation;
use glam::Vec3;

use crate::assets::Assets;
use crate::run::RunError;
use crate::scene::Scene;

/// The edits that a run has still to do, and what those done have made.
#[derive(Debug)]
pub(crate) struct Regrooming {
    /// Number of the edit, from 0, and when, seconds; in order of time.
    waiting: std::collections::VecDeque<(usize, f64)>,
    /// The groom as edited so far; none before the first edit.
    groom: Option<Groom>,
    /// Where each particle of the groom at the start is now: a particle of the edited groom and the fraction of the edge after it.
    places: Vec<(u32, f32)>,
    /// What was done, one sentence each.
    pub(crate) notes: Vec<String>,
    positions: Vec<Vec3>,
}

impl Regrooming {
    pub(crate) fn new(scene: &Scene) -> Self {
        Self {
            waiting: scene.edits.timed().into(),
            groom: None,
            places: Vec::new(),
            notes: Vec::new(),
            positions: Vec::new(),
        }
    }

    /// Whether edits wait for `time_secs`.
    pub(crate) fn is_due(&self, time_secs: f64) -> bool {
        self.waiting.front().is_some_and(|edit| edit.1 <= time_secs)
    }

    /// Does all edits whose time is not after `time_secs`, on a simulation whose head is at `head`; whether there were any.
    pub(crate) fn advance(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        simulation: &mut Simulation,
        (time_secs, head): (f64, Pose),
    ) -> Result<bool, RunError> {
        let waiting = self.waiting.len();
        while let Some((number, at_secs)) = self.waiting.front().copied().filter(|edit| edit.1 <= time_secs) {
            self.waiting.pop_front();
            let mut groom = self.groom.take().unwrap_or_else(|| assets.groom.clone());
            let report = assets.edit_other(scene, number, &mut groom)?;
            simulation.regroom(&groom, &report.sources, &head)?;
            let name = scene.edits.0[number].edit.operation.name();
            self.notes.push(format!("edit {} ({name}) at {at_secs} s: {report}", number + 1));
            self.places = places(&assets.groom, &groom);
            self.groom = Some(groom);
        }
        Ok(self.waiting.len() < waiting)
    }

    /// Positions in world space and the layout of the groom at the start, metres, of a simulation whose are told by `simulated`.
    pub(crate) fn positions(&mut self, simulated: impl FnOnce(&mut Vec<Vec3>), out: &mut Vec<Vec3>) {
        if self.groom.is_none() {
            return simulated(out);
        }
        simulated(&mut self.positions);
        let at = |&(particle, fraction): &(u32, f32)| {
            let i = particle as usize;
            match fraction {
                0.0 => self.positions[i],
                _ => self.positions[i].lerp(self.positions[i + 1], fraction),
            }
        };
        out.clear();
        out.extend(self.places.iter().map(at));
    }
}

/// Where the particles of `start` are on `now`, strand by strand at the same arc length, or at the tip.
fn places(start: &Groom, now: &Groom) -> Vec<(u32, f32)> {
    let mut places = Vec::with_capacity(start.particle_count());
    for strand in 0..start.strand_count() {
        let first = now.range(strand).start;
        let there = arc_lengths(now.strand(strand));
        let last = there.len() - 1;
        for arc in arc_lengths(start.strand(strand)) {
            let edge = there.partition_point(|&a| a <= arc).saturating_sub(1).min(last.saturating_sub(1));
            let width = there.get(edge + 1).map_or(0.0, |&next| next - there[edge]);
            let fraction = if width > 0.0 { ((arc - there[edge]) / width).clamp(0.0, 1.0) } else { 0.0 };
            // On a particle to rounding is on it.
            let on = (fraction - fraction.round()).abs() < 1e-4;
            let (edge, fraction) =
                if on { (edge + usize::from(fraction > 0.5), 0.0) } else { (edge, fraction) };
            #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit; a fraction in [0, 1]")]
            places.push(((first + edge) as u32, fraction as f32));
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_beyond_a_cut_lie_at_the_tip() {
        let strand = |n: u16| (0..n).map(|i| Vec3::Y * f32::from(i)).collect::<Vec<_>>();
        let mut shorter = strand(3);
        shorter.push(Vec3::Y * 2.5);
        let start = Groom::from_strands([strand(6), strand(2)]).unwrap();
        let now = Groom::from_strands([shorter, strand(2)]).unwrap();
        let expected = [(0, 0.0), (1, 0.0), (2, 0.0), (3, 0.0), (3, 0.0), (3, 0.0), (4, 0.0), (5, 0.0)];
        assert_eq!(places(&start, &now), expected);
    }
}
