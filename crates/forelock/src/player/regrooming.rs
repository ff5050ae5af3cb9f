//! Edits of the groom while the hair moves: `[[edit]]` tables with `at_secs`, and edits from
//! outside.
//!
//! # Practice
//! An edit of the scene is done before the step of the first frame that its time does not lie
//! after; the simulation takes the edited groom over and continues. A cache has one layout, so
//! strands are shown as they were at the start: particles beyond a cut lie at the tip. An edit from
//! outside that adds particles or strands changes the layout of what is shown. A resumed run
//! repeats the edits that were done before its snapshot.

use std::sync::{Arc, OnceLock};

use forelock_core::groom::edit::{Edit, EditReport};
use forelock_core::groom::{Groom, arc_lengths};
use forelock_core::pose::Pose;
use glam::Vec3;

use super::engine::Engine;
use super::error::PlayerError;
use crate::assets::{AssetError, Assets};
use crate::scalp::Cover;
use crate::scene::Scene;

/// The groom as edited so far, and the scene's edits that are not done yet.
#[derive(Clone, Debug)]
pub(super) struct Grooming {
    /// The scene's timed edits in order of time, and how many of them are done.
    timed: Arc<[TimedEdit]>,
    done: usize,
    /// The edited groom; none before the first edit.
    pub groom: Option<Arc<Groom>>,
    /// How that covers the body.
    pub covering: Option<Covering>,
    /// Place of each particle of the start's groom on the edited one.
    places: Arc<[Place]>,
    /// Whether positions are shown in the layout of the edited groom.
    own_layout: bool,
    /// What was done, one sentence each.
    pub notes: Vec<String>,
}

/// How an edited groom covers the body, computed once a picture needs it.
#[derive(Clone, Debug)]
pub(super) struct Covering {
    groom: Arc<Groom>,
    cover: Arc<OnceLock<Option<Cover>>>,
}

impl Covering {
    /// How it covers the body of `assets`.
    pub fn cover(&self, assets: &Assets) -> Option<&Cover> {
        self.cover.get_or_init(|| assets.cover_by(&self.groom)).as_ref()
    }
}

/// One timed edit of the scene.
#[derive(Clone, Copy, Debug)]
struct TimedEdit {
    /// Its number, from 0.
    number: usize,
    at_secs: f64,
}

/// A place on a strand.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    /// A particle of the edited groom.
    particle: u32,
    /// Fraction of the edge after it.
    fraction: f32,
}

/// What an edit works on.
pub(super) struct EditContext<'a> {
    pub scene: &'a Scene,
    pub assets: &'a Assets,
    pub engine: &'a mut Engine,
    /// The pose of the head that the simulation has reached.
    pub head: Pose,
}

impl Grooming {
    pub fn new(scene: &Scene) -> Self {
        let timed = scene.edits.timed().into_iter();
        Self {
            timed: timed.map(|(number, at_secs)| TimedEdit { number, at_secs }).collect(),
            done: 0,
            groom: None,
            covering: None,
            places: Arc::default(),
            own_layout: false,
            notes: Vec::new(),
        }
    }

    /// Whether edits of the scene are due at `secs`.
    pub fn is_due(&self, secs: f64) -> bool {
        self.timed.get(self.done).is_some_and(|edit| edit.at_secs <= secs)
    }

    /// Does the scene's edits that are due at `secs`.
    pub fn advance(&mut self, secs: f64, context: &mut EditContext<'_>) -> Result<(), PlayerError> {
        while let Some(&TimedEdit { number, at_secs }) = self.timed.get(self.done) {
            if at_secs > secs {
                break;
            }
            self.done += 1;
            let edit = &context.scene.edits.0[number].edit;
            let report = self.edit(edit, number, context)?;
            let name = edit.operation.name();
            self.notes.push(format!("edit {} ({name}) at {at_secs} s: {report}", number + 1));
        }
        Ok(())
    }

    /// Does `edit`, which is number `number` (from 0) for messages; nothing has changed after an
    /// error.
    pub fn edit(
        &mut self,
        edit: &Edit,
        number: usize,
        context: &mut EditContext<'_>,
    ) -> Result<EditReport, PlayerError> {
        let start = &context.assets.groom;
        let mut groom = self.groom.as_deref().unwrap_or(start).clone();
        let report = context
            .assets
            .edit_other(context.scene, edit, &mut groom)
            .map_err(|error| AssetError::of_edit(number, edit, error))?;
        context.engine.simulator().regroom(&groom, &report.sources, &context.head)?;
        self.own_layout |= matches!(edit.operation.name(), "lengthen" | "resample" | "density" | "mirror");
        self.places = if self.own_layout { Arc::default() } else { places(start, &groom).into() };
        let groom = Arc::new(groom);
        self.covering = Some(Covering { groom: groom.clone(), cover: Arc::default() });
        self.groom = Some(groom);
        Ok(report)
    }

    /// The groom whose layout positions are shown in.
    pub fn shown<'a>(&'a self, start: &'a Groom) -> &'a Groom {
        self.shown_groom().map_or(start, |groom| groom)
    }

    /// The edited groom whose layout positions are shown in; none for that of the start.
    pub fn shown_groom(&self) -> Option<&Arc<Groom>> {
        self.groom.as_ref().filter(|_| self.own_layout)
    }

    /// The simulated particle that is nearest to each one of the layout that is shown; none where
    /// both are the same.
    pub fn nearest(&self) -> Option<impl Iterator<Item = usize>> {
        let differs = self.groom.is_some() && !self.own_layout;
        let nearest = |own: &Place| own.particle as usize + usize::from(own.fraction > 0.5);
        differs.then(|| self.places.iter().map(nearest))
    }

    /// Whether the particles that are shown are those that are simulated, one by one.
    pub fn shows_simulated(&self) -> bool {
        let is_same = |(i, own): (usize, &Place)| own.particle as usize == i && own.fraction == 0.0;
        self.nearest().is_none() || self.places.iter().enumerate().all(is_same)
    }

    /// Positions in the layout that is shown, of those that `simulated` writes; `buffer` is
    /// scratch.
    pub fn positions(
        &self,
        simulated: impl FnOnce(&mut Vec<Vec3>) -> Result<(), PlayerError>,
        buffer: &mut Vec<Vec3>,
        out: &mut Vec<Vec3>,
    ) -> Result<(), PlayerError> {
        if self.groom.is_none() || self.own_layout {
            return simulated(out);
        }
        simulated(buffer)?;
        let at = |place: &Place| {
            let i = place.particle as usize;
            match place.fraction {
                0.0 => buffer[i],
                fraction => buffer[i].lerp(buffer[i + 1], fraction),
            }
        };
        out.clear();
        out.extend(self.places.iter().map(at));
        Ok(())
    }
}

/// Places of the particles of `start` on the strands of `now`: at the same arc length, or at the
/// tip.
fn places(start: &Groom, now: &Groom) -> Vec<Place> {
    let mut places = Vec::with_capacity(start.particle_count());
    for strand in 0..start.strand_count() {
        let first = now.range(strand).start;
        let there = arc_lengths(now.strand(strand));
        let last = there.len() - 1;
        for arc in arc_lengths(start.strand(strand)) {
            let edge = there.partition_point(|&a| a <= arc).saturating_sub(1).min(last.saturating_sub(1));
            let width = there.get(edge + 1).map_or(0.0, |&next| next - there[edge]);
            let fraction = if width > 0.0 { ((arc - there[edge]) / width).clamp(0.0, 1.0) } else { 0.0 };
            // Equal to a particle's arc length up to rounding: on the particle.
            let on = (fraction - fraction.round()).abs() < 1e-4;
            let (edge, fraction) =
                if on { (edge + usize::from(fraction > 0.5), 0.0) } else { (edge, fraction) };
            #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit; a fraction in [0, 1]")]
            places.push(Place { particle: (first + edge) as u32, fraction: fraction as f32 });
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
        assert_eq!(places(&start, &now), expected.map(|(particle, fraction)| Place { particle, fraction }));
    }
}
