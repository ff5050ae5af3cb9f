//! Writing of hair: strands as lines, in metres, y up.
//!
//! # Theory
//! The file has one mesh with one primitive of LINES: two indices an edge (glTF 2.0, §3.7.2). Its
//! attributes are `POSITION`, and those that the groom has: `COLOR_0` (linear RGB), `TEXCOORD_0`
//! (the root's coordinates at each particle) and `_WIDTH` (metres). Frames are morph targets
//! (§3.7.2.2): the mesh is frame 0, target f − 1 holds the displacements of frame f from it, and an
//! animation raises its weight to 1 at the time of the frame and to 0 at those beside. Between two
//! frames, positions are linear in time.
//!
//! # Practice
//! [`write_binary`] makes a `.glb`, [`write_text`] a `.gltf` whose buffer is a data URI.
//! [`LinesWriter`](super::LinesWriter) writes frames one by one.
//!
//! # Limitations
//! Transparencies, pins, stiffness, root bindings and labels are not written. Lines are a pixel
//! wide in most programs, whatever `_WIDTH` says. The weights of F frames take 4 F² bytes.

use std::io::{self, Write};

use base64::Engine as _;
use forelock_core::groom::Groom;
use glam::Vec3;
use serde_json::{Value, json};

/// The types of components, and what a view is for, by their numbers in the format.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// The mode LINES.
const LINES: u32 = 1;
/// The name of the mesh, its node and its animation.
const NAME: &str = "hair";
/// Bytes of the file's header with that of the first chunk, and of the header of the second.
const HEADS: [usize; 2] = [20, 8];
/// The most that a number of a bound takes in the text.
const NUMBER_BYTES: usize = 27;

/// An accessor; its numbers lie behind those of the one before, 4 bytes each.
struct Part {
    kind: &'static str,
    component: u32,
    count: usize,
    purpose: Option<u32>,
}

impl Part {
    fn floats(kind: &'static str, count: usize, purpose: Option<u32>) -> Self {
        Self { kind, component: FLOAT, count, purpose }
    }

    fn bytes(&self) -> u64 {
        let width = match self.kind {
            "VEC3" => 3,
            "VEC2" => 2,
            _ => 1,
        };
        (self.count as u64).saturating_mul(4 * width)
    }
}

/// What lies where in a file.
pub(super) struct Layout {
    /// The indices, the attributes, the times and weights, and the positions of each frame.
    parts: Vec<Part>,
    /// The names of the attributes, which are the parts from 1 on.
    names: Vec<&'static str>,
    /// The times of the frames in seconds; none of a groom at rest.
    times: Vec<f32>,
    pub particles: usize,
    /// The number of frames, 1 or more.
    pub frames: usize,
}

impl Layout {
    /// That of a file with the strands and attributes of `groom`, and frames at `times`.
    ///
    /// # Errors
    /// A message if the groom has no edge, or an attribute that does not match it or is not finite.
    pub fn new(groom: &Groom, times: Vec<f32>) -> Result<Self, String> {
        groom.check_attributes().map_err(|error| error.to_string())?;
        let edges: usize = groom.strands().map(|strand| strand.len().saturating_sub(1)).sum();
        if edges == 0 {
            return Err("there are no edges to write".into());
        }
        let particles = groom.particle_count();
        let indices = Part {
            kind: "SCALAR",
            component: UNSIGNED_INT,
            count: 2 * edges,
            purpose: Some(ELEMENT_ARRAY_BUFFER),
        };
        let (mut parts, mut names) = (vec![indices], Vec::new());
        for (name, kind, numbers) in attributes(groom) {
            if numbers.iter().any(|x| !x.is_finite()) {
                return Err(format!("{name} has a number that is not finite, which glTF forbids"));
            }
            names.push(name);
            parts.push(Part::floats(kind, particles, Some(ARRAY_BUFFER)));
        }
        let frames = times.len().max(1);
        if frames > 1 {
            let weights = frames.saturating_mul(frames - 1);
            parts.extend([frames, weights].map(|count| Part::floats("SCALAR", count, None)));
        }
        parts.extend((0..frames).map(|_| Part::floats("VEC3", particles, Some(ARRAY_BUFFER))));
        Ok(Self { parts, names, times, particles, frames })
    }

    /// The bytes of all numbers.
    fn bytes(&self) -> u64 {
        self.parts.iter().fold(0, |sum, part| sum.saturating_add(part.bytes()))
    }

    /// Writes what lies before the positions.
    pub fn write_constants(&self, groom: &Groom, out: &mut dyn Write) -> io::Result<()> {
        for strand in 0..groom.strand_count() {
            // Offsets are 32 bits wide.
            let particles: Vec<u32> = groom.range(strand).map(|particle| particle as u32).collect();
            particles.windows(2).try_for_each(|edge| out.write_all(bytemuck::cast_slice(edge)))?;
        }
        for (_, _, numbers) in attributes(groom) {
            out.write_all(bytemuck::cast_slice(&numbers))?;
        }
        if self.frames > 1 {
            out.write_all(bytemuck::cast_slice(&self.times))?;
            let mut weights = vec![0.0f32; self.frames - 1];
            for frame in 0..self.frames {
                weights.fill(0.0);
                if let Some(target) = frame.checked_sub(1) {
                    weights[target] = 1.0;
                }
                out.write_all(bytemuck::cast_slice(&weights))?;
            }
        }
        Ok(())
    }

    /// The text of a file whose positions and displacements have `bounds`, a pair for each frame,
    /// with the buffer at `uri`, or in the file.
    fn text(&self, bounds: &[[Vec3; 2]], uri: Option<String>) -> String {
        let first = self.parts.len() - self.frames;
        let (mut accessors, mut views, mut offset) = (Vec::new(), Vec::new(), 0);
        for (index, part) in self.parts.iter().enumerate() {
            let mut accessor = json!({ "bufferView": index, "componentType": part.component,
                "count": part.count, "type": part.kind });
            // Numbers of float32 are written in float64: exactly.
            if let Some([min, max]) = index.checked_sub(first).and_then(|frame| bounds.get(frame)) {
                accessor["min"] = json!(min.as_dvec3().to_array());
                accessor["max"] = json!(max.as_dvec3().to_array());
            } else if let (Some(start), Some(end)) = (self.times.first(), self.times.last())
                && index == self.names.len() + 1
            {
                accessor["min"] = json!([f64::from(*start)]);
                accessor["max"] = json!([f64::from(*end)]);
            }
            accessors.push(accessor);
            let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": part.bytes() });
            if let Some(purpose) = part.purpose {
                view["target"] = json!(purpose);
            }
            views.push(view);
            offset += part.bytes();
        }
        let mut attributes = json!({ "POSITION": first });
        for (index, name) in self.names.iter().enumerate() {
            attributes[name] = json!(index + 1);
        }
        let mut primitive = json!({ "mode": LINES, "indices": 0, "attributes": attributes });
        let mut buffer = json!({ "byteLength": offset });
        if let Some(uri) = uri {
            buffer["uri"] = Value::String(uri);
        }
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "Forelock" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": NAME, "mesh": 0 }],
            "buffers": [buffer],
            "bufferViews": views,
            "accessors": accessors,
        });
        if self.frames > 1 {
            let targets: Vec<Value> =
                (first + 1..self.parts.len()).map(|part| json!({ "POSITION": part })).collect();
            primitive["targets"] = Value::Array(targets);
            let (input, output) = (self.names.len() + 1, self.names.len() + 2);
            root["animations"] = json!([{
                "name": NAME,
                "samplers": [{ "input": input, "output": output, "interpolation": "LINEAR" }],
                "channels": [{ "sampler": 0, "target": { "node": 0, "path": "weights" } }],
            }]);
        }
        root["meshes"] = json!([{ "name": NAME, "primitives": [primitive] }]);
        root.to_string()
    }

    /// The bytes that the text takes at most, whatever the bounds.
    pub fn reserve(&self) -> usize {
        let numbers = 6 * self.frames;
        (self.text(&vec![[Vec3::ZERO; 2]; self.frames], None).len() + NUMBER_BYTES * numbers)
            .next_multiple_of(4)
    }

    /// The beginning of a `.glb`, up to the numbers: the headers, and the text with `bounds`,
    /// filled up with spaces to `reserved` bytes, which is a multiple of 4.
    ///
    /// # Errors
    /// A message if the file would exceed 4 GiB.
    pub fn start(&self, bounds: &[[Vec3; 2]], reserved: usize) -> Result<Vec<u8>, String> {
        let numbers = self.bytes();
        let total = numbers.saturating_add((HEADS[0] + reserved + HEADS[1]) as u64);
        let (Ok(total), Ok(numbers)) = (u32::try_from(total), u32::try_from(numbers)) else {
            let (frames, particles) = (self.frames, self.particles);
            return Err(format!(
                "{frames} frames of {particles} particles take {total} bytes in a .glb, whose limit is \
                 4,294,967,295; write fewer frames or strands, or another format, such as .abc or .usdc"
            ));
        };
        let mut out = Vec::with_capacity(HEADS[0] + reserved + HEADS[1]);
        out.extend(b"glTF");
        // The text is shorter than the file, whose size fits.
        out.extend([2, total, reserved as u32].iter().flat_map(|number| number.to_le_bytes()));
        out.extend(b"JSON");
        out.extend(self.text(bounds, None).bytes());
        out.resize(HEADS[0] + reserved, b' ');
        out.extend(numbers.to_le_bytes());
        out.extend(b"BIN\0");
        Ok(out)
    }
}

/// The attributes that `groom` has beside its positions: names, types and numbers.
fn attributes(groom: &Groom) -> Vec<(&'static str, &'static str, Vec<f32>)> {
    let mut found = Vec::new();
    if let Some(colours) = &groom.colours {
        found.push(("COLOR_0", "VEC3", colours.as_flattened().to_vec()));
    }
    if let Some(uvs) = &groom.root_uvs {
        // v runs downwards in glTF, upwards in Alembic and USD.
        let uv = |strand: usize| [uvs[strand][0], 1.0 - uvs[strand][1]];
        let each = |strand: usize| std::iter::repeat_n(uv(strand), groom.range(strand).len());
        let all: Vec<[f32; 2]> = (0..groom.strand_count()).flat_map(each).collect();
        found.push(("TEXCOORD_0", "VEC2", all.into_flattened()));
    }
    if let Some(widths) = &groom.widths {
        found.push(("_WIDTH", "SCALAR", widths.clone()));
    }
    found
}

/// The smallest box around `points`.
///
/// # Errors
/// A message if a point is not finite.
pub(super) fn bounds(points: &[Vec3]) -> Result<[Vec3; 2], String> {
    if let Some(particle) = points.iter().position(|point| !point.is_finite()) {
        return Err(format!("particle {particle} has a position that is not finite, which glTF forbids"));
    }
    let widen = |[min, max]: [Vec3; 2], point: &Vec3| [min.min(*point), max.max(*point)];
    Ok(points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], widen))
}

/// The bytes of a `.glb` with `groom`.
///
/// # Errors
/// A message if the groom has no edge, an attribute that does not match it, a number that is not
/// finite, or would exceed 4 GiB.
pub fn write_binary(groom: &Groom) -> Result<Vec<u8>, String> {
    let layout = Layout::new(groom, Vec::new())?;
    let bounds = [bounds(groom.positions())?];
    let reserved = layout.text(&bounds, None).len().next_multiple_of(4);
    let mut out = layout.start(&bounds, reserved)?;
    append_numbers(&layout, groom, &mut out);
    Ok(out)
}

/// The text of a `.gltf` with `groom`, its numbers in base 64.
///
/// # Errors
/// As of [`write_binary`], but the size has no limit.
pub fn write_text(groom: &Groom) -> Result<Vec<u8>, String> {
    let layout = Layout::new(groom, Vec::new())?;
    let bounds = [bounds(groom.positions())?];
    let mut numbers = Vec::new();
    append_numbers(&layout, groom, &mut numbers);
    let numbers = base64::engine::general_purpose::STANDARD.encode(numbers);
    let uri = format!("data:application/octet-stream;base64,{numbers}");
    Ok(layout.text(&bounds, Some(uri)).into_bytes())
}

fn append_numbers(layout: &Layout, groom: &Groom, out: &mut Vec<u8>) {
    // A vector takes all bytes.
    let _ = layout.write_constants(groom, out);
    out.extend_from_slice(bytemuck::cast_slice(groom.positions()));
}
