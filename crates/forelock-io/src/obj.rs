//! Wavefront OBJ: meshes, and grooms as polylines.
//!
//! # Theory
//! The file is text with one element per line: vertices `v x y z`, faces `f a b c …` and polylines
//! `l a b …`. The entries of faces and polylines are vertex indices. They count from 1 (negative
//! indices count backwards from −1) and may be followed by `/texture/normal`.
//!
//! # Practice
//! A face with more than three corners is triangulated as a fan. All objects and groups of a file
//! are one mesh. A polyline is a strand, root first. A polyline that starts at the last vertex of
//! the previous one continues that strand, since some programs write a curve as many short lines.
//!
//! # Limitations
//! Texture coordinates, normals and materials are discarded. The fan of a concave face may overlap
//! itself.

use std::fmt::Write;

use forelock_core::{
    body::TriMesh,
    groom::{Groom, GroomError},
};
use glam::Vec3;

use crate::error::{FormatError, Problem};

/// The elements of a file.
#[derive(Default)]
struct Elements {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// The vertex indices of all strands, and where each strand ends in them.
    strand_points: Vec<u32>,
    strand_ends: Vec<usize>,
    /// The largest index, and its place in the file.
    largest: Option<(u32, Place)>,
}

#[derive(Clone, Copy)]
struct Place {
    line: usize,
    offset: usize,
}

impl Place {
    fn invalid(self, words: impl std::fmt::Display) -> FormatError {
        let problem = Problem::Invalid(format!("line {}: {words}", self.line));
        FormatError { format: "OBJ", offset: self.offset as u64, strand: None, problem }
    }
}

/// Reads the mesh in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if a line is malformed, an index is out of range, a vertex is not finite, or
/// there is no face.
pub fn read_mesh(bytes: &[u8]) -> Result<TriMesh, FormatError> {
    let elements = parse(bytes)?;
    TriMesh::new(elements.positions, elements.triangles).map_err(|e| whole(e.into()))
}

/// Reads the polylines in `bytes` as strands. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if a line is malformed, an index is out of range, or there is no polyline.
pub fn read_groom(bytes: &[u8]) -> Result<Groom, FormatError> {
    let elements = parse(bytes)?;
    if elements.strand_ends.is_empty() {
        let words = "it has no polyline (`l`), so no strand; is it a mesh? Export the hair as curves or \
                     polylines";
        return Err(whole(Problem::Invalid(words.into())));
    }
    let points = elements.strand_points.iter().map(|&i| elements.positions[i as usize]).collect();
    // `Groom::new` refuses more points than 32 bits can count.
    let offsets = std::iter::once(0).chain(elements.strand_ends.iter().map(|&end| end as u32)).collect();
    Groom::new(points, offsets).map_err(|e: GroomError| whole(e.into()))
}

/// An error that concerns the whole file.
fn whole(problem: Problem) -> FormatError {
    FormatError { format: "OBJ", offset: 0, strand: None, problem }
}

fn parse(bytes: &[u8]) -> Result<Elements, FormatError> {
    let mut elements = Elements::default();
    let mut place = Place { line: 0, offset: 0 };
    for line in bytes.split(|&b| b == b'\n') {
        place.line += 1;
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => elements.positions.push(vertex(words, place)?),
            Some(b"f") => {
                let corners = elements.indices(words, place)?;
                let [first, rest @ ..] = corners.as_slice() else { return Err(too_short(place)) };
                if rest.len() < 2 {
                    return Err(too_short(place));
                }
                elements.triangles.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
            }
            Some(b"l") => {
                let line = elements.indices(words, place)?;
                let start = elements.strand_ends.len().checked_sub(2).map_or(0, |s| elements.strand_ends[s]);
                let last = elements.strand_points.get(start..).and_then(<[u32]>::last);
                if line.len() > 1 && last == line.first() {
                    elements.strand_points.extend(&line[1..]);
                    elements.strand_ends.pop();
                } else {
                    elements.strand_points.extend(&line);
                }
                elements.strand_ends.push(elements.strand_points.len());
            }
            _ => {}
        }
        place.offset += line.len() + 1;
    }
    match elements.largest {
        Some((index, place)) if index as usize >= elements.positions.len() => {
            Err(place.invalid(format_args!(
                "it names vertex {}, but the file has {}; is it cut short?",
                u64::from(index) + 1,
                elements.positions.len()
            )))
        }
        _ => Ok(elements),
    }
}

fn too_short(place: Place) -> FormatError {
    place.invalid("a face needs at least three corners")
}

fn number<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn vertex<'a>(words: impl Iterator<Item = &'a [u8]>, place: Place) -> Result<Vec3, FormatError> {
    let mut xyz = words.map(number::<f32>);
    let mut next =
        || xyz.next().flatten().ok_or_else(|| place.invalid("a vertex needs three numbers after `v`"));
    Ok(Vec3::new(next()?, next()?, next()?))
}

impl Elements {
    /// The vertex indices of a line, counted from 0. Their vertices may follow later in the file.
    fn indices<'a>(
        &mut self,
        words: impl Iterator<Item = &'a [u8]>,
        place: Place,
    ) -> Result<Vec<u32>, FormatError> {
        let mut indices = Vec::new();
        for word in words {
            let written = word.split(|&b| b == b'/').next().and_then(number::<i64>);
            let index = match written {
                Some(i) if i > 0 => u32::try_from(i - 1).ok(),
                Some(i) if i < 0 => {
                    i.checked_add_unsigned(self.positions.len() as u64).and_then(|i| i.try_into().ok())
                }
                _ => None,
            };
            let Some(index) = index else {
                let word = String::from_utf8_lossy(&word[..word.len().min(30)]);
                return Err(place.invalid(format_args!(
                    "`{word}` is no index of a vertex (1 is the first vertex, −1 the last)"
                )));
            };
            if self.largest.is_none_or(|(largest, _)| index > largest) {
                self.largest = Some((index, place));
            }
            indices.push(index);
        }
        Ok(indices)
    }
}

/// The text of an OBJ file with `mesh`. Each number has as few digits as give the same float32 when
/// read.
pub fn write_mesh(mesh: &TriMesh) -> Vec<u8> {
    let mut text = String::new();
    write_vertices(&mut text, &mesh.positions);
    for [a, b, c] in &mesh.triangles {
        let one_based = [a, b, c].map(|&i| u64::from(i) + 1);
        line(&mut text, format_args!("f {} {} {}", one_based[0], one_based[1], one_based[2]));
    }
    text.into_bytes()
}

/// The text of an OBJ file with the strands of `groom` as polylines. The format has no attributes.
pub fn write_groom(groom: &Groom) -> Vec<u8> {
    let mut text = String::new();
    write_vertices(&mut text, groom.positions());
    for strand in 0..groom.strand_count() {
        let indices: Vec<String> = groom.range(strand).map(|i| (i + 1).to_string()).collect();
        line(&mut text, format_args!("l {}", indices.join(" ")));
    }
    text.into_bytes()
}

fn write_vertices(text: &mut String, positions: &[Vec3]) {
    for p in positions {
        line(text, format_args!("v {} {} {}", p.x, p.y, p.z));
    }
}

fn line(text: &mut String, words: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{words}");
}
