//! The values of a crate file.
//!
//! # Theory
//! A value representation has 64 bits: bit 63 says array, bit 62 inlined, bit 61 compressed, bits
//! 48 to 55 are the type, and the lowest 48 bits the payload. An inlined value is in the lowest 32
//! bits: numbers as `i32` or `f32`, vectors as an `i8` each, matrices as an `i8` for each number of
//! the diagonal, words as an index. Otherwise the payload is an offset, 0 for an empty array. An
//! array begins with its count, `u32` before version 0.7 and then `u64` (before 0.5 after another
//! `u32`).
//!
//! A compressed array of integers is as in [`coding`](super::coding). One of floating-point numbers
//! has a byte first: `i`, they are integers, compressed as such; `t`, a table follows (`u32` count)
//! and compressed indices into it. Arrays of less than 16 are never compressed.
//!
//! Samples are two jumps, each an `i64` that counts from its own first byte. The first leads to the
//! representation of the times, a vector of doubles with a `u64` count. Behind it, the second leads
//! to a `u64` count and as many representations.
//!
//! # Practice
//! Samples are read without their values.
//!
//! # Limitations
//! Dictionaries, lists of references, splines and the like read as nothing.

use std::{
    io::{Read, Seek},
    rc::Rc,
};

use super::{
    UsdError,
    crate_file::Crate,
    layer::{Held, Samples, Value},
    source::Cursor,
};

pub(super) const ARRAY: u64 = 1 << 63;
pub(super) const INLINED: u64 = 1 << 62;
const COMPRESSED: u64 = 1 << 61;
pub(super) const PAYLOAD: u64 = (1 << 48) - 1;
/// Smaller arrays are not compressed.
const LEAST_COMPRESSED: usize = 16;

pub(super) const TOKEN: u64 = 11;
pub(super) const TOKEN_VECTOR: u64 = 41;
pub(super) const SAMPLES: u64 = 46;
pub(super) const DOUBLE_VECTOR: u64 = 48;

/// How a number is stored.
#[derive(Clone, Copy, PartialEq)]
enum Number {
    U8,
    I32,
    U32,
    I64,
    F16,
    F32,
    F64,
}

/// A type of numbers.
#[derive(Clone, Copy)]
struct Type {
    number: Number,
    /// Numbers of one element.
    each: usize,
    is_matrix: bool,
}

/// The type of numbers with the code `code`.
fn number_type(code: u64) -> Option<Type> {
    use Number::{F16, F32, F64, I32, I64, U8, U32};
    let (number, each) = match code {
        1 | 2 => (U8, 1),
        3 => (I32, 1),
        4 => (U32, 1),
        5 | 6 => (I64, 1),
        7 => (F16, 1),
        8 => (F32, 1),
        9 | 56 => (F64, 1),
        13 => (F64, 4),
        14 => (F64, 9),
        15 => (F64, 16),
        16 => (F64, 4),
        17 => (F32, 4),
        18 => (F16, 4),
        19..=30 => ([F64, F32, F16, I32][(code as usize - 19) % 4], 2 + (code as usize - 19) / 4),
        _ => return None,
    };
    Some(Type { number, each, is_matrix: (13..=15).contains(&code) })
}

impl Number {
    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::F64 => 8,
        }
    }

    /// The numbers in `bytes`.
    fn decode(self, bytes: &[u8]) -> Value {
        match self {
            Self::U8 => Value::Integers(bytes.iter().map(|&b| i64::from(b)).collect()),
            Self::I32 => Value::Integers(list(bytes, |b| i64::from(i32::from_le_bytes(b)))),
            Self::U32 => Value::Integers(list(bytes, |b| i64::from(u32::from_le_bytes(b)))),
            Self::I64 => Value::Integers(list(bytes, i64::from_le_bytes)),
            Self::F16 => Value::Floats(list(bytes, |b| half(u16::from_le_bytes(b)))),
            Self::F32 => Value::Floats(list(bytes, f32::from_le_bytes)),
            Self::F64 => Value::Doubles(list(bytes, f64::from_le_bytes)),
        }
    }

    /// `numbers` as a value of this type.
    fn convert(self, numbers: Vec<i64>) -> Value {
        match self {
            Self::F16 | Self::F32 => Value::Floats(numbers.into_iter().map(|n| n as f32).collect()),
            Self::F64 => Value::Doubles(numbers.into_iter().map(|n| n as f64).collect()),
            _ => Value::Integers(numbers),
        }
    }
}

fn list<const N: usize, T>(bytes: &[u8], decode: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&b| decode(b)).collect()
}

/// The value of a number of half precision.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let fraction = f32::from(bits & 0x3ff);
    sign * match (bits >> 10) & 31 {
        0 => fraction * (-24f32).exp2(),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        exponent => (1024.0 + fraction) * (f32::from(exponent) - 25.0).exp2(),
    }
}

impl<R: Read + Seek> Crate<R> {
    /// The value that `representation` stands for.
    pub fn unpack(&self, representation: u64) -> Result<Value, UsdError> {
        let code = (representation >> 48) & 0xff;
        let payload = representation & PAYLOAD;
        let is_array = representation & ARRAY != 0;
        let mut cursor = self.source.at(payload);
        if let Some(numbers) = number_type(code) {
            return match (is_array, representation & INLINED != 0) {
                (false, true) => Ok(inlined(numbers, payload)),
                (false, false) => {
                    let bytes = cursor.take(numbers.each as u64, numbers.number.bytes() as u64, "a value")?;
                    Ok(numbers.number.decode(&bytes))
                }
                (true, _) if payload == 0 => Ok(numbers.number.convert(Vec::new())),
                (true, _) => self.array(cursor, numbers, representation & COMPRESSED != 0),
            };
        }
        match (code, is_array) {
            (10..=12, false) => Ok(Value::Words(vec![self.word(code, payload, &cursor)?])),
            (10..=12, true) if payload == 0 => Ok(Value::Words(Vec::new())),
            (10..=12, true) => {
                let count = self.count(&mut cursor)?;
                self.words(&mut cursor, code, count)
            }
            (TOKEN_VECTOR, _) => {
                let count = cursor.value("a count")?;
                self.words(&mut cursor, TOKEN, count)
            }
            (SAMPLES, _) => self.samples(cursor),
            (DOUBLE_VECTOR, _) => {
                let count = cursor.value("a count")?;
                Ok(Value::Doubles(cursor.array(count, "the times")?))
            }
            _ => Ok(Value::Nothing),
        }
    }

    /// The count of an array.
    fn count(&self, cursor: &mut Cursor<'_, R>) -> Result<u64, UsdError> {
        if self.minor < 5 {
            cursor.value::<u32>("a shape")?;
        }
        if self.minor < 7 { Ok(cursor.value::<u32>("a count")?.into()) } else { cursor.value("a count") }
    }

    fn array(
        &self,
        mut cursor: Cursor<'_, R>,
        numbers: Type,
        is_compressed: bool,
    ) -> Result<Value, UsdError> {
        let Type { number, each, .. } = numbers;
        let stored = self.count(&mut cursor)?;
        let is_integer = matches!(number, Number::I32 | Number::U32 | Number::I64);
        let since = if is_integer { 5 } else { 6 };
        let is_small = stored < LEAST_COMPRESSED as u64;
        if !is_compressed || self.minor < since || is_small || number == Number::U8 || each != 1 {
            let bytes = cursor.take(stored, (each * number.bytes()) as u64, "an array")?;
            return Ok(number.decode(&bytes));
        }
        let count = cursor.check_count(stored, 16, "the numbers of an array")?;
        if is_integer {
            let integers = cursor.integers(count, number.bytes(), "the numbers of an array")?;
            return Ok(number.convert(match number {
                Number::U32 => integers.into_iter().map(|i| i & 0xffff_ffff).collect(),
                _ => integers,
            }));
        }
        match cursor.value::<u8>("an array")? {
            b'i' => Ok(number.convert(cursor.integers(count, 4, "the numbers of an array")?)),
            b't' => {
                let table: u32 = cursor.value("a table of numbers")?;
                let table =
                    number.decode(&cursor.take(table.into(), number.bytes() as u64, "a table of numbers")?);
                let indices = cursor.indices(count, "the numbers of an array")?;
                let found = match table {
                    Value::Floats(table) => pick(&table, &indices).map(Value::Floats),
                    Value::Doubles(table) => pick(&table, &indices).map(Value::Doubles),
                    _ => None,
                };
                found.ok_or_else(|| cursor.invalid("an index leads out of its table of numbers"))
            }
            code => Err(cursor.invalid(format!("the code {code} of a compressed array is not known"))),
        }
    }

    /// The word with the number `index` among the strings or tokens.
    fn word(&self, code: u64, index: u64, cursor: &Cursor<'_, R>) -> Result<Rc<str>, UsdError> {
        let index = usize::try_from(index & 0xffff_ffff).ok();
        let token = if code == 10 {
            index.and_then(|index| self.strings.get(index)).map(|&token| token as usize)
        } else {
            index
        };
        let word = token.and_then(|token| self.tokens.get(token)).cloned();
        word.ok_or_else(|| cursor.invalid("a word is not in the table of tokens"))
    }

    fn words(&self, cursor: &mut Cursor<'_, R>, code: u64, count: u64) -> Result<Value, UsdError> {
        let indices: Vec<u32> = cursor.array(count, "a list of words")?;
        let words = indices.into_iter().map(|index| self.word(code, index.into(), cursor));
        Ok(Value::Words(words.collect::<Result<_, _>>()?))
    }

    fn samples(&self, mut cursor: Cursor<'_, R>) -> Result<Value, UsdError> {
        cursor.jump()?;
        let times: u64 = cursor.value("the times of samples")?;
        // Anything else would be another set of samples, without end.
        let times = match (times >> 48) & 0xff {
            SAMPLES => None,
            _ => self.unpack(times)?.doubles(),
        };
        cursor.jump()?;
        let count = cursor.value("the samples")?;
        let values: Vec<u64> = cursor.array(count, "the samples")?;
        let times = times.filter(|times| times.len() == values.len());
        let Some(times) = times else {
            return Err(cursor.invalid("samples and their times differ in number"));
        };
        if !times.is_sorted_by(|a, b| a < b) {
            return Err(cursor.invalid("the times of samples do not rise"));
        }
        let values = values.into_iter().map(Held::Packed).collect();
        Ok(Value::Samples(Samples { times: times.into(), values }))
    }
}

fn pick<T: Copy>(table: &[T], indices: &[u32]) -> Option<Vec<T>> {
    indices.iter().map(|&index| table.get(index as usize).copied()).collect()
}

/// The value of numbers in the payload itself.
fn inlined(numbers: Type, payload: u64) -> Value {
    let bytes = payload.to_le_bytes();
    let Type { number, each, is_matrix } = numbers;
    // The bytes are signed.
    let small = |i: usize| i64::from(i8::from_le_bytes([bytes[i]]));
    if is_matrix {
        let side = each.isqrt();
        let at = |i: usize| if i.is_multiple_of(side + 1) { small(i / (side + 1)) } else { 0 };
        return number.convert((0..each).map(at).collect());
    }
    if each > 1 {
        // Two numbers of half precision need no more room than this.
        return match number {
            Number::F16 if each == 2 => number.decode(&bytes[..4]),
            _ => number.convert((0..each.min(4)).map(small).collect()),
        };
    }
    match number {
        Number::F64 => Value::Doubles(list(&bytes[..4], |b| f64::from(f32::from_le_bytes(b)))),
        Number::I64 => Number::I32.decode(&bytes[..4]),
        _ => number.decode(&bytes[..number.bytes()]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_half_precision() {
        for (bits, number) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x0400, 6.103_515_6e-5),
            (0x3555, 0.333_251_95),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(half(bits), number);
        }
        assert!(half(0x7e00).is_nan());
    }

    #[test]
    fn inlined_values() {
        let unpack = |code, payload| inlined(number_type(code).unwrap(), payload);
        assert_eq!(unpack(3, 0xffff_fffe), Value::Integers(vec![-2]));
        assert_eq!(unpack(9, 1.5f32.to_bits().into()), Value::Doubles(vec![1.5]));
        assert_eq!(unpack(24, 0x0003_fe01), Value::Floats(vec![1.0, -2.0, 3.0]));
        assert_eq!(unpack(13, 0x0201), Value::Doubles(vec![1.0, 0.0, 0.0, 2.0]));
        assert_eq!(unpack(21, 0xc000_3c00), Value::Floats(vec![1.0, -2.0]));
        assert_eq!(unpack(1, 1), Value::Integers(vec![1]));
    }
}
