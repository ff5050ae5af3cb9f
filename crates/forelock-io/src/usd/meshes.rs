//! Meshes: `Mesh` prims, as a character.
//!
//! # Practice
//! All meshes of a layer become one body, with the transforms above them applied. What moves them
//! is found from their points at each sample (see `moving_mesh`). Polygons are those of the first
//! sample; `orientation = "leftHanded"` reverses their winding.
//!
//! # Limitations
//! Skeletons (`UsdSkel`) do not move what is read here: points must have samples. Subdivision
//! surfaces are read as their control polygons. Visibility and purpose are ignored.

use std::io::{Read, Seek};

use forelock_core::body::character::Character;
use forelock_core::groom::Import;
use glam::{DAffine3, Vec3};

use super::{
    Stage, UsdError, import, invalid, is_of_transform,
    layer::{Layer, Place, Prim, Value},
    open_layer, times, xform,
};
use crate::moving_mesh::{self, Meshes, MovingMesh, Order, Room};

const SCHEMA: &str = "Mesh";
/// The bytes that meshes may take in memory for each byte of the file.
const ROOM: u64 = 32;

/// Reads the meshes of a layer as a character, in the units and axes of the layer. Returns it, its
/// conversion to metres and y up if the user `asked` for the given one, and what was left out, one
/// sentence each.
///
/// # Errors
/// [`UsdError`] if it is no layer, or has no meshes.
pub fn read_character(
    reader: impl Read + Seek,
    asked: &Import,
) -> Result<(Character, Import, Vec<String>), UsdError> {
    let layer = open_layer(reader)?;
    let prims = layer.prims.iter().enumerate();
    let indices: Vec<usize> =
        prims.filter(|(_, prim)| &*prim.kind == SCHEMA).map(|(index, _)| index).collect();
    if indices.is_empty() {
        return Err(invalid(
            "it has no meshes; if other files hold them, make one of all with `usdcat --flatten`",
        ));
    }
    let Stage { metres_per_unit, is_z_up, codes_per_second } = Stage::of(&layer)?;
    let (mut meshes, mut left_out) = (Meshes::new(Room::new(layer.size, ROOM)), 0);
    for &index in &indices {
        let prim = &layer.prims[index];
        let mut codes = times(&layer, &[index], &|name| name == "points" || is_of_transform(name))?;
        if codes.len() < 2 {
            codes = vec![codes.first().copied().unwrap_or(0.0)];
        }
        let secs: Vec<f64> = codes.iter().map(|code| code / codes_per_second).collect();
        meshes.take(2 * size_of_val(&*codes)).map_err(invalid)?;
        let mut mesh = meshes.begin(layer.path(prim), &secs);
        let mut before = (None, Vec::new());
        for (sample, &code) in codes.iter().enumerate() {
            let world = DAffine3::from_mat4(xform::world_from(&layer, prim, code)?);
            before = points(&layer, prim, code, before)?;
            if sample == 0 && !before.1.is_empty() {
                left_out += add_polygons(&layer, prim, code, world.matrix3.determinant() < 0.0, &mut mesh)?;
            }
            mesh.push(&before.1, &world).map_err(invalid)?;
        }
        mesh.finish().map_err(invalid)?;
    }
    let mut notes: Vec<String> = moving_mesh::left_out(left_out).into_iter().collect();
    if layer.prims.iter().any(is_of_skeleton) {
        notes.push(
            "its skeletons and blend shapes are not read: export the points of its meshes at each frame \
             (in Blender, without armatures and shape keys)"
                .to_owned(),
        );
    }
    let character = meshes.finish().map_err(invalid)?;
    Ok((character, import(asked, metres_per_unit, is_z_up), notes))
}

/// Whether a prim belongs to what moves by `UsdSkel`.
fn is_of_skeleton(prim: &Prim) -> bool {
    let is_bound = |name: &str| name.starts_with("primvars:skel:") || name.starts_with("skel:");
    matches!(&*prim.kind, "Skeleton" | "BlendShape") || prim.attributes.keys().any(|name| is_bound(name))
}

/// Where points are in the layer, and the points.
type Points = (Option<Place>, Vec<Vec3>);

/// The points of `prim`: those `before`, if they are the same.
fn points<R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    code: f64,
    before: Points,
) -> Result<Points, UsdError> {
    let Some(attribute) = prim.attributes.get("points") else { return Ok((None, Vec::new())) };
    let Some(place) = layer.place(attribute, code)? else { return Ok((None, Vec::new())) };
    if let (Place::At(own), Some(Place::At(last))) = (&place, &before.0)
        && own.is_same(last)
    {
        return Ok(before);
    }
    drop(before);
    let floats = layer.value_at(&place)?.and_then(|value| value.floats()).unwrap_or_default();
    Ok((Some(place), floats.as_chunks::<3>().0.iter().map(|&p| p.into()).collect()))
}

/// Appends the triangles of `prim` to those of `mesh`, with the winding reversed if it is
/// mirrored; returns how many were left out.
fn add_polygons<R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    code: f64,
    is_mirrored: bool,
    mesh: &mut MovingMesh<'_>,
) -> Result<usize, UsdError> {
    let fail = |words: &str| invalid(format!("{} {words}", layer.path(prim)));
    let find = |name: &str| match layer.find(prim, name, code)?.as_deref() {
        Some(Value::Integers(numbers)) => Ok(numbers.clone()),
        _ => Err(fail(&format!("has no `{name}`"))),
    };
    let (counts, corners) = (find("faceVertexCounts")?, find("faceVertexIndices")?);
    let orientation = layer.find(prim, "orientation", code)?;
    let is_left_handed = orientation.as_ref().and_then(|own| own.word()) == Some("leftHanded");
    let order = Order { is_clockwise: is_left_handed != is_mirrored, is_backwards: false };
    mesh.add_polygons(&counts, &corners, order).map_err(invalid)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    const TEXT: &str = r#"#usda 1.0
(
    metersPerUnit = 0.01
    timeCodesPerSecond = 24
    upAxis = "Z"
)
def Xform "root"
{
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 5), 13: (0, 0, 7) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "body"
    {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
        uniform token orientation = "rightHanded"
        point3f[] points = [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0), (5, 5, 9)]
    }
}
"#;

    fn read(text: &str) -> Result<(Character, Import, Vec<String>), UsdError> {
        read_character(Cursor::new(text.to_owned()), &Import::default())
    }

    /// Transforms alone move a mesh, as a joint; hair below them has frames as well.
    #[test]
    fn a_mesh_that_transforms_move_has_a_joint() {
        let (own, import, notes) = read(TEXT).unwrap();
        assert!((import.scale - 0.01).abs() < 1e-9 && notes.is_empty());
        assert_eq!(own.bound().triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
        assert_eq!(own.rest().positions[4], Vec3::new(5.0, 5.0, 14.0));
        assert!(own.shapes().is_empty() && (own.clips()[0].duration_secs() - 0.5).abs() < 1e-12);
        let rest = own.skeleton().rest();
        let mut locals = rest.clone();
        own.clips()[0].sample(0.25, &mut locals, &mut []);
        let moved = locals[0].translation - rest[0].translation;
        assert!((moved.z - 1.0).abs() < 1e-6 && moved.truncate().length() < 1e-6, "{moved}");
        let hair = TEXT.replace("Mesh \"body\"", "BasisCurves \"hair\"").replace(
            "int[] faceVertexCounts = [4, 3]",
            "int[] curveVertexCounts = [5]\n        uniform token type = \"linear\"",
        );
        let layer = super::super::Usd::open(Cursor::new(hair)).unwrap();
        assert_eq!(layer.times_secs(), [1.0 / 24.0, 13.0 / 24.0]);
        assert_eq!(layer.frame(1).unwrap().strand(0)[0], Vec3::new(0.0, 0.0, 7.0));
    }

    #[test]
    fn left_handed_and_mirrored_meshes_are_turned_over() {
        let left = TEXT.replace("rightHanded", "leftHanded");
        assert_eq!(read(&left).unwrap().0.bound().triangles[2], [0, 4, 1]);
        let mirrored = left.replace("xformOp:translate", "xformOp:scale").replace("(0, 0, 5)", "(1, 1, -1)");
        let mirrored = mirrored.replace("(0, 0, 7)", "(1, 1, -1)");
        assert_eq!(read(&mirrored).unwrap().0.bound().triangles[2], [0, 1, 4]);
    }

    #[test]
    fn broken_meshes_are_refused() {
        for (from, to, words) in [
            ("Mesh", "Scope", "it has no meshes"),
            ("[4, 3]", "[4, 4]", "the mesh `/root/body` has polygons with more corners"),
            ("0, 1, 4]", "0, 1, -4]", "a corner that is no vertex"),
            ("0, 1, 4]", "0, 1, 5]", "a corner at vertex 5"),
            ("int[] faceVertexIndices", "int[] other", "has no `faceVertexIndices`"),
        ] {
            let error = read(&TEXT.replace(from, to)).map(|_| ()).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
