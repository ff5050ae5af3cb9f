//! The labels of strands in formats that have attributes with names: Alembic, USD, `.npz`.
//!
//! # Limitations
//! Numbers that do not fit into 32 bits are refused: a label that changed would name another
//! strand.

use forelock_core::groom::Labels;

/// The names of the labels behind a prefix: identity, group, guide, closest guides, their weights.
macro_rules! names {
    ($prefix:literal) => {
        [
            concat!($prefix, "groom_id"),
            concat!($prefix, "groom_group_id"),
            concat!($prefix, "groom_guide"),
            concat!($prefix, "groom_closest_guides"),
            concat!($prefix, "groom_guide_weights"),
        ]
    };
}

/// The names of the labels, as Unreal's schema has them.
pub(crate) const NAMES: [&str; 5] = names!("");
/// The same in USD.
pub(crate) const PRIMVARS: [&str; 5] = names!("primvars:");

/// Attributes of strands in a file.
pub(crate) trait Attributes {
    /// Why they cannot be read.
    type Error;

    /// N integers for each strand; none where there is no such attribute.
    fn integers<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[i64; N]>>, Self::Error>;

    /// N numbers for each strand; none where there is no such attribute.
    fn floats<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[f32; N]>>, Self::Error>;

    /// The error that `words` describe.
    fn invalid(&self, words: String) -> Self::Error;
}

/// The labels among `attributes` with `names`.
pub(crate) fn read<A: Attributes>(attributes: &mut A, names: [&str; 5]) -> Result<Labels, A::Error> {
    let [id, group, guide, closest, weights] = names;
    let guides = attributes.integers::<1>(guide)?;
    Ok(Labels {
        ids: single(attributes, id)?,
        group_ids: single(attributes, group)?,
        guides: guides.map(|guides| guides.iter().map(|[guide]| *guide != 0).collect()),
        closest_guides: narrow(attributes, closest)?,
        guide_weights: attributes.floats(weights)?,
    })
}

fn single<A: Attributes>(attributes: &mut A, name: &str) -> Result<Option<Vec<i32>>, A::Error> {
    Ok(narrow::<1, A>(attributes, name)?.map(|values| values.as_flattened().to_vec()))
}

/// The attribute `name` in 32 bits.
fn narrow<const N: usize, A: Attributes>(
    attributes: &mut A,
    name: &str,
) -> Result<Option<Vec<[i32; N]>>, A::Error> {
    let Some(values) = attributes.integers::<N>(name)? else { return Ok(None) };
    let narrow = |(strand, values): (usize, &[i64; N])| {
        let mut out = [0; N];
        for (out, &value) in out.iter_mut().zip(values) {
            *out = i32::try_from(value).map_err(|_| {
                format!(
                    "`{name}` of strand {strand} is {value}, but must be from {} to {}; number the strands \
                     anew, or export them without it",
                    i32::MIN,
                    i32::MAX
                )
            })?;
        }
        Ok(out)
    };
    let narrowed: Result<Vec<[i32; N]>, String> = values.iter().enumerate().map(narrow).collect();
    narrowed.map(Some).map_err(|words| attributes.invalid(words))
}
