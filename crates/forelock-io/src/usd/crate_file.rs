//! The tables of a crate file, the binary form of a layer.
//!
//! # Theory
//! The file begins with 88 bytes: `PXR-USDC`, the version (`u8[8]`, the first three count), the
//! offset of the table of contents (`i64`) and 64 unused bytes. The table of contents is a `u64`
//! count of sections, each with a name (`u8[16]`), an offset and a size (`i64`).
//!
//! | section | contents |
//! | --- | --- |
//! | `TOKENS` | `u64` count, `u64` bytes, then the words, each with a NUL, compressed |
//! | `STRINGS` | `u64` count, `u32` tokens |
//! | `FIELDS` | `u64` count, tokens of the names, then 8 bytes of value each |
//! | `FIELDSETS` | `u64` count, runs of fields, each ended by −1 |
//! | `PATHS` | `u64` paths, `u64` entries: paths, tokens of the last parts (negative: a property), jumps |
//! | `SPECS` | `u64` count: paths, first entries in `FIELDSETS`, kinds |
//!
//! The entries of `PATHS` are a tree, depth first. A jump of −2 is a leaf, −1 has only children, 0
//! only a sibling; others have children, and the sibling so many entries further.
//!
//! # Practice
//! [`open`] reads the tables; values are read when they are asked for, see
//! [`unpack`](Crate::unpack).
//!
//! # Limitations
//! Versions 0.4 to 0.12. Relationships, connections and variants are skipped.

use std::{
    io::{Read, Seek},
    rc::Rc,
};

use super::{
    UsdError,
    layer::Layer,
    source::{Cursor, Source},
};

/// What the file begins with.
pub(super) const MAGIC: &[u8; 8] = b"PXR-USDC";
/// The bytes before the first value.
pub(super) const BOOT_BYTES: u64 = 88;

/// The kinds of specs that are read or written.
pub(super) const ATTRIBUTE: u32 = 1;
pub(super) const PRIM: u32 = 6;
pub(super) const LAYER: u32 = 7;

/// The prims between the root and a property.
pub(super) const DEEPEST: u32 = 256;

/// An open crate file.
pub(super) struct Crate<R> {
    pub source: Source<R>,
    /// The second number of the version.
    pub minor: u8,
    pub tokens: Vec<Rc<str>>,
    pub strings: Vec<u32>,
}

/// An entry of the tree of paths.
#[derive(Clone, Copy)]
pub(super) struct Path {
    pub parent: Option<u32>,
    /// The number of parents.
    pub depth: u32,
    pub token: u32,
    pub is_property: bool,
}

/// The tables that describe specs.
pub(super) struct Tables {
    /// Names of the fields and their values.
    pub fields: Vec<(u32, u64)>,
    pub sets: Vec<u32>,
    pub paths: Vec<Option<Path>>,
    pub specs: Vec<Spec>,
    /// The offset of the table of contents, for errors.
    pub contents: u64,
}

/// The fields of a path.
pub(super) struct Spec {
    pub path: u32,
    pub set: u32,
    pub kind: u32,
}

/// Opens the crate file in `reader`.
pub(super) fn open<R: Read + Seek>(reader: R) -> Result<Layer<R>, UsdError> {
    let source = Source::new(reader)?;
    let mut boot = source.at(0);
    let magic: [u8; 8] = boot.value("the first bytes")?;
    if magic != *MAGIC {
        return Err(source.at(0).invalid("it does not begin with PXR-USDC"));
    }
    let version: [u8; 8] = boot.value("the version")?;
    if version[0] != 0 || !(4..=12).contains(&version[1]) {
        let words = format!(
            "version {}.{} of the format is not known (0.4 to 0.12 are); write the file again with another \
             version, or as .usda",
            version[0], version[1]
        );
        return Err(source.at(8).invalid(words));
    }
    let contents: u64 = boot.value("the offset of the table of contents")?;
    if contents < BOOT_BYTES {
        return Err(source
            .at(16)
            .invalid("there is no table of contents: the file was not completed; write it again"));
    }
    let sections = sections(&mut source.at(contents))?;
    let section = |name: &str| match sections.iter().find(|section| section.0 == name) {
        Some(section) => Ok(source.at(section.1)),
        None => Err(source.at(contents).invalid(format!("the section {name} is missing"))),
    };
    let tokens = tokens(&mut section("TOKENS")?)?;
    let mut cursor = section("STRINGS")?;
    let count: u64 = cursor.value("the strings")?;
    let strings = cursor.array(count, "the strings")?;
    let fields = fields(&mut section("FIELDS")?)?;
    let mut cursor = section("FIELDSETS")?;
    let count = cursor.count(8, "the sets of fields")?;
    let sets = cursor.indices(count, "the sets of fields")?;
    let paths = paths(&mut section("PATHS")?)?;
    let specs = specs(&mut section("SPECS")?)?;
    let tables = Tables { fields, sets, paths, specs, contents };
    let file = Crate { source, minor: version[1], tokens, strings };
    let metadata = tables.metadata(&file)?;
    let prims = tables.prims(&file)?;
    let size = file.source.size();
    Ok(Layer::new(metadata, prims, Some(file), size))
}

/// A section's name and offset.
struct Section(String, u64);

fn sections<R: Read + Seek>(cursor: &mut Cursor<'_, R>) -> Result<Vec<Section>, UsdError> {
    let count: u64 = cursor.value("the table of contents")?;
    let bytes = cursor.take(count, 32, "the table of contents")?;
    let section = |entry: &[u8; 32]| {
        let (name, place) = entry.split_at(16);
        let end = name.iter().position(|&b| b == 0).unwrap_or(16);
        let start = bytemuck::pod_read_unaligned(&place[..8]);
        Section(String::from_utf8_lossy(&name[..end]).into_owned(), start)
    };
    Ok(bytes.as_chunks().0.iter().map(section).collect())
}

fn tokens<R: Read + Seek>(cursor: &mut Cursor<'_, R>) -> Result<Vec<Rc<str>>, UsdError> {
    let count = cursor.count(1, "the tokens")?;
    let bytes = cursor.count(1, "the bytes of the tokens")?;
    let all = cursor.decompressed(bytes, "the tokens")?;
    let mut tokens: Vec<Rc<str>> =
        all.split(|&b| b == 0).map(|t| String::from_utf8_lossy(t).into()).collect();
    // After the last NUL nothing follows.
    tokens.pop();
    if tokens.len() != count {
        return Err(cursor.invalid(format!("there should be {count} tokens, but there are {}", tokens.len())));
    }
    Ok(tokens)
}

fn fields<R: Read + Seek>(cursor: &mut Cursor<'_, R>) -> Result<Vec<(u32, u64)>, UsdError> {
    let count = cursor.count(16, "the fields")?;
    let names = cursor.indices(count, "the names of the fields")?;
    let values = cursor.decompressed(count * 8, "the values of the fields")?;
    let values = values.as_chunks::<8>().0.iter().map(|&bytes| u64::from_le_bytes(bytes));
    Ok(names.into_iter().zip(values).collect())
}

fn specs<R: Read + Seek>(cursor: &mut Cursor<'_, R>) -> Result<Vec<Spec>, UsdError> {
    let count = cursor.count(24, "the specs")?;
    let paths = cursor.indices(count, "the paths of the specs")?;
    let sets = cursor.indices(count, "the fields of the specs")?;
    let kinds = cursor.indices(count, "the kinds of the specs")?;
    let specs = paths.into_iter().zip(sets).zip(kinds);
    Ok(specs.map(|((path, set), kind)| Spec { path, set, kind }).collect())
}

fn paths<R: Read + Seek>(cursor: &mut Cursor<'_, R>) -> Result<Vec<Option<Path>>, UsdError> {
    let all = cursor.count(16, "the paths")?;
    let count = cursor.count(24, "the entries of the paths")?;
    let numbers = cursor.indices(count, "the numbers of the paths")?;
    let tokens = cursor.integers(count, 4, "the names of the paths")?;
    let jumps = cursor.integers(count, 4, "the jumps of the paths")?;
    let mut paths = vec![None; all];
    let mut subtrees = if count == 0 { vec![] } else { vec![(0usize, None, 0)] };
    while let Some((mut entry, mut parent, mut depth)) = subtrees.pop() {
        loop {
            let number = numbers.get(entry).copied();
            let slot = number.and_then(|n| paths.get_mut(n as usize));
            // A path that occurs twice would make a loop.
            let Some(slot) = slot.filter(|slot| slot.is_none()) else {
                return Err(
                    cursor.invalid(format!("entry {entry} of the paths does not belong to their tree"))
                );
            };
            let is_property = tokens[entry] < 0;
            #[expect(clippy::cast_possible_truncation, reason = "the numbers have 4 bytes")]
            let token = tokens[entry].unsigned_abs() as u32;
            *slot = Some(Path { parent, depth, token, is_property });
            let jump = jumps[entry];
            if jump < -1 {
                break;
            }
            if jump > 0 {
                let sibling = usize::try_from(jump).map_or(usize::MAX, |jump| entry.saturating_add(jump));
                subtrees.push((sibling, parent, depth));
            }
            if jump != 0 {
                (parent, depth) = (number, depth + 1);
            }
            if depth > DEEPEST {
                return Err(cursor.invalid(format!("prims are nested deeper than {DEEPEST}")));
            }
            entry += 1;
        }
    }
    Ok(paths)
}
