//! The numbers of a file: buffers, and accessors into them.

use std::path::Path;

use ::gltf::accessor::{DataType, Dimensions, sparse::IndexType};
use ::gltf::buffer::{Source, View};
use ::gltf::{Accessor, Document};
use base64::Engine as _;

/// The buffers of a file.
pub struct Buffers(Vec<Vec<u8>>);

impl Buffers {
    /// The buffers of `document`: its binary chunk `blob`, or read from files in `folder`.
    pub fn load(document: &Document, mut blob: Option<Vec<u8>>, folder: &Path) -> Result<Self, String> {
        let buffer = |buffer: ::gltf::Buffer<'_>| {
            let name = format!("buffer {}", buffer.index());
            let bytes = match buffer.source() {
                Source::Bin => blob.take().ok_or_else(|| format!("{name}: the file has no binary chunk"))?,
                Source::Uri(uri) if uri.starts_with("data:") => {
                    let data = uri.split_once(";base64,").map(|parts| parts.1);
                    let data = data.ok_or_else(|| format!("{name}: its data URI is not in base 64"))?;
                    let decoded = base64::engine::general_purpose::STANDARD.decode(data);
                    decoded.map_err(|error| format!("{name}: its data URI is not in base 64: {error}"))?
                }
                Source::Uri(uri) => {
                    let path = folder.join(percent_decoded(uri));
                    // Not from a device or pipe, which may have no end.
                    crate::read_bytes(&path)
                        .map_err(|error| format!("{name}: {error}; keep the files of a .gltf together"))?
                }
            };
            if bytes.len() < buffer.length() {
                let (length, found) = (buffer.length(), bytes.len());
                return Err(format!("{name} has {length} bytes by its header, but {found} are there"));
            }
            Ok(bytes)
        };
        document.buffers().map(buffer).collect::<Result<_, _>>().map(Self)
    }

    /// The bytes of `view` from `offset` on.
    fn view(&self, view: &View<'_>, offset: usize) -> Option<&[u8]> {
        let end = view.offset().checked_add(view.length())?;
        self.0[view.buffer().index()].get(view.offset()..end)?.get(offset..)
    }

    /// The numbers of `accessor`, `width` an entry; integers are as in the file, or between −1 and
    /// 1 if they are normalised.
    pub fn floats(&self, accessor: &Accessor<'_>, width: usize) -> Result<Vec<f32>, String> {
        let name = format!("accessor {}", accessor.index());
        let found = components(accessor.dimensions());
        if found != width {
            return Err(format!("{name} has {found} numbers an entry where {width} are expected"));
        }
        let (data_type, is_normalised) = (accessor.data_type(), accessor.normalized());
        let mut numbers = match accessor.view() {
            Some(view) => self.read(accessor, &view, width, Packed::read)?,
            // Zeros: what they belong to, vertices or times, has 4 bytes an entry in the buffers.
            None if accessor.count() <= self.0.iter().map(Vec::len).sum::<usize>() / 4 => {
                vec![0.0; accessor.count() * width]
            }
            None => return Err(format!("{name} has {} entries, but no buffer view", accessor.count())),
        };
        if let Some(sparse) = accessor.sparse() {
            let short = || format!("{name}: its sparse values are more than their buffer view");
            let (indices, values) = (sparse.indices(), sparse.values());
            let count = sparse.count();
            let index_type = match indices.index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            };
            let of = |data_type: DataType, width: usize, is_normalised: bool| {
                let stride = width * data_type.size();
                Packed { data_type, is_normalised, width, stride, count }
            };
            let bytes = self.view(&indices.view(), indices.offset()).unwrap_or_default();
            let at = of(index_type, 1, false).read_integers(bytes).ok_or_else(short)?;
            let bytes = self.view(&values.view(), values.offset()).unwrap_or_default();
            let new = of(data_type, width, is_normalised).read(bytes).ok_or_else(short)?;
            for (at, new) in at.into_iter().zip(new.chunks_exact(width)) {
                let place = (at as usize).checked_mul(width).and_then(|at| numbers.get_mut(at..at + width));
                place.ok_or_else(|| format!("{name}: sparse index {at} is beyond it"))?.copy_from_slice(new);
            }
        }
        Ok(numbers)
    }

    /// The numbers of `accessor` as whole numbers.
    pub fn integers(&self, accessor: &Accessor<'_>, width: usize) -> Result<Vec<u32>, String> {
        let name = format!("accessor {}", accessor.index());
        let (found, data_type) = (components(accessor.dimensions()), accessor.data_type());
        if found != width || !matches!(data_type, DataType::U8 | DataType::U16 | DataType::U32) {
            return Err(format!(
                "{name} has {found} numbers of type {data_type:?} an entry where {width} whole ones are \
                 expected"
            ));
        }
        if accessor.sparse().is_some() {
            return Err(format!("{name}: sparse whole numbers cannot be read; export the file without"));
        }
        let view = accessor.view().ok_or_else(|| format!("{name} has no buffer view"))?;
        self.read(accessor, &view, width, Packed::read_integers)
    }

    /// The entries of `accessor` in `view` as `read` reads them, `width` numbers each.
    fn read<T>(
        &self,
        accessor: &Accessor<'_>,
        view: &View<'_>,
        width: usize,
        read: impl Fn(&Packed, &[u8]) -> Option<Vec<T>>,
    ) -> Result<Vec<T>, String> {
        let (data_type, count) = (accessor.data_type(), accessor.count());
        let stride = view.stride().unwrap_or(width * data_type.size()).max(1);
        let own = Packed { data_type, is_normalised: accessor.normalized(), width, stride, count };
        read(&own, self.view(view, accessor.offset()).unwrap_or_default()).ok_or_else(|| {
            let name = format!("accessor {}", accessor.index());
            format!("{name} has {count} entries of {stride} bytes, more than its buffer view")
        })
    }
}

/// Numbers in bytes.
#[derive(Clone, Copy)]
struct Packed {
    data_type: DataType,
    is_normalised: bool,
    /// Numbers an entry.
    width: usize,
    /// Bytes from an entry to the next.
    stride: usize,
    /// Entries.
    count: usize,
}

impl Packed {
    /// The entries as slices of bytes; none if `bytes` are too few.
    fn entries<'a>(&self, bytes: &'a [u8]) -> Option<impl Iterator<Item = &'a [u8]> + use<'a>> {
        let (size, stride, count) = (self.width * self.data_type.size(), self.stride, self.count);
        let last =
            count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size))?;
        (last <= bytes.len()).then(|| (0..count).map(move |entry| &bytes[entry * stride..][..size]))
    }

    fn read(&self, bytes: &[u8]) -> Option<Vec<f32>> {
        let scaled = |x: f32, most: f32| if self.is_normalised { (x / most).max(-1.0) } else { x };
        let number = |b: &[u8]| match self.data_type {
            DataType::I8 => scaled(f32::from(b[0].cast_signed()), 127.0),
            DataType::U8 => scaled(f32::from(b[0]), 255.0),
            DataType::I16 => scaled(f32::from(i16::from_le_bytes([b[0], b[1]])), 32767.0),
            DataType::U16 => scaled(f32::from(u16::from_le_bytes([b[0], b[1]])), 65535.0),
            DataType::U32 => scaled(u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32, u32::MAX as f32),
            DataType::F32 => f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        };
        let size = self.data_type.size();
        Some(self.entries(bytes)?.flat_map(|entry| entry.chunks_exact(size)).map(number).collect())
    }

    fn read_integers(&self, bytes: &[u8]) -> Option<Vec<u32>> {
        let number = |b: &[u8]| match self.data_type {
            DataType::U16 | DataType::I16 => u16::from_le_bytes([b[0], b[1]]).into(),
            DataType::U32 | DataType::F32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            DataType::U8 | DataType::I8 => b[0].into(),
        };
        let size = self.data_type.size();
        Some(self.entries(bytes)?.flat_map(|entry| entry.chunks_exact(size)).map(number).collect())
    }
}

fn components(dimensions: Dimensions) -> usize {
    dimensions.multiplicity()
}

/// `uri` with `%xx` replaced by the byte of that number.
fn percent_decoded(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let (mut out, mut at) = (Vec::with_capacity(bytes.len()), 0);
    while at < bytes.len() {
        let code = uri.get(at + 1..at + 3).filter(|_| bytes[at] == b'%');
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => (out.push(byte), at += 3).0,
            None => (out.push(bytes[at]), at += 1).0,
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_in_names_are_decoded() {
        assert_eq!(percent_decoded("a%20b%C3%A9.bin"), "a bé.bin");
        assert_eq!(percent_decoded("100%"), "100%");
        assert_eq!(percent_decoded("%zz%4"), "%zz%4");
    }

    #[test]
    fn numbers_are_read_with_their_stride() {
        let own = Packed { data_type: DataType::U16, is_normalised: true, width: 1, stride: 3, count: 2 };
        assert_eq!(own.read(&[255, 255, 9, 0, 0]).unwrap(), [1.0, 0.0]);
        assert!(own.read(&[255, 255, 9, 0]).is_none());
        let huge = Packed { count: usize::MAX, ..own };
        assert!(huge.read(&[0; 8]).is_none());
    }
}
