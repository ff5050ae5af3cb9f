//! Grooms: strands at rest in the scalp's space, as a file stores them, and the operations on them.

mod binding;
pub mod edit;
pub mod grow;
pub mod guides;
mod info;
mod labels;
mod lift;
mod nearest;
mod repair;
mod resample;
mod root_frames;
mod skinned_roots;
mod units;

use glam::Vec3;

pub use binding::{BindingReport, bind_roots};
pub use info::{Info, Spread, UnitGuess};
pub use labels::{Labels, NO_GUIDE};
pub use lift::{EDGE_DEPTH, LiftParams, LiftReport, lift_out};
pub use repair::{REPEATED_FRACTION, RepairReport, repair};
pub use resample::{ResampleError, resample, resample_to};
pub use root_frames::{
    COLLAPSED_TRIANGLE, FLAT_TRIANGLE, FrameBuffers, ROOT_FRAMES_WGSL, RootFrames, SURFACE_WGSL, SurfaceRoot,
    SurfaceRoots,
};
pub use skinned_roots::SkinnedRoots;
pub use units::{Import, Unit, UnknownWord, Up, ZUp};

/// The attachment of a strand's root: a triangle of the body's mesh and a point in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RootBinding {
    /// Index of the triangle in [`TriMesh::triangles`](crate::body::TriMesh::triangles).
    pub triangle: u32,
    /// Barycentric coordinates of the nearest point of that triangle; they sum to 1.
    pub barycentric: [f32; 3],
    /// Signed distance in metres from that point to the root; positive if the root is outside the
    /// body.
    pub distance: f32,
}

/// Strands at rest, root first, in metres, y up, in the scalp's space.
///
/// Strand `s` has the particles `strand_offsets[s]..strand_offsets[s + 1]`. Each optional attribute
/// is either absent or has one entry for each particle or each strand, as its documentation says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Groom {
    positions: Vec<Vec3>,
    strand_offsets: Vec<u32>,
    /// Width (diameter) of the hair in metres, one entry for each particle.
    pub widths: Option<Vec<f32>>,
    /// Linear RGB in 0–1, one entry for each particle.
    pub colours: Option<Vec<[f32; 3]>>,
    /// Transparency from 0 (opaque) to 1 (clear), one entry for each particle.
    pub transparencies: Option<Vec<f32>>,
    /// Texture coordinates of the root on the scalp, one entry for each strand.
    pub root_uvs: Option<Vec<[f32; 2]>>,
    /// Number of particles that are fixed at the root, one entry for each strand (TressFX: those
    /// with w = 0).
    pub pinned: Option<Vec<u16>>,
    /// Factor on the stiffness of the strand's springs, relative to the solver's parameters, one
    /// entry for each strand.
    pub stiffness: Option<Vec<f32>>,
    /// Root bindings, one entry for each strand.
    pub bindings: Option<Vec<RootBinding>>,
    /// Labels that other programs give strands: identity, group, guides.
    pub labels: Labels,
}

/// Length of `strand` along its edges, in the points' unit.
fn length(strand: &[Vec3]) -> f32 {
    strand.windows(2).map(|w| w[0].distance(w[1])).sum()
}

/// Arc length of `strand` (one point or more) from its root to each of its points, in the points'
/// unit. It is computed in float64, because a thousand additions would accumulate rounding errors.
pub fn arc_lengths(strand: &[Vec3]) -> Vec<f64> {
    let mut arc = 0.0;
    let mut arcs = Vec::with_capacity(strand.len());
    arcs.push(arc);
    for edge in strand.windows(2) {
        arc += f64::from(edge[0].distance(edge[1]));
        arcs.push(arc);
    }
    arcs
}

/// Why arrays do not form a groom.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GroomError {
    /// The offsets do not start at 0, decrease, or do not end at the number of particles.
    #[error("strand offsets are inconsistent at strand {strand}: {detail}")]
    Offsets {
        /// The first strand with an inconsistent offset.
        strand: usize,
        /// Description of the inconsistency.
        detail: String,
    },
    /// The number of an attribute's entries does not match the number of particles or strands.
    #[error("attribute `{name}` has {found} entries, but {expected} were expected")]
    AttributeLength {
        /// Name of the attribute's field.
        name: &'static str,
        /// Required number of entries.
        expected: usize,
        /// Number of entries found.
        found: usize,
    },
    /// More particles than 32-bit offsets can index.
    #[error("a groom of {0} particles exceeds the limit of 4,294,967,295")]
    TooManyParticles(usize),
}

impl Groom {
    /// Creates a groom from `positions` (`[P]`, metres, y up), which `strand_offsets` (`[S + 1]`,
    /// first 0, not decreasing, last P) splits into strands.
    ///
    /// Non-finite positions are accepted; [`repair`] removes and counts them.
    ///
    /// # Errors
    /// [`GroomError`] if the offsets do not describe the positions.
    pub fn new(positions: Vec<Vec3>, strand_offsets: Vec<u32>) -> Result<Self, GroomError> {
        if u32::try_from(positions.len()).is_err() {
            return Err(GroomError::TooManyParticles(positions.len()));
        }
        let fail = |strand: usize, detail: String| Err(GroomError::Offsets { strand, detail });
        match (strand_offsets.first(), strand_offsets.last()) {
            (Some(0), Some(&last)) if last as usize == positions.len() => {}
            (Some(0), Some(&last)) => {
                return fail(
                    strand_offsets.len() - 1,
                    format!("the last offset is {last}, but there are {} particles", positions.len()),
                );
            }
            _ => return fail(0, "the first offset must be 0".into()),
        }
        if let Some(strand) = strand_offsets.windows(2).position(|w| w[1] < w[0]) {
            return fail(
                strand,
                format!("{} is followed by {}", strand_offsets[strand], strand_offsets[strand + 1]),
            );
        }
        Ok(Self { positions, strand_offsets, ..Self::default() })
    }

    /// Creates a groom from a list of strands, each with the root first, in metres.
    ///
    /// # Errors
    /// [`GroomError::TooManyParticles`].
    pub fn from_strands<S: AsRef<[Vec3]>>(strands: impl IntoIterator<Item = S>) -> Result<Self, GroomError> {
        let mut positions = Vec::new();
        let mut offsets = vec![0u32];
        for strand in strands {
            positions.extend_from_slice(strand.as_ref());
            offsets.push(
                u32::try_from(positions.len()).map_err(|_| GroomError::TooManyParticles(positions.len()))?,
            );
        }
        Self::new(positions, offsets)
    }

    /// Checks that every attribute has the right number of entries.
    ///
    /// # Errors
    /// [`GroomError::AttributeLength`] for the first attribute that has not.
    pub fn check_attributes(&self) -> Result<(), GroomError> {
        let (particles, strands) = (self.particle_count(), self.strand_count());
        let lengths = [
            ("widths", self.widths.as_ref().map(Vec::len), particles),
            ("colours", self.colours.as_ref().map(Vec::len), particles),
            ("transparencies", self.transparencies.as_ref().map(Vec::len), particles),
            ("root_uvs", self.root_uvs.as_ref().map(Vec::len), strands),
            ("pinned", self.pinned.as_ref().map(Vec::len), strands),
            ("stiffness", self.stiffness.as_ref().map(Vec::len), strands),
            ("bindings", self.bindings.as_ref().map(Vec::len), strands),
        ];
        let labels = self.labels.lengths().map(|(name, found)| (name, found, strands));
        for (name, found, expected) in lengths.into_iter().chain(labels) {
            if let Some(found) = found.filter(|&found| found != expected) {
                return Err(GroomError::AttributeLength { name, expected, found });
            }
        }
        Ok(())
    }

    /// Number of strands, S.
    pub fn strand_count(&self) -> usize {
        self.strand_offsets.len().saturating_sub(1)
    }

    /// Number of particles, P.
    pub fn particle_count(&self) -> usize {
        self.positions.len()
    }

    /// All positions, `[P]`, metres.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// All positions, `[P]`, metres, for modification in place.
    pub fn positions_mut(&mut self) -> &mut [Vec3] {
        &mut self.positions
    }

    /// Offsets, `[S + 1]`.
    pub fn strand_offsets(&self) -> &[u32] {
        &self.strand_offsets
    }

    /// The particle indices of strand `strand`.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn range(&self, strand: usize) -> std::ops::Range<usize> {
        self.strand_offsets[strand] as usize..self.strand_offsets[strand + 1] as usize
    }

    /// The positions of strand `strand`, root first.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn strand(&self, strand: usize) -> &[Vec3] {
        &self.positions[self.range(strand)]
    }

    /// All strands in order.
    pub fn strands(&self) -> impl ExactSizeIterator<Item = &[Vec3]> {
        (0..self.strand_count()).map(|strand| self.strand(strand))
    }

    /// Length of strand `strand` along its particles, in metres.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn length(&self, strand: usize) -> f32 {
        length(self.strand(strand))
    }

    /// The strands for which `keep` returns true, in order, with all their attributes.
    #[must_use]
    pub fn select(&self, mut keep: impl FnMut(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.strand_count()).filter(|&strand| keep(strand)).collect();
        self.only(&kept)
    }

    /// The strands with the indices `kept`, in that order, with all their attributes. An index may
    /// occur repeatedly.
    ///
    /// # Panics
    /// If an index is out of range, or the result has more particles than 32-bit offsets can index.
    #[must_use]
    pub fn only(&self, kept: &[usize]) -> Self {
        let mut positions = Vec::with_capacity(kept.iter().map(|&s| self.range(s).len()).sum());
        let mut strand_offsets = Vec::with_capacity(kept.len() + 1);
        strand_offsets.push(0);
        for &strand in kept {
            positions.extend_from_slice(self.strand(strand));
            assert!(
                u32::try_from(positions.len()).is_ok(),
                "the selection has more particles than a groom can hold"
            );
            #[expect(clippy::cast_possible_truncation, reason = "checked by the assertion above")]
            strand_offsets.push(positions.len() as u32);
        }
        let per_particle = |range: usize| self.range(range);
        Self {
            positions,
            strand_offsets,
            widths: self.widths.as_ref().map(|a| gather(a, kept, per_particle)),
            colours: self.colours.as_ref().map(|a| gather(a, kept, per_particle)),
            transparencies: self.transparencies.as_ref().map(|a| gather(a, kept, per_particle)),
            root_uvs: self.root_uvs.as_ref().map(|a| gather(a, kept, |s| s..s + 1)),
            pinned: self.pinned.as_ref().map(|a| gather(a, kept, |s| s..s + 1)),
            stiffness: self.stiffness.as_ref().map(|a| gather(a, kept, |s| s..s + 1)),
            bindings: self.bindings.as_ref().map(|a| gather(a, kept, |s| s..s + 1)),
            labels: self.labels.only(kept),
        }
    }

    /// The strands of all `parts`, one after the other. Labels are joined by [`Labels::join`];
    /// another attribute is kept if all parts have it.
    ///
    /// # Errors
    /// [`GroomError`] if there are more particles than 32-bit offsets can index, or an attribute of
    /// a part has the wrong number of entries.
    pub fn join(parts: &[Self]) -> Result<Self, GroomError> {
        fn all<T: Copy>(parts: &[Groom], get: impl Fn(&Groom) -> Option<&Vec<T>>) -> Option<Vec<T>> {
            let parts: Option<Vec<&Vec<T>>> = parts.iter().map(get).collect();
            parts.map(|parts| parts.into_iter().flatten().copied().collect())
        }
        if parts.is_empty() {
            return Ok(Self::default());
        }
        parts.iter().try_for_each(Self::check_attributes)?;
        let mut joined = Self::from_strands(parts.iter().flat_map(Self::strands))?;
        joined.widths = all(parts, |g| g.widths.as_ref());
        joined.colours = all(parts, |g| g.colours.as_ref());
        joined.transparencies = all(parts, |g| g.transparencies.as_ref());
        joined.root_uvs = all(parts, |g| g.root_uvs.as_ref());
        joined.pinned = all(parts, |g| g.pinned.as_ref());
        joined.stiffness = all(parts, |g| g.stiffness.as_ref());
        joined.bindings = all(parts, |g| g.bindings.as_ref());
        let labels: Vec<(&Labels, usize)> = parts.iter().map(|g| (&g.labels, g.strand_count())).collect();
        joined.labels = Labels::join(&labels);
        Ok(joined)
    }
}

fn gather<T: Copy>(values: &[T], kept: &[usize], range: impl Fn(usize) -> std::ops::Range<usize>) -> Vec<T> {
    kept.iter().flat_map(|&strand| values[range(strand)].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inconsistent_offsets_are_refused() {
        let p = vec![Vec3::ZERO; 3];
        assert!(Groom::new(p.clone(), vec![0, 2, 3]).is_ok());
        for bad in [vec![], vec![1, 3], vec![0, 4], vec![0, 3, 2, 3]] {
            assert!(Groom::new(p.clone(), bad).is_err());
        }
    }

    #[test]
    fn select_keeps_attributes_aligned() {
        let strand = |x: f32| vec![Vec3::X * x, Vec3::X * (x + 1.0)];
        let mut groom = Groom::from_strands([strand(0.0), strand(10.0), strand(20.0)]).unwrap();
        groom.widths = Some(vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        groom.pinned = Some(vec![1, 2, 3]);
        groom.labels.ids = Some(vec![7, 8, 9]);
        let kept = groom.select(|s| s != 1);
        assert_eq!(kept.strand(1), groom.strand(2));
        assert_eq!(kept.widths, Some(vec![0.0, 1.0, 4.0, 5.0]));
        assert_eq!((&kept.pinned, &kept.labels.ids), (&Some(vec![1, 3]), &Some(vec![7, 9])));
        kept.check_attributes().unwrap();
        groom.labels.guides = Some(vec![true]);
        let error = groom.check_attributes().unwrap_err();
        assert_eq!(error, GroomError::AttributeLength { name: "guides", expected: 3, found: 1 });
    }

    #[test]
    fn joined_grooms_keep_the_attributes_that_all_have() {
        let strand = |x: f32| [Vec3::X * x, Vec3::X * (x + 1.0)];
        let mut a = Groom::from_strands([strand(0.0)]).unwrap();
        let mut b = Groom::from_strands([strand(1.0), strand(2.0)]).unwrap();
        a.pinned = Some(vec![1]);
        b.pinned = Some(vec![2, 3]);
        b.widths = Some(vec![0.1; 4]);
        b.labels.group_ids = Some(vec![5, 6]);
        let joined = Groom::join(&[a, b]).unwrap();
        assert_eq!(joined.strand_offsets(), [0, 2, 4, 6]);
        assert_eq!((&joined.pinned, &joined.widths), (&Some(vec![1, 2, 3]), &None));
        assert_eq!(joined.labels.group_ids, Some(vec![0, 5, 6]));
    }
}
