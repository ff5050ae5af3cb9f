//! Writing a groom: one `BasisCurves` prim, in metres, y up.

use std::fmt::Write;

use forelock_core::groom::Groom;
use glam::Vec3;

use super::{
    attributes::{self, Numbers, PARENT, PRIM, Written},
    crate_tables::{self, Attribute},
};

/// The text layer with `groom`, `.usda`.
pub fn write_text(groom: &Groom) -> Vec<u8> {
    let mut out = format!(
        "#usda 1.0\n(\n    defaultPrim = \"{PARENT}\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\n\
         def Xform \"{PARENT}\"\n{{\n    def BasisCurves \"{PRIM}\"\n    {{\n"
    );
    let points = |points: &[Vec3]| Numbers::Floats(3, bytemuck::cast_slice(points).to_vec());
    let extent = attributes::extent(groom.positions(), attributes::radius(groom));
    let own = [("points", "point3f", points(groom.positions())), ("extent", "float3", points(&extent))];
    let own = own.map(|(name, kind, numbers)| Written { name, kind, interpolation: None, numbers });
    for Written { name, kind, interpolation, numbers } in attributes::of(groom).iter().chain(&own) {
        out.push_str("        ");
        // Writing to a text does not fail.
        let _ = match numbers {
            Numbers::Word(word) => write!(out, "uniform {kind} {name} = \"{word}\""),
            Numbers::Integers(each, list) => {
                let _ = write!(out, "{kind}[] {name} = ");
                write_list(&mut out, *each, list, |out, n| write!(out, "{n}"));
                Ok(())
            }
            Numbers::Floats(each, list) => {
                let _ = write!(out, "{kind}[] {name} = ");
                write_list(&mut out, *each, list, |out, x| write_float(out, *x));
                Ok(())
            }
        };
        if let Some(interpolation) = interpolation {
            let _ = write!(out, " (\n            interpolation = \"{interpolation}\"\n        )");
        }
        out.push('\n');
    }
    out.push_str("    }\n}\n");
    out.into_bytes()
}

/// Writes `list`, whose elements are `each` numbers.
fn write_list<T>(
    out: &mut String,
    each: usize,
    list: &[T],
    write: impl Fn(&mut String, &T) -> std::fmt::Result,
) {
    out.push('[');
    let _ = if each == 1 {
        separated(out, list, write)
    } else {
        let elements: Vec<&[T]> = list.chunks_exact(each).collect();
        separated(out, &elements, |out, element| {
            out.push('(');
            separated(out, element, &write)?;
            out.write_char(')')
        })
    };
    out.push(']');
}

/// Writes `list` with commas between.
fn separated<T>(
    out: &mut String,
    list: &[T],
    write: impl Fn(&mut String, &T) -> std::fmt::Result,
) -> std::fmt::Result {
    for (index, element) in list.iter().enumerate() {
        if index > 0 {
            out.push_str(", ");
        }
        write(out, element)?;
    }
    Ok(())
}

/// Writes the shortest text that reads as `x` again.
fn write_float(out: &mut String, x: f32) -> std::fmt::Result {
    let size = x.abs();
    if x.is_nan() {
        out.write_str("nan")
    } else if x.is_finite() && size != 0.0 && !(1e-4..1e7).contains(&size) {
        write!(out, "{x:e}")
    } else {
        write!(out, "{x}")
    }
}

/// The binary layer with `groom`, `.usdc` and `.usd`.
pub fn write_binary(groom: &Groom) -> Vec<u8> {
    let mut out = crate_tables::start();
    let mut attributes: Vec<Attribute> =
        attributes::of(groom).iter().map(|written| Attribute::append(written, &mut out, 0)).collect();
    let extent = attributes::extent(groom.positions(), attributes::radius(groom));
    for (name, kind, points) in [("points", "point3f", groom.positions()), ("extent", "float3", &extent)] {
        let value = crate_tables::append_points(points, &mut out, 0);
        attributes.push(Attribute::new(name, kind, Some(value)));
    }
    let start = out.len() as u64;
    let tail = crate_tables::Tail::new(start, &attributes.iter().collect::<Vec<_>>(), None);
    out.extend(tail.bytes);
    crate_tables::set_contents(&mut out, tail.contents);
    out
}
