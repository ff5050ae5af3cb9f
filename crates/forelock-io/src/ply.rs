//! Strands as a Stanford `.ply` point cloud (NeuralHaircut and its successors; Turk 1994).
//!
//! # Theory
//! A text header lists elements with a count and typed properties; their values follow, as text or
//! binary, in the byte order that the header names. The element `vertex` has `x`, `y` and `z`, root
//! first, strand after strand. What divides them into strands is not part of the format:
//! NeuralHaircut writes 100 points a strand.
//!
//! # Practice
//! If there is an element `edge` with `vertex1` and `vertex2`, points that edges join are a strand.
//! Else each 100 points are one, or as many as a comment `points_per_strand 50` says. The writer
//! adds edges.
//!
//! # Limitations
//! Edges must join neighbouring points. All other elements and properties are ignored.

use forelock_core::groom::Groom;
use glam::Vec3;

use crate::bytes::Bytes;
use crate::error::FormatError;

/// Points of a strand where the file does not say.
const POINTS: usize = 100;
/// The longest header.
const HEADER: usize = 1 << 16;

/// How values are stored.
#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of little-endian `bytes`, of which there are eight.
    fn value(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }
}

struct Property {
    name: String,
    number: Number,
    /// The type of the number of values, if it is a list.
    count: Option<Number>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    points_per_strand: usize,
    /// Where the values begin.
    size: usize,
}

/// Reads the values after the header one by one.
struct Values<'a> {
    bytes: Bytes<'a>,
    text: &'a [u8],
    encoding: Encoding,
}

impl Values<'_> {
    fn next(&mut self, number: Number) -> Result<f64, FormatError> {
        if self.encoding == Encoding::Text {
            let start = self.text.trim_ascii_start();
            let end = start.iter().position(u8::is_ascii_whitespace).unwrap_or(start.len());
            let (word, rest) = start.split_at(end);
            self.text = rest;
            let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            return value.ok_or_else(|| match word {
                [] => self.bytes.invalid("the values end before the counts of the header"),
                _ => self.bytes.invalid(format!("`{}` is no number", String::from_utf8_lossy(word))),
            });
        }
        let mut own = [0; 8];
        let size = number.size();
        own[..size].copy_from_slice(self.bytes.take(1, size, "the values")?);
        if self.encoding == Encoding::Big {
            own[..size].reverse();
        }
        Ok(number.value(own))
    }
}

/// Reads the groom in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if it is no PLY file, has no vertices, is cut short, or does not tell strands
/// apart.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    let start = Bytes::new(bytes, ".ply");
    let header = header(bytes).map_err(|problem| start.invalid(problem))?;
    let mut values = Values {
        bytes: start.at(header.size as u64),
        text: bytes.get(header.size..).unwrap_or_default(),
        encoding: header.encoding,
    };
    let (mut points, mut edges) = (Vec::new(), Vec::new());
    let mut has_edges = false;
    for element in &header.elements {
        let place = |name: &str| element.properties.iter().position(|own| own.name == name);
        let (is_points, is_edges) = (element.name == "vertex", element.name == "edge");
        let xyz = [place("x"), place("y"), place("z")];
        let ends = [place("vertex1"), place("vertex2")];
        if is_points && xyz.contains(&None) {
            return Err(start.invalid("its vertices have no x, y and z"));
        }
        // An element without properties has no values, whatever its count.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        has_edges |= is_edges && count > 0 && !ends.contains(&None);
        let mut row = vec![0.0; element.properties.len()];
        for _ in 0..count {
            for (value, property) in row.iter_mut().zip(&element.properties) {
                *value = match property.count {
                    None => values.next(property.number)?,
                    Some(count) => {
                        let count = values.next(count)?;
                        for _ in 0..count as u64 {
                            values.next(property.number)?;
                        }
                        count
                    }
                };
            }
            let at = |place: Option<usize>| place.map_or(0.0, |place| row[place]);
            if is_points {
                points.push(Vec3::from_array(xyz.map(|place| at(place) as f32)));
            } else if is_edges {
                edges.push(ends.map(at));
            }
        }
    }
    let offsets = if has_edges { by_edges(points.len(), &edges) } else { evenly(points.len(), &header) };
    let offsets = offsets.map_err(|problem| start.invalid(problem))?;
    Groom::new(points, offsets).map_err(|error| start.error(error.into()))
}

/// Strands of points that edges join.
fn by_edges(points: usize, edges: &[[f64; 2]]) -> Result<Vec<u32>, String> {
    let mut joins = vec![false; points];
    for &[a, b] in edges {
        let (low, high) = (a.min(b), a.max(b));
        if high - low != 1.0 || low < 0.0 || high >= points as f64 {
            return Err(format!("an edge joins the points {a} and {b}, which do not follow each other"));
        }
        joins[high as usize] = true;
    }
    let begins = joins.iter().enumerate().filter(|(_, joins)| !**joins).map(|(point, _)| point);
    begins.chain([points]).map(|point| u32::try_from(point).map_err(|_| too_many())).collect()
}

/// Strands of equal numbers of points.
fn evenly(points: usize, header: &Header) -> Result<Vec<u32>, String> {
    let each = header.points_per_strand;
    if !points.is_multiple_of(each) {
        return Err(format!(
            "{points} points are no whole number of strands of {each}, and there are no edges: add the line \
             `comment points_per_strand N` to its header"
        ));
    }
    (0..=points / each).map(|strand| u32::try_from(strand * each).map_err(|_| too_many())).collect()
}

fn too_many() -> String {
    "over 4,294,967,295 points".into()
}

fn header(bytes: &[u8]) -> Result<Header, String> {
    let mut lines = bytes[..bytes.len().min(HEADER)].split_inclusive(|byte| *byte == b'\n');
    let mut header =
        Header { encoding: Encoding::Text, elements: Vec::new(), points_per_strand: POINTS, size: 0 };
    let mut has_format = false;
    for number in 0.. {
        let line = lines.next().ok_or("its header has no `end_header`")?;
        header.size += line.len();
        let text = String::from_utf8_lossy(line);
        let words: Vec<&str> = text.split_whitespace().collect();
        match (number, &words[..]) {
            (0, ["ply"]) => {}
            (0, _) => return Err("it does not begin with `ply`".into()),
            (_, ["format", encoding, _]) => {
                has_format = true;
                header.encoding = match *encoding {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    other => return Err(format!("the format `{other}` is not known")),
                };
            }
            (_, ["comment", "points_per_strand", each]) => {
                let each = each.parse().ok().filter(|each| *each >= 1);
                header.points_per_strand = each.ok_or("`points_per_strand` takes a number of at least 1")?;
            }
            (_, ["comment" | "obj_info", ..]) => {}
            (_, ["element", name, count]) => {
                let count = count.parse().map_err(|_| format!("`{count}` is no number of elements"))?;
                header.elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
            }
            (_, ["property", words @ ..]) => {
                let element = header.elements.last_mut().ok_or("a property comes before all elements")?;
                element.properties.push(property(words)?);
            }
            (_, ["end_header"]) if has_format => return Ok(header),
            (_, ["end_header"]) => return Err("its header names no format".into()),
            (_, []) => {}
            (_, [word, ..]) => return Err(format!("its header has a line that begins with `{word}`")),
        }
    }
    Err("its header has no end".into())
}

fn property(words: &[&str]) -> Result<Property, String> {
    let number = |name: &str| Number::named(name).ok_or_else(|| format!("the type `{name}` is not known"));
    match words {
        ["list", count, own, name] => {
            Ok(Property { name: (*name).into(), number: number(own)?, count: Some(number(count)?) })
        }
        [own, name] => Ok(Property { name: (*name).into(), number: number(own)?, count: None }),
        _ => Err("a property has no type and name".into()),
    }
}

/// The bytes of a `.ply` file, binary, with the strands of `groom` and their edges. Attributes and
/// strands without points are not written.
///
/// # Errors
/// A message if there are more than 2³¹ − 1 points.
pub fn write(groom: &Groom) -> Result<Vec<u8>, String> {
    let points = groom.particle_count();
    if i32::try_from(points).is_err() {
        return Err("over 2,147,483,647 points, the limit of .ply".into());
    }
    let edges = groom.strands().map(|strand| strand.len().saturating_sub(1)).sum::<usize>();
    // Without edges the header has to say where strands end.
    let each = if edges == 0 { "comment points_per_strand 1\n" } else { "" };
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment strands by forelock: root first, in metres, y up\n{each}\
         element vertex {points}\nproperty float x\nproperty float y\nproperty float z\n\
         element edge {edges}\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    );
    let mut out = Vec::with_capacity(header.len() + 12 * points + 8 * edges);
    out.extend_from_slice(header.as_bytes());
    out.extend_from_slice(bytemuck::cast_slice(groom.positions()));
    for range in groom.strand_offsets().windows(2) {
        for point in range[0] + 1..range[1] {
            out.extend_from_slice(bytemuck::cast_slice(&[point - 1, point]));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_big_endian_are_read_with_what_else_they_hold() {
        let text = "ply\r\nformat ascii 1.0\ncomment points_per_strand 2\nelement vertex 4\n\
                    property uchar red\nproperty float x\nproperty double y\nproperty float z\n\
                    element face 1\nproperty list uchar int vertex_indices\nend_header\n\
                    255 0 0 0\n0 1 2 3\n7 4 5 6\n1 7 8 9.5\n3 0 1 2\n";
        let groom = read(text.as_bytes()).unwrap();
        assert_eq!(groom.strand_offsets(), [0, 2, 4]);
        assert_eq!(groom.positions()[3], Vec3::new(7.0, 8.0, 9.5));
        let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 100\nproperty float x\n\
                          property short y\nproperty float z\nend_header\n"
            .to_vec();
        for point in 0..100_u8 {
            bytes.extend(f32::from(point).to_be_bytes());
            bytes.extend((-i16::from(point)).to_be_bytes());
            bytes.extend(0.5_f32.to_be_bytes());
        }
        let groom = read(&bytes).unwrap();
        assert_eq!((groom.strand_count(), groom.positions()[7]), (1, Vec3::new(7.0, -7.0, 0.5)));
    }

    #[test]
    fn strands_of_different_lengths_come_back() {
        let line = |n: u16| (0..n).map(|i| Vec3::new(f32::from(n), f32::from(i), 0.1)).collect::<Vec<_>>();
        for counts in [vec![2, 7, 3], vec![1, 3, 1], vec![1], vec![1; 5], vec![]] {
            let groom = Groom::from_strands(counts.into_iter().map(line)).unwrap();
            assert_eq!(read(&write(&groom).unwrap()).unwrap(), groom);
        }
    }

    #[test]
    fn each_fault_gets_its_message() {
        let ascii = |rest: &str| format!("ply\nformat ascii 1.0\n{rest}");
        let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let points = "0 0 0 1 1 1 2 2 2\n";
        let edge = "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n";
        for (text, words) in [
            ("pny\n".to_owned(), "`ply`"),
            ("ply\nelement vertex 3\n".to_owned(), "end_header"),
            ("ply\nend_header\n".to_owned(), "names no format"),
            (ascii(&format!("{vertices}end_header\n{points}")), "points_per_strand"),
            (ascii(&format!("{vertices}end_header\n0 0 0 1")), "end before"),
            (ascii(&format!("{vertices}end_header\n0 0 zero")), "`zero`"),
            (ascii("element vertex 3\nproperty float x\nend_header\n0 1 2"), "no x, y and z"),
            (ascii(&format!("{vertices}{edge}{points}0 2")), "do not follow"),
            (ascii(&format!("{vertices}{edge}{points}0 9")), "do not follow"),
            (
                ascii(
                    "element vertex 99999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n1",
                ),
                "end before",
            ),
            (ascii("property float x\n"), "before all elements"),
            (ascii("element vertex 1\nproperty real x\n"), "`real`"),
        ] {
            let error = read(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
