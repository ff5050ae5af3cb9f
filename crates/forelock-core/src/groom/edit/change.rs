//! The change that an operation makes, and how it is written into a groom.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::chain::Chain;
use super::{Body, EditReport, Source, Touched};
use crate::body::Bvh;
use crate::groom::labels::Origin;
use crate::groom::{Groom, GroomError, RootBinding};

/// The change that an operation would make.
#[derive(Clone, Debug)]
pub(super) struct Change {
    pub(super) what: What,
    /// Number of strands that have too few particles for their curl.
    pub(super) coarse: usize,
}

#[derive(Clone, Debug)]
pub(super) enum What {
    /// Indices of strands and new positions of their particles.
    Moved(Vec<(usize, Vec<Vec3>)>),
    /// All strands of the new groom, in order.
    Rebuilt(Vec<NewStrand>),
}

/// A strand of a rebuilt groom.
#[derive(Clone, Debug)]
pub(super) struct NewStrand {
    /// The strand from which attributes are taken.
    pub(super) source: usize,
    /// Its particles; `None` keeps those of the source.
    pub(super) particles: Option<Vec<Particle>>,
    /// For a new strand: the strands and weights from which its root's attributes are interpolated.
    pub(super) parents: Option<Vec<(usize, f32)>>,
}

/// A particle and the point of the source strand from which its attributes are taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct Particle {
    pub(super) position: Vec3,
    /// Edge of the source strand.
    pub(super) edge: usize,
    /// Fraction of that edge.
    pub(super) fraction: f32,
}

impl NewStrand {
    /// Strand `source`, unchanged.
    pub(super) fn kept(source: usize) -> Self {
        Self { source, particles: None, parents: None }
    }
}

impl Change {
    /// Moves the particles of selected strands towards the positions returned by `targets`, keeping
    /// the lengths of all edges; `None` leaves a strand unchanged.
    pub(super) fn moved(
        groom: &Groom,
        selected: &[bool],
        targets: impl Fn(&Chain) -> Option<Vec<DVec3>> + Sync,
    ) -> Self {
        let strands = (0..groom.strand_count()).into_par_iter().filter(|&s| selected[s]);
        let moved = strands.filter_map(|s| {
            let chain = Chain::of(groom, s);
            let targets = targets(&chain)?;
            Some((s, chain.rounded(groom.strand(s), &targets)))
        });
        Self { what: What::Moved(moved.collect()), coarse: 0 }
    }

    /// Replaces the particles of selected strands by those returned by `particles`; `None` leaves a
    /// strand unchanged.
    pub(super) fn reshaped(
        groom: &Groom,
        selected: &[bool],
        particles: impl Fn(&Chain) -> Option<Vec<Particle>> + Sync,
    ) -> Self {
        let strands = (0..groom.strand_count()).into_par_iter().map(|s| {
            let particles = if selected[s] { particles(&Chain::of(groom, s)) } else { None };
            NewStrand { source: s, particles, parents: None }
        });
        let strands: Vec<NewStrand> = strands.collect();
        if strands.iter().all(|strand| strand.particles.is_none()) {
            return Self { what: What::Moved(Vec::new()), coarse: 0 };
        }
        Self { what: What::Rebuilt(strands), coarse: 0 }
    }

    /// Writes the change into `groom`, counts it in `report`, and returns the changed strands.
    pub(super) fn write(
        self,
        groom: &mut Groom,
        body: Option<&Body<'_>>,
        report: &mut EditReport,
    ) -> Result<Touched, GroomError> {
        match self.what {
            What::Moved(strands) => Ok(write_moved(groom, strands, report)),
            What::Rebuilt(strands) => rebuild(groom, strands, body, report),
        }
    }
}

fn write_moved(groom: &mut Groom, strands: Vec<(usize, Vec<Vec3>)>, report: &mut EditReport) -> Touched {
    let mut touched = Touched::default();
    for (strand, points) in strands {
        if points.iter().any(|p| !p.is_finite()) {
            report.refused += 1;
            continue;
        }
        let range = groom.range(strand);
        let old = &mut groom.positions_mut()[range];
        if *old != *points {
            old.copy_from_slice(&points);
            touched.changed.push(strand);
        }
    }
    report.changed = touched.changed.len();
    report.sources = (0..groom.strand_count()).map(|strand| source(strand, false)).collect();
    touched
}

fn source(strand: usize, fresh: bool) -> Source {
    #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, so strand indices fit")]
    Source { strand: strand as u32, fresh }
}

fn rebuild(
    groom: &mut Groom,
    mut strands: Vec<NewStrand>,
    body: Option<&Body<'_>>,
    report: &mut EditReport,
) -> Result<Touched, GroomError> {
    let broken = |strand: &NewStrand| strand.particles.iter().flatten().any(|p| !p.position.is_finite());
    for strand in strands.iter_mut().filter(|strand| broken(strand)) {
        report.refused += 1;
        strand.particles = None;
    }
    // A new strand that is not finite is dropped.
    strands.retain(|strand| strand.parents.is_none() || strand.particles.is_some());
    let mut touched = Touched::default();
    for (index, strand) in strands.iter().enumerate() {
        match (&strand.parents, &strand.particles) {
            (Some(_), _) => touched.fresh.push(index),
            (None, Some(_)) => touched.changed.push(index),
            (None, None) => {}
        }
    }
    report.changed = touched.changed.len();
    report.added = touched.fresh.len();
    report.sources = strands.iter().map(|s| source(s.source, s.parents.is_some())).collect();
    report.removed = groom.strand_count() - (strands.len() - touched.fresh.len());
    let mut built = built(groom, &strands)?;
    if built.bindings.is_some() && !touched.fresh.is_empty() && !bind(&mut built, body, &touched.fresh) {
        built.bindings = None;
        report.bindings_dropped = true;
    }
    *groom = built;
    Ok(touched)
}

/// Builds the groom of `strands`, whose sources are in `groom`.
fn built(groom: &Groom, strands: &[NewStrand]) -> Result<Groom, GroomError> {
    let points = |strand: &NewStrand| -> Vec<Vec3> {
        match &strand.particles {
            None => groom.strand(strand.source).to_vec(),
            Some(particles) => particles.iter().map(|particle| particle.position).collect(),
        }
    };
    let mut out = Groom::from_strands(strands.iter().map(points))?;
    let lerp = |a: f32, b: f32, t: f32| if a == b { a } else { a + (b - a) * t };
    out.widths = groom.widths.as_ref().map(|w| each(groom, strands, w, lerp));
    out.transparencies = groom.transparencies.as_ref().map(|w| each(groom, strands, w, lerp));
    let mix = |a: [f32; 3], b: [f32; 3], t: f32| [0, 1, 2].map(|c| lerp(a[c], b[c], t));
    out.colours = groom.colours.as_ref().map(|c| each(groom, strands, c, mix));
    let mixed = |strand: &NewStrand, value: &dyn Fn(usize) -> f32| match &strand.parents {
        None => value(strand.source),
        Some(parents) => parents.iter().map(|&(parent, weight)| value(parent) * weight).sum(),
    };
    out.root_uvs = groom
        .root_uvs
        .as_ref()
        .map(|uvs| strands.iter().map(|s| [0, 1].map(|c| mixed(s, &|parent| uvs[parent][c]))).collect());
    out.stiffness =
        groom.stiffness.as_ref().map(|k| strands.iter().map(|s| mixed(s, &|parent| k[parent])).collect());
    out.bindings = groom.bindings.as_ref().map(|b| strands.iter().map(|s| b[s.source]).collect());
    out.pinned = groom.pinned.as_ref().map(|pinned| {
        let most = |index: usize| u16::try_from(out.range(index).len()).unwrap_or(u16::MAX);
        strands.iter().enumerate().map(|(index, s)| pinned[s.source].min(most(index))).collect()
    });
    let origin = |strand: &NewStrand| Origin {
        source: strand.source,
        is_new: strand.parents.is_some(),
        is_copy: strand.parents.as_ref().is_some_and(|parents| parents.len() == 1),
    };
    out.labels = groom.labels.edited(&strands.iter().map(origin).collect::<Vec<_>>());
    Ok(out)
}

/// An attribute of the particles, interpolated from the source strands.
fn each<T: Copy>(
    groom: &Groom,
    strands: &[NewStrand],
    values: &[T],
    lerp: impl Fn(T, T, f32) -> T,
) -> Vec<T> {
    let mut out = Vec::with_capacity(values.len());
    for strand in strands {
        let values = &values[groom.range(strand.source)];
        match &strand.particles {
            None => out.extend_from_slice(values),
            Some(particles) => out.extend(particles.iter().map(|particle| {
                let edge = particle.edge.min(values.len() - 2);
                let fraction = if particle.edge > edge { 1.0 } else { particle.fraction };
                match fraction {
                    0.0 => values[edge],
                    1.0 => values[edge + 1],
                    _ => lerp(values[edge], values[edge + 1], fraction),
                }
            })),
        }
    }
    out
}

/// Binds the roots of new strands to the body's mesh; returns false if there is no mesh.
fn bind(groom: &mut Groom, body: Option<&Body<'_>>, fresh: &[usize]) -> bool {
    let Some((mesh, sdf)) = body.and_then(|body| Some((body.mesh?, body.sdf))) else { return false };
    let bvh = Bvh::new(mesh);
    let found: Option<Vec<RootBinding>> = fresh
        .iter()
        .map(|&strand| {
            let root = groom.strand(strand)[0];
            let nearest = bvh.nearest(root)?;
            let distance = nearest.distance_squared.sqrt();
            let distance = if sdf.sample(root).0 < 0.0 { -distance } else { distance };
            Some(RootBinding { triangle: nearest.triangle, barycentric: nearest.barycentric, distance })
        })
        .collect();
    let (Some(found), Some(bindings)) = (found, groom.bindings.as_mut()) else { return false };
    for (&strand, binding) in fresh.iter().zip(found) {
        bindings[strand] = binding;
    }
    true
}
