//! Labels of strands: their identity, their group and the guides that they follow.
//!
//! # Theory
//! Production grooms carry them from program to program. The names are those of the attributes of
//! Unreal's schema for grooms (Epic Games, 'Alembic for Grooms Specification', version 1.5):
//!
//! | label | attribute |
//! | --- | --- |
//! | [`ids`](Labels::ids) | `groom_id` |
//! | [`group_ids`](Labels::group_ids) | `groom_group_id` |
//! | [`guides`](Labels::guides) | `groom_guide` |
//! | [`closest_guides`](Labels::closest_guides) | `groom_closest_guides` |
//! | [`guide_weights`](Labels::guide_weights) | `groom_guide_weights` |
//!
//! # Practice
//! Labels do not change how hair moves; they go with their strand through repairs, resampling,
//! edits and files. Guides are named by their ID, not by their place in the groom, so links stay
//! right when strands are removed or reordered. A strand that an edit adds has the labels of its
//! source and an ID of its own; the mirror image of a strand follows the mirror images of its
//! guides.
//!
//! # Limitations
//! A guide that was removed may still be named by the strands that followed it. The simulation
//! treats guides as strands among the others.

use std::collections::{HashMap, HashSet};

/// In [`Labels::closest_guides`]: no guide.
pub const NO_GUIDE: i32 = -1;

/// Labels of the strands of a [`Groom`](super::Groom). Each is absent or has one entry for each
/// strand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// The identity of the strand.
    pub ids: Option<Vec<i32>>,
    /// The group of the strand, which selects its material and physics in other programs.
    pub group_ids: Option<Vec<i32>>,
    /// Whether the strand is a guide.
    pub guides: Option<Vec<bool>>,
    /// The IDs of the guides that the strand follows; [`NO_GUIDE`] where it follows less than
    /// three.
    pub closest_guides: Option<Vec<[i32; 3]>>,
    /// The weights of these guides, without unit.
    pub guide_weights: Option<Vec<[f32; 3]>>,
}

/// Where the labels of a strand of an edited groom come from.
pub(super) struct Origin {
    /// The strand before the edit.
    pub source: usize,
    /// Whether the strand is new.
    pub is_new: bool,
    /// Whether it is new and made of one strand: its source, copied, mirrored or shifted.
    pub is_copy: bool,
}

impl Labels {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The name of each label and the number of its entries, if it is there.
    pub(super) fn lengths(&self) -> [(&'static str, Option<usize>); 5] {
        [
            ("ids", self.ids.as_ref().map(Vec::len)),
            ("group_ids", self.group_ids.as_ref().map(Vec::len)),
            ("guides", self.guides.as_ref().map(Vec::len)),
            ("closest_guides", self.closest_guides.as_ref().map(Vec::len)),
            ("guide_weights", self.guide_weights.as_ref().map(Vec::len)),
        ]
    }

    /// The labels of the strands `kept`, in that order.
    pub(super) fn only(&self, kept: &[usize]) -> Self {
        fn pick<T: Copy>(values: &Option<Vec<T>>, kept: &[usize]) -> Option<Vec<T>> {
            values.as_ref().map(|values| kept.iter().map(|&strand| values[strand]).collect())
        }
        Self {
            ids: pick(&self.ids, kept),
            group_ids: pick(&self.group_ids, kept),
            guides: pick(&self.guides, kept),
            closest_guides: pick(&self.closest_guides, kept),
            guide_weights: pick(&self.guide_weights, kept),
        }
    }

    /// The labels of an edited groom, whose strands come from `origins`. New strands get new IDs.
    pub(super) fn edited(&self, origins: &[Origin]) -> Self {
        let sources: Vec<usize> = origins.iter().map(|origin| origin.source).collect();
        let mut out = self.only(&sources);
        let (Some(before), Some(ids)) = (&self.ids, &mut out.ids) else { return out };
        let mut free = free_ids(before.iter().chain(guides_of(self)));
        let mut copies = HashMap::new();
        for (id, origin) in ids.iter_mut().zip(origins).filter(|(_, origin)| origin.is_new) {
            let source = *id;
            *id = free.next().unwrap_or(source);
            if origin.is_copy {
                copies.entry(source).or_insert(*id);
            }
        }
        let copied = out.closest_guides.iter_mut().flatten().zip(origins).filter(|(_, own)| own.is_copy);
        for guide in copied.flat_map(|(guides, _)| guides) {
            *guide = copies.get(guide).copied().unwrap_or(*guide);
        }
        out
    }

    /// The labels of several parts of a groom, one after the other, each with its number of
    /// strands. What one part has, all get: strands without an ID get a free one, and those without
    /// other labels are in group 0, no guides, and follow none.
    ///
    /// IDs that several parts use stay as they are: [`tell_apart`](Self::tell_apart) changes them.
    pub fn join(parts: &[(&Self, usize)]) -> Self {
        fn all<T: Copy>(
            parts: &[(&Labels, usize)],
            get: impl Fn(&Labels) -> Option<&Vec<T>>,
            mut missing: impl FnMut() -> T,
        ) -> Option<Vec<T>> {
            parts.iter().any(|(labels, _)| get(labels).is_some()).then(|| {
                let mut joined = Vec::new();
                for &(labels, strands) in parts {
                    match get(labels) {
                        Some(values) => joined.extend_from_slice(values),
                        None => joined.extend(std::iter::repeat_with(&mut missing).take(strands)),
                    }
                }
                joined
            })
        }
        let used = parts.iter().flat_map(|(own, _)| own.ids.iter().flatten().chain(guides_of(own)));
        let mut free = free_ids(used);
        Self {
            ids: all(parts, |labels| labels.ids.as_ref(), || free.next().unwrap_or_default()),
            group_ids: all(parts, |labels| labels.group_ids.as_ref(), || 0),
            guides: all(parts, |labels| labels.guides.as_ref(), || false),
            closest_guides: all(parts, |labels| labels.closest_guides.as_ref(), || [NO_GUIDE; 3]),
            guide_weights: all(parts, |labels| labels.guide_weights.as_ref(), || [0.0; 3]),
        }
    }
}

impl Labels {
    /// Gives the strands of each of `parts` new IDs if an earlier part uses some of its IDs for
    /// other strands, as files do that each number theirs from 0. Links to guides follow; those to
    /// guides that the part does not have lead to none of the others. Returns the parts that were
    /// changed.
    ///
    /// Parts whose IDs differ share one numbering: they may follow guides of each other.
    pub fn tell_apart(parts: &mut [&mut Self]) -> Vec<usize> {
        let used = parts.iter().flat_map(|own| own.ids.iter().flatten().chain(guides_of(own)));
        let used: HashSet<i32> = used.copied().collect();
        let mut free = free_ids(used.iter());
        let ids: HashSet<i32> = parts.iter().flat_map(|own| own.ids.iter().flatten()).copied().collect();
        let mut earlier = HashSet::new();
        let mut changed = Vec::new();
        for (index, own) in parts.iter_mut().enumerate() {
            let is_used = own.ids.iter().flatten().any(|id| earlier.contains(id));
            // Links of strands without IDs lead to none of their part.
            let leads_away = own.ids.is_none() && guides_of(own).any(|guide| ids.contains(guide));
            if is_used || leads_away {
                let mut renamed = HashMap::new();
                let guides = own.closest_guides.iter_mut().flat_map(|all| all.as_flattened_mut());
                let guides = guides.filter(|guide| **guide != NO_GUIDE);
                for id in own.ids.iter_mut().flatten().chain(guides) {
                    *id = *renamed.entry(*id).or_insert_with(|| free.next().unwrap_or_default());
                }
                changed.push(index);
            }
            earlier.extend(own.ids.iter().flatten().copied());
        }
        changed
    }
}

/// The IDs of the guides that strands follow, whether these guides are still there or not.
fn guides_of(labels: &Labels) -> impl Iterator<Item = &i32> {
    labels.closest_guides.iter().flatten().flatten()
}

/// The IDs that are not among `used`, first those above the largest.
fn free_ids<'a>(used: impl Iterator<Item = &'a i32>) -> impl Iterator<Item = i32> {
    let used: HashSet<i32> = used.copied().collect();
    let above = used.iter().max().map_or(0, |last| last.saturating_add(1)).max(0);
    (above..=i32::MAX).chain(0..above).chain(i32::MIN..0).filter(move |id| !used.contains(id))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> Labels {
        Labels {
            ids: Some(vec![4, 9, 6]),
            group_ids: Some(vec![1, 1, 2]),
            guides: Some(vec![true, false, false]),
            closest_guides: Some(vec![[NO_GUIDE; 3], [4, NO_GUIDE, NO_GUIDE], [4, 4, 4]]),
            guide_weights: Some(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.25, 0.25]]),
        }
    }

    /// Strands without IDs follow none of the guides of another part.
    #[test]
    fn links_without_ids_lead_to_no_other_part() {
        let (mut first, mut second) = (three(), Labels { ids: None, ..three() });
        assert_eq!(Labels::tell_apart(&mut [&mut first, &mut second]), [1]);
        assert_eq!(first, three());
        let ids = first.ids.iter().flatten();
        assert!(ids.clone().count() == 3 && ids.clone().all(|id| guides_of(&second).all(|own| own != id)));
        assert_eq!(second.closest_guides.unwrap()[0], [NO_GUIDE; 3]);
        // Links that lead to none of the others stay as they are.
        let mut alone = Labels { ids: None, ..three() };
        assert!(Labels::tell_apart(&mut [&mut alone, &mut Labels::default()]).is_empty());
    }

    /// What followed a guide that is gone follows none of the strands that are added later.
    #[test]
    fn ids_of_guides_that_are_gone_are_not_given_again() {
        let gone = Labels {
            ids: Some(vec![4, 6]),
            closest_guides: Some(vec![[NO_GUIDE; 3], [9, 4, NO_GUIDE]]),
            ..Labels::default()
        };
        let kept = |source| Origin { source, is_new: false, is_copy: false };
        let added = Origin { source: 0, is_new: true, is_copy: false };
        assert_eq!(gone.edited(&[kept(0), kept(1), added]).ids, Some(vec![4, 6, 10]));
        assert_eq!(Labels::join(&[(&gone, 2), (&Labels::default(), 1)]).ids, Some(vec![4, 6, 10]));
    }

    #[test]
    fn copies_have_ids_of_their_own_and_follow_the_copies_of_their_guides() {
        let kept = |source| Origin { source, is_new: false, is_copy: false };
        let copy = |source| Origin { source, is_new: true, is_copy: true };
        let mixed = Origin { source: 1, is_new: true, is_copy: false };
        let out = three().edited(&[kept(2), kept(1), copy(1), copy(0), mixed]);
        assert_eq!(out.ids, Some(vec![6, 9, 10, 11, 12]));
        assert_eq!(out.group_ids, Some(vec![2, 1, 1, 1, 1]));
        assert_eq!(out.guides, Some(vec![false, false, false, true, false]));
        let one = |guide| [guide, NO_GUIDE, NO_GUIDE];
        assert_eq!(out.closest_guides, Some(vec![[4; 3], one(4), one(11), [NO_GUIDE; 3], one(4)]));
    }

    #[test]
    fn ids_never_run_out_above_the_largest() {
        let free: Vec<i32> = free_ids([i32::MAX, 0, 2].iter()).take(3).collect();
        assert_eq!(free, [1, 3, 4]);
        assert_eq!(free_ids([-5].iter()).next(), Some(0));
    }

    /// Two files that number their strands alike: no strand follows a guide of the other file.
    #[test]
    fn parts_with_the_same_ids_are_told_apart() {
        let [mut a, mut b, mut c] = [three(), three(), three()];
        c.ids = Some(vec![100, 101, 102]);
        c.closest_guides = Some(vec![[4, 100, NO_GUIDE]; 3]);
        // A guide that is gone, and has the ID of a strand of the first part.
        b.ids = Some(vec![4, 8, 7]);
        b.closest_guides = Some(vec![[NO_GUIDE; 3], [4, NO_GUIDE, NO_GUIDE], [9, 4, 4]]);
        let before = [a.clone(), c.clone()];
        assert_eq!(Labels::tell_apart(&mut [&mut a, &mut b, &mut c]), [1]);
        assert_eq!([a, c], before);
        assert_eq!(b.ids, Some(vec![103, 104, 105]));
        let links = [[NO_GUIDE; 3], [103, NO_GUIDE, NO_GUIDE], [106, 103, 103]];
        assert_eq!(b.closest_guides, Some(links.into()));
        assert!(Labels::tell_apart(&mut [&mut three(), &mut Labels::default()]).is_empty());
    }

    #[test]
    fn parts_without_labels_get_some_when_they_are_joined() {
        let bare = Labels::default();
        let joined = Labels::join(&[(&bare, 1), (&three(), 3), (&bare, 1)]);
        assert_eq!(joined.ids, Some(vec![10, 4, 9, 6, 11]));
        assert_eq!(joined.group_ids, Some(vec![0, 1, 1, 2, 0]));
        assert_eq!(joined.guides, Some(vec![false, true, false, false, false]));
        assert_eq!(joined.closest_guides.unwrap()[4], [NO_GUIDE; 3]);
        assert_eq!(joined.guide_weights.unwrap()[0], [0.0; 3]);
        assert!(Labels::join(&[(&bare, 1), (&bare, 2)]).is_empty());
    }
}
