//! The compression of crate files: LZ4 blocks, and integers coded as differences.
//!
//! # Theory
//! A compressed buffer is one byte, the number of chunks, and the chunks. 0 stands for one chunk
//! without its size; otherwise an `i32` size precedes each. A chunk is an
//! [LZ4 block](https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md).
//!
//! Integers of 4 (8) bytes are stored as differences to the integer before, the first to 0. After
//! the most common difference there are two bits for each integer, lowest bits first: 0 the most
//! common difference, 1, 2 and 3 a difference of 1, 2 and 4 (2, 4 and 8) bytes in the array that
//! follows. All of it is one compressed buffer.
//!
//! # Practice
//! The writer makes valid buffers that are not compressed: LZ4 blocks of literals, and differences
//! of four bytes. It uses them for the tables of a file, which take some kilobytes.
//!
//! # Limitations
//! What is decompressed must not exceed the limit that the caller gives.

/// Decompresses `buffer` to at most `limit` bytes. The error is a sentence.
pub(super) fn decompress(buffer: &[u8], limit: usize) -> Result<Vec<u8>, String> {
    let Some((&chunks, mut rest)) = buffer.split_first() else { return Err("it is empty".into()) };
    let mut out = Vec::new();
    if chunks == 0 {
        lz4_block(rest, limit, &mut out)?;
    }
    for _ in 0..chunks {
        let (size, data) = rest.split_first_chunk::<4>().ok_or("a chunk is missing")?;
        let size = usize::try_from(i32::from_le_bytes(*size)).map_err(|_| "a chunk has a negative size")?;
        let (chunk, after) = data.split_at_checked(size).ok_or("a chunk is cut short")?;
        lz4_block(chunk, limit, &mut out)?;
        rest = after;
    }
    Ok(out)
}

/// Appends the contents of one LZ4 block to `out`, which must not exceed `limit` bytes.
fn lz4_block(block: &[u8], limit: usize, out: &mut Vec<u8>) -> Result<(), String> {
    const CUT: &str = "an LZ4 block is cut short";
    let start = out.len();
    let mut rest = block;
    let mut next = |count: usize| -> Result<&[u8], &str> {
        let (taken, after) = rest.split_at_checked(count).ok_or(CUT)?;
        rest = after;
        Ok(taken)
    };
    loop {
        let token = next(1)?[0];
        let mut literals = usize::from(token >> 4);
        if literals == 15 {
            literals += extension(&mut next)?;
        }
        let literals = next(literals)?;
        if out.len() + literals.len() > limit {
            return Err(format!("it holds more than the {limit} bytes that it should"));
        }
        out.extend_from_slice(literals);
        // The last sequence has no match.
        let Ok(offset) = next(2) else { return Ok(()) };
        let offset = usize::from(u16::from_le_bytes([offset[0], offset[1]]));
        let mut length = usize::from(token & 15) + 4;
        if length == 19 {
            length += extension(&mut next)?;
        }
        if offset == 0 || offset > out.len() - start {
            return Err("an LZ4 match refers to bytes before its block".into());
        }
        if length > limit.saturating_sub(out.len()) {
            return Err(format!("it holds more than the {limit} bytes that it should"));
        }
        // The match may overlap the bytes that it makes.
        for at in out.len() - offset..out.len() - offset + length {
            out.push(out[at]);
        }
    }
}

/// The bytes that extend a length: 255 until the last.
fn extension<'a>(next: &mut impl FnMut(usize) -> Result<&'a [u8], &'static str>) -> Result<usize, String> {
    let mut sum = 0;
    loop {
        let byte = next(1)?[0];
        sum += usize::from(byte);
        if byte != 255 {
            return Ok(sum);
        }
    }
}

/// Decodes `count` integers of `width` bytes, 4 or 8, from a compressed buffer.
pub(super) fn integers(buffer: &[u8], count: usize, width: usize) -> Result<Vec<i64>, String> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let codes = count.div_ceil(4);
    let coded = decompress(buffer, width + codes + count * width)?;
    let short = || format!("it holds fewer than {count} integers");
    let (common, rest) = coded.split_at_checked(width).ok_or_else(short)?;
    let (codes, mut rest) = rest.split_at_checked(codes).ok_or_else(short)?;
    let common = signed(common);
    let mut value = 0i64;
    let mut out = Vec::with_capacity(count);
    for index in 0..count {
        let difference = match (codes[index / 4] >> (2 * (index % 4))) & 3 {
            0 => common,
            code => {
                let bytes = (width / 4) << (code - 1);
                let (number, after) = rest.split_at_checked(bytes).ok_or_else(short)?;
                rest = after;
                signed(number)
            }
        };
        value = value.wrapping_add(difference);
        if width == 4 {
            #[expect(clippy::cast_possible_truncation, reason = "the sum wraps in its width")]
            let wrapped = value as i32;
            value = i64::from(wrapped);
        }
        out.push(value);
    }
    Ok(out)
}

/// The little-endian signed integer of up to 8 bytes.
fn signed(bytes: &[u8]) -> i64 {
    let sign = if bytes.last().is_some_and(|&b| b > 127) { 255 } else { 0 };
    let mut all = [sign; 8];
    all[..bytes.len()].copy_from_slice(bytes);
    i64::from_le_bytes(all)
}

/// A buffer that decompresses to `bytes`.
pub(super) fn stored(bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![0];
    if let Some(mut extra) = bytes.len().checked_sub(15) {
        out.push(0xf0);
        while extra >= 255 {
            out.push(255);
            extra -= 255;
        }
        #[expect(clippy::cast_possible_truncation, reason = "below 255")]
        out.push(extra as u8);
    } else {
        #[expect(clippy::cast_possible_truncation, reason = "below 15")]
        out.push((bytes.len() as u8) << 4);
    }
    out.extend_from_slice(bytes);
    out
}

/// A buffer of coded `integers`, with all differences in four bytes.
pub(super) fn stored_integers(integers: &[i32]) -> Vec<u8> {
    let mut coded = vec![0; 4];
    coded.resize(4 + integers.len().div_ceil(4), 0xff);
    let mut before = 0i32;
    for &integer in integers {
        coded.extend(integer.wrapping_sub(before).to_le_bytes());
        before = integer;
    }
    stored(&coded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_decompresses() {
        for length in [0, 1, 14, 15, 16, 269, 270, 271, 5000] {
            let bytes: Vec<u8> = (0..length).map(|i| (i * 7 % 251) as u8).collect();
            assert_eq!(decompress(&stored(&bytes), length as usize), Ok(bytes));
        }
        let integers = [3, -2, i32::MAX, i32::MIN, 0, 7, 7];
        let wide: Vec<i64> = integers.iter().map(|&i| i64::from(i)).collect();
        assert_eq!(super::integers(&stored_integers(&integers), 7, 4), Ok(wide));
    }

    /// The example of the library's documentation, and a match that overlaps itself.
    #[test]
    fn coded_differences_and_matches() {
        let mut coded = 1i32.to_le_bytes().to_vec();
        coded.extend([0b1100_0001, 0b0001_0000, 123]);
        coded.extend(100_000i32.to_le_bytes());
        coded.extend([0, 0]);
        let found = integers(&stored(&coded), 7, 4).unwrap();
        assert_eq!(found, [123, 124, 125, 100_125, 100_126, 100_127, 100_127]);
        let block = [0, 0x26, b'a', b'b', 2, 0, 0x10, b'c'];
        assert_eq!(
            decompress(&block, 100).unwrap(),
            b"abababababababc"[..].split_at(12).0.iter().copied().chain(*b"c").collect::<Vec<_>>()
        );
        assert!(decompress(&block, 12).unwrap_err().contains("more than"));
        assert!(decompress(&[0, 0x16, b'a', 2, 0, 0], 100).unwrap_err().contains("before its block"));
    }
}
