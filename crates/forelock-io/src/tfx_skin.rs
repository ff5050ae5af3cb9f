//! Skinning files of TressFX: `.tfxskin` of version 3 ties strands to triangles of a mesh,
//! `.tfxbone` of version 4 to bones. Read only.
//!
//! # Theory
//! A `.tfxskin` file has a header of 268 bytes: `u32` version (1), strands and triangles that have
//! roots (0: not counted, as AMD's exporter for Maya writes it), and at bytes 136 and 140 the
//! offsets of two arrays. The first has 24 bytes a strand: `u32` mesh, `u32` triangle, `f32[3]`
//! barycentric coordinates of the root, 4 unused bytes. The second, absent if its offset is 0, has
//! `f32[3]` a strand: texture coordinates of the root.
//!
//! A `.tfxbone` file is `i32 bones`, then for each `i32 index`, `i32 length` and a name of that
//! length with a NUL at its end; `i32 strands`, then for each `i32 index` and four pairs of `i32
//! bone` and `f32 weight`. Bones are named by their index.
//!
//! # Practice
//! Counts, references to bones and finiteness are checked. There may be fewer triangles with roots
//! than the header says, for some programs count all of the mesh. Neither file holds the mesh or
//! the skeleton, so triangles cannot be checked further.
//!
//! # Limitations
//! The index of a strand in a `.tfxbone` file is discarded: strands are in order. Names that are
//! not UTF-8 have replacement characters.

use std::collections::HashSet;

use bytemuck::{Pod, Zeroable};

use crate::{bytes::Bytes, error::FormatError};

/// The bones that a strand follows, at most.
pub const INFLUENCES: usize = 4;
/// How far from 1 a sum of weights may be.
const TOLERANCE: f32 = 1e-3;

/// What a skinning file ties strands to.
#[derive(Clone, Debug, PartialEq)]
pub enum Skinning {
    /// Triangles: a `.tfxskin` file.
    Triangles(TriangleSkin),
    /// Bones: a `.tfxbone` file.
    Bones(BoneSkin),
}

/// Strands tied to triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleSkin {
    /// The root of each strand, `[S]`.
    pub roots: Vec<TriangleRoot>,
    /// Texture coordinates of each root, `[S]`; the third is not used.
    pub root_uvs: Option<Vec<[f32; 3]>>,
}

/// The place of a strand's root on a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TriangleRoot {
    /// Index of the mesh.
    pub mesh: u32,
    /// Index of the triangle in the mesh.
    pub triangle: u32,
    /// Barycentric coordinates in the triangle; they should sum to 1.
    pub barycentric: [f32; 3],
    /// Not used by the format.
    pub reserved: u32,
}

/// Strands tied to bones.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneSkin {
    /// Index and name of each bone.
    pub bones: Vec<(i32, String)>,
    /// The bones of each strand and their weights, `[S]`; weight 0 is none.
    pub strands: Vec<[BoneWeight; INFLUENCES]>,
}

/// A bone of a strand.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BoneWeight {
    /// Index of the bone.
    pub bone: i32,
    /// Its share of the strand's motion; the shares of a strand should sum to 1.
    pub weight: f32,
}

impl TriangleSkin {
    /// The strands whose barycentric coordinates do not sum to 1, or are not in the triangle.
    pub fn outside(&self) -> usize {
        let is_inside = |root: &&TriangleRoot| {
            let own = root.barycentric;
            is_one(own.iter().sum()) && own.iter().all(|share| *share >= -TOLERANCE)
        };
        self.roots.len() - self.roots.iter().filter(is_inside).count()
    }
}

impl BoneSkin {
    /// The strands whose weights do not sum to 1.
    pub fn unbalanced(&self) -> usize {
        let sum = |strand: &&[BoneWeight; INFLUENCES]| is_one(strand.iter().map(|own| own.weight).sum());
        self.strands.len() - self.strands.iter().filter(sum).count()
    }
}

fn is_one(sum: f32) -> bool {
    (sum - 1.0).abs() <= TOLERANCE
}

/// Reads a `.tfxskin` file.
///
/// # Errors
/// [`FormatError`] if the version is not 1, an array extends beyond the bytes or is missing, the
/// roots are on more triangles than the header says, or a number is not finite.
pub fn read_triangles(bytes: &[u8]) -> Result<TriangleSkin, FormatError> {
    let start = Bytes::new(bytes, ".tfxskin");
    let [version, strands] = start.at(0).value::<[u32; 2]>("the fields of the header")?;
    if version != 1 {
        return Err(start
            .invalid(format!("version {version} is not supported (1 is), or this is not a .tfxskin file")));
    }
    let triangles = start.at(8).value::<u32>("the fields of the header")?;
    let [roots, root_uvs] = start.at(136).value::<[u32; 2]>("the fields of the header")?;
    if roots == 0 {
        return Err(start.at(136).invalid("the offset of the roots is 0, so the file has none"));
    }
    let (own, count) = (start.at(roots.into()), u64::from(strands));
    let roots: Vec<TriangleRoot> = start.at(roots.into()).array(count, "the roots")?;
    if let Some(strand) = roots.iter().position(|root| root.barycentric.iter().any(|x| !x.is_finite())) {
        let mut place = own.at(own.offset() + 24 * strand as u64 + 8);
        place.enter_strand(strand);
        return Err(place.invalid("its barycentric coordinates are not finite"));
    }
    let rooted: HashSet<[u32; 2]> = roots.iter().map(|root| [root.mesh, root.triangle]).collect();
    if triangles > 0 && rooted.len() > triangles as usize {
        let rooted = rooted.len();
        let words = format!("there should be roots on {triangles} triangles, but they are on {rooted}");
        return Err(start.at(8).invalid(words));
    }
    let place = start.at(root_uvs.into());
    let root_uvs: Option<Vec<[f32; 3]>> =
        if root_uvs == 0 { None } else { Some(start.at(root_uvs.into()).array(count, "the root UVs")?) };
    let lost = |uv: &[f32; 3]| uv.iter().any(|x| !x.is_finite());
    if let Some(strand) = root_uvs.iter().flatten().position(lost) {
        let mut place = place.at(place.offset() + 12 * strand as u64);
        place.enter_strand(strand);
        return Err(place.invalid("its texture coordinates are not finite"));
    }
    Ok(TriangleSkin { roots, root_uvs })
}

/// Reads a `.tfxbone` file.
///
/// # Errors
/// [`FormatError`] if a count is negative or larger than the remaining bytes allow, a name is
/// empty, a weight is not finite, or a strand follows a bone that is not there.
pub fn read_bones(bytes: &[u8]) -> Result<BoneSkin, FormatError> {
    let mut bytes = Bytes::new(bytes, ".tfxbone");
    let count = bytes.count("bones")?;
    let mut bones = Vec::new();
    for _ in 0..count {
        let index: i32 = bytes.value("the bones")?;
        let here = bytes.at(bytes.offset());
        let length = bytes.count("characters of a name")?;
        if length == 0 {
            return Err(here.invalid("a bone has a name of no characters, not even the NUL at its end"));
        }
        let name = bytes.take(length, 1, "the names of the bones")?;
        let name = name.split(|&byte| byte == 0).next().unwrap_or_default();
        bones.push((index, String::from_utf8_lossy(name).into_owned()));
    }
    let known: HashSet<i32> = bones.iter().map(|bone| bone.0).collect();
    let count = bytes.count("strands")?;
    let mut strands: Vec<[BoneWeight; INFLUENCES]> = Vec::new();
    for strand in 0..count {
        bytes.enter_strand(strand as usize);
        let _index: i32 = bytes.value("the bones of the strands")?;
        let here = bytes.at(bytes.offset());
        let own: [BoneWeight; INFLUENCES] = bytes.value("the bones of the strands")?;
        if own.iter().any(|pair| !pair.weight.is_finite()) {
            return Err(here.invalid("a weight is not finite"));
        }
        if let Some(pair) = own.iter().find(|pair| pair.weight != 0.0 && !known.contains(&pair.bone)) {
            return Err(here.invalid(format!("it follows bone {}, which the file does not have", pair.bone)));
        }
        strands.push(own);
    }
    Ok(BoneSkin { bones, strands })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(words: &[u32]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// Two strands on triangles 7 and 9.
    fn skin() -> Vec<u8> {
        let mut bytes = words(&[1, 2, 10]);
        bytes.resize(136, 0);
        bytes.extend(words(&[268, 316]));
        bytes.resize(268, 0);
        for triangle in [7, 9] {
            bytes.extend(words(&[0, triangle]));
            bytes.extend([0.5f32, 0.25, 0.25].iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 4]);
        }
        bytes.extend((0..6u8).flat_map(|i| f32::from(i).to_le_bytes()));
        bytes
    }

    /// Two bones and two strands, of which the second follows one bone.
    fn bones() -> Vec<u8> {
        let mut bytes = words(&[2]);
        for (index, name) in [(0, "root\0"), (1, "head\0")] {
            bytes.extend(words(&[index, 5]));
            bytes.extend(name.bytes());
        }
        bytes.extend(words(&[2]));
        for (strand, pairs) in [(0, [(0, 0.5f32), (1, 0.5)]), (1, [(1, 1.0), (0, 0.0)])] {
            bytes.extend(words(&[strand]));
            for (bone, weight) in pairs.into_iter().chain([(u32::MAX, 0.0); 2]) {
                bytes.extend(words(&[bone, weight.to_bits()]));
            }
        }
        bytes
    }

    #[test]
    fn triangles_are_read() {
        let own = read_triangles(&skin()).unwrap();
        let triangles: Vec<u32> = own.roots.iter().map(|root| root.triangle).collect();
        assert_eq!((&triangles[..], own.outside()), (&[7, 9][..], 0));
        assert_eq!(own.root_uvs.unwrap()[1], [3.0, 4.0, 5.0]);
        let mut uncounted = skin();
        uncounted[8] = 0;
        assert!(read_triangles(&uncounted).is_ok());
        let mut without = skin();
        without[140..144].fill(0);
        without[268 + 8..][..4].copy_from_slice(&0.9f32.to_le_bytes());
        let own = read_triangles(&without).unwrap();
        assert_eq!((own.root_uvs, own.roots.len()), (None, 2));
        assert_eq!(read_triangles(&without).unwrap().outside(), 1);
    }

    #[test]
    fn bones_are_read() {
        let own = read_bones(&bones()).unwrap();
        assert_eq!(own.bones, [(0, "root".to_owned()), (1, "head".to_owned())]);
        assert_eq!(own.strands[1][0], BoneWeight { bone: 1, weight: 1.0 });
        assert_eq!((own.strands.len(), own.unbalanced()), (2, 0));
        let mut heavy = bones();
        let last = heavy.len() - 4;
        heavy[last - 24..last - 20].copy_from_slice(&3.0f32.to_le_bytes());
        assert_eq!(read_bones(&heavy).unwrap().unbalanced(), 1);
    }

    #[test]
    fn damage_is_told_with_its_place() {
        for cut in 0..skin().len() {
            assert!(read_triangles(&skin()[..cut]).is_err());
        }
        for cut in 0..bones().len() {
            assert!(read_bones(&bones()[..cut]).is_err());
        }
        let nan = f32::NAN.to_le_bytes();
        let triangles = |at: usize, four: [u8; 4]| {
            let mut bytes = skin();
            bytes[at..at + 4].copy_from_slice(&four);
            read_triangles(&bytes).unwrap_err().to_string()
        };
        let spoilt = triangles(268 + 24 + 12, nan);
        assert!(spoilt.contains("byte 300, strand 1: its barycentric coordinates"), "{spoilt}");
        assert!(triangles(316 + 12, nan).contains("byte 328, strand 1: its texture coordinates"));
        assert!(triangles(0, [9, 0, 0, 0]).contains("version 9"));
        assert!(triangles(8, [1, 0, 0, 0]).contains("byte 8: there should be roots on 1 triangles"));
        assert!(triangles(4, [0xff; 4]).contains("the roots take 103079215080 bytes"));
        assert!(triangles(136, [0; 4]).contains("so the file has none"));
        assert!(triangles(136, [0xff; 4]).contains("are left"));
        let bones = |at: usize, four: [u8; 4]| {
            let mut bytes = bones();
            bytes[at..at + 4].copy_from_slice(&four);
            read_bones(&bytes).unwrap_err().to_string()
        };
        assert!(bones(0, [0xff; 4]).contains("the number of bones is -1"));
        assert!(bones(0, [0xff, 0xff, 0xff, 0x7f]).contains("byte"));
        assert!(bones(8, [0; 4]).contains("byte 8: a bone has a name of no characters"));
        assert!(bones(8, [0xff, 0xff, 0xff, 0x7f]).contains("the names of the bones take 2147483647 bytes"));
        assert!(bones(30, [0xff, 0xff, 0xff, 0x7f]).contains("strand 2"));
        assert!(bones(38, [5, 0, 0, 0]).contains("strand 0: it follows bone 5"));
        assert!(bones(42, nan).contains("byte 38, strand 0: a weight is not finite"));
    }
}
