//! Grooms in `BasisCurves` prims.
//!
//! # Theory
//! Cubic curves in the bases `catmullRom` and `bezier` pass through all or every third of their
//! control points; a `bspline` passes through none. A strand is the list of the points
//!
//! - p₁, as they are, for linear and Catmull-Rom curves;
//! - (pᵢ₋₁ + 4pᵢ + pᵢ₊₁) / 6 for B-splines, which is the curve at its knots; the ends stay;
//! - the curve at 0, 1/3, 2/3 and 1 of each segment for Bézier curves.
//!
//! So a strand has as many particles as its curve has control points.
//!
//! # Practice
//! All curves of a layer are joined, in the order of its prims. Widths and other values are one for
//! all, one for a curve, one for a control point or one for an end of a segment (`varying`): their
//! number says which. An attribute is kept if all prims have it; `Labels::join` says what strands
//! get whose prim has no labels. Widths are scaled by the cube root of the transform's determinant.
//!
//! # Limitations
//! `wrap` does not close strands, and does not shorten curves that are `nonperiodic`.

use std::io::{Read, Seek};

use forelock_core::groom::{Groom, GroomError, RootBinding};
use glam::{DMat4, Vec3};

use super::{
    UsdError, from_groom, invalid,
    layer::{Layer, Prim, Value},
    names::{BINDING, COLOUR, OPACITY, PINNED, ROOT_UVS, STIFFNESS},
    xform,
};
use crate::labels;

pub(super) const SCHEMA: &str = "BasisCurves";

#[derive(Clone, Copy, PartialEq)]
enum Basis {
    Interpolating,
    BSpline,
    Bezier,
}

/// The strands of one prim.
struct Curves {
    counts: Vec<u32>,
    points: Vec<Vec3>,
    basis: Basis,
    is_cubic: bool,
    is_pinned: bool,
}

/// The groom of the prims `indices`, at `time`, in the units and axes of the layer.
pub(super) fn groom<R: Read + Seek>(
    layer: &Layer<R>,
    indices: &[usize],
    time: f64,
) -> Result<Groom, UsdError> {
    let parts: Result<Vec<Groom>, UsdError> =
        indices.iter().map(|&index| part(layer, &layer.prims[index], time)).collect();
    let mut parts = parts?;
    if parts.len() == 1 {
        return Ok(parts.swap_remove(0));
    }
    Groom::join(&parts).map_err(from_groom)
}

/// The groom of one prim.
fn part<R: Read + Seek>(layer: &Layer<R>, prim: &Prim, time: f64) -> Result<Groom, UsdError> {
    let curves = Curves::read(layer, prim, time)?;
    let world = xform::world_from(layer, prim, time)?;
    let mut positions = curves.points.clone();
    let mut start = 0;
    for &count in &curves.counts {
        let strand = start..start + count as usize;
        on_curve(&curves.points[strand.clone()], curves.basis, &mut positions[strand]);
        start += count as usize;
    }
    if world != DMat4::IDENTITY {
        for p in &mut positions {
            *p = world.transform_point3(p.as_dvec3()).as_vec3();
        }
    }
    let mut offsets = vec![0];
    offsets.extend(curves.counts.iter().scan(0u32, |sum, count| {
        *sum += count;
        Some(*sum)
    }));
    let mut groom = Groom::new(positions, offsets).map_err(from_groom)?;
    let find = |names: &[&str], each: usize| -> Result<Option<Vec<f32>>, UsdError> {
        for name in names {
            if let Some(values) = primvar(layer, prim, name, each, time)? {
                return Ok(Some(values));
            }
        }
        Ok(None)
    };
    #[expect(clippy::cast_possible_truncation, reason = "widths have single precision")]
    let scale = world.determinant().abs().cbrt() as f32;
    let widths = find(&["widths", "primvars:widths"], 1)?.and_then(|v| curves.spread::<1>(&v));
    groom.widths = widths.map(|widths| widths.iter().map(|[w]| w * scale).collect());
    groom.colours = find(&[COLOUR], 3)?.and_then(|v| curves.spread::<3>(&v));
    let opacities = find(&[OPACITY], 1)?.and_then(|v| curves.spread::<1>(&v));
    groom.transparencies = opacities.map(|opacities| opacities.iter().map(|[o]| 1.0 - o).collect());
    groom.root_uvs = find(&ROOT_UVS, 2)?.and_then(|v| curves.roots::<2>(&v));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
    let pinned = |[n]: &[f32; 1]| *n as u16;
    let pins = find(&[PINNED], 1)?.and_then(|v| curves.roots::<1>(&v));
    groom.pinned = pins.map(|pins| pins.iter().map(pinned).collect());
    let stiffness = find(&[STIFFNESS], 1)?.and_then(|v| curves.roots::<1>(&v));
    groom.stiffness = stiffness.map(|values| values.iter().map(|[k]| *k).collect());
    groom.bindings = bindings(layer, prim, &curves, time)?;
    groom.labels = labels::read(&mut Strands { layer, prim, curves: &curves, time }, labels::PRIMVARS)?;
    Ok(groom)
}

impl Curves {
    fn read<R: Read + Seek>(layer: &Layer<R>, prim: &Prim, time: f64) -> Result<Self, UsdError> {
        let fail = |words: String| invalid(format!("{}: {words}", layer.path(prim)));
        let counts = layer.find(prim, "curveVertexCounts", time)?;
        let points = layer.find(prim, "points", time)?.and_then(|value| value.floats()).unwrap_or_default();
        let (points, rest) = points.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(fail("`points` must have three numbers each".into()));
        }
        let counts = match counts.as_deref() {
            Some(Value::Integers(counts)) => counts.as_slice(),
            _ if points.is_empty() => &[],
            _ => return Err(fail("`curveVertexCounts` is missing".into())),
        };
        let counts: Option<Vec<u32>> = counts.iter().map(|&n| u32::try_from(n).ok()).collect();
        let counts = counts.ok_or_else(|| fail("`curveVertexCounts` has a number below 0".into()))?;
        let sum: u64 = counts.iter().map(|&n| u64::from(n)).sum();
        if sum != points.len() as u64 {
            return Err(fail(format!(
                "`curveVertexCounts` add up to {sum}, but there are {} points; export the curves again",
                points.len()
            )));
        }
        let word = |name: &str, default: &str| {
            let value = layer.find(prim, name, time)?;
            Ok::<_, UsdError>(value.as_ref().and_then(|v| v.word()).unwrap_or(default).to_owned())
        };
        let is_cubic = word("type", "cubic")? != "linear";
        let basis = match (is_cubic, word("basis", "bezier")?.as_str()) {
            (true, "bspline") => Basis::BSpline,
            (true, "bezier") => Basis::Bezier,
            _ => Basis::Interpolating,
        };
        let is_pinned = word("wrap", "nonperiodic")? == "pinned";
        let points: Vec<Vec3> = points.iter().map(|&p| Vec3::from_array(p)).collect();
        if u32::try_from(points.len()).is_err() {
            return Err(from_groom(GroomError::TooManyParticles(points.len())));
        }
        Ok(Self { counts, points, basis, is_cubic, is_pinned })
    }

    /// The number of `varying` values of a curve with `count` control points.
    fn varying(&self, count: u32) -> usize {
        let count = count as usize;
        match (self.is_cubic, self.basis) {
            (false, _) => count,
            (true, Basis::Bezier) => count.saturating_sub(1) / 3 + 1,
            (true, _) if self.is_pinned => count,
            (true, _) => count.saturating_sub(2),
        }
    }

    /// `values` as one for each particle; nothing if their number does not fit.
    fn spread<const N: usize>(&self, values: &[f32]) -> Option<Vec<[f32; N]>> {
        let (values, []) = values.as_chunks::<N>() else { return None };
        let each = |curve: usize| self.counts[curve] as usize;
        if let [value] = values {
            return Some(vec![*value; self.points.len()]);
        }
        if values.len() == self.points.len() {
            return Some(values.to_vec());
        }
        if values.len() == self.counts.len() {
            let curves = values.iter().enumerate();
            return Some(
                curves.flat_map(|(curve, &value)| std::iter::repeat_n(value, each(curve))).collect(),
            );
        }
        let mut rest = values;
        let mut spread = Vec::with_capacity(self.points.len());
        for &count in &self.counts {
            let (own, after) = rest.split_at_checked(self.varying(count))?;
            let last = own.len().checked_sub(1)?;
            let at = |particle: u32| {
                let along = particle as f32 / count.saturating_sub(1).max(1) as f32 * last as f32;
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to last")]
                let before = (along as usize).min(last);
                let share = along - before as f32;
                let next = own[(before + 1).min(last)];
                std::array::from_fn(|i| own[before][i] + (next[i] - own[before][i]) * share)
            };
            spread.extend((0..count).map(at));
            rest = after;
        }
        rest.is_empty().then_some(spread)
    }

    /// `values` as one for each strand: one for all, one a strand, or one a point, of which that of
    /// the root counts; nothing if their number does not fit.
    fn labels<const N: usize, T: Copy>(&self, values: &[T]) -> Option<Vec<[T; N]>> {
        let (values, []) = values.as_chunks::<N>() else { return None };
        match values {
            [value] => Some(vec![*value; self.counts.len()]),
            _ if values.len() == self.counts.len() => Some(values.to_vec()),
            _ if values.len() == self.points.len() => {
                let roots = self.counts.iter().scan(0, |sum, &count| {
                    *sum += count as usize;
                    Some(*sum - count as usize)
                });
                roots.map(|root| values.get(root).copied()).collect()
            }
            _ => None,
        }
    }

    /// `values` as one for each strand, that of its root; nothing if their number does not fit.
    fn roots<const N: usize>(&self, values: &[f32]) -> Option<Vec<[f32; N]>> {
        let (elements, []) = values.as_chunks::<N>() else { return None };
        if elements.len() == self.counts.len() {
            return Some(elements.to_vec());
        }
        let spread = self.spread::<N>(values)?;
        let mut start = 0;
        let root = |&count: &u32| {
            let root = spread.get(start).copied().unwrap_or([0.0; N]);
            start += count as usize;
            root
        };
        Some(self.counts.iter().map(root).collect())
    }
}

/// The numbers of the attribute `name`, `each` an element, through its indices if it has any.
fn primvar<R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    name: &str,
    each: usize,
    time: f64,
) -> Result<Option<Vec<f32>>, UsdError> {
    let values = layer.find(prim, name, time)?.and_then(|value| value.floats());
    match values {
        Some(values) => picked(layer, prim, name, values, each, time),
        None => Ok(None),
    }
}

/// `values` of the attribute `name`, `each` an element, through its indices if it has any.
fn picked<T: Copy, R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    name: &str,
    values: Vec<T>,
    each: usize,
    time: f64,
) -> Result<Option<Vec<T>>, UsdError> {
    let indices = layer.find(prim, &format!("{name}:indices"), time)?;
    let Some(Value::Integers(indices)) = indices.as_deref() else { return Ok(Some(values)) };
    let element = |&index: &i64| {
        let start = usize::try_from(index).ok()?.checked_mul(each)?;
        values.get(start..start.checked_add(each)?)
    };
    let picked: Option<Vec<&[T]>> = indices.iter().map(element).collect();
    Ok(picked.map(|picked| picked.concat()))
}

/// The attributes of a prim with curves.
struct Strands<'a, R> {
    layer: &'a Layer<R>,
    prim: &'a Prim,
    curves: &'a Curves,
    time: f64,
}

impl<R: Read + Seek> labels::Attributes for Strands<'_, R> {
    type Error = UsdError;

    fn integers<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[i64; N]>>, UsdError> {
        let value = self.layer.find(self.prim, name, self.time)?;
        let Some(Value::Integers(values)) = value.as_deref() else { return Ok(None) };
        let values = picked(self.layer, self.prim, name, values.clone(), N, self.time)?;
        Ok(values.and_then(|values| self.curves.labels(&values)))
    }

    fn floats<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[f32; N]>>, UsdError> {
        let values = primvar(self.layer, self.prim, name, N, self.time)?;
        Ok(values.and_then(|values| self.curves.labels(&values)))
    }

    fn invalid(&self, words: String) -> UsdError {
        invalid(format!("{}: {words}", self.layer.path(self.prim)))
    }
}

/// Root bindings as the writer stores them.
fn bindings<R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    curves: &Curves,
    time: f64,
) -> Result<Option<Vec<RootBinding>>, UsdError> {
    let [triangles, points, distances] = BINDING.map(|name| layer.find(prim, name, time));
    let (Some(triangles), Some(points), Some(distances)) = (triangles?, points?, distances?) else {
        return Ok(None);
    };
    let (Value::Integers(triangles), Some(points), Some(distances)) =
        (&*triangles, points.floats(), distances.floats())
    else {
        return Ok(None);
    };
    let points = points.as_chunks::<3>().0;
    if [triangles.len(), points.len(), distances.len()] != [curves.counts.len(); 3] {
        return Ok(None);
    }
    let binding = |((&triangle, &barycentric), &distance)| {
        Some(RootBinding { triangle: u32::try_from(triangle).ok()?, barycentric, distance })
    };
    Ok(triangles.iter().zip(points).zip(&distances).map(binding).collect())
}

/// Replaces the control points in `out`, which are also in `control`, by points of their curve.
fn on_curve(control: &[Vec3], basis: Basis, out: &mut [Vec3]) {
    match basis {
        Basis::Interpolating => {}
        Basis::BSpline => {
            for (p, w) in out.iter_mut().skip(1).zip(control.windows(3)) {
                *p = (w[0] + w[1] * 4.0 + w[2]) / 6.0;
            }
        }
        Basis::Bezier => {
            for start in (0..control.len().saturating_sub(3)).step_by(3) {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| control[start + i]);
                out[start + 1] = (a * 8.0 + b * 12.0 + c * 6.0 + d) / 27.0;
                out[start + 2] = (a + b * 6.0 + c * 12.0 + d * 8.0) / 27.0;
            }
        }
    }
}
