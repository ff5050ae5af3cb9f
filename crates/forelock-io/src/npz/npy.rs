//! One array in NumPy's `.npy` layout (NEP 1): magic, version, a Python dictionary as text, then
//! the elements.

use std::borrow::Cow;

use crate::error::{FormatError, Problem};

/// The most bytes that are read to find a header. The headers that NumPy writes take 128 bytes.
pub(super) const HEADER_LIMIT: u64 = 1 << 16;
/// The length in bytes of the headers written here. Every shape with up to three dimensions fits,
/// so the number of frames can be changed later without moving the data.
pub(super) const HEADER_BYTES: usize = 128;

/// The elements of an [`Array`].
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// float32.
    F32(Vec<f32>),
    /// float64.
    F64(Vec<f64>),
    /// uint8. The reader also converts bool to it.
    U8(Vec<u8>),
    /// uint32. The reader also converts uint16 to it.
    U32(Vec<u32>),
    /// uint64.
    U64(Vec<u64>),
    /// int32. The reader also converts int8 and int16 to it.
    I32(Vec<i32>),
    /// int64.
    I64(Vec<i64>),
}

/// A NumPy array in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// The length of each axis. Their product is the number of elements.
    pub shape: Vec<usize>,
    /// The elements, with the last axis varying fastest.
    pub data: Data,
}

macro_rules! from_vec {
    ($($element:ty => $variant:ident),*) => {$(
        impl From<Vec<$element>> for Data {
            fn from(values: Vec<$element>) -> Self {
                Self::$variant(values)
            }
        }
    )*};
}
from_vec!(f32 => F32, f64 => F64, u8 => U8, u32 => U32, u64 => U64, i32 => I32, i64 => I64);

impl Data {
    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::F32(v) => bytemuck::cast_slice(v),
            Self::F64(v) => bytemuck::cast_slice(v),
            Self::U8(v) => v,
            Self::U32(v) => bytemuck::cast_slice(v),
            Self::U64(v) => bytemuck::cast_slice(v),
            Self::I32(v) => bytemuck::cast_slice(v),
            Self::I64(v) => bytemuck::cast_slice(v),
        }
    }

    fn descr(&self) -> &'static str {
        match self {
            Self::F32(_) => "<f4",
            Self::F64(_) => "<f8",
            Self::U8(_) => "|u1",
            Self::U32(_) => "<u4",
            Self::U64(_) => "<u8",
            Self::I32(_) => "<i4",
            Self::I64(_) => "<i8",
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::U8(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::U64(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::I64(v) => v.len(),
        }
    }
}

impl Array {
    /// An array of `shape` with the elements `data`; `None` if their numbers differ.
    pub fn new(shape: &[usize], data: impl Into<Data>) -> Option<Self> {
        let data = data.into();
        (element_count(shape) == Some(data.len())).then(|| Self { shape: shape.to_vec(), data })
    }

    /// A one-dimensional array.
    pub fn vector(data: impl Into<Data>) -> Self {
        let data = data.into();
        Self { shape: vec![data.len()], data }
    }

    /// The elements as float32, if they are floats.
    pub fn floats(&self) -> Option<Cow<'_, [f32]>> {
        match &self.data {
            Data::F32(v) => Some(v.into()),
            #[expect(clippy::cast_possible_truncation, reason = "positions are stored as float32")]
            Data::F64(v) => Some(v.iter().map(|&x| x as f32).collect()),
            _ => None,
        }
    }

    /// The elements as uint32, if they are integers in its range.
    pub fn counts(&self) -> Option<Cow<'_, [u32]>> {
        match &self.data {
            Data::U32(v) => Some(v.into()),
            Data::U8(v) => Some(v.iter().map(|&x| x.into()).collect()),
            Data::U64(v) => v.iter().map(|&x| x.try_into().ok()).collect(),
            Data::I32(v) => v.iter().map(|&x| x.try_into().ok()).collect(),
            Data::I64(v) => v.iter().map(|&x| x.try_into().ok()).collect(),
            Data::F32(_) | Data::F64(_) => None,
        }
    }

    /// The elements as int64, if they are integers in its range.
    pub fn integers(&self) -> Option<Cow<'_, [i64]>> {
        match &self.data {
            Data::I64(v) => Some(v.into()),
            Data::U8(v) => Some(v.iter().map(|&x| x.into()).collect()),
            Data::I32(v) => Some(v.iter().map(|&x| x.into()).collect()),
            Data::U32(v) => Some(v.iter().map(|&x| x.into()).collect()),
            Data::U64(v) => v.iter().map(|&x| x.try_into().ok()).collect(),
            Data::F32(_) | Data::F64(_) => None,
        }
    }

    /// The bytes of a `.npy` file with this array.
    pub(super) fn to_npy(&self) -> Vec<u8> {
        [self.npy_header().as_slice(), self.data.bytes()].concat()
    }

    /// The header of that file.
    pub(super) fn npy_header(&self) -> Vec<u8> {
        header(self.data.descr(), &self.shape)
    }

    /// Reads the array in `npy`, the bytes of a `.npy` file.
    pub(super) fn from_npy(npy: &[u8]) -> Result<Self, FormatError> {
        let header = Header::parse(npy)?;
        let bytes = npy.get(header.at..).unwrap_or_default();
        let needed = header.byte_count()?;
        let bytes = usize::try_from(needed).ok().and_then(|n| bytes.get(..n)).ok_or_else(|| {
            error(header.at, Problem::Short { what: "the elements", needed, left: bytes.len() as u64 })
        })?;
        let data = if header.fortran_order && header.shape.len() > 1 {
            header.decode(&to_c_order(bytes, header.item_bytes, &header.shape))
        } else {
            header.decode(bytes)
        };
        Ok(Self { shape: header.shape, data })
    }
}

/// The number of elements of `shape`, unless it overflows.
pub(super) fn element_count(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1usize, |product, &n| product.checked_mul(n))
}

/// The header of a `.npy` file. It takes `HEADER_BYTES` bytes for up to three dimensions.
pub(super) fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}", sizes.join(", "));
    let length = (10 + text.len() + 1).next_multiple_of(64).max(HEADER_BYTES);
    text.extend(std::iter::repeat_n(' ', length - 11 - text.len()));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    #[expect(clippy::cast_possible_truncation, reason = "no array has thousands of dimensions")]
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

/// The header of a `.npy` file.
#[derive(Clone, Debug)]
pub(super) struct Header {
    kind: u8,
    swapped: bool,
    pub item_bytes: usize,
    fortran_order: bool,
    pub shape: Vec<usize>,
    /// The offset of the elements.
    pub at: usize,
}

fn error(offset: usize, problem: Problem) -> FormatError {
    FormatError { format: ".npy array in the .npz", offset: offset as u64, strand: None, problem }
}

fn invalid(offset: usize, words: impl Into<String>) -> FormatError {
    error(offset, Problem::Invalid(words.into()))
}

impl Header {
    /// Reads the header at the start of a `.npy` file.
    pub fn parse(npy: &[u8]) -> Result<Self, FormatError> {
        let length = match npy {
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => {
                Some((10usize, usize::from(u16::from_le_bytes([*a, *b]))))
            }
            [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d, ..] => {
                Some((12, u32::from_le_bytes([*a, *b, *c, *d]) as usize))
            }
            _ => None,
        };
        let (start, length) = length.ok_or_else(|| invalid(0, "it does not start as a NumPy array does"))?;
        let text = start.checked_add(length).and_then(|end| npy.get(start..end));
        let text = text.and_then(|text| std::str::from_utf8(text).ok());
        let text = text.ok_or_else(|| invalid(8, "its header is cut short or not text"))?;
        Self::from_text(text, start + length).ok_or_else(|| {
            let shown: String = text.trim().chars().take(120).collect();
            invalid(
                start,
                format!(
                    "its header `{shown}` does not describe float32, float64 or integer elements; save it \
                     as float32"
                ),
            )
        })
    }

    fn from_text(text: &str, at: usize) -> Option<Self> {
        let after = |key: &str| {
            let quoted = [format!("'{key}':"), format!("\"{key}\":")];
            let found = quoted.iter().find_map(|key| text.split_once(key.as_str()));
            found.map(|(_, value)| value.trim_start())
        };
        let descr = after("descr")?.strip_prefix(['\'', '"'])?.split(['\'', '"']).next()?.as_bytes();
        let (&order, kind) = descr.split_first()?;
        let (kind, item_bytes) = match kind {
            b"f4" => (b'f', 4),
            b"f8" => (b'f', 8),
            b"u1" | b"b1" => (b'u', 1),
            b"u2" => (b'u', 2),
            b"i1" => (b'i', 1),
            b"i2" => (b'i', 2),
            b"u4" => (b'u', 4),
            b"u8" => (b'u', 8),
            b"i4" => (b'i', 4),
            b"i8" => (b'i', 8),
            _ => return None,
        };
        let shape = after("shape")?.strip_prefix('(')?.split_once(')')?.0;
        let sizes = shape.split(',').map(str::trim).filter(|size| !size.is_empty());
        Some(Self {
            kind,
            swapped: match order {
                b'<' | b'|' | b'=' => false,
                b'>' => true,
                _ => return None,
            },
            item_bytes,
            fortran_order: after("fortran_order")?.starts_with("True"),
            shape: sizes.map(|size| size.trim_end_matches('L').parse().ok()).collect::<Option<_>>()?,
            at,
        })
    }

    /// The size of the elements in bytes.
    pub fn byte_count(&self) -> Result<u64, FormatError> {
        let bytes = element_count(&self.shape).and_then(|n| n.checked_mul(self.item_bytes));
        bytes
            .map(|n| n as u64)
            .ok_or_else(|| invalid(0, format!("its shape {:?} is larger than any file", self.shape)))
    }

    /// Whether the elements are float32 or float64, with each frame contiguous.
    pub fn has_frames(&self) -> bool {
        self.kind == b'f' && !self.fortran_order
    }

    /// The elements in `bytes`, in the same order.
    pub fn decode(&self, bytes: &[u8]) -> Data {
        let swapped: Vec<u8>;
        let bytes = if self.swapped {
            swapped =
                bytes.chunks_exact(self.item_bytes).flat_map(|item| item.iter().rev().copied()).collect();
            &swapped
        } else {
            bytes
        };
        match (self.kind, self.item_bytes) {
            (b'f', 4) => Data::F32(bytemuck::pod_collect_to_vec(bytes)),
            (b'f', _) => Data::F64(bytemuck::pod_collect_to_vec(bytes)),
            (b'u', 2) => {
                Data::U32(bytes.as_chunks().0.iter().map(|&b| u16::from_le_bytes(b).into()).collect())
            }
            (b'i', 1) => Data::I32(bytes.iter().map(|&b| i8::from_le_bytes([b]).into()).collect()),
            (b'i', 2) => {
                Data::I32(bytes.as_chunks().0.iter().map(|&b| i16::from_le_bytes(b).into()).collect())
            }
            (b'u', 4) => Data::U32(bytemuck::pod_collect_to_vec(bytes)),
            (b'u', 8) => Data::U64(bytemuck::pod_collect_to_vec(bytes)),
            (b'i', 4) => Data::I32(bytemuck::pod_collect_to_vec(bytes)),
            (b'i', _) => Data::I64(bytemuck::pod_collect_to_vec(bytes)),
            _ => Data::U8(bytes.to_vec()),
        }
    }
}

/// Reorders the items of an array whose first axis varies fastest, so that the last axis does.
fn to_c_order(bytes: &[u8], item: usize, shape: &[usize]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    let mut index = vec![0usize; shape.len()];
    for _ in 0..bytes.len() / item {
        let at = index.iter().zip(shape).rev().fold(0, |at, (&i, &n)| at * n + i);
        out.extend_from_slice(&bytes[at * item..(at + 1) * item]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_integers_are_widened() {
        for (descr, bytes, wanted) in [
            ("|i1", vec![1, 0xff, 7], Data::I32(vec![1, -1, 7])),
            ("<i2", vec![1, 0, 0xfe, 0xff, 0, 1], Data::I32(vec![1, -2, 256])),
            (">i2", vec![0, 1, 0xff, 0xfe, 1, 0], Data::I32(vec![1, -2, 256])),
            ("<u2", vec![1, 0, 0xfe, 0xff, 0, 1], Data::U32(vec![1, 65_534, 256])),
        ] {
            let npy = [header(descr, &[3]), bytes].concat();
            assert_eq!(Array::from_npy(&npy).unwrap().data, wanted, "{descr}");
        }
    }
}
