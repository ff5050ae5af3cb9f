//! Strands as arrays for the device.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::colour::HairColour;
use crate::drawable::strand_count;
use crate::hair::Group;

/// The struct of the same name in `frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct CurveData {
    pub base: u32,
    pub first: u32,
    pub count: u32,
    pub start: u32,
    pub offset: [f32; 3],
    pub wave: f32,
    pub log_albedo: [f32; 3],
    pub tilt: f32,
    pub bright: f32,
    pub grey: f32,
    pub has_colours: u32,
    /// The factor on its width.
    pub detail: f32,
}

/// Strands and their attributes, but for their positions, kept from one frame to the next.
#[derive(Debug, Default)]
pub(super) struct HairArrays {
    pub curves: Vec<CurveData>,
    /// The curve of each drawn particle.
    pub owners: Vec<u32>,
    /// Diameters before the factors on them, `[P]`, metres.
    pub widths: Vec<f32>,
    /// `[P]`, or empty if no group has colours of its own.
    pub albedos: Vec<[f32; 4]>,
    /// The random numbers of each curve that the factors of its group are applied to.
    draws: Vec<Draw>,
    /// What all this was made of, if it may be used again.
    sources: Option<Vec<Source>>,
    /// Factors of the groups: on widths, on the offsets of children, and the share that is drawn.
    factors: Vec<[f32; 3]>,
}

/// What is new in the arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum News {
    Nothing,
    /// Factors of curves.
    Factors,
    All,
}

#[derive(Debug)]
struct Draw {
    group: u32,
    /// The offset of a child, relative to the largest one.
    offset: Vec3,
    rank: f32,
}

/// Curves in the arrays, relative to those that are drawn: when the arrays are made, and the most
/// before they are made anew. So they need not be made for each small change of the level of
/// detail.
const SPARE: f32 = 1.15;
const MOST_SPARE: f32 = 1.35;

/// What the arrays of a group are made of.
#[derive(Debug)]
struct Source {
    particles: usize,
    offsets: Vec<u32>,
    widths: Option<Vec<f32>>,
    colours: Option<Vec<[f32; 3]>>,
    /// Width, colour, children of a strand, seed.
    settings: (f32, HairColour, u32, u32),
    /// Curves of this rank and above are left out.
    rank_limit: f32,
}

impl Source {
    fn of(group: &Group<'_>, seed: u32) -> Self {
        Self {
            particles: group.strands.positions.len(),
            offsets: group.strands.strand_offsets.to_vec(),
            widths: group.strands.widths.map(<[_]>::to_vec),
            colours: group.strands.colours.map(<[_]>::to_vec),
            settings: Self::settings(group, seed),
            rank_limit: rank_limit(group),
        }
    }

    fn is_of(&self, group: &Group<'_>, seed: u32) -> bool {
        let most = group.share * MOST_SPARE;
        self.rank_limit >= group.share
            && (self.rank_limit <= most || most >= 1.0)
            && self.settings == Self::settings(group, seed)
            && self.particles == group.strands.positions.len()
            && self.offsets == group.strands.strand_offsets
            && self.widths.as_deref() == group.strands.widths
            && self.colours.as_deref() == group.strands.colours
    }

    fn settings(group: &Group<'_>, seed: u32) -> (f32, HairColour, u32, u32) {
        (group.strands.width, group.strands.colour, group.children, seed)
    }
}

/// Curves of `group` of this rank and above are left out.
fn rank_limit(group: &Group<'_>) -> f32 {
    if group.share * SPARE < 1.0 { group.share * SPARE } else { f32::INFINITY }
}

impl HairArrays {
    /// Makes the arrays those of `groups`.
    pub fn update(&mut self, groups: &[Group<'_>], seed: u32) -> News {
        // Where a particle is not finite, positions decide which strands can be drawn.
        let is_finite = groups.iter().all(|group| group.is_finite);
        let are_known = is_finite
            && self.sources.as_ref().is_some_and(|sources| {
                sources.len() == groups.len()
                    && sources.iter().zip(groups).all(|(source, group)| source.is_of(group, seed))
            });
        if !are_known {
            *self = Self::default();
            self.append_all(groups, seed);
            self.sources = is_finite.then(|| groups.iter().map(|group| Source::of(group, seed)).collect());
        }
        let factors: Vec<_> =
            groups.iter().map(|group| [group.width_scale, group.radius, group.share]).collect();
        if are_known && factors == self.factors {
            return News::Nothing;
        }
        for (curve, draw) in self.curves.iter_mut().zip(&self.draws) {
            let group = &groups[draw.group as usize];
            curve.detail = group.detail(draw.rank) * group.width_scale;
            curve.offset = (draw.offset * group.radius).into();
        }
        self.factors = factors;
        if are_known { News::Factors } else { News::All }
    }

    fn append_all(&mut self, groups: &[Group<'_>], seed: u32) {
        let has_colours = groups.iter().any(|group| group.strands.colours.is_some());
        for (index, group) in groups.iter().enumerate() {
            let (before, limit) = (self.widths.len() as u32, rank_limit(group));
            self.widths.resize(self.widths.len() + group.strands.positions.len(), 0.0);
            if has_colours {
                let colours = group.strands.colours.unwrap_or_default();
                self.albedos.extend(colours.iter().map(|&[r, g, b]| [r, g, b, 0.0]));
                self.albedos.resize(self.widths.len(), [0.0; 4]);
            }
            for (strand, particles) in group.drawable(0..strand_count(&group.strands)) {
                let (first, count) = (before + particles.start as u32, particles.len() as u32);
                let places = self.widths[first as usize..][..count as usize].iter_mut();
                for (i, width) in places.enumerate() {
                    *width = group.bare_width(particles.start, i as f32, i as f32 / (count - 1) as f32);
                }
                for child in 0..group.children {
                    let rank = group.rank(strand as u32, child);
                    if rank >= limit {
                        continue;
                    }
                    let start = self.owners.len();
                    self.owners.resize(start + count as usize, self.curves.len() as u32);
                    let draws = group.draws(seed, strand as u32, child);
                    self.draws.push(Draw { group: index as u32, offset: draws.offset, rank });
                    self.curves.push(CurveData {
                        base: 3 * first,
                        first,
                        count,
                        start: start as u32,
                        offset: [0.0; 3],
                        wave: draws.wave,
                        log_albedo: draws.log_albedo.into(),
                        tilt: draws.tilt,
                        bright: draws.bright,
                        grey: draws.grey,
                        has_colours: group.strands.colours.is_some().into(),
                        detail: 0.0,
                    });
                }
            }
        }
    }
}
