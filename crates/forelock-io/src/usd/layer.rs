//! A layer: prims, their attributes, and the values of these.

use std::{
    cell::RefCell,
    collections::{BTreeMap, HashMap},
    io::{Read, Seek},
    rc::Rc,
};

use super::{UsdError, crate_file::Crate};

/// The layer of one file.
pub(super) struct Layer<R> {
    /// The metadata of the layer, such as `upAxis`.
    pub metadata: BTreeMap<Rc<str>, Held>,
    /// The prims that are defined and active, parents before their children.
    pub prims: Vec<Prim>,
    /// The file from which values are read, if it is binary.
    file: Option<Crate<R>>,
    /// The bytes of the file.
    pub size: u64,
    /// Samples of the file that were read, by their representation, and their number.
    known: RefCell<(HashMap<u64, Samples>, u64)>,
}

/// A prim.
pub(super) struct Prim {
    /// The last part of the path.
    pub name: Rc<str>,
    /// The schema, such as `BasisCurves`.
    pub kind: Rc<str>,
    /// The index of the parent.
    pub parent: Option<usize>,
    /// The attributes by name.
    pub attributes: BTreeMap<Rc<str>, Attribute>,
}

/// An attribute.
#[derive(Clone, Default)]
pub(super) struct Attribute {
    /// The value without a time.
    pub default: Option<Held>,
    /// The samples, [`Value::Samples`].
    pub samples: Option<Held>,
}

/// A value, or where it is in the file.
#[derive(Clone, Debug)]
pub(super) enum Held {
    Value(Rc<Value>),
    /// The value representation of a crate file.
    Packed(u64),
}

impl From<Value> for Held {
    fn from(value: Value) -> Self {
        Self::Value(Rc::new(value))
    }
}

/// A value. A single number or word is a list of one.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// Booleans and integers; vectors of them are joined.
    Integers(Vec<i64>),
    /// Numbers of half or single precision; vectors of them are joined. Quaternions are x, y, z, w.
    Floats(Vec<f32>),
    /// Numbers of double precision, joined likewise. Matrices are row by row.
    Doubles(Vec<f64>),
    /// Strings, tokens and paths of assets.
    Words(Vec<Rc<str>>),
    /// Values at times, which rise strictly.
    Samples(Samples),
    /// No value, or one of a type that grooms do not need.
    Nothing,
}

/// The values of an attribute at times.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Samples {
    pub times: Rc<[f64]>,
    pub values: Rc<[Held]>,
}

/// What gives the value of an attribute at a time.
pub(super) enum Place {
    /// A value.
    At(Held),
    /// Two samples, and the share of the way from one to the other.
    Between(Held, Held, f64),
}

impl PartialEq for Held {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Value(a), Self::Value(b)) => a == b,
            (Self::Packed(a), Self::Packed(b)) => a == b,
            _ => false,
        }
    }
}

impl Held {
    /// Whether both are the same value in the file.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Value(a), Self::Value(b)) => Rc::ptr_eq(a, b),
            (Self::Packed(a), Self::Packed(b)) => a == b,
            _ => false,
        }
    }
}

impl Value {
    /// The numbers in single precision.
    pub fn floats(&self) -> Option<Vec<f32>> {
        #[expect(clippy::cast_possible_truncation, reason = "grooms have single precision")]
        match self {
            Self::Floats(numbers) => Some(numbers.clone()),
            Self::Doubles(numbers) => Some(numbers.iter().map(|&x| x as f32).collect()),
            Self::Integers(numbers) => Some(numbers.iter().map(|&x| x as f32).collect()),
            _ => None,
        }
    }

    /// The numbers in double precision.
    pub fn doubles(&self) -> Option<Vec<f64>> {
        match self {
            Self::Floats(numbers) => Some(numbers.iter().map(|&x| f64::from(x)).collect()),
            Self::Doubles(numbers) => Some(numbers.clone()),
            Self::Integers(numbers) => Some(numbers.iter().map(|&x| x as f64).collect()),
            _ => None,
        }
    }

    pub fn word(&self) -> Option<&str> {
        match self {
            Self::Words(words) => words.first().map(|word| &**word),
            _ => None,
        }
    }

    /// The value between this one and `next`, at `share` of the way. Only lists of numbers that are
    /// equally long have one.
    fn towards(&self, next: &Self, share: f64) -> Option<Self> {
        #[expect(clippy::cast_possible_truncation, reason = "a share in single precision")]
        let single = share as f32;
        match (self, next) {
            (Self::Floats(a), Self::Floats(b)) if a.len() == b.len() => {
                Some(Self::Floats(a.iter().zip(b).map(|(a, b)| a + (b - a) * single).collect()))
            }
            (Self::Doubles(a), Self::Doubles(b)) if a.len() == b.len() => {
                Some(Self::Doubles(a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()))
            }
            _ => None,
        }
    }
}

impl<R> Layer<R> {
    /// A layer in a file of `size` bytes.
    pub fn new(
        metadata: BTreeMap<Rc<str>, Held>,
        prims: Vec<Prim>,
        file: Option<Crate<R>>,
        size: u64,
    ) -> Self {
        Self { metadata, prims, file, size, known: RefCell::default() }
    }
}

impl<R: Read + Seek> Layer<R> {
    /// The value of `held`.
    pub fn value(&self, held: &Held) -> Result<Rc<Value>, UsdError> {
        match (held, &self.file) {
            (Held::Value(value), _) => Ok(Rc::clone(value)),
            (Held::Packed(representation), Some(file)) => Ok(Rc::new(file.unpack(*representation)?)),
            (Held::Packed(_), None) => Ok(Rc::new(Value::Nothing)),
        }
    }

    /// The samples of `attribute`; none if it does not change. Those of a binary file are read
    /// once.
    pub fn samples(&self, attribute: &Attribute) -> Result<Samples, UsdError> {
        let Some(held) = &attribute.samples else { return Ok(Samples::default()) };
        let place = if let Held::Packed(place) = held { Some(*place) } else { None };
        if let Some(known) = place.and_then(|place| self.known.borrow().0.get(&place).cloned()) {
            return Ok(known);
        }
        let Value::Samples(samples) = &*self.value(held)? else { return Ok(Samples::default()) };
        if let Some(place) = place {
            let (all, count) = &mut *self.known.borrow_mut();
            *count += samples.values.len() as u64;
            // A sample has 8 bytes, so there are more only if lists share them.
            if *count > self.size / 8 {
                all.clear();
                *count = samples.values.len() as u64;
            }
            all.insert(place, samples.clone());
        }
        Ok(samples.clone())
    }

    /// What gives the value of `attribute` at `time`, in time codes: between two samples both of
    /// them, outside of them the first or the last.
    pub fn place(&self, attribute: &Attribute, time: f64) -> Result<Option<Place>, UsdError> {
        let Samples { times, values } = self.samples(attribute)?;
        let Some(before) = times.partition_point(|&t| t <= time).checked_sub(1) else {
            return Ok(values.first().or(attribute.default.as_ref()).cloned().map(Place::At));
        };
        Ok(match (values.get(before), values.get(before + 1)) {
            (Some(a), Some(b)) if times[before] < time => {
                let share = (time - times[before]) / (times[before + 1] - times[before]);
                Some(Place::Between(a.clone(), b.clone(), share))
            }
            (own, _) => own.cloned().map(Place::At),
        })
    }

    /// The value of `attribute` at `time`, in time codes. Between two samples it is interpolated.
    pub fn at(&self, attribute: &Attribute, time: f64) -> Result<Option<Rc<Value>>, UsdError> {
        self.place(attribute, time)?.map_or(Ok(None), |place| self.value_at(&place))
    }

    /// The value at `place`.
    pub fn value_at(&self, place: &Place) -> Result<Option<Rc<Value>>, UsdError> {
        let value = match place {
            Place::At(held) => self.value(held)?,
            Place::Between(a, b, share) => {
                let [a, b] = [a, b].map(|held| self.value(held));
                let a = a?;
                a.towards(&*b?, *share).map_or(a, Rc::new)
            }
        };
        Ok(Some(value).filter(|value| **value != Value::Nothing))
    }

    /// The value of the attribute `name` of `prim` at `time`.
    pub fn find(&self, prim: &Prim, name: &str, time: f64) -> Result<Option<Rc<Value>>, UsdError> {
        prim.attributes.get(name).map_or(Ok(None), |attribute| self.at(attribute, time))
    }

    /// The path of `prim`, for messages.
    pub fn path(&self, prim: &Prim) -> String {
        let above = prim.parent.map_or_else(String::new, |parent| self.path(&self.prims[parent]));
        format!("{above}/{}", prim.name)
    }

    /// A number of the layer's metadata.
    pub fn number(&self, name: &str) -> Result<Option<f64>, UsdError> {
        let value = self.metadata.get(name).map(|held| self.value(held)).transpose()?;
        Ok(value.and_then(|value| value.doubles()?.first().copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn samples_are_interpolated_and_held() {
        let floats = |x: f32| Held::from(Value::Floats(vec![x, -x]));
        let samples = Samples { times: [1.0, 2.0, 4.0].into(), values: [0.0, 1.0, 5.0].map(floats).into() };
        let attribute =
            Attribute { default: Some(floats(9.0)), samples: Some(Value::Samples(samples).into()) };
        let layer: Layer<Cursor<&[u8]>> = Layer::new(BTreeMap::new(), Vec::new(), None, 0);
        for (time, x) in
            [(f64::NEG_INFINITY, 0.0), (1.0, 0.0), (1.5, 0.5), (2.0, 1.0), (3.0, 3.0), (9.0, 5.0)]
        {
            let found = layer.at(&attribute, time).unwrap().unwrap();
            assert_eq!(*found, Value::Floats(vec![x, -x]), "{time}");
        }
        let fixed = Attribute { samples: None, ..attribute };
        assert_eq!(*layer.at(&fixed, 3.0).unwrap().unwrap(), Value::Floats(vec![9.0, -9.0]));
        let changing = [Value::Floats(vec![1.0]), Value::Floats(vec![2.0, 3.0])].map(Held::from);
        let samples = Samples { times: [0.0, 1.0].into(), values: changing.into() };
        let attribute = Attribute { default: None, samples: Some(Value::Samples(samples).into()) };
        assert_eq!(*layer.at(&attribute, 0.9).unwrap().unwrap(), Value::Floats(vec![1.0]));
    }
}
