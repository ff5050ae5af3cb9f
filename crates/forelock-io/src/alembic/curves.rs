//! Strand groups: objects of the schema `AbcGeom_Curve_v2`, which become one groom.
//!
//! # Theory
//! The compound `.geom` of such an object has the points `P`, the number of points of each strand
//! `nVertices`, and `curveBasisAndType`: type (0 cubic, 1 linear, 2 of variable order), whether the
//! strands are closed, and basis (1 Bézier, 2 B-spline, 3 Catmull-Rom). `width`, `uv` and
//! `.velocities` are optional. Attributes that the schema does not know lie in `.arbGeomParams`.
//!
//! # Practice
//! An attribute has one value, or one for each strand, or one for each point; the number of values
//! decides. It may be a compound of `.vals` and `.indices`. One that fits none of these is left
//! out. A groom has an attribute if all its groups have it; [`Labels::join`] says what strands get
//! whose group has no labels.
//!
//! # Limitations
//! All points of cubic curves become particles: bases are not evaluated, and handles of Bézier
//! curves are particles too (Blender writes Bézier curves without handles).

use std::{
    io::{Read, Seek},
    sync::Arc,
};

use forelock_core::groom::{Groom, Labels};
use glam::{DAffine3, Vec3};

use super::{
    AlembicError, Contents,
    archive::{Archive, Property, Sample},
    ogawa::{error, invalid},
    transforms::Transform,
};
use crate::labels;

/// An object of an archive with points: a strand group, or a mesh.
pub(super) struct Geometry {
    pub name: String,
    pub schema: String,
    pub parent: Option<Arc<Transform>>,
    /// The properties of `.geom`.
    pub geom: Vec<Property>,
    /// The properties of `.arbGeomParams`.
    pub others: Vec<Property>,
}

impl Geometry {
    fn attribute(&self, name: &str) -> Option<&Property> {
        Property::find(&self.others, name).or(Property::find(&self.geom, name))
    }
}

/// The bytes that strands may take in memory for each byte of the file, and a number of bytes more.
const ROOM: [u64; 2] = [6, 16 << 10];
/// Bytes that the labels of a strand take.
const LABEL_BYTES: usize = 33;

/// The strands of several groups, joined.
#[derive(Default)]
pub(super) struct Joined {
    /// The bytes that may still be taken.
    left: u64,
    positions: Vec<Vec3>,
    offsets: Vec<u32>,
    velocities: Column<Vec3>,
    widths: Column<f32>,
    colours: Column<[f32; 3]>,
    root_uvs: Column<[f32; 2]>,
    /// The labels of each group, and its number of strands.
    labels: Vec<(Labels, usize)>,
}

/// An attribute of several strand groups.
#[derive(Default)]
struct Column<T> {
    values: Vec<T>,
    /// Whether a group has none.
    is_partial: bool,
}

impl<T> Column<T> {
    /// Appends the values of a group.
    fn push(&mut self, values: Option<Vec<T>>) {
        match values {
            Some(values) => self.values.extend(values),
            None => self.is_partial = true,
        }
    }

    fn finish(self) -> Option<Vec<T>> {
        (!self.is_partial).then_some(self.values)
    }
}

impl Joined {
    /// No strands yet, of a file of `size` bytes.
    pub fn new(size: u64) -> Self {
        let [times, besides] = ROOM;
        Self { left: size.saturating_mul(times).saturating_add(besides), ..Self::default() }
    }

    /// Reads the strands of `curves` at `time_secs` and appends them.
    pub fn add<R: Read + Seek>(
        &mut self,
        archive: &mut Archive<R>,
        curves: &Geometry,
        time_secs: f64,
    ) -> Result<(), AlembicError> {
        let mut group = Group { archive, curves, time_secs, counts: Vec::new() };
        let points = group.read_points()?;
        if points.is_empty() && group.counts.is_empty() {
            return Ok(());
        }
        let has = |names: [&str; 2]| names.iter().any(|name| curves.attribute(name).is_some());
        let wide = [
            (".velocities", ".velocities", 12),
            ("groom_width", "width", 4),
            ("groom_color", "groom_color", 12),
        ];
        let each = 12 + wide.iter().filter(|own| has([own.0, own.1])).map(|own| own.2).sum::<usize>();
        let labels = LABEL_BYTES + size_of::<(u32, usize, [f32; 2])>();
        let bytes = points.len() * each + group.counts.len() * labels;
        self.left = self.left.checked_sub(bytes as u64).ok_or_else(|| {
            let words = format!("the strands take over {} times the bytes of the file in memory", ROOM[0]);
            invalid(0, format!("{words}: many groups share samples, or strands have no points"))
        })?;
        let world = match &curves.parent {
            Some(parent) => parent.world(group.archive, time_secs)?,
            None => DAffine3::IDENTITY,
        };
        let moved = |p: [f32; 3]| world.transform_point3(Vec3::from_array(p).as_dvec3()).as_vec3();
        let turned = |v: [f32; 3]| world.transform_vector3(Vec3::from_array(v).as_dvec3()).as_vec3();
        let velocities = group.tuples(&[".velocities"])?;
        let velocities = velocities.filter(|velocities| velocities.len() == points.len());
        let scale = scale(&world);
        let widths = group.tuples::<1>(&["groom_width", "width"])?;
        let widths = widths.and_then(|values| group.for_points(&values));
        let colours = group.tuples(&["groom_color"])?.and_then(|values| group.for_points(&values));
        let uvs = group.tuples(&["groom_root_uv", "uv"])?.and_then(|values| group.for_strands(&values));
        let labels = labels::read(&mut group, labels::NAMES)?;
        self.velocities.push(velocities.map(|v| v.into_iter().map(turned).collect()));
        self.widths.push(widths.map(|w| w.into_iter().map(|[w]| w * scale).collect()));
        self.colours.push(colours);
        self.root_uvs.push(uvs);
        self.labels.push((labels, group.counts.len()));
        let start = self.positions.len();
        self.positions.extend(points.into_iter().map(moved));
        group.extend_offsets(&mut self.offsets, start)
    }

    /// The groom of all groups.
    pub fn finish(self) -> Result<Contents, AlembicError> {
        if self.offsets.is_empty() {
            return Ok(Contents { groom: Groom::default(), velocities: None });
        }
        let mut groom = Groom::new(self.positions, self.offsets).map_err(|e| error(0, e.into()))?;
        groom.widths = self.widths.finish();
        groom.colours = self.colours.finish();
        groom.root_uvs = self.root_uvs.finish();
        let labels: Vec<(&Labels, usize)> = self.labels.iter().map(|(own, count)| (own, *count)).collect();
        groom.labels = Labels::join(&labels);
        groom.check_attributes().map_err(|e| error(0, e.into()))?;
        Ok(Contents { groom, velocities: self.velocities.finish() })
    }
}

/// The factor of `map` on lengths, the same in all directions.
fn scale(map: &DAffine3) -> f32 {
    map.matrix3.determinant().abs().cbrt() as f32
}

/// A strand group while it is read.
struct Group<'a, R> {
    archive: &'a mut Archive<R>,
    curves: &'a Geometry,
    time_secs: f64,
    /// The number of points of each strand in the file.
    counts: Vec<usize>,
}

impl<R: Read + Seek> Group<'_, R> {
    /// Reads the points and the number of points of each strand.
    fn read_points(&mut self) -> Result<Vec<[f32; 3]>, AlembicError> {
        let name = &self.curves.name;
        let place = |sample: &Option<Sample>| sample.as_ref().map_or(0, |sample| sample.offset);
        let sample = self.sample("P")?;
        let at = place(&sample);
        let floats = sample.map(|sample| sample.floats());
        let floats = floats.ok_or_else(|| invalid(at, format!("`{name}` has no points")))?;
        let points = floats.ok_or_else(|| invalid(at, format!("the points of `{name}` are no numbers")))?;
        let points = points.as_chunks::<3>().0.to_vec();
        let sample = self.sample("nVertices")?;
        let at = place(&sample);
        let counts = sample.and_then(|sample| sample.integers());
        let counts = counts.ok_or_else(|| invalid(at, format!("`{name}` has no `nVertices`")))?;
        self.counts = Vec::with_capacity(counts.len());
        let mut sum = 0usize;
        for (strand, &count) in counts.iter().enumerate() {
            let count = usize::try_from(count).map_err(|_| {
                invalid(at, format!("strand {strand} of `{name}` has {count} points, below 0"))
            })?;
            sum = sum.saturating_add(count);
            self.counts.push(count);
        }
        if sum != points.len() {
            let words = format!("the strands of `{name}` have {sum} points, but there are {}", points.len());
            return Err(invalid(at, words));
        }
        Ok(points)
    }

    /// Appends the end of each strand to `offsets`, the first particle being `start`.
    fn extend_offsets(&self, offsets: &mut Vec<u32>, start: usize) -> Result<(), AlembicError> {
        let mut end = start;
        if offsets.is_empty() {
            offsets.push(0);
        }
        for &count in &self.counts {
            end += count;
            let end = u32::try_from(end).map_err(|_| invalid(0, "the strands have over 2³² points"))?;
            offsets.push(end);
        }
        Ok(())
    }

    /// One value for each particle, if the number of `values` allows it.
    fn for_points<T: Copy>(&self, values: &[T]) -> Option<Vec<T>> {
        let points = self.counts.iter().sum();
        if values.len() == points {
            Some(values.to_vec())
        } else if values.len() == self.counts.len() {
            let repeated = values.iter().zip(&self.counts);
            Some(repeated.flat_map(|(&value, &count)| std::iter::repeat_n(value, count)).collect())
        } else if let &[value] = values {
            Some(vec![value; points])
        } else {
            None
        }
    }

    /// One value for each strand, if the number of `values` allows it: of one for each point, that
    /// of the root.
    fn for_strands<T: Copy>(&self, values: &[T]) -> Option<Vec<T>> {
        if values.len() == self.counts.len() {
            return Some(values.to_vec());
        }
        if let &[value] = values {
            return Some(vec![value; self.counts.len()]);
        }
        let mut start = 0;
        let roots = self.counts.iter().map(|count| {
            let root = values.get(start).copied();
            start += count;
            root
        });
        let roots: Option<Vec<T>> = roots.collect();
        roots.filter(|_| start == values.len())
    }

    /// The sample of the property `name` of `.geom`.
    fn sample(&mut self, name: &str) -> Result<Option<Sample>, AlembicError> {
        match Property::find(&self.curves.geom, name) {
            Some(property) => self.archive.sample(property, self.time_secs),
            None => Ok(None),
        }
    }

    /// The values of the first of the attributes `names` that exists, in groups of N.
    fn tuples<const N: usize>(&mut self, names: &[&str]) -> Result<Option<Vec<[f32; N]>>, AlembicError> {
        for name in names {
            let Some(attribute) = self.attribute(name)? else { continue };
            let Some(values) = attribute.values.floats() else { continue };
            let values = values.as_chunks::<N>().0;
            match attribute.indices {
                None => return Ok(Some(values.to_vec())),
                Some(indices) => return Ok(pick(values, &indices)),
            }
        }
        Ok(None)
    }

    fn attribute(&mut self, name: &str) -> Result<Option<Attribute>, AlembicError> {
        let Some(property) = self.curves.attribute(name) else { return Ok(None) };
        if property.samples.is_some() {
            let values = self.archive.sample(property, self.time_secs)?;
            return Ok(values.map(|values| Attribute { values, indices: None }));
        }
        let [values, indices] =
            [".vals", ".indices"].map(|part| self.curves.attribute(&format!("{name}{part}")));
        let Some(values) = values else { return Ok(None) };
        let values = self.archive.sample(values, self.time_secs)?;
        let indices = indices.map(|indices| self.archive.sample(indices, self.time_secs)).transpose()?;
        let indices = indices.flatten().and_then(|indices| indices.integers());
        Ok(values.map(|values| Attribute { values, indices }))
    }
}

impl<R: Read + Seek> labels::Attributes for Group<'_, R> {
    type Error = AlembicError;

    fn integers<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[i64; N]>>, AlembicError> {
        let Some(attribute) = self.attribute(name)? else { return Ok(None) };
        let Some(values) = attribute.values.wide_integers() else { return Ok(None) };
        let values = values.as_chunks::<N>().0;
        Ok(match attribute.indices {
            None => self.for_strands(values),
            Some(indices) => pick(values, &indices).and_then(|values| self.for_strands(&values)),
        })
    }

    fn floats<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[f32; N]>>, AlembicError> {
        Ok(self.tuples(&[name])?.and_then(|values| self.for_strands(&values)))
    }

    fn invalid(&self, words: String) -> AlembicError {
        invalid(0, format!("`{}`: {words}", self.curves.name))
    }
}

/// The sample of an attribute.
struct Attribute {
    values: Sample,
    indices: Option<Vec<i32>>,
}

/// `values` at `indices`, if all exist.
fn pick<T: Copy>(values: &[T], indices: &[i32]) -> Option<Vec<T>> {
    indices.iter().map(|&index| values.get(usize::try_from(index).ok()?).copied()).collect()
}
